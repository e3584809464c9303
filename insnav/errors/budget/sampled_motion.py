"""Motion as sensed by an IMU, sample by sample: the input of all parts of the budget."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from insnav.attitude import dcm_from_rph
from insnav.earth import gravity_n
from insnav.exceptions import ConfigError
from insnav.kernels.mechanization import POLAR_CAP
from insnav.simulate.ideal_sensors import imu_from_truth, reference
from insnav.simulate.truth import Truth, straight
from insnav.strapdown import increments, intervals
from insnav.types import FloatArray, Increments, Trajectory
from insnav.units import DEG

RATE = 100.0  # [Hz]
REST = np.array([45.0 * DEG, 0.0, 0.0])  # latitude, longitude [rad], height [m] of the stationary motion
HIGHEST = 1e5  # largest height in the search for a gravity value [m]


@dataclass(frozen=True, slots=True)
class SampledMotion:
    """Section of an exact motion, divided into n sample intervals."""

    truth: Trajectory  # at the n + 1 ends of the samples
    dt: FloatArray  # (n,) length of each sample [s]
    # (n, 3) latitude, longitude [rad], height [m] and velocity North, East, Down [m/s] in the middle of each sample
    lla: FloatArray
    v_n: FloatArray
    C_nb: FloatArray  # (n, 3, 3) attitude in the middle of each sample
    # (n, 3) mean angular rate [rad/s] and specific force [m/s^2] of each sample, body axes
    rate: FloatArray
    force: FloatArray
    increments: Increments  # input of the mechanization, with coning and sculling
    description: str = ""  # description of the motion

    @property
    def elapsed(self) -> FloatArray:
        """Time since the start at the end of every sample, ``(n,)`` [s]."""
        return np.cumsum(self.dt)

    @property
    def force_n(self) -> FloatArray:
        """Specific force North, East, Down, ``(n, 3)`` [m/s^2]."""
        return np.asarray(np.einsum("kij,kj->ki", self.C_nb, self.force))


def sampled(truth: Truth, begin: float, duration: float, description: str = "", rate: float = RATE) -> SampledMotion:
    """Cut a section out of a motion.

    `begin`: start of the section, after the start of the motion [s]. `duration`: its length [s]. `rate`: of the samples
    [Hz].
    Raises: ConfigError: the section exceeds the motion, or approaches a pole.
    """
    if begin < 0.0 or begin + duration > truth.duration + 1e-6:
        raise ConfigError("budget.motion_too_short", after_s=duration, begin_s=begin, duration_s=truth.duration)
    n = round(duration * rate)
    time = truth.start + begin + np.arange(n + 1) / rate
    time[-1] = min(time[-1], truth.start + truth.duration)
    samples = imu_from_truth(truth, time, "mean")
    middle = truth.evaluate(time[:-1] + 0.5 * np.diff(time))
    if float(np.cos(middle.lla[:, 0]).min()) < POLAR_CAP:
        raise ConfigError("budget.near_pole")
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


def at_rest(
    duration: float, lat: float = float(REST[0]), heading: float = 0.0, gravity: float | None = None
) -> SampledMotion:
    """Build the default motion of a budget: stationary and level.

    `duration`: length [s]. `lat`, `heading` [rad]. `gravity`: choose the height of this gravity [m/s^2] instead of
    zero.
    Raises: ConfigError: gravity that occurs nowhere near the ellipsoid, or a pole.
    """
    height = 0.0 if gravity is None else _height_of(gravity, lat)
    truth = straight(np.array([lat, 0.0, height]), 0.0, heading, duration + 1.0)
    toward = "north" if heading == 0.0 else f"{heading / DEG % 360.0:g} deg"
    at = f"at rest, level, heading {toward}, at a latitude of {lat / DEG:g} deg"
    where = "" if gravity is None else f", where gravity is {gravity:g} m/s^2 (height {height:.0f} m)"
    return sampled(truth, 0.0, duration, at + where)


def _height_of(gravity: float, lat: float) -> float:
    """Find the height [m] of a normal gravity [m/s^2]."""

    def excess(height: float) -> float:
        return float(np.linalg.norm(gravity_n(lat, height))) - gravity

    if not excess(HIGHEST) < 0.0 < excess(-HIGHEST):
        raise ConfigError(
            "budget.impossible_gravity",
            where="--gravity",
            gravity_m_s2=gravity,
            lat_deg=lat / DEG,
            height_km=HIGHEST / 1e3,
            low_m_s2=gravity + excess(HIGHEST),
            high_m_s2=gravity + excess(-HIGHEST),
        )
    return float(brentq(excess, -HIGHEST, HIGHEST, xtol=1e-3))


def first_movement(truth: Truth) -> float:
    """Compute the time from the start to a second before the first movement [s]; 0 without a pause."""
    tau = np.arange(0.0, truth.duration, 0.5)
    speed = np.linalg.norm(truth.evaluate(truth.start + tau).v_n, axis=1)
    moving = np.flatnonzero(speed > 0.05)
    return float(max(tau[moving[0]] - 1.0, 0.0)) if moving.size else 0.0
