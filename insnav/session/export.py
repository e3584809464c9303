"""Export of a run to the format of another program, at its rows or at other epochs, for the IMU or another point."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from insnav.attitude import wrap_pi
from insnav.earth import ned_offset
from insnav.errors.metrics import interpolated
from insnav.exceptions import ConfigError, InputError
from insnav.filter.run_recorder import move_to_point
from insnav.findings import Code, Finding
from insnav.input.formats.time_scales import DAY, EPOCH, UNIX_DAYS, WEEK_DAYS, leap_seconds
from insnav.output.folder import read_facts
from insnav.output.solution_tables import has_smoothed, read_solution
from insnav.output.track_files import WRITERS, Track, body_motion
from insnav.plain_text import plain_text
from insnav.steps.given import vector
from insnav.types import FloatArray, Trajectory

Solution = Literal["smoothed", "filtered", "poses"]
_START = EPOCH.astype("datetime64[ns]")


def export(folder: Path, kind: str, **how: Any) -> bytes:
    """Convert a run to another format.

    `folder`: run folder. `kind`: a format, one of `insnav.output.track_files.WRITERS`. `how`: options of `track_of`.
    Raises: InputError: no such run. ConfigError: an unknown format, or a missing date.
    """
    if kind not in WRITERS:
        raise ConfigError("session.unknown_format", where="--to", value=str(kind), known=tuple(WRITERS))
    return encoded(track_of(folder, **how)[0], kind)


def encoded(track: Track, kind: str) -> bytes:
    """Convert a track to the bytes of a file in format `kind`."""
    written = WRITERS[kind](track)
    return written if isinstance(written, bytes) else written.encode()


def track_of(
    folder: Path,
    *,
    solution: Solution | None = None,
    week: int | None = None,
    interval: float = 0.0,
    epochs: FloatArray | None = None,
    point: FloatArray | None = None,
) -> tuple[Track, tuple[Finding, ...]]:
    """Read the track of a run.

    `solution`: by default smoothed, if present. `week`: GPS week of the first epoch, if neither fixes nor times
    determine it. `interval`: rows at its whole multiples [s]; 0: rows of the run. `epochs` (m,): times of the rows
    instead [s]. `point` (3,): point to export, forward, right, down of the IMU [m]. Its standard deviations neglect
    correlations of position, velocity and attitude, which a folder does not contain.
    Returns: the track, and findings on its interpolation.
    Raises: InputError: no such run, or no epoch in its time.
    """
    facts = read_facts(folder)
    name = solution or ("smoothed" if has_smoothed(folder) else "filtered")
    trajectory = read_solution(folder, "solution" if name == "filtered" else name)
    has_position = np.isfinite(np.hstack((trajectory.lla, trajectory.v_n))).all(axis=1)
    if not has_position.all():
        n_lost, where = int(np.sum(~has_position)), str(folder)
        raise InputError("session.rows_without_position", where=where, count=int(n_lost))
    findings: tuple[Finding, ...] = ()
    if (point := vector("point", point)) is not None:
        zero_covariance = np.zeros((len(trajectory.time), 9, 9))
        trajectory = move_to_point(trajectory, body_motion(trajectory)[0], point, zero_covariance, np.zeros(3))
    if epochs is not None or interval > 0.0:
        trajectory, findings = _resampled(trajectory, interval, epochs)
    inputs = facts.get("input", {})
    gps = inputs.get("gps", {}) if isinstance(inputs, dict) else {}
    utc, gps_time = _instants(trajectory.time, _week(inputs) if week is None else week)
    title = f"{plain_text(folder.resolve().name)}, {name}"
    return Track(trajectory, title, utc, gps_time, gps.get("height") or "ellipsoidal"), findings


def _resampled(track: Trajectory, interval: float, epochs: FloatArray | None) -> tuple[Trajectory, tuple[Finding, ...]]:
    """Interpolate at epochs or multiples of an interval; estimate the error by interpolation of every other row.

    Errors of cubic Hermite interpolation are of fourth order, of linear interpolation of second order: halving the step
    divides them by 16 and by 4 (J. Stoer and R. Bulirsch, "Introduction to Numerical Analysis", 2002, section 2.1.5).
    """
    begin, end = track.time[[0, -1]].tolist()
    if epochs is None:
        first = math.ceil(begin / interval - 1e-6)
        wanted = interval * np.arange(first, math.floor(end / interval + 1e-6) + 1)
    else:
        wanted = epochs
    out = interpolated(track, wanted)
    if not len(out.time):
        ends = (float(wanted[0]), float(wanted[-1])) if len(wanted) else (begin, begin)
        raise InputError("session.epochs_outside", where="--epochs", epochs_s=ends, solution_s=(begin, end))
    findings = []
    if epochs is not None and (missed := len(epochs) - len(out.time)):
        findings.append(Finding.of(Code.RUN_EPOCHS_MISSED, count=missed, total=len(epochs), solution_s=(begin, end)))
    if len(track.time) > 4 and not np.isin(out.time.round(6), track.time.round(6)).all():
        coarse = interpolated(track.rows(slice(None, None, 2)), track.time[1::2])
        true = track.rows(np.flatnonzero(np.isin(track.time, coarse.time)))
        if len(coarse.time):
            errors = ned_offset(coarse.lla, true.lla) / 16.0, coarse.v_n - true.v_n, wrap_pi(coarse.rph - true.rph)
            place, velocity, attitude = (float(np.nanmax(np.abs(each))) for each in errors)
            sizes: dict[str, Any] = {"velocity_m_s": velocity / 4.0, "attitude_rad": attitude / 4.0}
            findings.append(Finding.of(Code.EXPORT_INTERPOLATED, position_m=place, **sizes))
    return out, tuple(findings)


def _week(inputs: Any) -> int | None:
    """Return the GPS week of the input files, first of the fixes, since the solution has the time of the fixes."""
    facts = (inputs.get(key) for key in ("gps", "reference", "imu"))
    return next((each["gps_week"] for each in facts if isinstance(each, dict) and "gps_week" in each), None)


def _instants(
    time: FloatArray, week: int | None
) -> tuple[NDArray[np.datetime64], NDArray[np.datetime64]] | tuple[None, None]:
    """Convert seconds of a GPS week, or Unix time, to UTC and GPS time; None if the time is neither."""
    if time[0] > UNIX_DAYS * DAY:  # seconds of a week are smaller, Unix times since the GPS epoch are larger
        since = time - UNIX_DAYS * DAY
        day = np.floor(since / DAY)
        utc = _START + np.round(since * 1e6).astype(np.int64) * np.timedelta64(1, "us")
        return utc, utc + leap_seconds(day, since - DAY * day).astype(np.int64) * np.timedelta64(1, "s")
    if week is None:
        return None, None
    gps = _START + int(week * WEEK_DAYS) * np.timedelta64(1, "D") + np.round(time * 1e9).astype(np.int64)
    day = WEEK_DAYS * week + np.floor(time / DAY)
    # the table of leap seconds is in UTC: only during a leap second may this be wrong, by one second
    leap = leap_seconds(day, time % DAY - 18.0)
    return gps - leap.astype(np.int64) * np.timedelta64(1, "s"), gps
