"""Errors without GPS: in outages, where everything else that helps may help, and by the IMU alone."""

from __future__ import annotations

import numpy as np

from insnav import strapdown
from insnav.earth import lla_offset, ned_offset
from insnav.errors.outage.gnss_outage import outages
from insnav.exceptions import InputError
from insnav.filter.navigate import Navigated, aided
from insnav.filter.prepare import prepare
from insnav.imu import ImuErrors, correct
from insnav.regression.accuracy_metrics import FREE, OUTAGES
from insnav.regression.cases import Material
from insnav.types import FloatArray, ImuData, Increments, SensorErrors, Trajectory

GROWTH = (5.0, 10.0, 20.0, 30.0, 45.0, 60.0)  # times without GPS at which the error is kept [s]
_WINDOWS = 20  # at most, in a recording
_NEAR = 1.5  # a fix so near to one of these times stands for it [s]
_LEAD = 1.0  # samples before and after a window, for the polynomials at its ends [s]


def without_gps(material: Material) -> tuple[dict[str, FloatArray], FloatArray]:
    """Horizontal error after some time without fixes, and how it grew.

    Parameters
    ----------
    material : Material

    Returns
    -------
    values : dict of str to array
        Metrics; none if the recording is too short.
    growth : (6, 3) array
        At each of `GROWTH` the number of windows, the sum of squared errors [m^2], and of predicted variances [m^2].
    """
    growth = np.zeros((len(GROWTH), 3))
    ready = aided(prepare(material.imu, material.gps, material.spec, material.settings), material.spec)
    longest = max(OUTAGES)
    spacing = max(longest, float(material.imu.time[-1] - material.imu.time[0]) / _WINDOWS)
    try:
        windows = outages(ready, lengths=(longest,), spacing=spacing, truth=material.exact)
    except InputError:
        return {}, growth
    error, sd = np.full((2, len(windows), len(GROWTH)), np.nan)
    for row, window in enumerate(windows):
        for column, wanted in enumerate(GROWTH):
            at = int(np.argmin(np.abs(window.elapsed - wanted)))
            if abs(window.elapsed[at] - wanted) < _NEAR:
                error[row, column] = np.hypot(*window.error[at, :2])
                sd[row, column] = np.hypot(*window.sd[at, :2])
    known = np.isfinite(error)
    growth = np.stack([known.sum(axis=0), np.nansum(error**2, axis=0), np.nansum(sd**2, axis=0)], axis=1)
    chosen = {f"outage_{t:.0f}s_m": error[:, GROWTH.index(t)] for t in OUTAGES}
    return {key: _by_recording(value, material.block) for key, value in chosen.items()}, growth


def free_inertial(done: Navigated, material: Material) -> dict[str, FloatArray]:
    """Horizontal error after a minute of nothing but the IMU.

    Position and velocity at the start are true; attitude and sensor errors are those that the filter had found by then.
    Where the truth does not tell the velocity, the smoothed solution stands for it.

    Parameters
    ----------
    done : Navigated
        The recording, navigated.
    material : Material

    Returns
    -------
    dict of str to array
        The metric; none if the recording is too short.
    """
    run = done.run
    behind = run.gps_delay - material.settings.delay  # the solution is in the time of the fixes
    filtered = run.solution
    truth, clock = material.truth, 0.0
    if not material.whole_state:
        if run.smoothed is None:
            return {}
        truth, clock = run.smoothed.solution, behind
    begin = max(filtered.time[0] - behind, truth.time[0] - clock, material.imu.time[0]) + material.settle
    end = min(filtered.time[-1] - behind, truth.time[-1] - clock, material.imu.time[-1] - _LEAD) - FREE
    error = []
    for wanted in np.arange(begin, end, max(FREE, (end - begin) / _WINDOWS)):
        row = int(np.searchsorted(filtered.time - behind, wanted))
        start = float(filtered.time[row]) - behind
        if start > end:
            break
        lla, v_n = _state(truth, start + clock)
        imu = _part(material.imu, start - _LEAD, start + FREE + _LEAD)
        parts = strapdown.intervals(correct(imu, _found(run.sensor_errors, start + behind)))
        pieces = strapdown.split(parts, np.array([start, start + FREE]), 0, len(parts.end))
        inc = _between(strapdown.increments(parts, pieces), start, start + FREE)
        gone = strapdown.navigate(inc, lla, v_n, filtered.rph[row])
        there, _ = _state(truth, start + FREE + clock)
        error.append(float(np.hypot(*ned_offset(gone.lla[-1], there)[:2])))
    return {"free_inertial_60s_m": _by_recording(np.array(error), material.block)} if error else {}


def rms(error: FloatArray) -> float:
    """Root mean square of the errors known; NaN if there is none."""
    known = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def _by_recording(value: FloatArray, block: float) -> FloatArray:
    """Every window by itself where a drive is judged in pieces, else their root mean square."""
    return value if block > 0.0 else np.array([rms(value)])


def _state(trajectory: Trajectory, time: float) -> tuple[FloatArray, FloatArray]:
    """Position and velocity between two rows: by the velocity from the nearer one, and on a straight line."""
    at = int(np.clip(np.searchsorted(trajectory.time, time), 1, len(trajectory.time) - 1))
    if time - trajectory.time[at - 1] < trajectory.time[at] - time:
        at -= 1
    after = min(at + 1, len(trajectory.time) - 1)
    first = after - 1
    share = (time - trajectory.time[first]) / (trajectory.time[after] - trajectory.time[first])
    v_n = trajectory.v_n[first] + share * (trajectory.v_n[after] - trajectory.v_n[first])
    way = 0.5 * (trajectory.v_n[at] + v_n) * (time - trajectory.time[at])
    return lla_offset(trajectory.lla[at], way), v_n


def _found(known: SensorErrors, time: float) -> ImuErrors:
    """Sensor errors as they were known at a time."""
    value = known.value[max(int(np.searchsorted(known.time, time, side="right")) - 1, 0)]
    return ImuErrors(
        gyro_bias=value[0:3],
        gyro_matrix=np.diag(1.0 + value[6:9]),
        accel_bias=value[3:6],
        accel_matrix=np.diag(1.0 + value[9:12]),
    )


def _part(imu: ImuData, start: float, end: float) -> ImuData:
    first, last = np.searchsorted(imu.time, [start, end])
    return imu.rows(slice(first, last))


def _between(inc: Increments, start: float, end: float) -> Increments:
    return inc.rows((inc.time > start + strapdown.TIME_TOLERANCE) & (inc.time < end + strapdown.TIME_TOLERANCE))
