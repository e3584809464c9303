"""A delay of the fixes that changes within a drive, as of a receiver that begins to lag.

The delay is a state of the filter, constant throughout; the adjoint of the smoother shows the change of it that later
fixes ask for (see `insnav.filter.shocks`). Where one stands out, all fixes are put on the smaller of both delays and
the drive is prepared and navigated anew: a state of the filter goes only half way, and so is done a few times. Which of
both is right the drive does not tell; standard deviations hold the other one, and where a jump of the fixes explains as
much, that, too. What a drift of the clock explains as well, or is gone without fixes that were false, is no step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from insnav.filter.changes import BETTER, either, widened
from insnav.filter.gps_delay import LARGEST_DRIFT
from insnav.filter.navigate import Navigated
from insnav.filter.prepare import Prepared
from insnav.filter.shocks import scatter
from insnav.filter.whole_record import rows_of, stretches, unlikely
from insnav.findings import CONTRADICTIONS, Code, Finding, of_code
from insnav.types import DelayStep, FloatArray, GpsData, Run, Trajectory

ROUNDS = 5  # of moving fixes
PARTS = 0.5, 1.0, 1.5  # of the drift of the clock that a step may stand for
MOVES, SHOWN = 1.0, 10.0  # at rest nothing shows a delay: faster [m/s], and for longer on either side of a step [s]
SAME = 0.2  # part of the largest move; smaller ones are none

Solved = tuple[Prepared, Navigated]


def with_one_delay(first: Solved, fixes: GpsData, navigated: Callable[..., Solved]) -> Solved:
    """Navigate again with fixes on one delay if that changes; the likelier of both.

    `first`: with the fixes as they are; `navigated`: prepares and navigates with other fixes, and with the clock of the
    samples from where it is looked for.
    """
    other = first
    late, some, sure = np.zeros(fixes.time.size), fixes, True
    cost = cost_of_first = _cost(*first, fixes)
    for _ in range(ROUNDS):
        smoothed = other[1].run.smoothed
        if smoothed is None or smoothed.delay_step is None:
            break
        step = smoothed.delay_step
        if not _shows_both(smoothed.solution, step):
            break
        later = late + moved(step, fixes.time - other[0].settings.delay - late)
        time = fixes.time - later
        kept = time > np.maximum.accumulate(np.concatenate([[-np.inf], time[:-1]]))
        tried = replace(fixes, time=time).rows(kept)
        solved = navigated(tried)
        if (by_moved := _cost(*solved, tried)) > cost:  # what is no step is not likelier half way to it
            break
        sure = sure and (step.sure or other is not first)
        other, late, some, cost = solved, later, tried, by_moved
    if other is first or cost > cost_of_first - _margin(other):
        return first
    found, row = other[1].run.innovations, rows_of(other[1].run, some, other[0].settings)
    false = np.isin(fixes.time - late, some.time[row[np.isfinite(found.nis_position) & ~found.used_position]])
    if false.any():
        ready, done = navigated(fixes.rows(~false))
        if done.run.smoothed is not None and done.run.smoothed.delay_step is None:  # false fixes looked like one
            more = (each for each in _contradictions(other) if each not in done.run.events)
            return ready, replace(done, gps=first[1].gps, run=replace(done.run, events=(*done.run.events, *more)))
    rates = _rates_of_drift(first[0], late, float(fixes.time[-1] - fixes.time[0]))
    drifting = [navigated(fixes, _clock_of(first[0], other, fixes, late, rate)) for rate in rates]
    costs = [_cost(*each, fixes) for each in drifting]
    if (rate := _likeliest_rate(rates, costs)) is not None:
        drifting.append(navigated(fixes, _clock_of(first[0], other, fixes, late, rate)))
        costs.append(_cost(*drifting[-1], fixes))
    if costs and min(costs) < cost + _margin(other):
        # a delay that was given stays, and is reported to contradict the drive
        return drifting[int(np.argmin(costs))] if first[0].settings.delay_sd > 0.0 else first
    ready, done = other
    run = _with_steps(done.run, fixes.time, late)
    if not sure:
        run = either(replace(run, events=(*run.events, *_contradictions(first))), first[1].run)
    return ready, replace(done, run=run)


def _rates_of_drift(ready: Prepared, late: FloatArray, length: float) -> list[float]:
    """Return rates of the clock that look like a step, and none where the delay was given: it may just be another.

    `late` (n,): by how much fixes were moved [s]; `length`: of the drive [s].
    """
    # means before and after the middle of a drift are half of it apart
    slope = 2.0 * float(late[-1] - late[0]) / length
    rates = [part * slope for part in PARTS if abs(part * slope) <= LARGEST_DRIFT]
    return rates if ready.settings.delay_sd > 0.0 else [*rates, 0.0]


def _clock_of(ready: Prepared, other: Solved, fixes: GpsData, late: FloatArray, rate: float) -> tuple[float, float]:
    """Return the clock at the start [s], and its rate, that has the mean delay of fixes that were moved by `late`."""
    mean = other[1].run.gps_delay + float(late.mean()) - ready.settings.delay
    total = ready.rate + rate
    return mean - 0.5 * total * float(fixes.time[-1] - fixes.time[0]), total


def _likeliest_rate(rates: list[float], costs: list[float]) -> float | None:
    """Return the rate at the top of a parabola through the first three; none without one."""
    if len(costs) < 3:
        return None
    curve = np.polyfit(rates[:3], costs[:3], 2)
    top = -0.5 * curve[1] / curve[0]
    return float(top) if curve[0] > 0.0 and abs(top) <= LARGEST_DRIFT else None


def _shows_both(track: Trajectory, step: DelayStep) -> bool:
    """Whether the vehicle moves for long before and after a step: what a departure shows of attitude looks like one."""
    spent = np.diff(track.time, append=track.time[-1]) * (np.linalg.norm(track.v_n, axis=1) > MOVES)
    before = float(spent[track.time < step.time].sum())
    return min(before, float(spent.sum()) - before) > SHOWN


def _margin(solved: Solved) -> float:
    """By how much likelier a drive must be, by the size of its innovations and how alike they are."""
    squares, count = scatter(solved[1].run.innovations, solved[1].run.innovations.time)
    return BETTER * max(1.0, float(squares.sum() / count.sum()))


def _cost(ready: Prepared, done: Navigated, gps: GpsData) -> float:
    """How unlikely a drive was, whatever standard deviations its fixes came with, and all that had to be explained."""
    same = np.ones_like(gps.lla)
    total = unlikely(done.run, replace(gps, position_sd=same, velocity_sd=same), ready.settings)
    return total + BETTER * sum(1 for _ in of_code(done.run.events, *CONTRADICTIONS))


def _contradictions(solved: Solved) -> list[Finding]:
    """Contradictions in a run that its preparation did not report already: each preparation finds the same."""
    return [each for each in of_code(solved[1].run.events, *CONTRADICTIONS) if each not in solved[0].faults]


def moved(step: DelayStep, time: FloatArray) -> FloatArray:
    """By how much fixes at some times are later than with the smaller delay [s]."""
    change = step.after - step.before
    right = change if abs(step.after) < abs(step.before) else 0.0
    return np.asarray(np.where(time >= step.time, change, 0.0) - right)


def _with_steps(run: Run, time: FloatArray, late: FloatArray) -> Run:
    """Report each stretch of fixes that were moved, with standard deviations that hold them as they were."""
    largest = float(np.abs(late).max())
    events = []
    for begin, end in stretches(time, (np.abs(late) > SAME * largest) & (time >= run.solution.time[0])):
        size = float(np.median(late[(time >= begin) & (time <= end)]))
        events.append(Finding.of(Code.CHANGE_DELAY, begin, end, subject="gps", delay_s=size))
    return replace(widened(run, lambda solution: largest * solution.v_n, 0.0), events=(*events, *run.events))
