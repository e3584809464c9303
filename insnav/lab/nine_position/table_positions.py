"""Table positions for the nine-position method: required positions, and the one to add."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Finding
from insnav.lab.calibration import few
from insnav.types import FloatArray
from insnav.units import DEG

STANDARD = ((0, 0), (45, 0), (-45, 0), (0, 45), (0, -45), (35, 35), (35, -35), (-35, 35), (-35, -35))  # [deg]
SMALLEST, LARGEST = 20.0 * DEG, 75.0 * DEG  # range of nonzero angles
SAME = 0.5 * DEG  # angles closer than this are equal
OPPOSITE = 1e-3  # forces this close to opposite, in g, are opposite
WORST_CONDITION = 50.0


def ideal_force(roll: FloatArray, pitch: FloatArray, gravity: float) -> FloatArray:
    """Specific force at rest, (n, 3) [m/s^2], Forward-Right-Down axes.

    ``g [sin(pitch), -cos(pitch) sin(roll), -cos(pitch) cos(roll)]``: minus the third column of the transposed attitude
    matrix times g; Groves (2013), section 5.6.2.

    `roll`, `pitch` (n,): [rad]. `gravity`: [m/s^2].
    """
    cos = np.cos(pitch)
    return gravity * np.column_stack((np.sin(pitch), -cos * np.sin(roll), -cos * np.cos(roll)))


def products(force: FloatArray) -> FloatArray:
    """Compute products of the forces across x, y, z, (n, 3), for comparison with the gyro of each module."""
    return np.column_stack((force[:, 1] * force[:, 2], force[:, 2] * force[:, 0], force[:, 0] * force[:, 1]))


def opposite_pairs(force: FloatArray, gravity: float) -> tuple[tuple[int, int] | None, ...]:
    """Two positions with x, y, z along the vertical, up and down; None for an axis that has no such two.

    `force` (n, 3): ideal forces [m/s^2]. `gravity`: [m/s^2].
    """
    pairs: list[tuple[int, int] | None] = []
    for axis in range(3):
        up, down = int(np.argmax(force[:, axis])), int(np.argmin(force[:, axis]))
        along = min(force[up, axis], -force[down, axis]) > (1.0 - OPPOSITE) * gravity
        pairs.append((up, down) if along else None)
    return tuple(pairs)


def check_positions(roll: FloatArray, pitch: FloatArray, where: str) -> tuple[Finding, ...]:
    """Refuse an undetermined or unbalanced set of positions, naming the one to add.

    `roll`, `pitch` (n,): [rad]. Returns findings on unusual but usable positions.
    """
    here = {_key(r, p) for r, p in zip(roll, pitch, strict=True)}
    force = ideal_force(roll, pitch, 1.0)
    tilted = np.abs(force).max(axis=1) < 1.0 - OPPOSITE
    angles = np.abs(np.concatenate((roll[tilted], pitch[tilted])))
    bad = (angles > SAME) & ((angles < SMALLEST - SAME) | (angles > LARGEST + SAME))
    if bad.any():
        raise InputError("lab.table_angle", where=where, angle_rad=float(angles[bad][0]))
    signs = ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0))
    mirrored = {_key(a * r, b * p) for r, p in zip(roll[tilted], pitch[tilted], strict=True) for a, b in signs}
    missing = sorted(mirrored - _nearby(here))
    if missing:
        raise InputError("lab.positions_asymmetric", where=where, positions=_written(missing[:4]))
    if not _determined(roll, pitch):
        accel, gyro = _conditions(roll, pitch)
        raise InputError(
            "lab.positions_undetermined",
            where=where,
            count=len(here),
            accel=accel,
            gyro=gyro,
            positions=_written(_to_add(roll, pitch)),
        )
    return few("positions", len(here), len(STANDARD))


def _key(roll: float, pitch: float) -> tuple[float, float]:
    return round(float(roll / DEG), 1) + 0.0, round(float(pitch / DEG), 1) + 0.0


def _nearby(keys: set[tuple[float, float]]) -> set[tuple[float, float]]:
    """All keys within half a degree of one that is there, in steps of the key."""
    steps = np.arange(-5, 6) / 10.0
    return {(round(r + a, 1) + 0.0, round(p + b, 1) + 0.0) for r, p in keys for a in steps for b in steps}


def _written(keys: Sequence[tuple[float, float]]) -> tuple[str, ...]:
    return tuple(f"{roll:g}°/{pitch:g}°" for roll, pitch in keys)


def _designs(roll: FloatArray, pitch: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Build the design matrices of an accelerometer, and of the gyros."""
    force = ideal_force(roll, pitch, 1.0)
    return np.column_stack((force, np.ones(len(force)))), products(force)


def _conditions(roll: FloatArray, pitch: FloatArray) -> tuple[float, float]:
    """Compute condition numbers of `_designs` with columns of length 1; infinite with a zero column."""

    def of(design: FloatArray) -> float:
        lengths = np.linalg.norm(design, axis=0)
        return float(np.linalg.cond(design / lengths)) if (lengths > 0.0).all() else float("inf")

    accel, gyro = _designs(roll, pitch)
    return of(accel), of(gyro)


def _determined(roll: FloatArray, pitch: FloatArray) -> bool:
    return roll.size > 5 and max(_conditions(roll, pitch)) < WORST_CONDITION


def _to_add(roll: FloatArray, pitch: FloatArray) -> list[tuple[float, float]]:
    """List standard positions that complete the set: groups of mirror images, the best first."""
    groups = [STANDARD[5:], STANDARD[1:3], STANDARD[3:5], STANDARD[:1]]
    added: list[tuple[float, float]] = []

    def score(group: tuple[tuple[int, int], ...]) -> float:
        both = [
            np.concatenate((angle, more)) for angle, more in zip((roll, pitch), np.array(group).T * DEG, strict=True)
        ]
        # infinite while one of the two is singular: use the ranks first
        lack = 7 - sum(int(np.linalg.matrix_rank(design)) for design in _designs(*both))
        return 1e6 * lack + sum(min(each, 1e5) for each in _conditions(*both))

    while groups and not _determined(roll, pitch):
        group = groups.pop(min((score(group), place) for place, group in enumerate(groups))[1])
        added += [(float(r), float(p)) for r, p in group]
        roll, pitch = (
            np.concatenate((old, new)) for old, new in zip((roll, pitch), np.array(group).T * DEG, strict=True)
        )
    return added
