"""Navigation of one recording: prepare it, calibrate aiding in a first pass if needed, run filter and smoother."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Literal

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
from insnav.types import GpsData, ImuData, Run, Trajectory

AidingChoice = Literal["auto", "on", "off"]
GAP_WORTH = 3.0  # shortest GPS gap that needs aiding: in shorter ones, the solution drifts by centimetres [s]
CREEPS = 10.0  # drop unconfirmed stops if this increases twice the log-likelihood by more [-]
UNKNOWN_HEIGHT = 1000.0  # reported height sd if the fixes have no heights [m]
DENSE = 0.1  # solution interval to calibrate aiding, and to compare with fixes [s]


@dataclass(frozen=True, slots=True)
class Navigated:
    """Result of a navigation, with its input and findings."""

    run: Run  # solution and innovations of the run
    ready: FilterInput  # input of the filter, including the calibrated aiding
    notes: tuple[Finding, ...] = ()  # findings that concern the whole drive

    @property
    def findings(self) -> tuple[Finding, ...]:
        """All findings, including events of the run."""
        return (*self.notes, *self.run.events)

    def report(self, earlier: tuple[Finding, ...]) -> Navigated:
        """Copy with the findings of earlier steps in front."""
        notes, events = (tuple(each for each in earlier if each.timed is timed) for timed in (False, True))
        run = replace(self.run, events=(*events, *self.run.events))
        return replace(self, run=run, notes=(*notes, *self.notes))


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
    ready, findings = prepare(imu, gps, spec, receiver or Receiver(), known=known)
    output = output or Output()
    dense_output = replace(output, interval=dense(output.interval))
    done = navigate_prepared(replace(ready, gates=gates, output=dense_output), spec, aiding=aiding).report(findings)
    return replace(done, run=thinned(done.run, output.interval))


def navigate_prepared(
    ready: FilterInput,
    spec: ImuSpec,
    *,
    aiding: AidingChoice = "auto",
    noise_source: str = "specification",
    widen: Callable[[Run], Run] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Navigated:
    """Navigate an aligned recording; see `navigate_recording`.

    `noise_source`: source of the misalignment noise, specification or innovations. `widen`: function that widens
    standard deviations if the record is ambiguous. `progress`: called with the fraction done.
    """
    notes = tuple[Finding, ...]()
    has_height = any(isinstance(each, HeightAiding) for each in ready.aiding.measurements or ())
    if aiding == "on" or (aiding == "auto" and (ready.aiding.logs or _longest_gap(ready) > GAP_WORTH)):
        first = _first_pass(ready, share_of(progress, 0.0, 0.5))
        progress = share_of(progress, 0.5, 0.5)
        ready, notes = _add_aiding(ready, first, spec)
        ready, run, notes = _doubt_stops(ready, _run(ready, progress), notes)
    else:
        run = _run(ready, progress)
    if run.smoothed is not None and (jumps := resets_of(run)):  # resets to fixes, which may be false
        run = widen_by_jumps(run, jumps)
    if run.smoothed is not None and widen is not None:
        run = widen(run)
    fixes, start, end = ready.fix_time, ready.initial.time, float(ready.imu.time[-1])
    sides = ("before", fixes < start - 1e-6, start), ("after", fixes > end + 1e-6, end)  # fixes outside the solution
    outside_fixes = [(side, rows.sum(), time) for side, rows, time in sides if rows.any()]
    outside = [Finding.of(Code.GPS_OUTSIDE, time, count=count, side=side) for side, count, time in outside_fixes]
    run = replace(run, events=(*run.events, *outside))
    if not heights_measured(ready.gps.lla) and not has_height:
        run = with_wider_sd(run, lambda _, sd: np.hypot(sd, UNKNOWN_HEIGHT * np.eye(9)[2]))
    return Navigated(run, ready, (*notes, *_axes(run, ready, noise_source)))


def dense(every: float) -> float:
    """Return an interval up to `DENSE` that divides `every` [s], to compare the solution with fixes or a reference."""
    return every / float(np.ceil(max(every / DENSE, 1.0)))


def thinned(run: Run, every: float) -> Run:
    """Thin the solutions of a run to times that are multiples of `every` [s], if it is longer than `DENSE`.

    Without such a row, the first one remains.
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
    """Navigate once, calibrate aiding by the smoothed solution, and return the filter input with this aiding."""
    return _add_aiding(ready, _first_pass(ready, progress), spec)[0]


def _first_pass(ready: FilterInput, progress: Callable[[float], None] | None) -> Run:
    """Navigate with smoothing, to calibrate the aiding measurements."""
    return _likelier(replace(ready, output=replace(ready.output, smooth=True, interval=DENSE)), progress)


def _add_aiding(ready: FilterInput, run: Run, spec: ImuSpec) -> tuple[FilterInput, tuple[Finding, ...]]:
    """Calibrate aiding by the first pass, add it to the filter input, and return also the findings."""
    assert run.smoothed is not None
    # convert the solution to sample time: it is in fix time, later by the estimated minus the specified delay
    clock = run.gps_delay - ready.receiver.delay.value
    solution = run.smoothed.solution
    first = FirstPass(
        replace(solution, time=solution.time - clock),
        ready.imu,
        replace(ready.gps, time=ready.gps.time - run.gps_delay),
        spec,
        {log.name: log for log in ready.aiding.logs},
    )
    measurements, notes = measurements_from_drive(first)
    existing = ready.aiding.measurements or ()
    used = (*existing, *(each for each in measurements if each.name not in {other.name for other in existing}))
    axes_sd = ready.model.axes_sd.copy()
    if first.mounting is not None and any(each.name == NonHolonomic.name for each in used):
        axes_sd[2] = max(axes_sd[2], first.mounting.sd[1])  # heading by NHC is no better than mounting yaw
    return replace(ready.replace_aiding(used), model=replace(ready.model, axes_sd=axes_sd)), tuple(notes)


def _doubt_stops(
    ready: FilterInput, run: Run, notes: tuple[Finding, ...]
) -> tuple[FilterInput, Run, tuple[Finding, ...]]:
    """Drop stops during GPS gaps if the fixes are more likely without them: a creeping vehicle can seem stationary."""
    aiding = ready.aiding.measurements or ()
    zupt = next((each for each in aiding if isinstance(each, ZeroVelocity)), None)
    if zupt is None:
        return ready, run, notes
    edges = np.concatenate([[-np.inf], ready.fix_time[ready.gps.valid], [np.inf]])
    rows = np.searchsorted(edges, zupt.stops)
    confirmed = np.array([np.diff(edges[a - 1 : b + 1]).max() <= GAP_WORTH for a, b in rows])
    if confirmed.all():
        return ready, run, notes
    kept = (replace(zupt, stops=zupt.stops[confirmed]),) * bool(confirmed.any())
    note = Finding.of(Code.ZUPT_PARTLY, count=confirmed.sum(), total=confirmed.size)
    without_stops = ready.replace_aiding((*(each for each in aiding if each is not zupt), *kept))
    freer_run = _run(without_stops, None)
    if unlikely(freer_run, without_stops) >= unlikely(run, ready) - CREEPS:
        return ready, run, notes
    return without_stops, freer_run, (*(each for each in notes if each.code is not Code.ZUPT_USED), note)


def _axes(run: Run, ready: FilterInput, source: str) -> tuple[Finding, ...]:
    """Report the misalignment part of the attitude sd, which no data reduce, if it dominates."""
    sd = (run.smoothed or run).solution.sd
    axes = ready.model.axes_sd
    if sd is None or not axes.any():
        return ()
    rest = np.sqrt(np.maximum(np.median(sd[:, 6:], axis=0) ** 2 - axes**2, 0.0))
    if (rest > axes).all():
        return ()
    nhc = any(each.name == NonHolonomic.name for each in ready.aiding.measurements or ())
    values: dict[str, Any] = {"misalignment_rad": axes.max(), "tilt_sd_rad": rest[:2].max(), "heading_sd_rad": rest[2]}
    return (Finding.of(Code.ATTITUDE_AXES, **values, source=source, aiding=NonHolonomic.name * nhc),)


def _longest_gap(ready: FilterInput) -> float:
    """Compute the longest time without a valid fix [s], including the times before the first and after the last."""
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
    """Navigate. If the filter was reset, perhaps by false fixes, accept all fixes if the result is more likely."""
    run = _run(ready, progress)
    if resets_of(run):
        with suppress(DivergenceError):
            believing = _run(replace(ready, gates=ready.gates.believing()), None)
            run = min(run, believing, key=lambda each: unlikely(each, ready))
    return run
