"""Test whether a reference belongs to this drive and time."""

from __future__ import annotations

from collections.abc import Callable
from operator import itemgetter
from typing import Any

import numpy as np

from insnav.earth import ned_offset
from insnav.exceptions import InputError
from insnav.input.interpret.overlap import LEAP, ZONE, named_offset
from insnav.types import FloatArray, GpsData, Trajectory

EPOCHS = 500  # epochs of a search, enough for the turns of a drive
FEWEST = 10  # common epochs
APART, OTHERWISE = 50.0, 0.5  # least distance to another drive [m], and share of the drive's extent
ALIKE = 0.1  # share of this extent below which tracks at different hours are the same


def other_drive(reference: Trajectory, track: Trajectory, gps: GpsData | None) -> float:
    """Return the distance of a reference from the fixes [m], if it moves differently from both; else zero."""
    if gps is None:
        return 0.0
    inside = (gps.time >= reference.time[0]) & (gps.time <= reference.time[-1]) & np.isfinite(gps.lla[:, 0])
    inside &= (gps.time >= track.time[0]) & (gps.time <= track.time[-1])
    if np.count_nonzero(inside) < FEWEST:
        return 0.0
    time, fixes = gps.time[inside], gps.lla[inside]
    origin = np.median(fixes, axis=0)
    here = ned_offset(fixes, origin)[:, :2]
    theirs, mine = (_at(time, each.time, ned_offset(each.lla, origin)) - here for each in (reference, track))
    if _spread(theirs) < max(APART, OTHERWISE * _spread(here)) or _spread(mine) > ALIKE * _spread(theirs):
        return 0.0
    return float(np.median(np.linalg.norm(theirs, axis=1)))


def no_time_in_common(reference: Trajectory, track: Trajectory) -> InputError:
    """Build the error for a reference of another time, with whole hours, days and leap seconds as correction."""
    values: dict[str, Any] = {"reference_s": tuple(reference.time[[0, -1]]) if len(reference.time) else ()}
    values |= {"solution_s": tuple(track.time[[0, -1]]) if len(track.time) else ()}
    offset, far = _hours_off(reference, track)
    if not offset:
        return InputError("ref.no_common_time", **values)
    values |= named_offset(offset, 0.0)[1]
    return InputError("ref.no_common_time_offset", offset_s=offset, apart_m=far, **values)


def apart(reference: Trajectory, track: Trajectory) -> Callable[[float], FloatArray]:
    """Build a function: distance of reference epochs from a track, (k, 2) [m], by clock lead [s]."""
    rows = np.unique(np.linspace(0, len(reference.time) - 1, EPOCHS).astype(np.int64))
    time, origin = reference.time[rows], track.lla[0]
    there, here = ned_offset(reference.lla[rows], origin)[:, :2], ned_offset(track.lla, origin)

    def at(late: float) -> FloatArray:
        inside = (time - late >= track.time[0]) & (time - late <= track.time[-1])
        return np.asarray(there[inside] - _at(time[inside] - late, track.time, here))

    return at


def _hours_off(reference: Trajectory, track: Trajectory) -> tuple[float, float]:
    """Find half hours and leap seconds that match a reference to a track [s], and their distance then [m]; or zero."""
    if not (len(reference.time) and len(track.time)):
        return 0.0, 0.0
    away = apart(reference, track)
    least, most = track.time[0] - reference.time[-1], track.time[-1] - reference.time[0]
    zones = ZONE * np.arange(np.floor((least - LEAP) / ZONE), np.ceil((most + LEAP) / ZONE) + 1.0)
    found = (0.0, ALIKE * _spread(ned_offset(track.lla, track.lla[0])[:, :2]))
    for offset in (zones[:, None] + [0.0, LEAP, -LEAP]).ravel():
        if len(there := away(-offset)) >= FEWEST:
            found = min(found, (float(offset), float(np.median(np.linalg.norm(there, axis=1)))), key=itemgetter(1))
    return found


def _at(time: FloatArray, known: FloatArray, place: FloatArray) -> FloatArray:
    """Interpolate north and east at other times."""
    return np.column_stack([np.interp(time, known, axis) for axis in place.T[:2]])


def _spread(place: FloatArray) -> float:
    """Compute the median distance from the middle [m]."""
    return float(np.median(np.linalg.norm(place - np.median(place, axis=0), axis=1)))
