"""What a calibration is worth: one minute of free inertial navigation with and without it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from insnav.earth import radii
from insnav.imu.dynamic_map import AxisMap, DynamicMap
from insnav.imu.model import ImuErrors, correct, corrupt
from insnav.simulate.closed_forms import circle, straight
from insnav.simulate.ideal_sensors import imu_from_truth, reference
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
    g_sensitivity_sd : (3, 3) array
        [rad/s/(m/s^2)].
    gyro_map_covariance : tuple of (k, k) array or None
        Of the errors at the knots of the map of each gyro [rad^2/s^2].
    """

    errors: ImuErrors
    gyro_bias_sd: FloatArray = field(default_factory=_zeros)
    gyro_matrix_sd: FloatArray = field(default_factory=_none)
    accel_bias_sd: FloatArray = field(default_factory=_zeros)
    accel_matrix_sd: FloatArray = field(default_factory=_none)
    g_sensitivity_sd: FloatArray = field(default_factory=_none)
    gyro_map_covariance: tuple[FloatArray | None, ...] = (None, None, None)

    def corrected_sd(self, rate: FloatArray, force: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Uncertainty of corrected rates and specific forces that comes from the calibration alone.

        Parameters
        ----------
        rate, force : (n, 3) array
            True ones [rad/s], [m/s^2].

        Returns
        -------
        rate_sd, force_sd : (n, 3) array
            One standard deviation, bias and each element of the matrix taken as independent, sensors as nearly those
            of a perfect triad [rad/s], [m/s^2].
        """
        of_rate = rate**2 @ self.gyro_matrix_sd.T**2 + force**2 @ self.g_sensitivity_sd.T**2 + self.gyro_bias_sd**2
        known = (
            ()
            if self.errors.gyro_map is None
            else zip(self.errors.gyro_map.axes, self.gyro_map_covariance, strict=True)
        )
        for axis, (item, spread) in enumerate(known):
            if item is not None and spread is not None:
                share = np.column_stack([np.interp(rate[:, axis], item.rate, row) for row in np.eye(item.rate.size)])
                of_rate[:, axis] += np.sum((share @ spread) * share, axis=1)
        return np.sqrt(of_rate), np.sqrt(force**2 @ self.accel_matrix_sd.T**2 + self.accel_bias_sd**2)


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
    gyro_map, terms = known.gyro_map, known.gyro_terms
    if gyro_map is not None:
        maps = zip(gyro_map.axes, calibrated.gyro_map_covariance, strict=True)
        gyro_map = DynamicMap(*(_drawn_map(item, spread, rng) for item, spread in maps))
    if terms is not None:
        drawn = calibrated.g_sensitivity_sd * rng.standard_normal((3, 3))
        terms = replace(terms, g_sensitivity=terms.g_sensitivity + drawn)
    return replace(
        known,
        gyro_bias=known.gyro_bias + calibrated.gyro_bias_sd * rng.standard_normal(3),
        gyro_matrix=known.gyro_matrix + calibrated.gyro_matrix_sd * rng.standard_normal((3, 3)),
        accel_bias=known.accel_bias + calibrated.accel_bias_sd * rng.standard_normal(3),
        accel_matrix=known.accel_matrix + calibrated.accel_matrix_sd * rng.standard_normal((3, 3)),
        gyro_map=gyro_map,
        gyro_terms=terms,
    )


def _drawn_map(item: AxisMap | None, spread: FloatArray | None, rng: np.random.Generator) -> AxisMap | None:
    if item is None or spread is None:
        return item
    return replace(item, error=item.error + np.linalg.cholesky(spread) @ rng.standard_normal(item.rate.size))


def _error(path: Trajectory, imu: ImuData) -> float:
    vertical = path.lla[1:, 2], path.v_n[1:, 2]
    n = len(imu.time)
    found = navigate(increments(intervals(imu)), path.lla[0], path.v_n[0], path.rph[0], vertical=vertical, every=n)
    meridian, transverse = radii(path.lla[-1, 0])
    north, east = (found.lla[-1] - path.lla[-1])[:2]
    return float(np.hypot(north * meridian, east * transverse * np.cos(path.lla[-1, 0])))


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
