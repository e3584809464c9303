"""Navigation of one recording: prepare it, calibrate the aiding in a first pass if needed, feed the filter."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from insnav import spill
from insnav.exceptions import DivergenceError
from insnav.filter.agreement import contradicted, unlikely
from insnav.filter.ambiguity import resets_of, widen_by_jumps, with_wider_sd
from insnav.filter.gps_noise import heights_measured
from insnav.filter.measurements import measurements_from_drive
from insnav.filter.measurements.measurement import FirstPass
from insnav.filter.measurements.sensors import NonHolonomic, ZeroVelocity
from insnav.filter.navigator import Navigator
from insnav.filter.prepare import GivenStart, Prepared, prepare
from insnav.filter.run_recorder import on_grid
from insnav.filter.settings import FilterSettings
from insnav.findings import Code, Finding
from insnav.imu.specification import ImuSpec
from insnav.types import FloatArray, GpsData, ImuData, Run, Trajectory

AidingChoice = Literal["auto", "on", "off"]
GAP_WORTH = 3.0  # shortest GPS gap for a second pass with other aiding: shorter gaps drift by centimetres [s]
CREEPS = 10.0  # least increase of twice the log-likelihood for dropping unconfirmed stops or weakening assumptions
ASSUMED = NonHolonomic, ZeroVelocity  # assumptions on vehicle motion, not sensors
WEAKER = 5.0  # factor on the sd of doubtful motion assumptions, which gaps still need [-]
UNKNOWN_HEIGHT = 1000.0  # standard deviation if fixes have no heights [m]
DENSE = 0.1  # interval of the solution for calibration of aiding and comparison with fixes [s]


@dataclass(frozen=True, slots=True)
class Navigated:
    """Run and its assumptions."""

    run: Run  # the result
    gps: GpsData  # the fixes as processed, every value with a standard deviation
    notes: tuple[Finding, ...] = field(default=())  # findings
    ready: Prepared | None = None  # input of the navigation, including other aiding

    @property
    def findings(self) -> tuple[Finding, ...]:
        """All findings, including events of the run."""
        return (*self.notes, *self.run.events)


def navigate_recording(
    imu: ImuData,
    gps: GpsData,
    spec: ImuSpec,
    settings: FilterSettings,
    *,
    states: int = 21,
    known: GivenStart = GivenStart(),  # noqa: B008  # frozen
    aiding: AidingChoice = "auto",
    progress: Callable[[float], None] | None = None,
) -> Navigated:
    """Navigate one recording: `prepare` it and feed it to the filter.

    `states`: 21 or 15, with or without scale factor errors. `known`: inputs to the alignment. `aiding`: non-holonomic
    constraint, odometer, ZUPT, barometer and `settings.logs`, calibrated in a first pass (auto: where there are logs or
    GPS gaps). `progress`: called with the fraction done.
    Raises: InputError: no fixes, or an initial state outside the record. AlignmentError: the data do not determine the
    attitude. DivergenceError: the filter lost consistency.
    """
    ready = prepare(imu, gps, spec, settings, states=states, known=known)
    return navigate_prepared(ready, spec, aiding=aiding, progress=progress)


def navigate_prepared(
    ready: Prepared, spec: ImuSpec, *, aiding: AidingChoice = "auto", progress: Callable[[float], None] | None = None
) -> Navigated:
    """Navigate an aligned recording; see `navigate_recording`."""
    every = ready.settings.output_interval
    ready = replace(ready, settings=replace(ready.settings, output_interval=dense(every)))
    if aiding == "on" or (aiding == "auto" and (ready.settings.logs or _longest_gap(ready) > GAP_WORTH)):
        first = _first_pass(ready, None if progress is None else _half_of(progress, 0.0))
        progress = None if progress is None else _half_of(progress, 0.5)
        ready = _add_aiding(ready, first, spec)
        ready, run = _doubt_motion(*_standing(ready, _run(ready, progress)), first)
    else:
        ready, run = _standing(ready, _run(ready, progress))
    if run.smoothed is not None and (jumps := resets_of(run)):  # to fixes that may be false
        run = widen_by_jumps(run, jumps)
    if run.smoothed is not None and ready.explanation is not None:
        run = ready.explanation.widen(run)
    outside = _outside(ready.gps.time - ready.settings.delay, ready.initial.time, float(ready.imu.time[-1]))
    events = (*ready.faults, *run.events, *outside)
    run = replace(thinned(run, every), events=events, gps_delay=run.gps_delay + ready.clock)
    if not heights_measured(ready.gps.lla) and ready.settings.fixed_height_sd <= 0.0:
        run = with_wider_sd(run, lambda _, sd: np.hypot(sd, UNKNOWN_HEIGHT * np.eye(9)[2]))
    return Navigated(run, ready.gps, (*ready.notes, *_axes(run, ready)), ready)


def dense(every: float) -> float:
    """Return the interval of a solution for comparison with fixes or a reference: a part of `every` [s]."""
    return every / float(np.ceil(max(every / DENSE, 1.0)))


def thinned(run: Run, every: float) -> Run:
    """Thin the solutions of a run to whole multiples of an interval, if that is longer than a dense one [s].

    Without such a row, the first remains.
    """
    if every <= DENSE:
        return run

    def few(track: Trajectory) -> Trajectory:
        rows = np.flatnonzero(on_grid(track.time, every))
        return track.rows(rows if rows.size else slice(0, 1))

    smoothed = run.smoothed and replace(run.smoothed, solution=few(run.smoothed.solution))
    poses = run.poses
    if poses is not None and np.array_equal(poses.time, run.solution.time):
        poses = few(poses)
    return replace(run, solution=few(run.solution), smoothed=smoothed, poses=poses)


def aided(ready: Prepared, spec: ImuSpec, progress: Callable[[float], None] | None = None) -> Prepared:
    """Navigate once, calibrate the aiding by the smoothed solution, and add it to the settings with findings."""
    return _add_aiding(ready, _first_pass(ready, progress), spec)


def _first_pass(ready: Prepared, progress: Callable[[float], None] | None) -> Run:
    """Navigate without the aiding that this run calibrates."""
    settings = replace(ready.settings, smooth=True, output_interval=DENSE)
    return _likelier(replace(ready, settings=settings), progress)


def _add_aiding(ready: Prepared, run: Run, spec: ImuSpec) -> Prepared:
    """Add the aiding that the first pass calibrates."""
    assert run.smoothed is not None
    # the solution is in fix time, shifted by the estimated minus the specified delay; the samples are not
    clock = run.gps_delay - ready.settings.delay
    solution = run.smoothed.solution
    first = FirstPass(
        replace(solution, time=solution.time - clock),
        ready.imu,
        replace(ready.gps, time=ready.gps.time - run.gps_delay),
        spec,
        {log.name: log for log in ready.settings.logs},
    )
    found, notes = measurements_from_drive(first)
    given = ready.settings.aiding or ()
    aiding = (*given, *(each for each in found if each.name not in {other.name for other in given}))
    axes_sd = ready.model.axes_sd.copy()
    if first.mounting is not None and any(each.name == NonHolonomic.name for each in aiding):
        axes_sd[2] = max(axes_sd[2], first.mounting.sd[1])  # the direction of travel limits such a heading
    model, settings = replace(ready.model, axes_sd=axes_sd), replace(ready.settings, aiding=aiding)
    return replace(ready, model=model, settings=settings, notes=(*ready.notes, *notes))


def _doubt_motion(ready: Prepared, run: Run, first: Run) -> tuple[Prepared, Run]:
    """Weaken the motion assumptions if the first pass, without them, makes the fixes more likely."""
    aiding, cost = ready.settings.aiding or (), unlikely(run, ready.gps, ready.settings)
    assumed = any(isinstance(each, ASSUMED) for each in aiding)
    if not assumed or cost < unlikely(first, ready.gps, ready.settings) + CREEPS:
        return ready, run
    weaker = (replace(each, sd=WEAKER * each.sd) if isinstance(each, ASSUMED) else each for each in aiding)
    note = Finding.of(Code.RECORD_MOTION, run.innovations.time[0], sd_factor=WEAKER)
    other = replace(ready, settings=replace(ready.settings, aiding=tuple(weaker)), faults=(*ready.faults, note))
    freer = _run(other, None)
    return (other, freer) if unlikely(freer, ready.gps, ready.settings) < cost - CREEPS else (ready, run)


def _standing(ready: Prepared, run: Run) -> tuple[Prepared, Run]:
    """Drop stops in gaps of the fixes, or all stops, if fixes contradict them: a creeping vehicle may not shake."""
    settings, aiding = ready.settings, ready.settings.aiding or ()
    zupt = next((each for each in aiding if isinstance(each, ZeroVelocity)), None)
    if zupt is None or run.smoothed is None or not contradicted(run, ready.gps, settings):
        return ready, run
    edges = np.concatenate([[-np.inf], _fix_times(ready) - settings.delay, [np.inf]])
    rows = np.searchsorted(edges, zupt.stops)
    seen = np.array([np.diff(edges[a - 1 : b + 1]).max() <= GAP_WORTH for a, b in rows])
    others = tuple(each for each in aiding if each is not zupt)
    notes = tuple(note for note in ready.notes if note.code is not Code.ZUPT_USED)
    least, best = unlikely(run, ready.gps, settings) - CREEPS, (ready, run)
    for kept in ([seen] if seen.any() and not seen.all() else []) + [np.zeros_like(seen)]:
        some = (replace(zupt, stops=zupt.stops[kept]),) * bool(kept.any())
        code = Code.ZUPT_PARTLY if some else Code.ZUPT_CONTRADICTED
        note = Finding.of(code, count=kept.sum(), total=kept.size)
        bare = replace(ready, settings=replace(settings, aiding=(*others, *some)), notes=(*notes, note))
        other = _run(bare, None)
        cost = unlikely(other, bare.gps, bare.settings)
        if cost < least and not contradicted(other, bare.gps, bare.settings):  # otherwise the fixes are false
            least, best = cost, (bare, other)
    return best


def _axes(run: Run, ready: Prepared) -> tuple[Finding, ...]:
    """Report the irreducible part of the attitude's standard deviation, if it dominates."""
    sd = (run.smoothed or run).solution.sd
    axes = ready.model.axes_sd
    if sd is None or not axes.any():
        return ()
    own = np.sqrt(np.maximum(np.median(sd[:, 6:], axis=0) ** 2 - axes**2, 0.0))
    if (own > axes).all():
        return ()
    source = "specification" if ready.noise is None else "innovations"
    nhc = any(each.name == NonHolonomic.name for each in ready.settings.aiding or ())
    return (
        Finding.of(
            Code.ATTITUDE_AXES,
            misalignment_rad=axes.max(),
            tilt_sd_rad=own[:2].max(),
            heading_sd_rad=own[2],
            source=source,
            aiding=NonHolonomic.name * nhc,
        ),
    )


def _longest_gap(ready: Prepared) -> float:
    """Compute the longest time without a valid fix, including the end of the record [s]."""
    time = _fix_times(ready)
    inside = time[(time > ready.initial.time) & (time < ready.imu.time[-1])]
    return float(np.diff(inside, prepend=ready.initial.time, append=ready.imu.time[-1]).max())


def _fix_times(ready: Prepared) -> FloatArray:
    """Return the times of valid fixes [s]."""
    return ready.gps.time if ready.gps.fix is None else ready.gps.time[ready.gps.fix != 0]


def feed(navigator: Navigator, imu: ImuData, progress: Callable[[float], None] | None = None) -> Navigator:
    """Feed a filter with the samples in blocks; `progress` is called with the fraction done."""
    for block in spill.blocks(imu.time.shape[0]):
        navigator.feed(imu.rows(block))
        if progress is not None:
            progress(block.stop / imu.time.shape[0])
    return navigator


def _run(ready: Prepared, progress: Callable[[float], None] | None) -> Run:
    return feed(ready.navigator(), ready.imu, progress).finish()


def _likelier(ready: Prepared, progress: Callable[[float], None] | None) -> Run:
    """Navigate; after resets, which false fixes in streets cause, accept all fixes if that is more likely."""
    run, settings = _run(ready, progress), ready.settings
    if resets_of(run):
        with suppress(DivergenceError):
            other = _run(replace(ready, settings=replace(settings, gates=settings.gates.believing())), None)
            run = min(run, other, key=lambda each: unlikely(each, ready.gps, settings))
    return run


def _half_of(progress: Callable[[float], None], before: float) -> Callable[[float], None]:
    return lambda done: progress(before + 0.5 * done)


def _outside(fixes: FloatArray, start: float, end: float) -> list[Finding]:
    """Report the fixes before the start of navigation, and the fixes after the last sample, once each."""
    sides = ("before", fixes < start - 1e-6, start), ("after", fixes > end + 1e-6, end)
    return [Finding.of(Code.GPS_OUTSIDE, time, count=rows.sum(), side=side) for side, rows, time in sides if rows.any()]
