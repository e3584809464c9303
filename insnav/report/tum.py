"""Compared epochs as trajectories in the TUM format (``time x y z qx qy qz qw``), which evo and others read.

Positions are East, North, Up in the tangent plane at the first epoch, attitude turns body axes (Forward, Right, Down)
into these. Every pose stands where the error, in metres North, East, Down at its epoch, puts it from the reference: so
the distances between two files are the errors that insnav counts, to rounding.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain, count
from pathlib import Path

import numpy as np
import pymap3d

from insnav.attitude import dcm_from_quat, quat_from_dcm, quat_from_rph, quat_multiply
from insnav.errors.metrics import TrajectoryErrors
from insnav.io.folder import RunFolder
from insnav.report.compare import shared_errors
from insnav.simulate.earthfixed import quat_earth_from_level
from insnav.types import FloatArray, Trajectory
from insnav.units import DEG

_NED_TO_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
REFERENCE = "reference"
_HEAD = "# time [s], East, North, Up [m] from {:.9f} {:.9f} deg {:.4f} m, qx qy qz qw of Forward-Right-Down axes"


def tum_files(reference: Trajectory, runs: Mapping[str, TrajectoryErrors]) -> dict[str, str]:
    """Write the reference and each run at their common epochs.

    Parameters
    ----------
    reference : Trajectory
        At those epochs and perhaps others.
    runs : mapping of str to TrajectoryErrors
        Name and errors of each run, all at the same epochs.

    Returns
    -------
    dict of str to str
        Name of a file, ``reference.tum`` the first, and its text.
    """
    first = next(iter(runs.values()))
    rows = np.searchsorted(reference.time, first.time)
    lla, rph = reference.lla[rows], reference.rph[rows]
    origin = lla[0] / np.array([DEG, DEG, 1.0])
    place = np.column_stack(pymap3d.geodetic2enu(*(lla / [DEG, DEG, 1.0]).T, *origin))
    turn = _to_tangent(lla, lla[0])
    head = _HEAD.format(*origin)
    files = {f"{REFERENCE}.tum": _text(head, first.time, place, turn, rph)}
    for name, errors in runs.items():
        moved = place + (turn @ errors.position[:, :, None])[:, :, 0]
        files[f"{name}.tum"] = _text(head, errors.time, moved, turn, rph + errors.attitude)
    return files


def write_tum(folder: RunFolder, runs: Sequence[Path], reference: Trajectory, lever_b: FloatArray | None) -> Path:
    """Write the files of `tum_files` for run folders, at the epochs that all of them cover.

    Parameters
    ----------
    folder : RunFolder
        Entered, not committed.
    runs : sequence of Path
    reference : Trajectory
    lever_b : (3,) array or None
        The point of the reference seen from the IMU, body axes [m].

    Returns
    -------
    Path
        The finished folder.

    Raises
    ------
    InputError
        As of `insnav.report.compare.compare`.
    OutputError
        The folder cannot be written.
    """
    named: dict[str, TrajectoryErrors] = {}
    for run, solution, errors in shared_errors(runs, reference, lever_b=lever_b):
        name = f"{run}-smoothed" if solution == "smoothed" else run
        numbered = chain([name], (f"{name}-{number}" for number in count(2)))
        named[next(each for each in numbered if each not in named and each != REFERENCE)] = errors
    files = tum_files(reference, named)
    for name, text in files.items():
        folder.path(name).write_text(text, encoding="utf-8", newline="\n")
    return folder.commit({"runs": [str(run) for run in runs]})


def _to_tangent(lla: FloatArray, origin: FloatArray) -> FloatArray:
    """Matrices that turn local North, East, Down at each place into East, North, Up at the origin, (n, 3, 3)."""
    here, there = (dcm_from_quat(quat_earth_from_level(place)) for place in (lla, origin[None]))
    return np.asarray(_NED_TO_ENU @ np.swapaxes(there, 1, 2) @ here)


def _text(head: str, time: FloatArray, place: FloatArray, turn: FloatArray, rph: FloatArray) -> str:
    known = np.isfinite(rph).all(axis=1)
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(time), 1))  # where the reference does not know the attitude
    q[known] = quat_multiply(quat_from_dcm(turn[known]), quat_from_rph(rph[known]))
    lines = (" ".join(map(repr, row)) for row in np.column_stack([time, place, q[:, 1:], q[:, :1]]).tolist())
    return "\n".join([head, *lines]) + "\n"
