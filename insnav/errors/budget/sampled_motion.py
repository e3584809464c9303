"""A motion as an IMU senses it, sample by sample: the input of every part of the budget."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.attitude import dcm_from_rph
from insnav.exceptions import ConfigError
from insnav.kernels.mechanization import POLAR_CAP
from insnav.simulate.closed_forms import straight
from insnav.simulate.ideal_sensors import imu_from_truth, reference
from insnav.simulate.truth import Truth
from insnav.strapdown import increments, intervals
from insnav.types import FloatArray, Increments, Trajectory
from insnav.units import DEG

RATE = 100.0  # [Hz]
REST = np.array([45.0 * DEG, 0.0, 0.0])  # latitude, longitude [rad], height [m] of the stationary motion


@dataclass(frozen=True, slots=True)
class SampledMotion:
    """A stretch of an exact motion, cut into the intervals of n samples."""

    truth: Trajectory  # at the n + 1 ends of the samples
    dt: FloatArray  # (n,) length of each sample [s]
    # (n, 3) latitude, longitude [rad], height [m] and velocity North, East, Down [m/s] in the middle of each sample
    lla: FloatArray
    v_n: FloatArray
    C_nb: FloatArray  # (n, 3, 3) attitude in the middle of each sample
    # (n, 3) mean angular rate [rad/s] and specific force [m/s^2] of each sample, body axes
    rate: FloatArray
    force: FloatArray
    increments: Increments  # what the mechanization takes, with coning and sculling
    description: str = ""  # what the motion is

    @property
    def elapsed(self) -> FloatArray:
        """Time since the start at the end of every sample, ``(n,)`` [s]."""
        return np.cumsum(self.dt)

    @property
    def force_n(self) -> FloatArray:
        """Specific force North, East, Down, ``(n, 3)`` [m/s^2]."""
        return np.asarray(np.einsum("kij,kj->ki", self.C_nb, self.force))


def sampled(truth: Truth, begin: float, duration: float, description: str = "", rate: float = RATE) -> SampledMotion:
    """Cut a stretch out of a motion.

    `begin`: start of the stretch, since that of the motion [s]; `duration`: its length [s]; `rate`: of the samples
    [Hz].
    Raises: ConfigError: the motion ends before, the stretch begins before it, or comes close to a pole.
    """
    if begin < 0.0 or begin + duration > truth.duration + 1e-6:
        raise ConfigError(
            f"the motion is not long enough for {duration:g} s from {begin:g} s on",
            why=f"it lasts {truth.duration:.2f} s",
            fix="choose shorter times, an earlier begin, or a longer motion",
        )
    n = round(duration * rate)
    time = truth.start + begin + np.arange(n + 1) / rate
    time[-1] = min(time[-1], truth.start + truth.duration)
    samples = imu_from_truth(truth, time, "mean")
    middle = truth.evaluate(time[:-1] + 0.5 * np.diff(time))
    if float(np.cos(middle.lla[:, 0]).min()) < POLAR_CAP:
        raise ConfigError(
            "a budget North and East has no meaning so close to a pole",
            why="within 128 km of it North turns too fast for a linear model in these axes",
            fix="choose a stretch of the motion that keeps away from the poles",
        )
    return SampledMotion(
        reference(truth, time),
        np.diff(time),
        middle.lla,
        middle.v_n,
        dcm_from_rph(middle.rph),
        samples.gyro,
        samples.accel,
        increments(intervals(samples)),
        description,
    )


def at_rest(duration: float) -> SampledMotion:
    """Make the default motion of a budget: stationary, level, heading north, at 45 deg of latitude.

    `duration`: length [s].
    """
    truth = straight(REST, 0.0, 0.0, duration + 1.0)
    description = "at rest, level, heading north, at a latitude of 45 deg"
    return sampled(truth, 0.0, duration, description)


def first_movement(truth: Truth, lead: float = 1.0) -> float:
    """Time from the start of a motion to its first movement, less `lead` [s]; 0 if it moves at once.

    `lead`: so much earlier [s].
    """
    tau = np.arange(0.0, truth.duration, 0.5)
    speed = np.linalg.norm(truth.evaluate(truth.start + tau).v_n, axis=1)
    moving = np.flatnonzero(speed > 0.05)
    return float(max(tau[moving[0]] - lead, 0.0)) if moving.size else 0.0
