"""Free-inertial windows slid along a drive: navigated from the filter's state, compared with what is known better."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from insnav.attitude import rph_from_quat
from insnav.errors.metrics import MOVING_M_S
from insnav.errors.outage.window_drive import Driven
from insnav.errors.outage.window_reference import Judge
from insnav.errors.outage.window_start import StartChoice, alone, forward_start, smoothed_start, uncalibrated
from insnav.errors.outage.windows import part_of, shown_only
from insnav.exceptions import InputError
from insnav.filter.error_model import FilterState
from insnav.filter.navigate import feed
from insnav.filter.navigator import Navigator
from insnav.filter.prepare import Prepared
from insnav.filter.settings import FilterSettings
from insnav.kernels.errorstate import STATES
from insnav.types import BoolArray, FloatArray, GpsData

Motion = Literal["static", "straight", "turning"]
MOTIONS: tuple[Motion, ...] = ("static", "straight", "turning")

TURNED = np.deg2rad(15.0)  # a window whose heading stays within this is straight [rad]
HOLE = 10.0  # without anything to judge by for longer than this, and than three intervals of it, is a gap [s]
LOST = 6  # samples in a row that make a gap of the IMU record
_UNDER_WAY = 1.0  # course is the direction of the velocity above this [m/s]


@dataclass(frozen=True, slots=True)
class Windows:
    """n windows of one length, seen at k times since their start.

    Attributes
    ----------
    length, spacing : float
        Of each, and from one to the next as asked for [s].
    start : (n,) array
        Stamp of the last fix each has seen [s].
    grid : (k,) array
        Times since the start that the tables are for [s].
    elapsed : (n, k) array
        Times since the start of the epochs that stand for them [s].
    error : (n, k, 6) array
        Navigated minus judged position North, East, Down [m] and velocity [m/s]; ``NaN`` where there is nothing to
        judge by.
    covariance : (n, k, 6, 6) array
        Predicted, of position and velocity.
    judge_sd : (n, k, 6) array
        Standard deviation of what it is judged by.
    course : (n, k) array
        Direction of travel [rad]; ``NaN`` in windows at rest.
    q_nb : (n, k + 1, 4) array
        Navigated attitude, the first at the start.
    v_n : (n, k + 1, 3) array
        Navigated velocity, the first at the start [m/s].
    lla : (n, 3) array
        Where it starts [rad], [rad], [m].
    start_covariance : (n, 21, 21) array
        Of the errors at the start.
    motion : (n,) array of str
        ``static``, ``straight`` or ``turning``.
    dropped : dict
        Reason to number of windows left out for it.
    raw : bool
        The filter's estimates of sensor errors were not taken off.
    """

    length: float
    spacing: float
    start: FloatArray
    grid: FloatArray
    elapsed: FloatArray
    error: FloatArray
    covariance: FloatArray
    judge_sd: FloatArray
    course: FloatArray
    q_nb: FloatArray
    v_n: FloatArray
    lla: FloatArray
    start_covariance: FloatArray
    motion: np.ndarray
    dropped: dict[str, int]
    raw: bool

    @property
    def count(self) -> int:
        """Number of windows."""
        return len(self.start)

    def only(self, chosen: BoolArray | np.ndarray) -> Windows:
        """Some of the windows."""
        return replace(self, **{name: getattr(self, name)[chosen] for name in _Window.__slots__})


def free_windows(
    drive: Driven,
    judge: Judge,
    length: float,
    spacing: float,
    *,
    raw: bool = False,
    start: StartChoice = "forward",
    times: FloatArray | None = None,
    progress: Callable[[float], None] | None = None,
) -> Windows:
    """Navigate windows without any fix.

    Parameters
    ----------
    drive : Driven
        With the states they begin at.
    judge : Judge
        What counts as true.
    length, spacing : float
        Of the windows, as in `starts` [s].
    raw : bool
        Do not take off the sensor errors that the filter has estimated; what is predicted then comes from the turn-on
        figures of the IMU.
    start : {"forward", "smoothed"}
        A smoothed start knows the fixes in and after the window: it is not independent of them.
    times : (k,) array, optional
        Since the start, at which to compare [s]; by default every second, or as often as there is something.
    progress : callable, optional
        Called with the fraction done.

    Raises
    ------
    InputError
        No window is left: each touches a gap.
    """
    ready, delay = drive.ready, drive.ready.settings.delay
    settings = alone(ready.settings, withheld=judge.withheld)
    spread = max(1.0, float(np.median(np.diff(judge.fixes.time))))
    grid: FloatArray = np.arange(1.0, int(length / spread + 1e-6) + 1.0) * spread if times is None else times
    gaps = _gaps(ready, judge)
    course = _course(drive)
    found: list[_Window] = []
    dropped: dict[str, int] = {}
    for number, state in enumerate(drive.states):
        begin = state.time + delay
        reason = _touches(gaps, begin, begin + length)
        shown, known = _shown(judge.fixes, begin + grid, 0.5 * spread)
        if reason is None and not known[-1]:
            reason = "nothing to judge by at its end"
        first = forward_start(state, settings, judge.lever_b)
        if start == "smoothed" and reason is None:
            seen = smoothed_start(first, drive.run, drive.clock)
            reason = "no fix was used at its start" if seen is None else None
            first = first if seen is None else seen
        if reason is not None:
            dropped[reason] = dropped.get(reason, 0) + 1
            continue
        first = uncalibrated(first, ready.model) if raw else first
        found.append(_navigated(part_of(ready, first, length), first, shown, known, settings, course))
        if progress is not None:
            progress((number + 1) / len(drive.states))
    if not found:
        why = ", ".join(f"{count}: {reason}" for reason, count in dropped.items())
        raise InputError(
            f"no window of {length:g} s is left",
            why=f"of {len(drive.states)}, {why or 'none begins at a fix'}",
            fix="give a shorter window, a longer drive or a reference without holes",
        )
    columns = {name: np.stack([getattr(each, name) for each in found]) for name in _Window.__slots__}
    return Windows(length=length, spacing=spacing, grid=grid, dropped=dropped, raw=raw, **columns)


@dataclass(frozen=True, slots=True)
class _Window:
    """One of `Windows`, its fields under the same names."""

    start: float
    elapsed: FloatArray
    error: FloatArray
    covariance: FloatArray
    judge_sd: FloatArray
    course: FloatArray
    q_nb: FloatArray
    v_n: FloatArray
    lla: FloatArray
    start_covariance: FloatArray
    motion: Motion


def _navigated(
    part: Prepared,
    first: FilterState,
    shown: GpsData,
    known: BoolArray,
    settings: FilterSettings,
    course: tuple[FloatArray, FloatArray, FloatArray],
) -> _Window:
    """Navigate one window from its first state to the last of its epochs."""
    delay = part.settings.delay
    navigator = Navigator(first, part.model, shown, part.alignment, part.nominal, settings)
    feed(navigator, part.imu)
    run = navigator.finish()
    seen, at = run.innovations, run.epochs
    judge_sd = np.column_stack([shown.position_sd, shown.velocity_sd])
    covariance = at.covariance[:, :6, :6].copy()
    # the filter's own uncertainty of what is compared: arm and clock are in it, the judge is not
    own = seen.sd**2 - judge_sd**2
    axis = np.arange(6)
    covariance[:, axis, axis] = np.where(np.isfinite(own) & (own > 0.0), own, covariance[:, axis, axis])
    begin = first.time + delay
    time, speed, direction = course
    inside = (time >= begin) & (time <= shown.time[-1])
    motion = _motion(speed[inside], rph_from_quat(np.vstack([first.x[None, 6:], at.q_nb]))[:, 2])
    return _Window(
        begin,
        shown.time - begin,
        np.where(known[:, None], -seen.innovation, np.nan),
        covariance,
        judge_sd,
        np.interp(shown.time, time, direction) if motion != "static" else np.full(len(shown.time), np.nan),
        np.vstack([first.x[None, 6:], at.q_nb]),
        np.vstack([first.x[None, 3:6], at.v_n]),
        first.x[:3].copy(),
        first.covariance[:STATES, :STATES].copy(),
        motion,
    )


def _motion(speed: FloatArray, heading: FloatArray) -> Motion:
    if speed.size == 0 or float(speed.max()) < MOVING_M_S:
        return "static"
    return "straight" if float(np.ptp(np.unwrap(heading))) <= TURNED else "turning"


def _shown(judge: GpsData, wanted: FloatArray, close: float) -> tuple[GpsData, BoolArray]:
    """What a window is compared with at the times of the grid, and whether there is anything so close to each."""
    after = np.clip(np.searchsorted(judge.time, wanted), 1, len(judge.time) - 1)
    at = np.where(wanted - judge.time[after - 1] < judge.time[after] - wanted, after - 1, after)
    nearest = judge.time[at]
    known: BoolArray = np.asarray(np.abs(nearest - wanted) <= close + 1e-6)
    known[1:] &= nearest[1:] > nearest[:-1]
    # the filter tells its state at all of them
    return shown_only(replace(judge.rows(at), time=np.where(known, nearest, wanted))), known


def _gaps(ready: Prepared, judge: Judge) -> list[tuple[FloatArray, FloatArray, str]]:
    """Begins and ends of the holes of the IMU record and of the judge [s], in the time of the fixes."""
    time = ready.imu.time
    lost = np.flatnonzero(np.diff(time) > (LOST + 0.5) * ready.nominal)
    delay = ready.settings.delay
    stamps = judge.fixes.time
    step = np.diff(stamps)
    dark = np.flatnonzero(step > max(HOLE, 3.0 * float(np.median(step))))
    begin, end = (
        np.concatenate([[-np.inf], stamps[dark], stamps[-1:]]),
        np.concatenate([stamps[:1], stamps[dark + 1], [np.inf]]),
    )
    return [
        (time[lost] + delay, time[lost + 1] + delay, "hole in the IMU record"),
        (begin, end, "gap in what it is judged by"),
    ]


def _touches(gaps: Sequence[tuple[FloatArray, FloatArray, str]], begin: float, end: float) -> str | None:
    for starts_at, ends_at, reason in gaps:
        if np.any((starts_at < end - 1e-6) & (ends_at > begin + 1e-6)):
            return reason
    return None


def _course(drive: Driven) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time in that of the fixes, speed and direction of travel of the whole drive, straight across the stops."""
    solution = drive.run.solution
    time = solution.time - drive.clock + drive.ready.settings.delay
    v_north, v_east = solution.v_n[:, 0], solution.v_n[:, 1]
    speed = np.hypot(v_north, v_east)
    moving = speed > _UNDER_WAY
    if not moving.any():
        return time, speed, np.zeros_like(speed)
    direction = np.unwrap(np.arctan2(v_east[moving], v_north[moving]))
    return time, speed, np.interp(time, time[moving], direction)
