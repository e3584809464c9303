"""Fine alignment: run the filter over a stationary record, with zero velocity and a fixed position as fixes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from insnav import strapdown
from insnav.alignment import align_static
from insnav.alignment.align import THEN_FILTER
from insnav.alignment.static import latitude_from_sensors, summarize, unexplained_rate
from insnav.exceptions import AlignmentError
from insnav.filter.error_model import Part, error_model, initial_state
from insnav.filter.filter_input import FilterInput, Output
from insnav.filter.measurements.sensors import VELOCITY_SD
from insnav.filter.navigator import Navigator
from insnav.findings import Code
from insnav.imu.specification import ImuSpec
from insnav.types import Alignment, FloatArray, GpsData, ImuData

POSITION_SD = 0.1  # position sd of a stationary vehicle, moved by wind and people [m]
INTERVAL = 1.0  # time between zero-velocity updates: vehicle motion over less time is correlated [s]
COARSE_SHARE, COARSE_TIME = 0.1, 10.0  # length of the first, coarse alignment: share of the record, and least [s]


@dataclass(frozen=True, slots=True)
class FineAlignment:
    """Alignment of a stationary record."""

    coarse: Alignment  # alignment from the means of the whole record
    fine: Alignment | None  # alignment by the filter, at the end; None without observable Earth rotation
    sensor_latitude: float  # latitude from the sensors alone [rad]
    latitude: float  # specified latitude [rad]


def fine_alignment(
    imu: ImuData, spec: ImuSpec, lla: FloatArray, rest: tuple[float, float], heading: float | None = None
) -> FineAlignment:
    """Align a stationary record: coarse from the means of the samples, then fine with the filter.

    `lla` (3,): latitude, longitude [rad], height [m]. `rest`: stationary interval [s]. `heading`: given heading [rad].
    Raises: AlignmentError: fewer than ten samples in the interval.
    """
    inside = (imu.time >= rest[0]) & (imu.time <= rest[1])
    if inside.sum() < 10:
        raise AlignmentError(
            "align.static_outside",
            samples_s=(float(imu.time[0]), float(imu.time[-1])),
            static_s=(float(rest[0]), float(rest[1])),
        )
    imu = imu.rows(inside)
    parts = strapdown.intervals(imu)
    begin, end = float(parts.end[0] - parts.dt[0]), float(parts.end[-1])
    coarse = align_static(parts, spec, float(lla[0]), float(lla[2]), (begin, end), heading)
    means = summarize(parts, begin, end)
    latitude = latitude_from_sensors(means)
    if not np.isfinite(coarse.sd[2]) or unexplained_rate(means, spec, float(lla[0])) > 0.0:
        return FineAlignment(coarse, None, latitude, float(lla[0]))
    # the first part gives the initial attitude of the filter, which then uses only later samples in records over 20 s
    first = min(end, begin + max(COARSE_TIME, COARSE_SHARE * (end - begin)))
    start = align_static(parts, spec, float(lla[0]), float(lla[2]), (begin, first), heading)
    if not np.isfinite(start.sd[2]):
        start = coarse
    start = replace(start, time=first if first < end - COARSE_TIME else begin)
    n = int((end - start.time) / INTERVAL)
    if n < 2:
        return FineAlignment(coarse, None, latitude, float(lla[0]))
    time = np.asarray(start.time + INTERVAL * np.arange(1, n + 1), dtype=float)
    still = GpsData(
        time, np.tile(lla, (n, 1)), np.zeros((n, 3)), np.full((n, 3), POSITION_SD), np.full((n, 3), VELOCITY_SD)
    )
    model = error_model(spec, 15)  # scale factors are not observable while stationary
    initial = initial_state(start, model, lla, np.zeros(3), np.full(3, POSITION_SD), np.full(3, VELOCITY_SD))
    starts, nominal = (Part(begin, start, initial),), strapdown.nominal_interval(imu.time)
    navigator = Navigator(FilterInput(imu, still, model, starts, nominal, output=Output(1.0)))
    navigator.feed(imu)
    run = navigator.finish()
    solution = run.solution
    assert solution.sd is not None
    bias, bias_sd = run.sensor_errors.value[-1, :3], run.sensor_errors.sd[-1, :3]
    fine = replace(
        coarse,
        time=float(solution.time[-1]),
        rph=solution.rph[-1],
        sd=solution.sd[-1, 6:],
        gyro_bias=bias,
        gyro_bias_sd=bias_sd,
        level_method=Code.ALIGN_LEVEL_FILTER,
        heading_method=THEN_FILTER[Code(start.heading_method)],
    )
    return FineAlignment(coarse, fine, latitude, float(lla[0]))
