"""Fixes that stay as they are while the vehicle goes on: a receiver that repeats its last one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.earth import ned_offset
from insnav.plain_text import moment
from insnav.tabular import runs_of
from insnav.types import Event, EventKind, GpsData, ImuData

UNUSABLE = 1e4  # standard deviation of positions that are none [m]
# way of the velocities at one position, where that is written with jitter, which goes so small a part of it, and where
# it is not: in all [m], in steps as well as positions are written, and faster than velocities drift at rest [m/s]
FROZEN, HARDLY, SAME, STEPS, AT_REST = 30.0, 0.01, 3.0, 10.0, 0.5
PARKED = 0.2  # of their sd: positions of a vehicle that rests while its velocities are false scatter by more
# Where velocities are repeated too, or none are given, samples tell motion: for so long [s], means over so long [s]
# scatter by more than at any rest [m/s^2], in a vehicle that goes so far [m]
WHILE, MEANS, SHAKEN, JOURNEY = 10.0, 2.0, 0.3, 100.0


def without_frozen(gps: GpsData, imu: ImuData) -> tuple[GpsData, list[Event]]:
    """Fixes without positions that stay the same in motion, nor velocities that are repeated there; and an event.

    Motion shows in the velocities, or in the samples where all of a fix is repeated.
    """
    position_sd, v_n, frozen = gps.position_sd.copy(), gps.v_n.copy(), list[tuple[float, float, int, int]]()
    moved = ned_offset(gps.lla[1:], gps.lla[:-1])
    mean = np.nan_to_num(0.5 * (v_n[1:] + v_n[:-1])[:, :2])
    gone = mean * (np.diff(gps.time) * (np.linalg.norm(mean, axis=1) > AT_REST))[:, None]
    level = np.abs(moved[:, :2])
    step, written = np.linalg.norm(level, axis=1), float(np.min(level, initial=FROZEN, where=level != 0.0))
    jitter = np.minimum(HARDLY * np.linalg.norm(gone, axis=1), PARKED * gps.position_sd[1:, :2].min(axis=1))
    same = (step == 0.0) | (step < jitter)
    repeated = (moved == 0.0).all(axis=1) & ((np.diff(v_n, axis=0) == 0.0) | np.isnan(v_n[1:])).all(axis=1)
    travels = float(np.ptp(ned_offset(gps.lla, gps.lla[0])[:, :2], axis=0).max(initial=0.0)) > JOURNEY
    for first, last in runs_of(same if gps.fix is None else same & (gps.fix[1:] != 0)):
        far, rows = float(np.linalg.norm(gone[first:last].sum(axis=0))), slice(first + 1, last + 1)
        least, whole = (
            FROZEN if step[first:last].any() else max(SAME, STEPS * written),
            bool(repeated[first:last].all()),
        )
        if far > least or (whole and travels and _moves(imu, float(gps.time[first]), float(gps.time[last]))):
            position_sd[rows] = UNUSABLE
            v_n[rows][repeated[first:last]] = np.nan
            frozen.append((far, least, first, last))
    if not frozen:
        return gps, []
    far, least, first, last = max(frozen)
    more = f", and {len(frozen) - 1} times for a shorter way" * (len(frozen) > 1)
    shown = f"the velocities go {far:.2g} m" if far > least else "the IMU moves"
    when = moment(float(gps.time[first]), float(gps.time[last]))
    text = f"positions of the fixes are frozen from {when}, in which {shown}{more}: not used"
    said = Event(float(gps.time[first]), EventKind.GPS_FROZEN, far, least, "m", text)
    return replace(gps, position_sd=position_sd, v_n=v_n), [said]


def _moves(imu: ImuData, first: float, last: float) -> bool:
    """Whether specific force changes as in no vehicle at rest."""
    rows = slice(*np.searchsorted(imu.time, [first, last]).tolist())
    time, accel = imu.time[rows], imu.accel[rows]
    if last - first < WHILE or time.size < WHILE:
        return False
    scale = 1.0 / float(np.median(np.diff(time))) if imu.sampling == "increment" else 1.0
    width = max(1, int(time.size * MEANS / (last - first)))
    count = time.size // width
    means = scale * np.einsum("ijk->ik", accel[: count * width].reshape(count, width, 3)) / width
    return float(np.linalg.norm(np.std(means, axis=0))) > SHAKEN
