"""What a calibration is worth: one minute of free inertial navigation with and without it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from insnav.earth import radii
from insnav.imu.model import ImuErrors, correct, corrupt
from insnav.simulate.closed_forms import circle, straight
from insnav.simulate.measure import imu_from_truth, reference
from insnav.strapdown import increments, intervals, navigate
from insnav.types import FloatArray, ImuData, Trajectory
from insnav.units import DEG

MINUTE = 60.0  # [s]
RATE = 50  # samples a second
PLACE = np.array([45.0 * DEG, 0.0, 0.0])
DRAWS = 24
TURN = 10.0 * DEG  # [rad/s]
SPEED = 10.0  # [m/s]


def _zeros() -> FloatArray:
    return np.zeros(3)


def _none() -> FloatArray:
    return np.zeros((3, 3))


@dataclass(frozen=True, slots=True)
class Calibrated:
    """Errors as calibrated and how sure they are, one standard deviation of each number.

    Attributes
    ----------
    errors : ImuErrors
        As written to the calibration file.
    gyro_bias_sd, accel_bias_sd : (3,) array
        [rad/s], [m/s^2].
    gyro_matrix_sd, accel_matrix_sd : (3, 3) array
        [-].
    """

    errors: ImuErrors
    gyro_bias_sd: FloatArray = field(default_factory=_zeros)
    gyro_matrix_sd: FloatArray = field(default_factory=_none)
    accel_bias_sd: FloatArray = field(default_factory=_zeros)
    accel_matrix_sd: FloatArray = field(default_factory=_none)


@dataclass(frozen=True, slots=True)
class Effect:
    """Horizontal position error after one minute, root mean square.

    Attributes
    ----------
    motion : str
        In words.
    without, corrected : float
        Without the calibration, and with it [m].
    """

    motion: str
    without: float
    corrected: float


def physical(errors: ImuErrors) -> ImuErrors:
    """Errors of rates and specific forces, where the zero of volts or counts is taken for 0 of them.

    Parameters
    ----------
    errors : ImuErrors
        Of a calibration.
    """
    gyro, accel = errors.gyro_raw, errors.accel_raw
    return replace(
        errors,
        gyro_bias=errors.gyro_bias + (0.0 if gyro is None else gyro.zero / gyro.scale),
        accel_bias=errors.accel_bias + (0.0 if accel is None else accel.zero / accel.scale),
        gyro_raw=None,
        accel_raw=None,
    )


def minute_effect(calibrated: Calibrated, *, seed: int = 1) -> tuple[Effect, ...]:
    """Navigate a simulated minute at rest and on a circle, sensors without other errors.

    The true errors are drawn about the calibrated ones with their uncertainty; the calibration takes off what it knows.
    Both start from the true state, and height is held.

    Parameters
    ----------
    calibrated : Calibrated
        The calibration.
    seed : int
        Of the draws.

    Returns
    -------
    tuple of Effect
    """
    known = physical(calibrated.errors)
    rng = np.random.default_rng(seed)
    truths = [_drawn(known, calibrated, rng) for _ in range(DRAWS)]
    effects = []
    for words, motion in (
        ("at rest", straight(PLACE, 0.0, 0.0, MINUTE)),
        (
            f"circle, {SPEED:g} m/s, turning {TURN / DEG:g} deg/s",
            circle(PLACE, SPEED, TURN, MINUTE),
        ),
    ):
        perfect = imu_from_truth(motion, np.arange(int(MINUTE * RATE) + 1) / RATE)
        path = reference(motion, np.concatenate(([0.0], perfect.time)))
        measured = [corrupt(perfect, each) for each in truths]
        without = [_error(path, each) for each in measured]
        corrected = [_error(path, correct(each, known)) for each in measured]
        effects.append(Effect(words, _rms(without), _rms(corrected)))
    return tuple(effects)


def _drawn(known: ImuErrors, calibrated: Calibrated, rng: np.random.Generator) -> ImuErrors:
    return replace(
        known,
        gyro_bias=known.gyro_bias + calibrated.gyro_bias_sd * rng.standard_normal(3),
        gyro_matrix=known.gyro_matrix + calibrated.gyro_matrix_sd * rng.standard_normal((3, 3)),
        accel_bias=known.accel_bias + calibrated.accel_bias_sd * rng.standard_normal(3),
        accel_matrix=known.accel_matrix + calibrated.accel_matrix_sd * rng.standard_normal((3, 3)),
    )


def _error(path: Trajectory, imu: ImuData) -> float:
    vertical = path.lla[1:, 2], path.v_n[1:, 2]
    n = len(imu.time)
    found = navigate(increments(intervals(imu)), path.lla[0], path.v_n[0], path.rph[0], vertical=vertical, every=n)
    meridian, transverse = radii(path.lla[-1, 0])
    north, east = (found.lla[-1] - path.lla[-1])[:2]
    return float(np.hypot(north * meridian, east * transverse * np.cos(path.lla[-1, 0])))


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
