"""Sensor axis directions as letters or angles, and the rotation to Forward, Right, Down."""

from __future__ import annotations

import numpy as np

from insnav.attitude import dcm_from_rph
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
    """Build the rotation from sensor axes to Forward, Right, Down.

    `axes`: directions of the sensor's x, y and z: three letters of F/B, R/L, D/U, such as ``FLU``. Or roll, pitch and
    yaw of the sensor in the vehicle [deg], such as ``0,0,30``.
    Returns: (3, 3): ``v_frd = axes_matrix(axes) @ v_sensor``; a rotation.
    Raises: ConfigError: neither letters nor angles, one direction twice, or left-handed axes.
    """
    letters = axes.strip().upper()
    angles = _angles(letters)
    if angles is not None:
        return dcm_from_rph(np.deg2rad(angles))
    if len(letters) != 3 or any(letter not in _DIRECTIONS for letter in letters):
        raise ConfigError("columns.axes_unknown", where="imu-axes", axes=axes)
    matrix = np.array([_DIRECTIONS[letter] for letter in letters]).T + 0.0
    determinant = round(float(np.linalg.det(matrix)))
    if determinant == 0:
        raise ConfigError("columns.axes_twice", where="imu-axes", axes=axes)
    if determinant < 0:
        other = "".join((letters[1], letters[0], letters[2]))
        raise ConfigError("columns.axes_left_handed", where="imu-axes", axes=axes, other=other)
    return matrix


def _angles(text: str) -> FloatArray | None:
    """Parse three comma-separated angles [deg]."""
    try:
        angles = np.array([float(each) for each in text.split(",")])
    except ValueError:
        return None
    return angles if angles.shape == (3,) and bool(np.all(np.abs(angles) <= 360.0)) else None
