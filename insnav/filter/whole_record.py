"""The whole record decides which fixes were false: filter and smoother repeated with robust weights.

The gates of the filter decide once, in order of time, from one side: a false first fix is believed, and a long row of
false ones is followed by a reset onto their track. After the smoother every fix can be compared with what all others,
earlier and later, say. Where filter and smoother contradict each other, the drive is navigated a few times more,
without gates: all fixes weak at first, then each weighted by its residual from the smoothed track. The weight is that
of Geman and McClure, made strict step by step (graduated non-convexity), so that no start decides.

References
----------
Yang, Antonante, Tzoumas, Carlone, "Graduated Non-Convexity for Robust Spatial Perception: From Non-Minimal Solvers to
Global Outlier Rejection", IEEE Robotics and Automation Letters 5 (2020) 1127-1134: the Geman-McClure surrogate.
Agamennoni, Nieto, Nebot, "Approximate Inference in State-Space Models With Heavy-Tailed Noise", IEEE Transactions on
Signal Processing 60 (2012) 5024-5037: smoothing repeated with weights of each measurement.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from insnav import strapdown
from insnav.attitude import dcm_from_rph
from insnav.earth import lla_offset, ned_offset
from insnav.exceptions import DivergenceError
from insnav.filter.changes import (
    AMBIGUOUS,
    AROUND,
    ATTITUDE,
    BETTER,
    BRIEF,
    FIXES_CHANGED,
    HELD,
    IMU_CHANGED,
    VELOCITY,
    at_an_end,
    beyond,
    changes_of,
    either,
    false_between,
    mixed,
    of_the_imu,
    report_changes,
    resets_of,
    unused,
    widened,
)
from insnav.filter.gates import Gates, Trust
from insnav.filter.prepare import LONGEST_GAP
from insnav.filter.settings import FilterSettings
from insnav.findings import Code, Finding, of_code
from insnav.sample_statistics import chi2_limit
from insnav.tabular import runs_of
from insnav.types import BoolArray, FloatArray, GpsData, IntArray, Run, StateChange

OPEN = Gates(max_sd=np.inf, max_speed=np.inf, probability=1.0, reset_after=np.inf)  # no gate: the weights decide
# In the first pass standard deviations are so many times those reported. Positions start the weaker: frozen or shifted
# ones contradict the velocities beside them only by their integral, and many would decide against few. Where that
# decides nothing, less may (RTK), or all fixes that fade in together, with strict limits throughout (velocities alone).
STARTS = (3000.0, 3.0, False), (1000.0, 3.0, False), (3000.0, 3.0, True)
STRICTNESS = (100.0, 30.0, 10.0, 3.0, 1.0, 1.0)  # limits of the passes, from nearly convex to strict
ALONE = ((10.0, 1.0, False),)  # positions without velocities: with more, the IMU alone would lead the track too far
FALSE = 0.1  # a fix of less weight is not used at all
LIMIT = chi2_limit(3, 0.01)  # squared normalised residual of three numbers at which a weight falls to a quarter [-]
GROSS = chi2_limit(3, 1e-9)  # of an accepted fix: filter and smoother contradict each other [-]
MEDIAN = chi2_limit(3, 0.5)
AGREEMENT = 2.0  # median squared residual, in parts of what it should be, up to which weights have made fixes agree
MOST = 0.5  # share of fixes that may be false: beyond it they are not what the others contradict
FAR = 300.0  # false positions nearer are not told from true ones without velocities, but by a run without resets [m]
LONGEST = 3.0  # fixes that the smoothed track supports may be rejected for so long [s]
ENDS = 0.2  # a fix so little before or after the track is compared with its end [s]
# likelihood of runs, twice its negative logarithm: from where on the NIS of a fix counts by its logarithm, what a
# fix costs that was not used, and as much more a row of them, however long: a false one is seldom alone [-]
LARGEST, UNUSED, EPISODE = 30.0, 10.0, 30.0
SURELY = 1.0  # twice the log-likelihood of a fix, on average, by which another explanation is better [-]
PATIENT = 60.0  # fixes between houses may be false for so long, which a filter that is good lives through [s]
LONG = 5.0  # so long false fixes at begin or end may be those before or after a jump for good [s]
WEAKER = 5.0  # times the sd of how vehicles are assumed to move, where that is doubted: gaps need it still [-]
OPEN_START = 3000.0  # standard deviation of a first position that may be false [m]


@dataclass(frozen=True, slots=True)
class Explained:
    """A run by one explanation of what contradicts."""

    run: Run
    navigate: Callable[..., Run]  # with the same once more: changes, and which fixes to leave out
    events: tuple[Finding, ...] = ()
    trust: Trust | None = None  # fixes left out
    agreed: bool = True  # whether it explains anything

    def again(self, changes: tuple[StateChange, ...], trust: Trust | None = None) -> Run:
        """Navigate with further changes, and further fixes left out."""
        return self.navigate(trust=self.trusted(trust), changes=changes)

    def trusted(self, trust: Trust | None) -> Trust | None:
        """Further fixes left out and those of this explanation."""
        if self.trust is not None and trust is not None:
            trust = replace(trust, false=trust.false | self.trust.false)
        return trust or self.trust


def residuals(run: Run, gps: GpsData, settings: FilterSettings) -> tuple[FloatArray, FloatArray]:
    """Compare fixes with the smoothed track at the antenna, velocities with that of the time they are of.

    Returns: (2, n, 3) what positions and velocities are off, North, East, Down [m], [m/s]; (2, n) its square, by the
    variance reported and smoothed: 3 on average, if both are true. ``NaN`` without a value, or outside the track.
    """
    assert run.smoothed is not None
    track = run.smoothed.solution
    assert track.sd is not None
    time = gps.time - settings.delay
    after, lla = strapdown.between(track.time, track.lla, time)
    late, v_n = strapdown.between(track.time, track.v_n, time - settings.velocity_lag)
    antenna = lla_offset(lla, dcm_from_rph(track.rph[after]) @ run.lever_b)
    turned = dcm_from_rph(track.rph[late]) - dcm_from_rph(track.rph[late - 1])  # the antenna swings about the IMU
    swing = turned @ run.lever_b / (track.time[late] - track.time[late - 1])[:, None]
    off = np.array([ned_offset(gps.lla, antenna), gps.v_n - v_n - swing])
    outside = (time < track.time[0] - ENDS) | (time > track.time[-1] + ENDS)
    near = np.minimum(time - track.time[after - 1], track.time[after] - time) <= ENDS
    outside |= (track.time[after] - track.time[after - 1] > LONGEST_GAP) & ~near
    off[:, outside] = np.nan
    smoothed = np.array([track.sd[after, :3], track.sd[after, 3:6]])
    return off, np.sum(off**2 / (np.array([gps.position_sd, gps.velocity_sd]) ** 2 + smoothed**2), axis=2)


def decided(
    first: Run, gps: GpsData, settings: FilterSettings, again: Callable[..., Run]
) -> tuple[Run, tuple[Finding, ...]]:
    """Let the whole record decide which fixes were false, or what changed and stayed so; only where it contradicts.

    `first`: with `settings`; one that is not smoothed stays as it is; `again`: navigates once more: fixes, which of
    them to leave out, a standard deviation to be added to the first position [m], changes, gates, whether false fixes
    may still count, and whether it is doubted that a vehicle moves as it is assumed to.
    Returns: the run to be believed, and what was found.
    """
    if first.smoothed is None:
        return first, ()

    def worth(run: Run, changes: tuple[StateChange, ...] = ()) -> float:
        return unlikely(run, gps, settings, unused(changes, gps, settings.delay))

    found = Explained(first, partial(again, gps, gates=settings.gates))
    bare = _without_parting(found, settings)
    if bare is not None:
        return _doubting(bare, gps, settings, again)
    against = contradicted(first, gps, settings)
    if not against and first.smoothed.surest is None:
        return first, ()
    others = list[Run]()
    starts = STARTS if np.isfinite(gps.v_n).any() else ALONE
    for start in starts if against else ():
        try:
            weighed = reconcile(first, gps, settings, again, start)
        except DivergenceError:
            continue
        if weighed.agreed:
            found, others = weighed, []
            break
        found = replace(found, events=weighed.events)
        others.append(weighed.run)
    if resets_of(first):
        for patient in _without_resets(first, settings.gates, partial(again, gps)):
            if worth(patient.run) < worth(found.run) - BETTER and _diverged(patient.run) <= _diverged(first):
                found, others = patient, []
    changes: tuple[StateChange, ...] = ()
    step = first.smoothed.delay_step
    if against or any(each.first == ATTITUDE for each in first.smoothed.likely[:1]):  # else gates hide nothing
        beside = of_moments(found.trust, gps)  # whatever else changes
        with suppress(DivergenceError):
            ungated = again(gps, trust=beside, weighing=True)
            step = (ungated.smoothed and ungated.smoothed.delay_step) or step
            _, changes, _ = changes_of(ungated, (), partial(again, gps, trust=beside), worth)
    if changes:
        ways = [partial(again, gps, gates=gates) for gates in (settings.gates, OPEN)]
        runs = [way(changes=changes, trust=beside) for way in ways]
        best = int(np.argmin([worth(run, changes) for run in runs]))
        # where false fixes explain it, changes must explain much more
        margin = BETTER if found.trust is None else max(BETTER, SURELY * first.innovations.time.size)
        if worth(runs[best], changes) <= worth(found.run) - margin:
            said_of = () if beside is None else tuple(report_false(gps, beside))
            found, others = Explained(runs[best], ways[best], said_of, beside), []
        else:
            changes = ()
    if not changes and found.run is not first and _without_parting(found, settings) is not None:
        return _doubting(again(gps, gates=settings.gates, doubting=True), gps, settings, again)
    # fixes that no gate and no smoothed track contradicts are not left out
    run, said, trust = _left_open(found, changes, gps, settings, worth, AROUND if against else BRIEF)
    if trust is not None:
        run, open_ = false_at_an_end(run, gps, settings, trust)
        said += open_
    for other in others:
        run = either(run, other)
    resets = resets_of(run)  # onto fixes that may be false
    run = mixed(run, resets) if resets else run
    assert run.smoothed is not None
    return replace(run, smoothed=replace(run.smoothed, delay_step=step)), (*found.events, *said)


def _without_resets(first: Run, gates: Gates, again: Callable[..., Run]) -> list[Explained]:
    """Runs that believe what reset the first one, and that endure it."""
    begin, found = float(first.innovations.time[0]), list[Explained]()
    accepted = Finding.of(Code.RECORD_RESETS_ACCEPTED, begin, subject="gps")
    endured = Finding.of(Code.RECORD_RESETS_ENDURED, begin, subject="gps", patience_s=PATIENT)
    for other, said in ((gates.believing(), accepted), (replace(gates, reset_after=PATIENT), endured)):
        with suppress(DivergenceError):
            found.append(Explained(again(gates=other), partial(again, gates=other), (said,)))
    return found


def _without_parting(found: Explained, settings: FilterSettings) -> Run | None:
    """The run that doubts how a vehicle is assumed to move, if fixes part from the IMU only where it does not."""
    surest = None if found.run.smoothed is None else found.run.smoothed.surest
    if not settings.aiding or surest is None or of_the_imu(surest):
        return None
    with suppress(DivergenceError):
        bare = found.navigate(trust=found.trust, doubting=True)
        if bare.smoothed is not None and bare.smoothed.surest is None:
            return bare
    return None


def _doubting(
    first: Run, gps: GpsData, settings: FilterSettings, again: Callable[..., Run]
) -> tuple[Run, tuple[Finding, ...]]:
    """Let the whole record decide where what is assumed of a vehicle's motion counts little; `first`: a run with it."""
    run, events = decided(first, gps, replace(settings, aiding=()), partial(again, doubting=True))
    motion = Finding.of(Code.RECORD_MOTION, first.innovations.time[0], sd_factor=WEAKER)
    return run, (*events, motion)


def of_moments(trust: Trust | None, gps: GpsData) -> Trust | None:
    """Of what is not trusted the velocities that are false for a moment only, which are no change of anything."""
    if trust is None:
        return None
    brief = np.zeros_like(trust.false)
    for start, stop in runs_of(trust.false[1]):
        brief[1, start:stop] = gps.time[stop - 1] - gps.time[start] < LONGEST
    return replace(trust, false=brief) if brief.any() else None


def false_at_an_end(run: Run, gps: GpsData, settings: FilterSettings, trust: Trust) -> tuple[Run, list[Finding]]:
    """Fixes that are false from the begin on or to the end, for long, may be true: standard deviations hold both."""
    off, said = residuals(run, gps, settings)[0][0], []
    every = np.flatnonzero(np.isfinite(off).all(axis=1))
    for code, rows in ((Code.RECORD_AMBIGUOUS_BEGIN, every), (Code.RECORD_AMBIGUOUS_END, every[::-1])):
        some = rows[: int(np.argmin(trust.false[0, rows]))]
        if some.size == 0 or np.ptp(gps.time[some]) < LONG:
            continue
        size = np.sqrt(np.mean(off[some] ** 2, axis=0))
        span, far = (gps.time[some].min(), gps.time[some].max()), float(np.linalg.norm(size))
        said.append(Finding.of(code, *span, subject="gps", distance_m=far, count=some.size))
        run = widened(run, lambda _, size=size: size, some.size / rows.size)  # type: ignore[misc]
    return run, said


def _left_open(
    found: Explained,
    likely: tuple[StateChange, ...],
    gps: GpsData,
    settings: FilterSettings,
    worth: Callable[[Run, tuple[StateChange, ...]], float],
    around: float,
) -> tuple[Run, list[Finding], Trust | None]:
    """Take what stands out in a run as another change, while that makes it likelier, and widen standard deviations.

    `likely`: changes that the run has; `around`: see `changes_of`. Returns: the run, what was found, and all fixes that
    were left out.
    """
    run, changes, other = changes_of(found.run, likely, found.again, worth, only_surest=True, around=around)
    assert run.smoothed is not None
    sure = bool(changes) or run.smoothed.surest is None
    if not changes and run.smoothed.surest is not None:
        changes = (run.smoothed.surest,)
    # an IMU that was off for a while elsewhere has missed a change of velocity, which no receiver makes up
    missed = {VELOCITY} if settings.changes else set()
    of_imu = tuple(each for each in changes if of_the_imu(each) or each.first in missed)
    of_fixes = tuple(each for each in changes if each not in of_imu)
    news = tuple(each for each in of_imu if not at_an_end(each, settings.changes))
    said = report_changes(news, IMU_CHANGED if sure else AMBIGUOUS)
    sd = run.smoothed.solution.sd
    assert sd is not None
    held = HELD * float(np.linalg.norm(np.median(sd[:, :3], axis=0)))
    trust, lasting = false_between(of_fixes, gps, settings.delay, held), beyond(run, of_fixes)
    if trust is not None:
        once_more = partial(found.again, of_imu)
        run, trust = _used_again(trust, once_more(trust=trust), gps, settings, once_more)
    elif lasting:
        trust = unused(tuple(each for each in of_fixes if not each.change.any()), gps, settings.delay)
        run = mixed(run, lasting)
        said += report_changes(lasting, FIXES_CHANGED)
    if trust is not None:
        off, _ = residuals(run, gps, settings)
        said += report_false(gps, replace(trust, residual=np.linalg.norm(off, axis=2)))
    return run if sure else either(run, other), said, found.trusted(trust)


def _used_again(
    trust: Trust, run: Run, gps: GpsData, settings: FilterSettings, again: Callable[..., Run]
) -> tuple[Run, Trust]:
    """Navigate with the false fixes that `without_ends` leaves, if these are fewer than those that a run left out."""
    left = without_ends(trust.false[0], run, gps, settings)
    if not left.any() or (left == trust.false[0]).all():
        return run, trust
    trust = replace(trust, false=np.array([left, trust.false[1]]))
    return again(trust=trust), trust


def without_ends(false: BoolArray, run: Run, gps: GpsData, settings: FilterSettings) -> BoolArray:
    """False positions (n,) without those at begin and end of each row that the smoothed track supports."""
    off, square = residuals(run, gps, settings)
    small = np.linalg.norm(off[0], axis=1) <= settings.gates.small_position
    against, left = false & ~small & ~(square[0] < LIMIT * _scales(run)[0]), np.zeros_like(false)
    for start, stop in runs_of(false):
        rows = np.flatnonzero(against[start:stop])
        if rows.size > 0:
            left[start + rows[0] : start + rows[-1] + 1] = True
    return left


def reconcile(
    first: Run, gps: GpsData, settings: FilterSettings, again: Callable[..., Run], start: tuple[float, float, bool]
) -> Explained:
    """Weigh the fixes until they agree with the smoothed track, and leave out those of no weight; see `decided`.

    `start`: by which the standard deviations of positions and velocities are larger at first, and whether that fades
    from pass to pass for all alike. A residual that the gates of `settings` call small is never false.
    """
    scale, (*widest, fades) = _scales(first), start
    open_ = np.array(widest)[:, None] ** -2.0
    weights = np.ones((2, 1)) if fades else open_
    for left, strictness in zip(np.linspace(1.0, 0.0, len(STRICTNESS)), STRICTNESS, strict=True):
        wide, limit = (_weighted(gps, open_**left), LIMIT) if fades else (gps, LIMIT * strictness)
        run = again(_weighted(wide, weights), opened=OPEN_START, weighing=True)
        off, square = residuals(run, wide, settings)
        square = square / scale[:, None]
        weights = np.where(np.isfinite(square), (limit / (limit + square)) ** 2, 1.0)
    size, gates = np.linalg.norm(off, axis=2), settings.gates
    false = (weights < FALSE) & (size > np.array([[gates.small_position], [gates.small_velocity]]))
    agreement = max(float(np.nanmedian(each)) / MEDIAN for each in square if np.isfinite(each).any())
    if agreement > AGREEMENT or float(np.mean(false[0])) > MOST:
        code = Code.RECORD_DISAGREEMENT
    elif start in ALONE and not resets_of(first) and float(np.max(size[0][false[0]], initial=0.0)) < FAR:
        code = Code.RECORD_WITHOUT_VELOCITIES
    elif false[0].any() and float(np.mean(false[1][false[0]])) > MOST:
        code = Code.RECORD_WHOLE_FIXES
    else:
        begin = int(np.searchsorted(gps.time, first.alignment.time, side="right")) + 1  # up to the first one used
        opened = OPEN_START if false[0, :begin].any() else 0.0
        trust = Trust(false, size)
        kept = _weighted(gps, np.where(false, 1.0, weights)) if false.any() else gps  # weak fixes hide what changed
        better = partial(again, kept, opened=opened)
        run, trust = _used_again(trust, better(trust=trust), gps, settings, better)
        if _diverged(run) <= _diverged(first):
            return Explained(run, better, tuple(report_false(gps, trust)), trust)
        code = Code.RECORD_WORSE
    factor = np.sqrt(agreement) if code is Code.RECORD_DISAGREEMENT else np.nan
    undecided = Finding.of(code, first.innovations.time[0], subject="gps", residual_factor=factor)
    return Explained(run, again, (undecided,), agreed=False)


def _diverged(run: Run) -> int:
    """Windows whose innovations are far from their predicted size."""
    return sum(1 for _ in of_code(run.events, Code.FILTER_DIVERGED))


def _scales(run: Run) -> FloatArray:
    """How much larger squared innovations of position and velocity are than they should be, (2,); no less than one."""
    both = [nis[np.isfinite(nis)] for nis in (run.innovations.nis_position, run.innovations.nis_velocity)]
    return np.array([max(1.0, float(np.median(nis)) / MEDIAN) if nis.size else 1.0 for nis in both])


def unlikely(run: Run, gps: GpsData, settings: FilterSettings, dragged: Trust | None = None) -> float:
    """Twice the negative log-likelihood of all fixes against white noise of the reported standard deviations.

    A fix that was not used costs more than those that were, but for positions that were `dragged` all together.
    """
    found, rows = run.innovations, rows_of(run, gps, settings)
    total = EPISODE * sum(1 for _ in of_code(run.events, Code.FILTER_RESET))
    for nis, sd, reported, used in (
        (found.nis_position, found.sd[:, :3], gps.position_sd[rows], found.used_position),
        (found.nis_velocity, found.sd[:, 3:], gps.velocity_sd[rows], found.used_velocity),
    ):
        known = np.isfinite(nis)
        large = LARGEST * (1.0 + np.log(np.maximum(nis, LARGEST) / LARGEST))  # heavy tails
        cost = (np.where(nis > LARGEST, large, nis) + 2.0 * np.log(sd / reported).sum(axis=1))[known & used]
        usual = float(np.median(cost)) if cost.size else 0.0
        total += float(np.sum(cost)) + int((known & ~used).sum()) * (UNUSED + usual)
        total += EPISODE * len(stretches(found.time, known & ~used))
    if dragged is not None:
        total -= (UNUSED - 1.0) * int(dragged.false[0, rows].sum())
    return total


def rows_of(run: Run, gps: GpsData, settings: FilterSettings) -> IntArray:
    """Row of the fix of each innovation."""
    return np.searchsorted(gps.time - settings.delay, run.innovations.time - 1e-6)


def without_rejected(gps: GpsData, run: Run, settings: FilterSettings) -> GpsData:
    """Fixes of which those whose position a run rejected are marked as none; velocities the gates decide anew."""
    found, rows = run.innovations, rows_of(run, gps, settings)
    fix = np.ones(gps.time.shape[0], dtype=np.int64) if gps.fix is None else gps.fix.copy()
    fix[rows[~found.used_position]] = 0
    return replace(gps, fix=fix)


def contradicted(run: Run, gps: GpsData, settings: FilterSettings) -> bool:
    """Whether the filter reset, believed a fix that the smoothed track contradicts, or rejected many it supports."""
    if any(of_code(run.events, Code.FILTER_RESET)):
        return True
    gates, rows = settings.gates, rows_of(run, gps, settings)
    off, square = (each[:, rows] for each in residuals(run, gps, settings))
    square = square / _scales(run)[:, None]
    believed = np.array([run.innovations.used_position, run.innovations.used_velocity])
    far = np.linalg.norm(off, axis=2) > 2.0 * np.array([[gates.small_position], [gates.small_velocity]])
    if (believed & far & (square > GROSS)).any():
        return True
    offered = np.isfinite(run.innovations.nis_position) & (gps.position_sd[rows] <= gates.max_sd).all(axis=1)
    supported = np.asarray(offered & ~believed[0] & (square[0] < LIMIT))
    return any(stop - start > LONGEST for start, stop in stretches(run.innovations.time, supported))


def _weighted(gps: GpsData, weights: ArrayLike) -> GpsData:
    """Fixes whose standard deviations say how much positions and velocities are trusted, (2, n) or (2,)."""
    factors = np.reshape(np.sqrt(np.maximum(weights, 1e-8)), (2, -1, 1))
    return replace(gps, position_sd=gps.position_sd / factors[0], velocity_sd=gps.velocity_sd / factors[1])


def stretches(time: FloatArray, chosen: BoolArray) -> list[tuple[float, float]]:
    """First and last time of each unbroken row of chosen fixes."""
    return [(float(time[start]), float(time[stop - 1])) for start, stop in runs_of(chosen)]


def report_false(gps: GpsData, trust: Trust) -> list[Finding]:
    """Report positions and velocities that are false, one finding each."""
    found = []
    kinds = (Code.RECORD_FALSE_POSITIONS, "residual_m"), (Code.RECORD_FALSE_VELOCITIES, "residual_m_s")
    for (code, name), false, size in zip(kinds, trust.false, trust.residual, strict=True):
        if false.any():
            largest = np.max(np.nan_to_num(size[false])) or np.nan  # none is known of one outside the track
            time, rows = gps.time[false], len(runs_of(false))
            values = {"count": false.sum(), name: largest, "span_count": rows if rows > 1 else np.nan}
            found.append(Finding.of(code, time[0], time[-1], subject="gps", **values))
    return found
