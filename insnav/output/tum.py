"""Compared epochs as trajectories in the TUM format (``time x y z qx qy qz qw``), which evo and others read.

Positions are East, North, Up in the tangent plane at the first epoch, attitude turns body axes (Forward, Right, Down)
into these. Every pose stands where the error, in metres North, East, Down at its epoch, puts it from the reference: so
the distances between two files are the errors that insnav counts, to rounding.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pymap3d

from insnav.attitude import dcm_from_quat, quat_from_dcm, quat_from_rph, quat_multiply
from insnav.earth_fixed import quat_earth_from_level
from insnav.types import FloatArray, Trajectory
from insnav.units import DEG

_NED_TO_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_HEAD = "# time [s], East, North, Up [m] from {:.9f} {:.9f} deg {:.4f} m, qx qy qz qw of Forward-Right-Down axes"


def tum_files(
    reference: Trajectory, time: FloatArray, errors: Mapping[str, tuple[FloatArray, FloatArray]]
) -> dict[str, str]:
    """Text of the reference and of each run at their common epochs, by the name of the file.

    `time` (n,): the epochs [s]; `errors` (n, 3): name of each run, its position errors North, East, Down [m] and
    attitude errors roll, pitch, heading [rad].
    """
    rows = np.searchsorted(reference.time, time)
    lla, rph = reference.lla[rows], reference.rph[rows]
    origin = lla[0] / np.array([DEG, DEG, 1.0])
    place = np.column_stack(pymap3d.geodetic2enu(*(lla / [DEG, DEG, 1.0]).T, *origin))
    turn = _to_tangent(lla, lla[0])
    head = _HEAD.format(*origin)
    files = {"reference.tum": _text(head, time, place, turn, rph)}
    for name, (position, attitude) in errors.items():
        moved = place + (turn @ position[:, :, None])[:, :, 0]
        files[f"{name}.tum"] = _text(head, time, moved, turn, rph + attitude)
    return files


def _to_tangent(lla: FloatArray, origin: FloatArray) -> FloatArray:
    """Matrices that turn local North, East, Down at each place into East, North, Up at the origin, (n, 3, 3)."""
    here, there = (dcm_from_quat(quat_earth_from_level(place)) for place in (lla, origin[None]))
    return np.asarray(_NED_TO_ENU @ np.swapaxes(there, 1, 2) @ here)


def _text(head: str, time: FloatArray, place: FloatArray, turn: FloatArray, rph: FloatArray) -> str:
    q = _attitude(turn, rph)
    lines = (" ".join(map(repr, row)) for row in np.column_stack([time, place, q[:, 1:], q[:, :1]]).tolist())
    return "\n".join([head, *lines]) + "\n"


def _attitude(turn: FloatArray, rph: FloatArray) -> FloatArray:
    """Quaternions from body axes to the tangent plane, scalar first; none where the attitude is not known, (n, 4)."""
    known = np.isfinite(rph).all(axis=1)
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(rph), 1))
    q[known] = quat_multiply(quat_from_dcm(turn[known]), quat_from_rph(rph[known]))
    return q


def tangent_poses(track: Trajectory) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions East, North, Up of the first epoch ``(n, 3)`` [m], quaternions scalar first, velocities [m/s]."""
    origin = track.lla[0] / np.array([DEG, DEG, 1.0])
    place = np.column_stack(pymap3d.geodetic2enu(*(track.lla / [DEG, DEG, 1.0]).T, *origin))
    turn = _to_tangent(track.lla, track.lla[0])
    return place, _attitude(turn, track.rph), np.einsum("nij,nj->ni", turn, track.v_n)
