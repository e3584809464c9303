"""Interface of aiding measurements, and tools to calibrate them from a first pass over the drive."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Protocol, Self

import numpy as np

from insnav.alignment.clock_offset import APART, LONG_ENOUGH, STEP, correlate_masked
from insnav.alignment.in_motion import SLOWEST, Velocity, gives_velocities, velocity
from insnav.attitude import dcm_from_rph
from insnav.findings import Finding
from insnav.imu.specification import ImuSpec
from insnav.types import BoolArray, FloatArray, GpsData, ImuData, SensorLog, Trajectory
from insnav.units import DEG

ENOUGH = 60.0  # time above `SLOWEST` that determines mounting angles to a tenth of a degree [s]
# In a car on a road, this velocity is centimetres per second. Tracked, floating or flying vehicles have more.
LARGEST_RMS = 0.3  # largest RMS lateral or vertical velocity for a non-holonomic constraint [m/s]
WIDEST = 45.0 * DEG  # largest mounting angle: an IMU turned farther does not point ahead [rad]


@dataclass(frozen=True, slots=True)
class Mounting:
    """Axes of the vehicle relative to the axes of the IMU."""

    # (2,) pitch and yaw of the direction of travel in the axes of the IMU, and their standard deviations [rad]
    angles: FloatArray
    sd: FloatArray
    to_vehicle: FloatArray  # (3, 3) rotation from IMU axes to vehicle axes (forward, right, down)
    lever_b: FloatArray  # (3,) point on the unsteered axle, seen from the IMU, body axes [m]
    right: FloatArray  # (m,) residual velocity to the right, and down, at the rows of `FirstPass.fast` [m/s]
    down: FloatArray

    @property
    def rms(self) -> tuple[float, float]:
        """Compute the RMS of the residual velocity to the right and down [m/s]."""
        return float(np.sqrt(np.mean(self.right**2))), float(np.sqrt(np.mean(self.down**2)))

    @property
    def holds(self) -> bool:
        """Test whether the vehicle moves along one axis, near the forward axis of the IMU."""
        return max(self.rms) <= LARGEST_RMS and float(np.abs(self.angles).max()) <= WIDEST


def mounting(v_b: FloatArray, rate: FloatArray, step: float) -> Mounting:
    """Estimate vehicle axes from velocity in IMU axes [m/s] and body rate [rad/s], (m, 3), every `step` [s].

    The fit also estimates x: an unsteered axle, x ahead of the IMU, has zero lateral velocity, ``v_y + x w_z = 0``.
    """
    ahead = v_b[:, 0]
    right, right_rest, right_sd = robust_fit(np.column_stack([ahead, -rate[:, 2], rate[:, 0]]), v_b[:, 1], step)
    down, down_rest, down_sd = robust_fit(np.column_stack([ahead, rate[:, 1], -rate[:, 0]]), v_b[:, 2], step)
    forward = np.array([1.0, right[0], down[0]])
    forward /= np.linalg.norm(forward)
    side = np.cross([0.0, 0.0, 1.0], forward)
    side /= np.linalg.norm(side)
    return Mounting(
        np.array([-np.arctan(down[0]), np.arctan(right[0])]),
        np.array([down_sd, right_sd]),
        np.array([forward, side, np.cross(forward, side)]),
        np.array([right[1], 0.0, 0.0]),
        right_rest,
        down_rest,
    )


@dataclass(frozen=True)
class FirstPass:
    """Drive with its smoothed solution, all in the time of the IMU samples, to calibrate aiding measurements."""

    solution: Trajectory  # smoothed solution, with several rows per second
    imu: ImuData  # samples of the IMU
    gps: GpsData  # fixes, shifted to the time of the samples
    spec: ImuSpec  # error specification of the IMU
    logs: Mapping[str, SensorLog] = field(default_factory=dict)  # logs of further sensors, by name

    @cached_property
    def step(self) -> float:
        """Time between rows of the solution [s]."""
        return float(np.median(np.diff(self.solution.time))) if self.solution.time.shape[0] > 1 else INTERVAL

    @cached_property
    def v_b(self) -> FloatArray:
        """Velocity in IMU axes, (n, 3) [m/s]."""
        return np.asarray(np.einsum("nji,nj->ni", dcm_from_rph(self.solution.rph), self.solution.v_n))

    @cached_property
    def speed(self) -> Velocity:
        """Velocity measured by the receiver or, if none, of the solution, as position changes are mostly noise."""
        solution = self.solution
        if solution.sd is None or gives_velocities(self.gps):
            return velocity(self.gps)
        return Velocity(solution.time, solution.v_n, solution.sd[:, 3:5].max(axis=1))

    @cached_property
    def fast(self) -> BoolArray:
        """Rows with a speed above `SLOWEST`, (n,)."""
        return np.asarray(np.linalg.norm(self.solution.v_n, axis=1) > SLOWEST)

    @cached_property
    def fast_time(self) -> float:
        """Time spent at speeds above `SLOWEST` [s]."""
        return float(self.fast.sum() * self.step)

    @cached_property
    def mounting(self) -> Mounting | None:
        """Mounting of the IMU in its vehicle, with the attitude sd included; None if the drive is too short."""
        if self.fast_time < ENOUGH:
            return None
        estimate = mounting(self.v_b[self.fast], self._rate()[self.fast], self.step)
        sd = self.solution.sd
        return estimate if sd is None else replace(estimate, sd=np.hypot(estimate.sd, sd[self.fast, 7:].min(axis=0)))

    @cached_property
    def forward(self) -> FloatArray:
        """Speed along the forward axis of the vehicle, (n,) [m/s]; needs the `mounting`."""
        assert self.mounting is not None
        return np.asarray(self.v_b @ self.mounting.to_vehicle[0])

    def _rate(self) -> FloatArray:
        """Angular rate at the rows of the solution, averaged over a tenth of a second [rad/s]."""
        time, imu = self.solution.time, self.imu
        step = np.gradient(imu.time)[:, None]
        angle = np.cumsum(imu.gyro if imu.sampling == "increment" else imu.gyro * step, axis=0)
        half = 0.05
        at = [np.column_stack([np.interp(time + s * half, imu.time, angle[:, i]) for i in range(3)]) for s in (-1, 1)]
        return np.asarray((at[1] - at[0]) / (2.0 * half))


NOTHING = slice(0, 0)  # filled rows of a measurement that has no data at the time


@dataclass(frozen=True, slots=True)
class FilterView:
    """Filter state that an aiding measurement may use."""

    begin: float  # start of the interval since the last aiding measurements [s]
    time: float  # end of this interval: the present time [s]
    # (10,) state, see `insnav.kernels.mechanization`, after the measurements so far at the present time
    x: FloatArray
    correction: FloatArray  # (12,) estimated sensor errors
    rate: FloatArray  # (3,) body rate, corrected for sensor errors [rad/s]
    mean_gyro: FloatArray  # (3,) mean raw gyro output over the interval [rad/s]
    speed: float  # horizontal speed before the first measurement at the present time [m/s]


class Measurement(Protocol):
    """Interface of one kind of aiding measurement."""

    order: ClassVar[int]  # rank among the measurements at one time, lowest first
    name: ClassVar[str]  # name in the result, and subject of findings on rejections
    unit: ClassVar[str]
    excluded_by: ClassVar[frozenset[str]]  # names of measurements that make it redundant at the same time

    @property
    def sd(self) -> FloatArray:
        """Standard deviation of the white noise of each component, (m,)."""

    def observe(self, at: FilterView, z: FloatArray, h: FloatArray) -> slice:
        """Fill rows of `z` (6,) with predicted minus measured, and of `h` (6, n) with their derivatives by the states.

        Returns: the filled rows. The first filled row has the first standard deviation of `sd`.
        """

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """Calibrate the measurement, and its standard deviation, from a first pass over the drive.

        Returns: the measurement, or None if the drive has no such sensor or does not support it; and a finding.
        """


INTERVAL = 0.25  # time between aiding measurements of one kind [s]
# Largest factor on a residual's RMS for its time correlation. Residuals that persist for minutes are systematic: white
# noise cannot represent them, and with a larger factor the measurement would have no weight [-]
LARGEST_INFLATION = 3.0
UNCORRELATED = 0.05  # smaller autocorrelations count as chance [-]


def robust_fit(design: FloatArray, values: FloatArray, step: float) -> tuple[FloatArray, FloatArray, float]:
    """Fit parameters by least squares with Huber's weights (P. J. Huber, Robust Statistics, 1981, chapter 7).

    `design` (n, k), `values` (n,). `step`: time between rows [s].
    Returns: parameters (k,), residuals (n,), and the standard deviation of the first parameter. This sd uses the
    effective sample size of time-correlated residuals.
    """
    weight = np.ones(values.shape[0])
    parameters: FloatArray = np.zeros(design.shape[1])
    residual: FloatArray = values.copy()
    for _ in range(10):
        parameters[:] = np.linalg.lstsq(design * weight[:, None], values * weight, rcond=None)[0]
        residual[:] = values - design @ parameters
        # 1.4826 median |r| is the standard deviation of a normal distribution; 1.5 of it is Huber's usual limit
        scale = 1.4826 * float(np.median(np.abs(residual))) or 1.0
        weight = np.sqrt(np.minimum(1.0, 1.5 * scale / np.maximum(np.abs(residual), 1e-12)))
    covariance = np.linalg.inv((design * weight[:, None] ** 2).T @ design) * float(np.mean((weight * residual) ** 2))
    inflation = _sum_of_correlations(residual, max(1, round(INTERVAL / step))) * max(1, round(INTERVAL / step))
    return parameters, residual, float(np.sqrt(covariance[0, 0] * inflation))


def time_correlated_sd(residual: FloatArray, step: float) -> float:
    """Compute the sd of white noise at each `INTERVAL` whose mean is as uncertain as the mean of correlated residuals.

    `step`: time between residuals [s]. For m values over far more than the correlation time, their mean has the
    variance ``sd^2 / m (1 + 2 sum rho_k)`` with the autocorrelations rho.
    """
    rms = float(np.sqrt(np.mean(residual**2)))
    inflation = _sum_of_correlations(residual, max(1, round(INTERVAL / step)))
    return rms * min(LARGEST_INFLATION, float(np.sqrt(inflation)))


def _sum_of_correlations(residual: FloatArray, stride: int) -> float:
    """Compute ``1 + 2 sum rho_k`` over lags of `stride` rows, up to the first that is not positive."""
    r = residual[::stride]
    power = float(np.mean(r * r)) or 1.0
    total = 1.0
    for lag in range(1, min(r.shape[0] // 3, 400)):
        rho = float(np.mean(r[lag:] * r[:-lag])) / power
        if rho <= UNCORRELATED:
            break
        total += 2.0 * rho
    return total


LEAST_CORRELATION = 0.9  # least correlation of two records of one motion; hills and corners alone give 0.5 [-]
CLEARER = 2.0  # an offset is the best if all others leave more than this multiple unexplained [-] ...
LEAST_UNEXPLAINED = 0.02  # ... and more than this share of the variance, however well the best speeds agree [-]
LONGEST_GAP = 1.0  # longest interval over which a speed is interpolated [s]


def clock_offset(time: FloatArray, speed: FloatArray, log_time: FloatArray, log_speed: FloatArray) -> float | None:
    """Find the clock offset of a log: the time shift, of any size, with the greatest correlation of its speed.

    On a repetitive route, several shifts are similar. Of these, only shifts of a few seconds are then accepted.

    `time`, `speed` (n,): times [s] and known speed [m/s]. `log_time`, `log_speed` (m,): of the log, speed in any unit.
    Returns: time by the log minus `time` [s]; None if no shift is clearly best.
    """
    (a, known_a), (b, known_b) = _even(time, speed), _even(log_time, log_speed)
    if min(known_a.sum(), known_b.sum()) * STEP < LONG_ENOUGH:
        return None
    correlation, count = correlate_masked(a, known_a, b, known_b)
    enough = count * STEP >= max(LONG_ENOUGH, 0.5 * STEP * min(known_a.sum(), known_b.sum()))
    correlation = np.where(enough, correlation, -1.0)
    offset = (np.arange(correlation.size) - (a.size - 1)) * STEP + log_time[0] - time[0]
    best = int(np.argmax(correlation))
    if correlation[best] < LEAST_CORRELATION:
        return None
    similar = 1.0 - correlation < max(CLEARER * (1.0 - correlation[best]), LEAST_UNEXPLAINED)
    if np.ptp(offset[similar]) > 2.0 * APART:
        similar &= np.abs(offset) <= APART
        if not similar.any():
            return None
        best = int(np.argmax(np.where(similar, correlation, -1.0)))
    before, peak, after = correlation[np.clip([best - 1, best, best + 1], 0, correlation.size - 1)]
    curvature = before - 2.0 * peak + after
    vertex = 0.5 * (before - after) / curvature if curvature < 0.0 else 0.0  # vertex of a parabola
    return float(offset[best] + vertex * STEP)


def near_values(time: FloatArray, at: FloatArray) -> BoolArray:
    """Test for each of the times `at` whether values at `time` on both sides are near enough to interpolate, (n,)."""
    after = np.clip(np.searchsorted(time, at), 1, time.shape[0] - 1)
    inside = (at >= time[0]) & (at <= time[-1])
    return np.asarray(inside & (time[after] - time[after - 1] <= LONGEST_GAP))


def _even(time: FloatArray, speed: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Resample a speed at intervals of `STEP`; return also where it is known."""
    times = np.arange(time[0], time[-1], STEP)
    return np.interp(times, time, speed), near_values(time, times)
