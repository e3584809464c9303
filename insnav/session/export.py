"""Export of a run to the format of another program."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from insnav.exceptions import ConfigError, InputError
from insnav.input.formats.time_scales import DAY, EPOCH, UNIX_DAYS, WEEK_DAYS, leap_seconds
from insnav.output.folder import read_facts
from insnav.output.solution_tables import has_smoothed, read_solution
from insnav.output.track_files import WRITERS, Track
from insnav.plain_text import plain_text
from insnav.types import FloatArray

Solution = Literal["smoothed", "filtered"]
_START = EPOCH.astype("datetime64[ns]")
_UNIX_FROM = 1e9  # larger times are Unix time [s]


def export(folder: Path, kind: str, *, solution: Solution | None = None, week: int | None = None) -> bytes:
    """Convert a run to another format.

    `folder`: of a run. `kind`: one of `insnav.output.track_files.WRITERS`. `solution`: by default smoothed, if present.
    `week`: GPS week of the first epoch, if neither fixes nor times determine it.
    Raises: InputError: no such run. ConfigError: an unknown format, or a missing date.
    """
    if kind not in WRITERS:
        raise ConfigError("session.unknown_format", where="--to", value=str(kind), known=tuple(WRITERS))
    facts = read_facts(folder)
    smoothed = solution == "smoothed" or (solution is None and has_smoothed(folder))
    trajectory = read_solution(folder, "smoothed" if smoothed else "solution")
    known = np.isfinite(np.hstack((trajectory.lla, trajectory.v_n))).all(axis=1)
    if not known.all():
        lost, where = int(np.sum(~known)), str(folder)
        raise InputError("session.rows_without_position", where=where, count=int(lost))
    inputs = facts.get("input", {})
    gps = inputs.get("gps", {}) if isinstance(inputs, dict) else {}
    utc, gps_time = _instants(trajectory.time, _week(inputs) if week is None else week)
    name = f"{plain_text(folder.resolve().name)}, {'smoothed' if smoothed else 'filtered'}"
    written = WRITERS[kind](Track(trajectory, name, utc, gps_time, gps.get("height") or "ellipsoidal"))
    return written if isinstance(written, bytes) else written.encode()


def _week(inputs: Any) -> int | None:
    """Return the GPS week from reading the files; the solution uses the time of the fixes."""
    found = (inputs.get(key) for key in ("gps", "reference", "imu"))
    return next((each["gps_week"] for each in found if isinstance(each, dict) and "gps_week" in each), None)


def _instants(
    time: FloatArray, week: int | None
) -> tuple[NDArray[np.datetime64], NDArray[np.datetime64]] | tuple[None, None]:
    """Convert seconds of a GPS week, or Unix time, to UTC and GPS time; None if neither."""
    if time[0] > _UNIX_FROM:
        since = time - UNIX_DAYS * DAY
        day = np.floor(since / DAY)
        utc = _START + np.round(since * 1e6).astype(np.int64) * np.timedelta64(1, "us")
        return utc, utc + leap_seconds(day, since - DAY * day).astype(np.int64) * np.timedelta64(1, "s")
    if week is None:
        return None, None
    gps = _START + int(week * WEEK_DAYS) * np.timedelta64(1, "D") + np.round(time * 1e9).astype(np.int64)
    day = WEEK_DAYS * week + np.floor(time / DAY)
    # the table is in UTC: within a leap second it may be wrong by one, which drives hardly meet
    ahead = leap_seconds(day, time % DAY - 18.0)
    return gps - ahead.astype(np.int64) * np.timedelta64(1, "s"), gps
