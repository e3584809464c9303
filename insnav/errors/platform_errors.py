"""Errors of the platform's integrators on a known motion, and of a platform compared with a strapdown navigator."""

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

SINE_STEPS = (40, 80, 160, 320)  # over `SINE_END`: coarse enough that no rule is exact to rounding
SINE_END = 5.0
REST_M_S = 0.1  # a platform slower than this without its errors is at rest
AGAINST: Integrator = "fourth"  # what the other integrators are compared with
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
    """Largest error of an integrator for several steps."""

    integrator: Integrator
    # (n,)
    step: FloatArray
    error: FloatArray

    @property
    def order(self) -> float:
        """Slope of the error over the step on logarithmic axes."""
        return float(np.polyfit(np.log(self.step), np.log(self.error), 1)[0])


@dataclass(frozen=True, slots=True)
class PlatformComparison:
    """A platform and a strapdown navigator with the same errors on the same motion."""

    time: FloatArray  # (n,) [s]
    # (n, 3) error of position North, East, Down [m]; both height-constrained
    platform: FloatArray
    strapdown: FloatArray


@dataclass(frozen=True, slots=True)
class Demonstration:
    """Integrators on a sine and a known flight, and a platform beside a strapdown navigator at rest and in circles."""

    orders: Sequence[Convergence]
    flight: Mapping[float, Sequence[TrajectoryErrors]]  # by sampling rate [Hz], in the order of `INTEGRATORS`
    rest: PlatformComparison
    turning: PlatformComparison


@dataclass(frozen=True, slots=True)
class PlatformStudy:
    """One record, by all integrators."""

    chosen: Integrator  # whose solution is wanted
    runs: Mapping[Integrator, PlatformRun]  # by integrator; with the errors of the platform
    errors: PlatformErrors
    reference: Trajectory | None  # what the integrators are evaluated against

    @property
    def run(self) -> PlatformRun:
        """The run that was asked for."""
        return self.runs[self.chosen]

    @property
    def theory(self) -> StaticErrors | None:
        """Closed form of the errors, where the vehicle is at rest and the vertical channel off."""
        run = self.run
        still = float(np.abs(run.undisturbed.v_n).max()) < REST_M_S
        if not self.errors.any or run.vertical != "off" or not still:
            return None
        start = run.undisturbed.lla[0]
        return static_errors(run.solution.time - run.solution.time[0], start[0], start[2], self.errors)

    def differences(self) -> dict[Integrator, TrajectoryErrors]:
        """Each integrator, on a platform without errors, against the reference; else the others against the fourth."""
        if self.reference is not None:
            return {name: position_errors(run.undisturbed, self.reference) for name, run in self.runs.items()}
        fourth = self.runs[AGAINST].solution
        return {name: position_errors(run.solution, fourth) for name, run in self.runs.items() if name != AGAINST}


def demonstrate() -> Demonstration:
    """Integrate a sine, a holding pattern and a day at rest, whose truth is known."""
    holding = partial(circle, np.array([LAT, 0.0, HEIGHT]), SPEED, 2.0 * np.pi / ROUND)
    at_rest = straight(np.array([LAT, 0.0, 0.0]), 0.0, 0.0, DAY)
    return Demonstration(
        sine_convergence(),
        integrator_errors(holding(FLIGHT), FLIGHT_RATES, keep=1.0),
        compare_with_strapdown(at_rest, ERRORS, DAY_RATE, 60.0),
        compare_with_strapdown(holding(PATTERN), ERRORS, PATTERN_RATE, 10.0),
    )


def sine_convergence() -> list[Convergence]:
    """Largest error of the integral of sin(t) from 0 to 5, whose truth is 1 - cos(t), by each integrator."""
    found = []
    for name in INTEGRATORS:
        errors = []
        for count in SINE_STEPS:
            t = np.linspace(0.0, SINE_END, count + 1)
            errors.append(float(np.abs(integral(t, np.sin(t), name) - (1.0 - np.cos(t))).max()))
        found.append(Convergence(name, SINE_END / np.array(SINE_STEPS), np.array(errors)))
    return found


def level_force(truth: Truth, time: FloatArray) -> FloatArray:
    """Specific force along North, East, Down, as a platform without errors measures it.

    `time` (n,): times [s].
    Returns: (n, 3): ``C_nb f_b`` [m/s^2].
    """
    at = truth.evaluate(time)
    return np.asarray((dcm_from_rph(at.rph) @ at.f_b[:, :, None])[:, :, 0])


def integrator_errors(
    truth: Truth, rates: Sequence[float], *, keep: float = 1.0
) -> dict[float, list[TrajectoryErrors]]:
    """Errors of each integrator on a level motion, for several sampling rates.

    `truth`: a motion at constant height: the vertical channel is off. `rates`: samples per second [Hz]. `keep`:
    interval between the errors returned [s], and no less than that of the samples.
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
    """Give a platform and a strapdown navigator the same errors on the same motion.

    `truth`: a motion at constant height that begins level and to the north: forward, right, down then are the
    platform's axes, and the strapdown sensors have about the first what the platform has about the second. `errors`:
    drift d of the platform becomes a gyro bias of -d of the strapdown system, which turns its computed axes by d as
    well. `rate`: samples per second [Hz]. `keep`: interval between the errors returned [s].
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
