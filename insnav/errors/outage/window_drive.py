"""The drive that windows are cut from: navigated once, its states kept where they begin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from insnav.errors.outage.windows import good
from insnav.exceptions import ConfigError, InputError
from insnav.filter.error_model import FilterState
from insnav.filter.navigate import feed
from insnav.filter.prepare import Prepared
from insnav.types import FloatArray, Run

SHORTEST, LONGEST = 10.0, 300.0  # windows [s]
SETTLED = 60.0  # no window begins earlier after the start, if the drive is long enough [s]
COUNT = 60  # windows that are to fit
CLOSEST, LEAST = 2.0, 0.1  # distance of two windows unless told otherwise, and the least to be told [s]
_SOLUTION = 0.1  # of the whole drive, for speed and course, and for its twin [s]


@dataclass(frozen=True, slots=True)
class Driven:
    """The whole drive by the forward filter, smoothed, and its states where windows begin.

    Attributes
    ----------
    ready : Prepared
    run : Run
    states : tuple of FilterState
        Where windows begin, in order of time.
    clock : float
        Time of the run minus that of the samples [s].
    """

    ready: Prepared
    run: Run
    states: tuple[FilterState, ...]
    clock: float


def starts(ready: Prepared, length: float, first: float | None = None, spacing: float | None = None) -> FloatArray:
    """Stamps of fixes at which windows may begin, evenly along the drive.

    Parameters
    ----------
    ready : Prepared
        The drive.
    length : float
        Of the windows [s].
    first : float, optional
        Where the first begins, after the start of navigation [s]; a minute, or less if the drive is short.
    spacing : float, optional
        From one to the next [s]; by default so that about sixty fit.

    Raises
    ------
    ConfigError
        A length outside 10 to 300 s, a spacing of less than 0.1 s, or a negative `first`.
    InputError
        The drive is too short.
    """
    if not SHORTEST <= length <= LONGEST:
        raise ConfigError(
            f"windows of {length:g} s make no budget",
            why="below 10 s the uncertainty of the positions is all there is; beyond 300 s errors no longer grow alike",
            fix=f"give a length of {SHORTEST:g} to {LONGEST:g} s",
        )
    if spacing is not None and not LEAST <= spacing < np.inf:
        raise ConfigError(f"windows cannot be {spacing:g} s apart", fix=f"give a spacing of {LEAST:g} s or more")
    if first is not None and not 0.0 <= first < np.inf:
        raise ConfigError(f"the first window cannot begin {first:g} s after the start", fix="give zero or more")
    stamps = ready.gps.time[good(ready.gps)]
    delay = ready.settings.delay
    begin, end = ready.initial.time, float(min(ready.imu.time[-1], stamps[-1] - delay))
    first = min(SETTLED, max(0.0, 0.5 * (end - begin - length))) if first is None else first
    room = end - begin - first - length
    if room < 0.0:
        raise InputError(
            f"the drive is too short for windows of {length:g} s",
            why=f"{end - begin:.0f} s are navigated, the first {first:.0f} s of them for the filter to settle",
            fix="give a shorter window, or begin the first one earlier",
        )
    spacing = max(CLOSEST, room / COUNT) if spacing is None else spacing
    wanted = begin + first + np.arange(int(room / spacing + 1e-9) + 1) * spacing
    on_time = stamps - delay
    at = np.unique(np.searchsorted(on_time, wanted - 1e-6))
    at = at[at < len(stamps)]
    chosen: FloatArray = stamps[at][on_time[at] <= end - length + 1e-6]
    return chosen


def driven(
    ready: Prepared, stamps: FloatArray, progress: Callable[[float], None] | None = None, *, smooth: bool = True
) -> Driven:
    """Navigate the whole drive and keep the filter's state at some fixes.

    Parameters
    ----------
    ready : Prepared
        The drive.
    stamps : (n,) array
        Of fixes [s].
    progress : callable, optional
        Called with the fraction done.
    smooth : bool
        Go backwards as well, for smoothed starts and for a twin.
    """
    rows = np.searchsorted(ready.gps.time, stamps - 1e-6)
    settings = replace(ready.settings, smooth=smooth, output_interval=_SOLUTION)
    navigator = replace(ready, settings=settings).navigator(marks=set(rows.tolist()))
    feed(navigator, ready.imu, progress)
    run = navigator.finish()
    states = tuple(state for _, state in sorted(navigator.kept.items()))
    return Driven(ready, run, states, run.gps_delay - ready.settings.delay)
