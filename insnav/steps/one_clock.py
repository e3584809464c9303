"""Step 2: put the samples on the clock of the fixes.

The offset between Unix time and GPS time is applied. Other offsets are estimated from the motion and refused.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from insnav import spill
from insnav.alignment.clock_offset import SHOWN, ClockOffset, Unlike, likeness, turn_scale
from insnav.exceptions import InputError
from insnav.filter.gps_noise import clock_offset
from insnav.findings import Code, Finding
from insnav.input import Reading, check_overlap
from insnav.input.interpret.overlap import epoch_offset, named_offset, overlap
from insnav.input.interpret.physics import odd_one
from insnav.steps import Model, Recording
from insnav.steps.given import mounting_of, refuse_unlike_gyros
from insnav.strapdown import Intervals, joined, pieces
from insnav.types import GpsData, ImuData
from insnav.units import DEG

WORTH = 1.5  # smaller offsets are left to the delay estimate of the filter [s]
SURE, FACTOR = 0.7, 1.5  # least correlation, and largest remaining scale error, to identify a unit [-]
SIGMAS = 6.0  # least significance of an offset, in sd [-]
EXPLAINS = 0.5  # largest unexplained variance in the new unit, relative to the unit as read [-]
BOTH = 0.6  # correlation of turns and accelerations that only one drive has: ten true offsets had 0.68 or more [-]


def one_clock(recording: Recording, model: Model) -> tuple[Recording, Model, tuple[Finding, ...]]:
    """Put samples, and logs recorded with them, on the clock of the fixes.

    Raises: InputError: no common time, no common motion, or a clock offset (with the value to specify).
    """
    imu, gps, inputs = recording.imu, recording.gps, recording.inputs
    given, fixes = inputs.get("time_offset"), recording.fixes_by_scatter
    if gps is None or fixes is None:
        return recording if given is None else _moved(recording, given), model, ()
    offset, findings = given or 0.0, []
    if given is None and overlap(imu.data, gps.data) == 0.0:
        epochs_offset = epoch_offset(imu.data, gps.data)
        if epochs_offset is not None:
            offset = epochs_offset
            findings.append(Finding.of(Code.CLOCK_EPOCHS, subject="imu", offset_s=offset))
    if offset:
        recording = _moved(recording, offset)
        imu = recording.imu
    intervals = joined(pieces(imu.data))
    fixes = replace(fixes, time=fixes.time - (inputs.get("gps_delay") or 0.0))
    disjoint = overlap(imu.data, gps.data) == 0.0
    if not disjoint:  # check units first: turns in a wrong unit would fit at a wrong offset
        _check_gyro_unit(imu, intervals, fixes)
        if given is None:
            _check_radians(gps.facts.path, intervals, fixes)
    estimate = None if given is not None else clock_offset(intervals, fixes, worth=WORTH)
    # samples and fixes in one file belong to one drive, even if noise hides the common motion
    same_file = imu.facts.path == gps.facts.path and Path(imu.facts.path).is_file()
    if isinstance(estimate, Unlike) and not disjoint and not same_file and mounting_of(imu, fixes) is None:
        values: dict[str, Any] = {"where": f"{imu.facts.path}, {gps.facts.path}", "overlap_s": estimate.overlap}
        if estimate.at_rest:
            raise InputError("clock.imu_at_rest", **values)
        raise InputError("clock.two_drives", turns=estimate.turns, forces=estimate.accelerations, **values)
    if isinstance(estimate, ClockOffset) and abs(estimate.offset) > max(WORTH, SIGMAS * estimate.sd):
        if not disjoint:  # with a wrong turn axis, another offset would seem to fit
            refuse_unlike_gyros(imu, fixes)
        offset, parts_of_it = named_offset(offset + estimate.offset, estimate.sd)
        turns, forces = (r if r > SHOWN else np.nan for r in (abs(estimate.turns), estimate.accelerations))
        certain = min(abs(estimate.turns), estimate.accelerations) > BOTH
        raise InputError(
            "clock.no_common_time" if disjoint else "clock.differ",
            where=f"{imu.facts.path}, {gps.facts.path}",
            gives={"time_offset": offset},
            imu_s=tuple(imu.data.time[[0, -1]]),
            gps_s=tuple(gps.data.time[[0, -1]]),
            offset_s=offset,
            found_s=estimate.offset,
            sd_s=estimate.sd,
            overlap_s=estimate.overlap,
            turns=turns,
            forces=forces,
            **parts_of_it,
            other_drive="" if certain else "--imu-time-offset",
        )
    check_overlap(imu.data, gps.data)
    return recording, model, tuple(findings)


def _check_gyro_unit(imu: Reading[ImuData], parts: Intervals, fixes: GpsData) -> None:
    """Refuse gyros whose turns differ from the turns of the course by the factor of another unit."""
    scale, correlation = turn_scale(parts, fixes)
    for factor, unit in ((DEG, "deg/s"), (1.0 / DEG, "rad/s"), (1e-3 / DEG, "mrad/s")):
        if correlation > SURE and 1.0 / FACTOR < scale / factor < FACTOR:
            values: dict[str, Any] = {"where": imu.facts.path, "ratio": 1.0 / scale, "correlation": correlation}
            if (odd := odd_one(list(imu.data.gyro.T))) is not None:
                raise InputError("clock.gyro_unit_odd", axis="xyz"[odd], **values)
            refuse_unlike_gyros(imu, fixes)
            raise InputError("clock.gyro_unit", gives={"units": {"gyro": unit}}, unit=unit, **values)


def _check_radians(path: str, parts: Intervals, fixes: GpsData) -> None:
    """Refuse latitudes or longitudes whose accelerations match the samples only if they are radians."""
    for column, name in enumerate(("latitudes", "longitudes")):
        if np.max(np.abs(fixes.lla[:, column])) < (0.5 * np.pi, np.pi)[column] * DEG:
            lla = fixes.lla.copy()
            lla[:, column] /= DEG
            as_read, as_radians = likeness(parts, fixes, replace(fixes, lla=lla))
            if as_radians > SURE and 1.0 - as_radians**2 < EXPLAINS * (1.0 - as_read**2):
                raise InputError("clock.radians", where=path, quantity=name, correlation=as_radians, as_read=as_read)


def _moved(recording: Recording, offset: float) -> Recording:
    """Shift samples, and logs that overlap them, by `offset` [s]."""
    imu = recording.imu
    first, last = float(imu.data.time[0]), float(imu.data.time[-1])
    logs = {
        name: replace(log, data=replace(log.data, time=log.data.time + offset))
        if log.data.time[-1] > first and log.data.time[0] < last
        else log
        for name, log in recording.logs.items()
    }
    facts = replace(imu.facts, start_s=imu.facts.start_s + offset, end_s=imu.facts.end_s + offset)
    events = tuple(event.later(offset) for event in imu.events)
    data = replace(imu.data, time=spill.by_blocks(lambda time: time + offset, imu.data.time))
    return replace(recording, imu=Reading(data, events, facts), logs=logs)
