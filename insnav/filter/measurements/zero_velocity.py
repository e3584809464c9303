"""Zero-velocity update (ZUPT) where the IMU alone detects that the vehicle is stationary."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from insnav.alignment.in_motion import Velocity
from insnav.filter.measurements.first_pass import FirstPass
from insnav.filter.measurements.measurement import NOTHING, FilterView
from insnav.filter.measurements.residual_noise import INTERVAL
from insnav.findings import Code, Finding
from insnav.imu.specification import ImuSpec
from insnav.kernels.aiding_measurements import zero_velocity
from insnav.tabular import runs_of
from insnav.types import BoolArray, FloatArray, ImuData

WINDOW = 0.5  # length of the classified windows: several periods of an idling engine [s]
STATIONARY, MOVING = 0.15, 1.0  # certainly stationary below, certainly moving above [m/s]
FALSE_STOPS = 0.002  # share of moving windows misclassified as stationary: a false ZUPT costs metres
FEWEST_STOPS = 0.5  # least share of detected stationary windows for a useful ZUPT
# Largest deviation of specific force from its median at rest [m/s^2]: a soft stop or start shakes no more below 1 m/s
STEADY = 0.05
VELOCITY_SD = 0.02  # of a stationary vehicle with a running engine [m/s]


@dataclass(frozen=True, slots=True)
class ZeroVelocity:
    """Velocity and angular rate against the Earth are zero."""

    stops: FloatArray  # (k, 2) begin and end of the stationary intervals [s]
    # (6,) standard deviation of the velocity [m/s] and of the mean gyro output over `INTERVAL` [rad/s]; infinite: rate
    # unused
    sd: FloatArray

    order: ClassVar[int] = 20
    name: ClassVar[str] = "zupt"
    unit: ClassVar[str] = "m/s, rad/s"
    excluded_by: ClassVar[frozenset[str]] = frozenset()

    def observe(self, at: FilterView, z: FloatArray, h: FloatArray) -> slice:
        """See `Measurement`."""
        row = int(np.searchsorted(self.stops[:, 0], at.begin, side="right")) - 1
        if row < 0 or at.time > float(self.stops[row, 1]):
            return NOTHING
        zero_velocity(at.x, at.correction[:3], at.mean_gyro, z, h)
        return slice(0, 6 if np.isfinite(self.sd).all() else 3)

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """See `Measurement`."""
        stops, rate_sd, note = find_stops(first.imu, first.speed, first.spec)
        return (cls(stops, np.array([*[VELOCITY_SD] * 3, *rate_sd])) if stops.size else None), note


def find_stops(imu: ImuData, speed: Velocity, spec: ImuSpec) -> tuple[FloatArray, FloatArray, Finding]:
    """Detect stationary intervals by the IMU alone; a speed signal determines the limits.

    Times are sample times.

    Returns: `stops` (k, 2): begin and end [s]; empty if standing and moving cannot be separated. `rate_sd` (3,):
    standard deviation of the mean gyro output over `INTERVAL` at a stop [rad/s]. Then a finding.
    """
    none = np.empty((0, 2))
    no_sd = np.full(3, np.inf)
    step = float(np.median(np.diff(imu.time)))
    size = max(4, round(WINDOW / step))
    n = imu.time.shape[0] // size
    if n < 20 or speed.time.shape[0] < 10:
        return none, no_sd, Finding.of(Code.ZUPT_SHORT)
    scale = 1.0 / step if imu.sampling == "increment" else 1.0
    blocks = [v[: n * size].reshape(n, size, 3) * scale for v in (imu.gyro, imu.accel)]
    begin, end = imu.time[: n * size : size] - step, imu.time[size - 1 : n * size : size]
    still, moving = _seen(speed, begin, end)
    if still.sum() < 10 or moving.sum() < 50:
        return none, no_sd, Finding.of(Code.ZUPT_UNSEEN)
    stationary = np.ones(n, dtype=bool)
    for feature in np.log([np.linalg.norm(b.std(axis=1), axis=1) + 1e-9 for b in blocks]):
        high, low = np.quantile(feature[still], 0.9), np.quantile(feature[moving], 0.01)
        if high < low:
            stationary &= feature < 0.5 * (high + low)
    wrong, right = float(np.mean(stationary[moving])), float(np.mean(stationary[still]))
    if stationary.all() or wrong > FALSE_STOPS or right < FEWEST_STOPS:
        return none, no_sd, Finding.of(Code.ZUPT_POOR, share=right, false_share=wrong, limit_false_share=FALSE_STOPS)
    force = blocks[1].mean(axis=1)
    for a, b in runs_of(stationary):
        stationary[a:b] = np.linalg.norm(force[a:b] - np.median(force[a:b], axis=0), axis=1) < STEADY
    # the first and the last window of a stop may contain braking or starting
    stops = np.array([[begin[a] + 0.5 * WINDOW, end[b - 1] - 0.5 * WINDOW] for a, b in runs_of(stationary)])
    stops = stops[stops[:, 1] - stops[:, 0] >= WINDOW]
    if not stops.size:
        return none, no_sd, Finding.of(Code.ZUPT_NONE)
    few = max(2, round(INTERVAL / step))
    quiet = blocks[0][still & stationary]
    means = quiet[:, : size // few * few].reshape(quiet.shape[0], -1, few, 3).mean(axis=2)
    # two means per window: the scatter about their common mean is smaller by the root of two
    scatter = (means - means.mean(axis=1, keepdims=True)).std(axis=(0, 1)) * np.sqrt(2.0)
    # doubled: people and wind sometimes move a stationary vehicle, which most windows do not contain
    rate_sd = 2.0 * np.hypot(scatter, spec.gyro.random_walk / np.sqrt(INTERVAL))
    total = float(np.sum(stops[:, 1] - stops[:, 0]))
    note = Finding.of(Code.ZUPT_USED, count=stops.shape[0], duration_s=total, share=right, false_share=wrong)
    return stops, rate_sd, note


def _seen(speed: Velocity, begin: FloatArray, end: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Find windows in which the vehicle is certainly stationary, and certainly moving."""
    fast = np.linalg.norm(speed.v_n, axis=1)
    margin = np.maximum(0.5, 0.6 * float(np.median(np.diff(speed.time))))
    first, last = np.searchsorted(speed.time, begin - margin), np.searchsorted(speed.time, end + margin)
    seen = last > first
    most = np.array([fast[a:b].max() if b > a else np.nan for a, b in zip(first, last, strict=True)])
    least = np.array([fast[a:b].min() if b > a else np.nan for a, b in zip(first, last, strict=True)])
    noise = 3.0 * float(np.median(speed.sd))
    return seen & (most < max(STATIONARY, noise)), seen & (least > max(MOVING, 2.0 * noise))
