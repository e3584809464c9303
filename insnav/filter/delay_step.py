"""A delay of the fixes that changes within a drive, as of a receiver that begins to lag.

The delay is a state of the filter, constant throughout; the adjoint of the smoother shows the change of it that later
fixes ask for (see `insnav.filter.shocks`). Where one stands out, all fixes are put on the smaller of both delays and
the drive is prepared and navigated anew: a state of the filter goes only half way, and so is done a few times. Which of
both is right the drive does not tell; standard deviations hold the other one, and where a jump of the fixes explains as
much, that, too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from insnav.filter.changes import BETTER, either, widened
from insnav.filter.navigate import Navigated
from insnav.filter.prepare import Prepared
from insnav.filter.whole_record import stretches, unlikely
from insnav.plain_text import moment
from insnav.types import DelayStep, Event, EventKind, FloatArray, GpsData, Run

ROUNDS = 5  # of moving fixes
SAME = 0.2  # part of the largest move; smaller ones are none


def with_one_delay(
    fixes: GpsData | None, navigated: Callable[[GpsData | None], tuple[Prepared, Navigated]]
) -> tuple[Prepared, Navigated]:
    """Navigate, and again with fixes on one delay if that changes; the likelier of both.

    `navigated`: prepares and navigates with other fixes.
    """
    first = other = navigated(fixes)
    assert fixes is not None  # else there was nothing to navigate
    late, some, sure = np.zeros(fixes.time.size), fixes, True
    for _ in range(ROUNDS):
        smoothed = other[1].run.smoothed
        if smoothed is None or smoothed.delay_step is None:
            break
        step = smoothed.delay_step
        sure = sure and (step.sure or other is not first)
        late += moved(step, fixes.time - other[0].settings.delay - late)
        time = fixes.time - late
        kept = time > np.maximum.accumulate(np.concatenate([[-np.inf], time[:-1]]))
        some = replace(fixes, time=time).rows(kept)
        other = navigated(some)
    if other is first or _cost(*other, some) > _cost(*first, fixes) - BETTER:
        return first
    ready, done = other
    run = _told(done.run, fixes.time, late)
    if not sure:
        said = (event for event in first[1].run.events if event.kind is EventKind.CONTRADICTION)
        run = either(replace(run, events=(*run.events, *said)), first[1].run)
    return ready, replace(done, run=run)


def _cost(ready: Prepared, done: Navigated, gps: GpsData) -> float:
    """How unlikely a drive was, whatever standard deviations its fixes came with, and all that had to be explained."""
    same = np.ones_like(gps.lla)
    total = unlikely(done.run, replace(gps, position_sd=same, velocity_sd=same), ready.settings)
    return total + BETTER * sum(event.kind is EventKind.CONTRADICTION for event in done.run.events)


def moved(step: DelayStep, time: FloatArray) -> FloatArray:
    """By how much fixes at some times are later than with the smaller delay [s]."""
    change = step.after - step.before
    right = change if abs(step.after) < abs(step.before) else 0.0
    return np.asarray(np.where(time >= step.time, change, 0.0) - right)


def _told(run: Run, time: FloatArray, late: FloatArray) -> Run:
    """An event for each stretch of fixes that were moved, and standard deviations that hold them as they were."""
    largest = float(np.abs(late).max())
    events = []
    for begin, end in stretches(time, np.abs(late) > SAME * largest):
        size = float(np.median(late[(time >= begin) & (time <= end)]))
        said = f"fixes from {moment(begin, end)} are {abs(size):.2g} s {'later' if size > 0.0 else 'earlier'} than the"
        said += " others: moved; standard deviations hold both"
        events.append(Event(begin, EventKind.CONTRADICTION, abs(size), np.nan, "s", said))
    return replace(widened(run, lambda solution: largest * solution.v_n, 0.0), events=(*events, *run.events))
