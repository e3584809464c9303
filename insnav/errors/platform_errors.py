"""Integrator errors of a platform on a known motion, and platform errors compared with strapdown errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from insnav import strapdown
from insnav.attitude import dcm_from_rph, quat_from_rotvec, quat_from_rph, quat_multiply, rph_from_quat
from insnav.earth import ned_offset
from insnav.errors.metrics import TrajectoryErrors, position_errors
from insnav.errors.schuler import StaticErrors, static_errors
from insnav.gimbal import INTEGRATORS, Integrator, PlatformErrors, PlatformRun, integral, navigate_platform
from insnav.simulate import Truth, circle, imu_from_truth, reference, straight
from insnav.types import FloatArray, Trajectory
from insnav.units import DEG, DEG_PER_H, UG

SINE_STEPS = (40, 80, 160, 320)  # steps over `SINE_END`: coarse enough that no rule reaches rounding
SINE_END = 5.0
REST_M_S = 0.1  # a slower error-free platform is at rest
AGAINST: Integrator = "fourth"  # reference integrator of the comparison
# of the demonstration
LAT = 45.0 * DEG
HEIGHT, SPEED, ROUND = 5000.0, 150.0, 600.0  # of the holding pattern [m], [m/s], [s]
FLIGHT, FLIGHT_RATES = 1800.0, (1.0, 10.0, 100.0)  # [s], [Hz]
DAY, DAY_RATE = 86400.0, 10.0
PATTERN, PATTERN_RATE = 7200.0, 50.0
ERRORS = PlatformErrors(
    tilt=np.array([0.0, 0.0, 1.0 / 60.0]) * DEG,
    drift=np.array([0.01, 0.01, 0.01]) * DEG_PER_H,
    bias=np.array([50.0, 50.0, 0.0]) * UG,
)


@dataclass(frozen=True, slots=True)
class Convergence:
    """Largest error of an integrator for several step sizes."""

    integrator: Integrator
    # (n,)
    step: FloatArray
    error: FloatArray

    @property
    def order(self) -> float:
        """Slope of log error over log step."""
        return float(np.polyfit(np.log(self.step), np.log(self.error), 1)[0])


@dataclass(frozen=True, slots=True)
class PlatformComparison:
    """Platform and strapdown navigator with equal errors on the same motion."""

    time: FloatArray  # (n,) [s]
    # (n, 3) error of position North, East, Down [m]; both height-constrained
    platform: FloatArray
    strapdown: FloatArray


@dataclass(frozen=True, slots=True)
class Demonstration:
    """Integrators on a sine and a known flight; platform and strapdown navigator at rest and in circles."""

    orders: Sequence[Convergence]
    flight: Mapping[float, Sequence[TrajectoryErrors]]  # by sampling rate [Hz], in the order of `INTEGRATORS`
    rest: PlatformComparison
    turning: PlatformComparison


@dataclass(frozen=True, slots=True)
class PlatformStudy:
    """Record of specific force, integrated by all integrators."""

    chosen: Integrator  # integrator of the main solution
    runs: Mapping[Integrator, PlatformRun]  # by integrator; with the errors of the platform
    errors: PlatformErrors
    reference: Trajectory | None  # reference of the integrators

    @property
    def run(self) -> PlatformRun:
        """Run of the chosen integrator."""
        return self.runs[self.chosen]

    @property
    def theory(self) -> StaticErrors | None:
        """Closed form of the errors, for a vehicle at rest with the vertical channel off."""
        run = self.run
        still = float(np.abs(run.undisturbed.v_n).max()) < REST_M_S
        if not self.errors.any or run.vertical != "off" or not still:
            return None
        start = run.undisturbed.lla[0]
        return static_errors(run.solution.time - run.solution.time[0], start[0], start[2], self.errors)

    def differences(self) -> dict[Integrator, TrajectoryErrors]:
        """Compare each integrator, on an error-free platform, with the reference, else with the fourth-order one."""
        if self.reference is not None:
            return {name: position_errors(run.undisturbed, self.reference) for name, run in self.runs.items()}
        fourth = self.runs[AGAINST].solution
        return {name: position_errors(run.solution, fourth) for name, run in self.runs.items() if name != AGAINST}


def demonstrate() -> Demonstration:
    """Integrate a sine, a holding pattern and a day at rest, with known truth."""
    holding = partial(circle, np.array([LAT, 0.0, HEIGHT]), SPEED, 2.0 * np.pi / ROUND)
    at_rest = straight(np.array([LAT, 0.0, 0.0]), 0.0, 0.0, DAY)
    return Demonstration(
        sine_convergence(),
        integrator_errors(holding(FLIGHT), FLIGHT_RATES, keep=1.0),
        compare_with_strapdown(at_rest, ERRORS, DAY_RATE, 60.0),
        compare_with_strapdown(holding(PATTERN), ERRORS, PATTERN_RATE, 10.0),
    )


def sine_convergence() -> list[Convergence]:
    """Compute each integrator's largest error of the integral of sin(t) from 0 to 5; truth is 1 - cos(t)."""
    found = []
    for name in INTEGRATORS:
        errors = []
        for count in SINE_STEPS:
            t = np.linspace(0.0, SINE_END, count + 1)
            errors.append(float(np.abs(integral(t, np.sin(t), name) - (1.0 - np.cos(t))).max()))
        found.append(Convergence(name, SINE_END / np.array(SINE_STEPS), np.array(errors)))
    return found


def level_force(truth: Truth, time: FloatArray) -> FloatArray:
    """Compute specific force along North, East, Down, as measured by an error-free platform.

    `time` (n,): times [s].
    Returns: (n, 3): ``C_nb f_b`` [m/s^2].
    """
    at = truth.evaluate(time)
    return np.asarray((dcm_from_rph(at.rph) @ at.f_b[:, :, None])[:, :, 0])


def integrator_errors(
    truth: Truth, rates: Sequence[float], *, keep: float = 1.0
) -> dict[float, list[TrajectoryErrors]]:
    """Compute errors of each integrator on a level motion, for several sampling rates.

    `truth`: a motion at constant height, without vertical channel. `rates`: samples per second [Hz]. `keep`: interval
    of the returned errors [s], at least the sample interval.
    """
    found = {}
    for rate in rates:
        time = truth.start + np.arange(round(truth.duration * rate) + 1) / rate
        force, start = level_force(truth, time), truth.evaluate(time[:1])
        every = max(1, round(keep * rate))
        at = reference(truth, time[::every])
        runs = (
            navigate_platform(time, force, start.lla[0], start.v_n[0], integrator=name, every=every)
            for name in INTEGRATORS
        )
        found[rate] = [position_errors(run.solution, at) for run in runs]
    return found


def compare_with_strapdown(truth: Truth, errors: PlatformErrors, rate: float, keep: float) -> PlatformComparison:
    """Apply equal errors to a platform and a strapdown navigator on the same motion.

    `truth`: a motion at constant height that begins level and northward. Forward, right, down are then the platform's
    axes, and strapdown and platform sensors sense almost the same. `errors`: platform drift d becomes a strapdown gyro
    bias of -d, which also rotates the computed axes by d. `rate`: samples per second [Hz]. `keep`: interval of the
    returned errors [s].
    """
    time = truth.start + np.arange(round(truth.duration * rate) + 1) / rate
    every = max(1, round(keep * rate))
    at = reference(truth, time[::every])
    run = navigate_platform(
        time, level_force(truth, time), at.lla[0], at.v_n[0], integrator="fourth", errors=errors, every=every
    )
    imu = imu_from_truth(truth, time, "instant")
    imu.gyro[:] -= errors.drift
    imu.accel[:] += errors.bias
    inc = strapdown.increments(strapdown.intervals(imu))
    after = inc.rows(slice(1, None))
    held = np.full(len(after.time), at.lla[0, 2]), np.zeros(len(after.time))
    start = rph_from_quat(quat_multiply(quat_from_rotvec(-errors.tilt), quat_from_rph(at.rph[0])))
    other = strapdown.navigate(after, at.lla[0], at.v_n[0], start, vertical=held, every=every)
    return PlatformComparison(
        at.time,
        ned_offset(run.solution.lla, at.lla),
        np.concatenate([np.zeros((1, 3)), ned_offset(other.lla, at.lla[1:])]),
    )
