"""Navigation of one recording: prepare it, calibrate the aiding in a first pass if needed, feed the filter."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from insnav import spill
from insnav.engine import share_of
from insnav.exceptions import DivergenceError
from insnav.filter.agreement import unlikely
from insnav.filter.ambiguity import resets_of, widen_by_jumps, with_wider_sd
from insnav.filter.filter_input import FilterInput, Output
from insnav.filter.gates import Gates
from insnav.filter.gps_noise import heights_measured
from insnav.filter.measurements import measurements_from_drive
from insnav.filter.measurements.measurement import FirstPass
from insnav.filter.measurements.sensors import HeightAiding, NonHolonomic, ZeroVelocity
from insnav.filter.navigator import Navigator
from insnav.filter.prepare import GivenStart, prepare
from insnav.filter.receiver import Receiver
from insnav.filter.run_recorder import on_grid
from insnav.findings import Code, Finding
from insnav.imu.specification import ImuSpec
from insnav.types import FloatArray, GpsData, ImuData, Run, Trajectory

AidingChoice = Literal["auto", "on", "off"]
GAP_WORTH = 3.0  # shortest GPS gap for a second pass with other aiding: shorter gaps drift by centimetres [s]
CREEPS = 10.0  # least increase of twice the log-likelihood for dropping unconfirmed stops
UNKNOWN_HEIGHT = 1000.0  # standard deviation if fixes have no heights [m]
DENSE = 0.1  # interval of the solution for calibration of aiding and comparison with fixes [s]


@dataclass(frozen=True, slots=True)
class Navigated:
    """Run and its assumptions."""

    run: Run  # the result
    ready: FilterInput  # input of the navigation, including other aiding
    notes: tuple[Finding, ...] = ()  # findings

    @property
    def findings(self) -> tuple[Finding, ...]:
        """All findings, including events of the run."""
        return (*self.notes, *self.run.events)


def navigate_recording(
    imu: ImuData,
    gps: GpsData,
    spec: ImuSpec,
    receiver: Receiver | None = None,
    *,
    known: GivenStart = GivenStart(),  # noqa: B008  # frozen
    gates: Gates = Gates(),  # noqa: B008  # frozen
    aiding: AidingChoice = "auto",
    output: Output | None = None,
) -> Navigated:
    """Navigate one recording: `prepare` it and feed it to the filter.

    `receiver`: lever arm, delay and errors of the fixes. `known`: inputs to the alignment. `aiding`: non-holonomic
    constraint, odometer, ZUPT and barometer, calibrated in a first pass (auto: where there are GPS gaps). `output`:
    wanted results.
    Raises: InputError: no fixes, or an initial state outside the record. AlignmentError: the data do not determine the
    attitude. DivergenceError: the filter lost consistency.
    """
    ready, output = prepare(imu, gps, spec, receiver or Receiver(), known=known), output or Output()
    every = replace(output, interval=dense(output.interval))
    done = navigate_prepared(replace(ready, gates=gates, output=every), spec, aiding=aiding)
    return replace(done, run=thinned(done.run, output.interval))


def navigate_prepared(
    ready: FilterInput,
    spec: ImuSpec,
    *,
    aiding: AidingChoice = "auto",
    widen: Callable[[Run], Run] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Navigated:
    """Navigate an aligned recording; see `navigate_recording`.

    `widen`: by the remaining ambiguity of the record. `progress`: called with the fraction done.
    """
    held = any(isinstance(each, HeightAiding) for each in ready.aiding.measurements or ())
    if aiding == "on" or (aiding == "auto" and (ready.aiding.logs or _longest_gap(ready) > GAP_WORTH)):
        first = _first_pass(ready, share_of(progress, 0.0, 0.5))
        progress = share_of(progress, 0.5, 0.5)
        ready = _add_aiding(ready, first, spec)
        ready, run = _doubt_stops(ready, _run(ready, progress))
    else:
        run = _run(ready, progress)
    if run.smoothed is not None and (jumps := resets_of(run)):  # to fixes that may be false
        run = widen_by_jumps(run, jumps)
    if run.smoothed is not None and widen is not None:
        run = widen(run)
    outside = _outside(ready.fix_time, ready.initial.time, float(ready.imu.time[-1]))
    events = (*ready.faults, *run.events, *outside)
    run = replace(run, events=events, gps_delay=run.gps_delay + ready.clock)
    if not heights_measured(ready.gps.lla) and not held:
        run = with_wider_sd(run, lambda _, sd: np.hypot(sd, UNKNOWN_HEIGHT * np.eye(9)[2]))
    return Navigated(run, ready, (*ready.notes, *_axes(run, ready)))


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


def aided(ready: FilterInput, spec: ImuSpec, progress: Callable[[float], None] | None = None) -> FilterInput:
    """Navigate once, calibrate the aiding by the smoothed solution, and return the input with it and its findings."""
    return _add_aiding(ready, _first_pass(ready, progress), spec)


def _first_pass(ready: FilterInput, progress: Callable[[float], None] | None) -> Run:
    """Navigate without the aiding that this run calibrates."""
    return _likelier(replace(ready, output=replace(ready.output, smooth=True, interval=DENSE)), progress)


def _add_aiding(ready: FilterInput, run: Run, spec: ImuSpec) -> FilterInput:
    """Add the aiding that the first pass calibrates."""
    assert run.smoothed is not None
    # the solution is in fix time, shifted by the estimated minus the specified delay; the samples are not
    clock = run.gps_delay - ready.receiver.delay.value
    solution = run.smoothed.solution
    first = FirstPass(
        replace(solution, time=solution.time - clock),
        ready.imu,
        replace(ready.gps, time=ready.gps.time - run.gps_delay),
        spec,
        {log.name: log for log in ready.aiding.logs},
    )
    found, notes = measurements_from_drive(first)
    given = ready.aiding.measurements or ()
    used = (*given, *(each for each in found if each.name not in {other.name for other in given}))
    axes_sd = ready.model.axes_sd.copy()
    if first.mounting is not None and any(each.name == NonHolonomic.name for each in used):
        axes_sd[2] = max(axes_sd[2], first.mounting.sd[1])  # the direction of travel limits such a heading
    return replace(ready.replace_aiding(used).add_notes(*notes), model=replace(ready.model, axes_sd=axes_sd))


def _doubt_stops(ready: FilterInput, run: Run) -> tuple[FilterInput, Run]:
    """Drop the stops in gaps if that makes the fixes more likely: a creeping vehicle may hardly vibrate."""
    aiding = ready.aiding.measurements or ()
    zupt = next((each for each in aiding if isinstance(each, ZeroVelocity)), None)
    if zupt is None:
        return ready, run
    edges = np.concatenate([[-np.inf], ready.fix_time[ready.gps.valid], [np.inf]])
    rows = np.searchsorted(edges, zupt.stops)
    seen = np.array([np.diff(edges[a - 1 : b + 1]).max() <= GAP_WORTH for a, b in rows])
    if seen.all():
        return ready, run
    kept = (replace(zupt, stops=zupt.stops[seen]),) * bool(seen.any())
    note = Finding.of(Code.ZUPT_PARTLY, count=seen.sum(), total=seen.size)
    notes = (*(each for each in ready.notes if each.code is not Code.ZUPT_USED), note)
    other = replace(ready.replace_aiding((*(each for each in aiding if each is not zupt), *kept)), notes=notes)
    freer = _run(other, None)
    return (other, freer) if unlikely(freer, other) < unlikely(run, ready) - CREEPS else (ready, run)


def _axes(run: Run, ready: FilterInput) -> tuple[Finding, ...]:
    """Report the irreducible part of the attitude's standard deviation, if it dominates."""
    sd = (run.smoothed or run).solution.sd
    axes = ready.model.axes_sd
    if sd is None or not axes.any():
        return ()
    own = np.sqrt(np.maximum(np.median(sd[:, 6:], axis=0) ** 2 - axes**2, 0.0))
    if (own > axes).all():
        return ()
    source = "specification" if ready.noise is None else "innovations"
    nhc = any(each.name == NonHolonomic.name for each in ready.aiding.measurements or ())
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


def _longest_gap(ready: FilterInput) -> float:
    """Compute the longest time without a valid fix, also before the first and after the last one [s]."""
    time = ready.gps.time[ready.gps.valid]
    inside = time[(time > ready.initial.time) & (time < ready.imu.time[-1])]
    return float(np.diff(inside, prepend=ready.initial.time, append=ready.imu.time[-1]).max())


def feed(navigator: Navigator, imu: ImuData, progress: Callable[[float], None] | None = None) -> Navigator:
    """Feed a filter with the samples in blocks; `progress` is called with the fraction done."""
    for block in spill.blocks(imu.time.shape[0]):
        navigator.feed(imu.rows(block))
        if progress is not None:
            progress(block.stop / imu.time.shape[0])
    return navigator


def _run(ready: FilterInput, progress: Callable[[float], None] | None) -> Run:
    return feed(Navigator(ready), ready.imu, progress).finish()


def _likelier(ready: FilterInput, progress: Callable[[float], None] | None) -> Run:
    """Navigate; after resets, which false fixes in streets cause, accept all fixes if that is more likely."""
    run = _run(ready, progress)
    if resets_of(run):
        with suppress(DivergenceError):
            other = _run(replace(ready, gates=ready.gates.believing()), None)
            run = min(run, other, key=lambda each: unlikely(each, ready))
    return run


def _outside(fixes: FloatArray, start: float, end: float) -> list[Finding]:
    """Report the fixes before the start of navigation, and the fixes after the last sample, once each."""
    sides = ("before", fixes < start - 1e-6, start), ("after", fixes > end + 1e-6, end)
    return [Finding.of(Code.GPS_OUTSIDE, time, count=rows.sum(), side=side) for side, rows, time in sides if rows.any()]
