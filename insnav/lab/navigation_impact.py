"""Impact of a calibration on navigation: one minute of free inertial navigation with and without it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.earth import radii
from insnav.imu.higher_order import AxisMap, DynamicMap
from insnav.imu.model import ImuErrors, correct, corrupt
from insnav.lab.calibration import CalibrationSd, Impact, physical
from insnav.sample_statistics import rms
from insnav.simulate.ideal_sensors import imu_from_truth, reference
from insnav.simulate.truth import circle, straight
from insnav.strapdown import increments, intervals, navigate
from insnav.types import FloatArray, ImuData, Trajectory
from insnav.units import DEG

MINUTE = 60.0  # [s]
RATE = 50  # samples a second
PLACE = np.array([45.0 * DEG, 0.0, 0.0])
SAMPLES, SEED = 24, 1
TURN = 10.0 * DEG  # [rad/s]
SPEED = 10.0  # [m/s]


def navigation_impact(errors: ImuErrors, sd: CalibrationSd) -> tuple[Impact, ...]:
    """Navigate a simulated minute at rest and on a circle, sensors without other errors.

    The true errors are sampled about the calibrated ones with their uncertainty; the calibration corrects the known
    part. Both navigate from the true state, height-constrained.
    """
    known = physical(errors)
    rng = np.random.default_rng(SEED)
    truths = [_sampled(known, sd, rng) for _ in range(SAMPLES)]
    impacts = []
    for words, motion in (
        ("at rest", straight(PLACE, 0.0, 0.0, MINUTE)),
        (f"circle, {SPEED:g} m/s, turning {TURN / DEG:g} deg/s", circle(PLACE, SPEED, TURN, MINUTE)),
    ):
        perfect = imu_from_truth(motion, np.arange(int(MINUTE * RATE) + 1) / RATE)
        path = reference(motion, np.concatenate(([0.0], perfect.time)))
        measured = [corrupt(perfect, each) for each in truths]
        without = [_error(path, each) for each in measured]
        corrected = [_error(path, correct(each, known)) for each in measured]
        impacts.append(Impact(words, rms(without), rms(corrected)))
    return tuple(impacts)


def _sampled(known: ImuErrors, sd: CalibrationSd, rng: np.random.Generator) -> ImuErrors:
    gyro_map, terms = known.gyro_map, known.gyro_terms
    if gyro_map is not None:
        maps = zip(gyro_map.axes, sd.gyro_map, strict=True)
        gyro_map = DynamicMap(tuple(_sampled_map(item, spread, rng) for item, spread in maps))
    if terms is not None:
        error = sd.g_sensitivity * rng.standard_normal((3, 3))
        terms = replace(terms, g_sensitivity=terms.g_sensitivity + error)
    return replace(
        known,
        gyro_bias=known.gyro_bias + sd.gyro_bias * rng.standard_normal(3),
        gyro_matrix=known.gyro_matrix + sd.gyro_matrix * rng.standard_normal((3, 3)),
        accel_bias=known.accel_bias + sd.accel_bias * rng.standard_normal(3),
        accel_matrix=known.accel_matrix + sd.accel_matrix * rng.standard_normal((3, 3)),
        gyro_map=gyro_map,
        gyro_terms=terms,
    )


def _sampled_map(item: AxisMap | None, spread: FloatArray | None, rng: np.random.Generator) -> AxisMap | None:
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
