"""Whether a reference is of this drive and this hour at all, before its errors are looked at."""

from __future__ import annotations

import numpy as np

from insnav.earth import ned_offset
from insnav.exceptions import InputError
from insnav.input.interpret.overlap import LEAP, ZONE, named_offset
from insnav.types import FloatArray, GpsData, Trajectory

EPOCHS = 500  # of a search: a drive shows its turns in as many
FEWEST = 10  # in common
APART, OTHERWISE = 50.0, 0.5  # least difference [m], and part of the extent of the drive, of tracks that are no other's
ALIKE = 0.1  # of that extent, by which a track at another hour is told to be the same


def other_drive(reference: Trajectory, track: Trajectory, gps: GpsData | None) -> float:
    """How far a reference is from the fixes [m], if it moves otherwise than they and the track do; else zero."""
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
    extent = _spread(here)
    if _spread(theirs) < max(APART, OTHERWISE * extent) or _spread(mine) > ALIKE * _spread(theirs):
        return 0.0
    return float(np.median(np.linalg.norm(theirs, axis=1)))


def no_time_in_common(reference: Trajectory, track: Trajectory) -> InputError:
    """What is wrong with a reference of another time, with the whole hours, days and leap seconds that mend it."""
    spans = [(float(each.time[0]), float(each.time[-1])) for each in (reference, track)]
    fix = "check the time base of the reference (GPS week, Unix time, UTC against GPS time)"
    offset, apart = _hours_off(reference, track)
    if offset:
        name = named_offset(offset, 0.0)[1]
        fix = f"add {offset:+.0f} s to its times: so it is {apart:.2g} m from the solution{name}"
    return InputError(
        "the reference and the solution have no time in common",
        why="reference {:.3f} to {:.3f} s, solution {:.3f} to {:.3f} s".format(*spans[0], *spans[1]),
        fix=fix,
    )


def _hours_off(reference: Trajectory, track: Trajectory) -> tuple[float, float]:
    """Quarters of an hour and leap seconds with which a reference lies on a track [s], and how far from it then [m]."""
    rows = np.unique(np.linspace(0, len(reference.time) - 1, EPOCHS).astype(np.int64))
    time, origin = reference.time[rows], track.lla[0]
    there, here = ned_offset(reference.lla[rows], origin)[:, :2], ned_offset(track.lla, origin)[:, :2]
    least, most = track.time[0] - time[-1], track.time[-1] - time[0]
    zones = ZONE * np.arange(np.floor((least - LEAP) / ZONE), np.ceil((most + LEAP) / ZONE) + 1.0)
    found = (0.0, ALIKE * _spread(here))
    for offset in (zones[:, None] + [0.0, LEAP, -LEAP]).ravel():
        inside = (time + offset >= track.time[0]) & (time + offset <= track.time[-1])
        if np.count_nonzero(inside) >= FEWEST:
            away = float(
                np.median(np.linalg.norm(there[inside] - _at(time[inside] + offset, track.time, here), axis=1))
            )
            found = min(found, (float(offset), away), key=lambda each: each[1])
    return found


def _at(time: FloatArray, known: FloatArray, place: FloatArray) -> FloatArray:
    return np.column_stack([np.interp(time, known, axis) for axis in place.T[:2]])


def _spread(place: FloatArray) -> float:
    """Median distance from the middle [m]."""
    return float(np.median(np.linalg.norm(place - np.median(place, axis=0), axis=1)))
