"""Directions of a sensor's axes in letters, and the way from there to Forward, Right, Down."""

from __future__ import annotations

import numpy as np

from insnav.exceptions import ConfigError
from insnav.types import FloatArray

_DIRECTIONS = {
    "F": (1.0, 0.0, 0.0),
    "B": (-1.0, 0.0, 0.0),
    "R": (0.0, 1.0, 0.0),
    "L": (0.0, -1.0, 0.0),
    "D": (0.0, 0.0, 1.0),
    "U": (0.0, 0.0, -1.0),
}


def axes_matrix(axes: str) -> FloatArray:
    """Matrix from sensor axes to Forward, Right, Down.

    `axes`: where the sensor's x, y and z point: three letters of F/B, R/L, D/U, such as ``FLU``.
    Returns: (3, 3): ``v_frd = axes_matrix(axes) @ v_sensor``; a signed permutation of determinant 1.
    Raises: ConfigError: not three letters, one direction twice, or a left-handed set.
    """
    letters = axes.strip().upper()
    fix = "name where x, y and z point, such as FRD, FLU or RFU: F or B, R or L, D or U"
    if len(letters) != 3 or any(letter not in _DIRECTIONS for letter in letters):
        raise ConfigError(f"{axes!r} are not three directions", where="imu-axes", fix=fix)
    matrix = np.array([_DIRECTIONS[letter] for letter in letters]).T + 0.0
    determinant = round(float(np.linalg.det(matrix)))
    if determinant == 0:
        raise ConfigError(f"{axes!r} names one direction twice", where="imu-axes", fix=fix)
    if determinant < 0:
        other = "".join((letters[1], letters[0], letters[2]))
        raise ConfigError(
            f"{axes!r} is a left-handed set of axes",
            where="imu-axes",
            why="x cross y must be z, else rotations have the wrong sign",
            fix=f"one direction must be the opposite one; or did you mean {other}?",
        )
    return matrix
