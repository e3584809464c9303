"""Run of the filter, evaluated against a reference if available, and its assessment: problems and assumptions.

The evaluation includes GPS outages and short-duration windows. The assessment lists problems beyond the stated
uncertainty of the run, and assumptions, most important first. `insnav.result.Result` holds all findings in this order;
pages and the terminal select them by severity.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from insnav import findings, strapdown
from insnav.alignment.static import CONTRADICTED, LONG_REST
from insnav.attitude import dcm_from_rph
from insnav.earth import earth_rate_n, ned_offset, transport_rate_n
from insnav.errors import reference_check
from insnav.errors.metrics import TrajectoryErrors, nees, on_clock, position_errors
from insnav.errors.reference_check import ReferenceOffset, check_reference, delay_shown, reference_offset
from insnav.exceptions import InputError
from insnav.filter.gates import UNUSABLE
from insnav.filter.gps_noise import heights_measured, white_noise
from insnav.filter.innovation_likelihood import LARGEST
from insnav.filter.navigate import Navigated
from insnav.filter.noise_estimate import NoiseEstimate
from insnav.findings import Code, Finding, Severity, by_time, of_code
from insnav.input.readers.reading import Reading, not_covered
from insnav.result import Result
from insnav.sample_statistics import rms
from insnav.strapdown import navigate_short
from insnav.tabular import runs_of
from insnav.types import FloatArray, GpsData, ImuData, Increments, Run, SensorErrors, Trajectory
from insnav.units import DEG

LENGTH = 60.0  # of a window [s]
KEEP = 0.5  # interval of the compared states [s]
HOLDS = 0.95  # share of errors inside 3 sd without a finding
_LARGEST_SCALE = LARGEST["scale_factor"]["accel"]
_MANY = 0.1  # share of rejected fixes that requires an explanation
_LARGE, _ONE_ROW = 0.5, 0.8  # the same, if this share of the rejected fixes is one run: a fault that ended
_ROW, _ROW_TIME = 3, 1.9  # length of a run of rejected fixes, and its duration [s], beyond chance
_LONG_GAP = 1.0  # of samples [s]: a car may turn and brake in it
_EXPLAINED = 0.5  # largest remaining share of epochs outside 3 sd, if a constant difference is their cause
_AT_THE_LIMIT = 0.99  # share of the search limit of scale factors, if fixes and IMU disagree
_ACROSS = 0.02  # share of the signal about other axes that such sensors sense [-]
_TURN_ON = 2.0  # multiple of the turn-on bias beyond plausibility: clean drives have 1.4, of navigation grade 4 [-]
_ALONG, _MOVING = 0.5, 3.0  # resultant of a heading unrelated to the course (clean drives: 0.84), from a speed [m/s]
_UNUSED = 0.3  # share of the fixes before the start of navigation without a finding
_TURNED = 5.0 * DEG  # least reported heading error by a steady turn during the initial stationary period [rad]
_PACE = 1.0  # averaging time of turns and accelerations, against vibration [s]
_DATA_LOST = {
    Code.IMU_SATURATED: Code.RUN_SATURATED,
    Code.IMU_LIMITED: Code.RUN_LIMITED,
    Code.IMU_STUCK: Code.RUN_STUCK,
    Code.IMU_FROZEN: Code.RUN_STUCK,
    Code.ROWS_GAP: Code.RUN_GAPS,
}


@dataclass(frozen=True, slots=True)
class ShortWindow:
    """Short form minus full form over one window, from the same state."""

    start: float  # time of the start [s]
    speed: float  # mean horizontal speed [m/s]
    elapsed: FloatArray  # (n,) time since the start [s]
    # (n, 3) difference North, East, Down [m], [m/s]; the attitude of both comes from the full form
    position: FloatArray
    velocity: FloatArray
    dropped: FloatArray  # (n, 3) position error of the omitted terms, integrated along the full form [m]
    # (n, 3) position error if the attitude also omits Earth and transport rate [m]
    untilted: FloatArray

    @property
    def rest(self) -> FloatArray:
        """Position difference that the omitted terms do not explain: Euler's rule [m], ``(n, 3)``."""
        return self.position - self.dropped


def short_windows(imu: ImuData, solution: Trajectory, sensor_errors: SensorErrors | None = None) -> list[ShortWindow]:
    """Run both mechanizations free-inertial through successive windows of a drive.

    `sensor_errors`: biases and scale factors known at the start of a window, corrected in its samples.
    Returns: successive windows of a minute without a data gap. Raises: InputError: the drive is too short, or every
    window has a gap.
    """
    parts = strapdown.intervals(imu)
    inc = strapdown.increments(parts)
    every = max(1, round(KEEP / strapdown.nominal_interval(imu.time)))
    windows = []
    tolerance = strapdown.TIME_TOLERANCE
    starts = inc.time - inc.dt
    for begin in np.arange(float(solution.time[0]), float(solution.time[-1]) - LENGTH + tolerance, LENGTH):
        # an index error of one sample is irrelevant: both forms start from the same state
        state = int(np.searchsorted(solution.time, begin))
        first = int(np.searchsorted(starts, solution.time[state] - tolerance))
        last = int(np.searchsorted(inc.time, starts[min(first, len(starts) - 1)] + LENGTH + tolerance))
        if last <= first or inc.time[last - 1] - starts[first] < LENGTH - KEEP or parts.gap[first:last].any():
            continue
        if not np.isfinite(solution.rph[state]).all():  # near a pole
            continue
        piece = inc.rows(slice(first, last))
        windows.append(_compared(_corrected(piece, sensor_errors, begin), solution, state, every))
    if not windows:
        raise InputError("diagnosis.no_short_window", length_s=LENGTH, duration_s=solution.time[-1] - solution.time[0])
    return windows


def size_at(windows: Sequence[ShortWindow], name: str, elapsed: float) -> FloatArray:
    """Compute the horizontal size of short-form minus full navigation in each window at a time since its start.

    `name`: attribute of `ShortWindow`. `elapsed` [s].
    Returns: (n,): per window [m] or [m/s].
    """
    rows = [int(np.argmin(np.abs(window.elapsed - elapsed))) for window in windows]
    return np.array([np.hypot(*getattr(window, name)[row, :2]) for window, row in zip(windows, rows, strict=True)])


def _compared(piece: Increments, solution: Trajectory, state: int, every: int) -> ShortWindow:
    """Navigate a window by the full and the short form, from row `state` of the solution; keep every n-th state."""
    start = solution.lla[state], solution.v_n[state], solution.rph[state]
    full = strapdown.navigate(piece, *start, every=every)
    short, untilted = (navigate_short(piece, *start, every=every, turning=turning) for turning in (True, False))
    begin = float(piece.time[0] - piece.dt[0])
    elapsed = full.time - begin
    rate = 2.0 * earth_rate_n(full.lla[:, 0]) + transport_rate_n(full.lla[:, 0], full.lla[:, 2], full.v_n)
    velocity_error = _integral(elapsed, np.cross(rate, full.v_n))  # of the short form: it omits the Coriolis term
    return ShortWindow(
        start=begin,
        speed=float(np.mean(np.hypot(full.v_n[:, 0], full.v_n[:, 1]))),
        elapsed=elapsed,
        position=ned_offset(short.lla, full.lla),
        velocity=short.v_n - full.v_n,
        dropped=_integral(elapsed, velocity_error),
        untilted=ned_offset(untilted.lla, full.lla),
    )


def _integral(elapsed: FloatArray, values: FloatArray) -> FloatArray:
    """Integrate by the trapezoid rule from zero, with the first value as value before it."""
    step = np.diff(elapsed, prepend=0.0)[:, None]
    return np.asarray(np.cumsum(0.5 * step * (np.concatenate([values[:1], values[:-1]]) + values), axis=0))


def _corrected(piece: Increments, errors: SensorErrors | None, begin: float) -> Increments:
    """Correct biases and scale factor errors known at the start of the window."""
    if errors is None or len(errors.time) == 0:
        return piece
    known = np.nan_to_num(errors.value[max(0, int(np.searchsorted(errors.time, begin, side="right")) - 1)])
    gyro, accel = 1.0 + known[6:9], 1.0 + known[9:12]
    dt = piece.dt[:, None]
    return replace(piece, dtheta=(piece.dtheta - dt * known[0:3]) / gyro, dvel=(piece.dvel - dt * known[3:6]) / accel)


_FEW, _MOST, _SAME = 10, 0.9, 1e-10  # common epochs, and share of them with equal positions [rad]: half a millimetre
_WHOLE = 1e-3  # steps: rounding of a double [-]
_SIGNIFICANT = 5.0  # standard deviations of a significant difference
_REJECTED = 0.5  # share of rejected positions of a lost filter ...
_LOST, _LOST_RESETS = 0.2, 3  # ... or after this many resets
_UNKNOWN = 300.0  # standard deviation of used fixes, beyond all receivers [m]
SHORTEST_OUTAGE_S = 2.0
MISSED_FIXES = 3.0  # median intervals without a used position fix that make an outage


@dataclass(frozen=True)
class EvaluatedRun:
    """Run with the fixes it used, and its errors."""

    run: Run
    gps: GpsData | None = None  # processed fixes, every value with a standard deviation
    # of the filtered and of the smoothed solution against the reference
    errors: TrajectoryErrors | None = None
    smoothed_errors: TrajectoryErrors | None = None
    # short-duration mechanization compared with the full one, if requested
    short_duration: tuple[ShortWindow, ...] = ()
    noise: NoiseEstimate | None = None  # estimate from the innovations
    reference_is_gps: bool = False  # the reference equals the aiding fixes
    backdrop: FloatArray | None = None  # (n, 2) latitude and longitude of lines behind the map, NaN between them [rad]

    @property
    def reference_offset(self) -> ReferenceOffset | None:
        """Constant parts of the filter's errors, if the reference determines them."""
        return None if self.errors is None else reference_offset(self.errors, self.run.solution, self.run.lever_sd)

    @property
    def solutions(self) -> dict[str, Trajectory]:
        """Solutions by name, the better one first."""
        smoothed = {} if self.run.smoothed is None else {"smoothed": self.run.smoothed.solution}
        return {**smoothed, "filtered": self.run.solution}

    @property
    def best(self) -> Trajectory:
        """Smoothed solution, or else the filtered solution."""
        return next(iter(self.solutions.values()))

    @property
    def known_errors(self) -> dict[str, TrajectoryErrors]:
        """Errors of the solutions with a reference, the better one first."""
        both = {"smoothed": self.smoothed_errors, "filtered": self.errors}
        return {name: each for name, each in both.items() if each is not None}

    @property
    def reference_late(self) -> float:
        """Time by which the reference clock leads the solution [s]; zero if unknown."""
        clock = of_code(self.run.events, Code.REF_CLOCK, Code.REF_CLOCK_OF_IMU)
        return next((finding["late_s"] for finding in clock), 0.0)

    @property
    def other_drive(self) -> bool:
        """True if the reference belongs to another drive: its errors are meaningless."""
        return any(of_code(self.run.events, Code.REF_OTHER_DRIVE))

    @property
    def noisy_reference(self) -> bool:
        """True if the errors are mostly noise of the reference."""
        return any(of_code(self.run.events, Code.REF_NOISIER))

    @property
    def useless_reference(self) -> bool:
        """True if the errors do not describe the solution: another drive, the fixes themselves, or a noisier file."""
        return self.other_drive or self.reference_is_gps or self.noisy_reference

    @cached_property
    def errors_on_clock(self) -> dict[str, TrajectoryErrors]:
        """Return `known_errors` with the clock of the reference corrected."""
        late, known = self.reference_late, self.known_errors
        return {name: on_clock(each, self.solutions[name], late) for name, each in known.items()} if late else known


def evaluate_run(
    done: Navigated, reference: Reading[Trajectory] | None = None, lever_b: FloatArray | None = None
) -> tuple[EvaluatedRun, tuple[Finding, ...]]:
    """Compare a run with a reference.

    `lever_b` (3,): point of the reference seen from the IMU, body axes [m].
    Raises: InputError: run and reference have no common time.
    """
    notes: tuple[Finding, ...] = ()
    errors, smoothed_errors, same = None, None, False
    if reference is not None:
        good, notes = fixed_epochs(reference)
        best = (done.run.smoothed or done.run).solution
        same = same_positions(done.ready.gps, good)
        good = _held(good, best.time)
        if not same:
            point = done.run.lever_b if lever_b is None else lever_b
            good, doubts = check_reference(good, best, done.ready.gps, point, delay_shown(done.run), done.run.lever_sd)
            done = replace(done, run=replace(done.run, events=by_time((*doubts, *done.run.events))))
        errors = position_errors(done.run.solution, good, lever_b=lever_b)
        if done.run.smoothed is not None:
            smoothed_errors = position_errors(done.run.smoothed.solution, good, lever_b=lever_b)
        noisy = None if same else noisier_reference(done.run, smoothed_errors or errors)
        if noisy is not None:
            done = replace(done, run=replace(done.run, events=by_time((noisy, *done.run.events))))
    return EvaluatedRun(done.run, done.ready.gps, errors, smoothed_errors, reference_is_gps=same), notes


def _held(reference: Trajectory, time: FloatArray) -> Trajectory:
    """Sample the reference at times ``(n,)``; extend a stationary reference, such as a bench, to all of them."""
    inside = (reference.time >= time[0]) & (reference.time <= time[-1]) if len(time) else np.ones(1, dtype=np.bool_)
    rests = len(reference.time) > 1 and not np.any(np.ptp(reference.lla, axis=0)) and not np.any(reference.v_n)
    if inside.any() or not rests or reference.time[0] > time[0] or reference.time[-1] < time[-1]:
        return reference
    return replace(reference.rows(np.zeros(len(time), dtype=np.int64)), time=time)


def noisier_reference(run: Run, errors: TrajectoryErrors) -> Finding | None:
    """Find that most of the error is noise of the reference, and more than that of the fixes: they may be exchanged.

    The solution is smooth, so the white noise of its errors comes from the reference. White noise of innovations comes
    from fixes and prediction. The sd of a scale estimate by medians of n third differences is about 2 / sqrt(n) of it.
    """
    used = run.innovations.used_position
    fixes, count = white_noise(run.innovations.time[used], run.innovations.innovation[used, :2])
    of_reference, other = white_noise(errors.time, errors.position[:, :2])
    least = 1.0 + 2.0 * _SIGNIFICANT / math.sqrt(max(min(count, other), 1))
    if min(count, other) < _FEW or of_reference < least * fixes or of_reference**2 < 0.5 * rms(errors.horizontal) ** 2:
        return None
    return Finding.of(Code.REF_NOISIER, subject="ref", reference_m=of_reference, fixes_m=fixes)


def same_positions(gps: GpsData, reference: Trajectory) -> bool:
    """Return whether fixes and reference have equal positions at their common epochs, as rounded in either file."""
    step = max(_SAME, _rounding(gps.lla), _rounding(reference.lla))
    _, i, j = np.intersect1d(gps.time, reference.time, return_indices=True)
    if len(i) < _FEW:
        return False
    return bool(np.mean(np.abs(gps.lla[i, :2] - reference.lla[j, :2]).max(axis=1) < step) > _MOST)


def _rounding(lla: FloatArray) -> float:
    """Return the largest rounding error of positions (n, 3) in a file, decimals of a degree or of a minute [rad]."""
    degrees = lla[:, :2] / DEG
    for size in sorted((step / part for step in (1e-5, 1e-6, 1e-7, 1e-8) for part in (1.0, 60.0)), reverse=True):
        if np.abs(degrees / size - np.round(degrees / size)).max() < _WHOLE:
            return 0.5 * size * (1.0 + _WHOLE) * DEG
    return 0.0


def fixed_epochs(reference: Reading[Trajectory]) -> tuple[Trajectory, tuple[Finding, ...]]:
    """Select reference epochs with fixed ambiguities, with findings; all epochs if the file has no types."""
    if reference.fix is None or not (reference.fix == 1).any() or (reference.fix == 1).all():
        return reference.data, ()
    fixed = np.asarray(reference.fix == 1)
    left = Finding.of(Code.REF_NOT_FIXED, subject="ref", count=int(np.count_nonzero(~fixed)))
    return reference.data.rows(fixed), (left,)


def failure(run: Run) -> Finding | None:
    """Return the finding that a solution is unusable after repeated filter resets; otherwise None."""
    resets = len(list(of_code(run.events, Code.FILTER_RESET)))
    fixes = run.innovations
    # frozen fixes contradict nothing
    processed = np.isfinite(fixes.innovation[:, :3]).any(axis=1) & ~(fixes.sd[:, 0] >= UNUSABLE)
    lost = float(np.mean(~fixes.used_position[processed])) if processed.any() else 0.0
    if lost > _REJECTED:
        by_record = any(of_code(run.events, Code.GATE_RECORD_POSITION))
        code = Code.RUN_CONTRADICTED if by_record else Code.RUN_REJECTED
        return Finding.of(code, share=lost, limit_share=_REJECTED)
    if resets >= _LOST_RESETS and lost > _LOST:
        return Finding.of(Code.RUN_LOST, count=resets, limit_count=_LOST_RESETS, share=lost, limit_share=_LOST)
    known, sd = run.solution.time, run.solution.sd
    if sd is not None and len(known) and fixes.used_position.any():
        rows = np.clip(np.searchsorted(known, fixes.time[fixes.used_position]), 0, len(known) - 1)
        middle = float(np.median(np.hypot(*sd[rows, :2].T)))
        if middle > _UNKNOWN:
            return Finding.of(Code.RUN_UNKNOWN, sd_m=middle, limit_m=_UNKNOWN)
    return None


class Unaided(NamedTuple):
    """Time without a used position fix."""

    start: float  # [s]
    end: float
    rejected: int  # rejected fixes in this time; zero in an outage


def outages(run: Run) -> list[Unaided]:
    """Find times without a used position fix, including the ends of the run.

    Returns: longer than `MISSED_FIXES` median intervals between fixes and than `SHORTEST_OUTAGE_S`; empty if the run
    had no position fix at all.
    """
    fixes = run.innovations
    processed = fixes.time[np.isfinite(fixes.innovation[:, 0:3]).any(axis=1)]
    used = fixes.time[fixes.used_position]
    if len(processed) < 2 or len(run.solution.time) == 0:
        return []
    limit = max(MISSED_FIXES * float(np.median(np.diff(processed))), SHORTEST_OUTAGE_S)
    start, end = run.solution.time[0], run.solution.time[-1]
    edges = np.concatenate(([start], used[(used > start) & (used < end)], [end]))
    lost = np.setdiff1d(processed, used)
    return [
        Unaided(float(a), float(b), int(np.count_nonzero((lost >= a) & (lost <= b))))
        for a, b in pairwise(edges)
        if b - a > limit
    ]


def judged(result: Result[Any], run: EvaluatedRun) -> Result[Any]:
    """Add the findings about its run to a result, and sort all findings by importance.

    `result`: with the findings of the drive, the filter and the reference.
    """
    taken = [each for each in result.findings if each.severity is Severity.ASSUMPTION]
    of_files = [each for facts in result.inputs.values() for each in facts.evidence]
    ordered = (
        *run_warnings(run),
        *file_warnings(result),
        *taken,
        *_not_given(result, run),
        *(each for each in of_files if each.severity is Severity.ASSUMPTION),
        *result.findings,
    )
    return replace(result, findings=tuple(sorted(dict.fromkeys(ordered), key=_place)))


def _place(each: Finding) -> tuple[bool, bool]:
    """Order findings: unusable, then wrong inputs, which can cause the others; the rest keeps its order."""
    return each.severity is not Severity.UNUSABLE, each.severity is not Severity.WARNING or "given" not in each.code


def run_warnings(found: EvaluatedRun) -> tuple[Finding, ...]:
    """Report problems that make a solution worse than stated, most important first."""
    stated, same = found.errors_on_clock, found.reference_is_gps
    too_sure = [each for mode in ("filtered", "smoothed") for each in overconfident(mode, stated.get(mode))]
    unusable, lost = failure(found.run), tuple(_lost_heading(found))
    delay = delay_shown(found.run)  # beyond it, the clocks of samples and fixes leave no definite solution time
    turn = reference_check.turned_in_place(found.best)  # of a wheeled vehicle that stands
    of_drive, of_reference = event_warnings(found.run)
    return (
        *([unusable] if unusable else []),
        *lost,
        *(() if lost else _impossible_scale(found.run)),
        *([Finding.of(Code.REF_SAME_AS_GPS, subject="ref")] if same else []),
        *of_drive,
        *([Finding.of(Code.RUN_LATE_FIXES, subject="gps", delay_s=delay)] if delay else []),
        *of_reference,
        *_many_rejected(found.run),
        *(() if found.useless_reference else too_sure[:1]),
        *_diverged(found.run),
        *_turned_at_rest(found.run),
        *(Finding.of(Code.RUN_TURNED_IN_PLACE, *span, angle_rad=angle) for *span, angle in filter(None, [turn])),
        *_begun_late(found.run),
        *_samples_lost(found.run),
        *_no_heights(found),
    )


def file_warnings(result: Result[Any]) -> tuple[Finding, ...]:
    """Report truncated files, partly overlapping files, and problems of a drive."""
    both = {"imu", "gps"} <= result.inputs.keys()
    return (
        *of_code(result.findings, Code.ROWS_CUT),
        *(not_covered(result.inputs["imu"], result.inputs["gps"]) if both else ()),
        *(each for facts in result.inputs.values() for each in facts.evidence if each.severity >= Severity.WARNING),
        *(each for each in result.findings if not each.timed and each.severity >= Severity.WARNING),
    )


def event_warnings(run: Run) -> tuple[list[Finding], list[Finding]]:
    """Split findings into implausible fixes and samples, and implausible references."""
    begun = run.solution.time[0] + 1.0
    elsewhere = findings.SUMMED | {Code.ROWS_CUT}
    serious = [event for event in run.events if event.severity >= Severity.WARNING and event.code not in elsewhere]
    # a problem from the start is less serious than a later fault
    serious.sort(key=lambda event: not event.begin >= begun)
    of_drive = [event for event in serious if event.subject != "ref"]
    resets = list(of_code(run.events, Code.FILTER_RESET))
    for first in resets[:1]:
        of_drive.append(Finding.of(Code.RUN_RESET, first.begin, count=len(resets), distance_m=first.value))
    return of_drive, [event for event in serious if event.subject == "ref"]


def _no_heights(found: EvaluatedRun) -> Iterator[Finding]:
    if found.gps is not None and not heights_measured(found.gps.lla):
        height = float(found.gps.lla[0, 2])
        constant = Finding.of(Code.RUN_CONSTANT_HEIGHT, subject="gps", height_m=height)
        yield constant if height else Finding.of(Code.RUN_NO_HEIGHTS, subject="gps")


def _begun_late(run: Run) -> Iterator[Finding]:
    """Report a start long after the first fix: the drive did not determine the attitude before."""
    early = sum(event.value for event in of_code(run.events, Code.GPS_OUTSIDE) if event.begin <= run.solution.time[0])
    every = early + run.innovations.time.size
    if early > _UNUSED * every:
        yield Finding.of(Code.RUN_LATE_START, float(run.solution.time[0]), count=int(early), of=int(every))


def _samples_lost(run: Run) -> Iterator[Finding]:
    """Report invalid samples, and long data gaps: only the uncertainty covers these times."""
    lost: dict[tuple[Code, str], list[Finding]] = {}
    for event in of_code(run.events, *_DATA_LOST):
        if event.code is not Code.ROWS_GAP or (event.subject == "imu" and event.value > _LONG_GAP):
            lost.setdefault((_DATA_LOST[event.code], event.subject), []).append(event)
    for (code, subject), events in lost.items():
        length = sum(event.value for event in events)
        yield Finding.of(code, events[0].begin, subject=subject, duration_s=length, count=len(events))


def _many_rejected(run: Run) -> Iterator[Finding]:
    """Report a large number of rejected headings, and of rejected fixes without a known cause."""
    for use in run.aiding:
        if use.name == "heading" and use.rejected > _MANY * use.processed:
            yield Finding.of(Code.RUN_HEADINGS_REJECTED, subject="gps", count=use.rejected, total=use.processed)
    fixes = run.innovations
    named = {event.code for event in run.events}
    shares: dict[str, Any] = {}
    rows = []
    for name, key, first, used, by in (
        ("position", "share", 0, fixes.used_position, findings.NOT_MEASURED | {Code.GATE_RECORD_POSITION}),
        ("velocity", "velocity_share", 3, fixes.used_velocity, findings.NOT_MEASURED | {Code.GATE_RECORD_VELOCITY}),
    ):
        if named & by:
            continue
        processed = np.isfinite(fixes.innovation[:, first : first + 3]).any(axis=1)
        time, rejected = fixes.time[processed], ~used[processed]
        found = [(stop - start, name, time[start], time[stop - 1]) for start, stop in runs_of(rejected)]
        rows += [each for each in found if each[0] >= _ROW and each[3] - each[2] >= _ROW_TIME]
        share = float(rejected.mean()) if processed.any() else 0.0
        row = max(found)[0] if found else 0
        if share > (_LARGE if row > _ONE_ROW * rejected.sum() else _MANY):
            shares[key] = share
    if shares:
        yield Finding.of(Code.RUN_MANY_REJECTED, subject="gps", **shares)
    elif rows:
        _, name, start, stop = max(rows, key=lambda row: row[3] - row[2])
        others: dict[str, Any] = {"count": len(rows) - 1} if rows[1:] else {}
        yield Finding.of(Code.RUN_ROW_REJECTED, start, stop, subject=name, **others)


def overconfident(name: str, errors: TrajectoryErrors | None) -> list[Finding]:
    """Report errors outside 3 sd far more often than expected. `name`: of the solution."""
    position = None if errors is None else (nees(errors) or {}).get("position")
    if errors is None or not position or position["inside_3_sd"] >= HOLDS:
        return []
    outside = 1.0 - position["inside_3_sd"]
    constant = np.nanmedian(errors.position, axis=0)
    without = (nees(replace(errors, position=errors.position - constant)) or {}).get("position")
    if without and (rest := 1.0 - without["inside_3_sd"]) < _EXPLAINED * outside:
        offset = dict(zip(("north_m", "east_m", "down_m"), constant.tolist(), strict=True))
        return [Finding.of(Code.RUN_OVERCONFIDENT_OFFSET, subject=name, share=outside, rest=rest, **offset)]
    return [Finding.of(Code.RUN_OVERCONFIDENT, subject=name, share=outside)]


def _diverged(run: Run) -> Iterator[Finding]:
    windows = list(of_code(run.events, Code.FILTER_DIVERGED))
    for first in windows[:1]:
        yield Finding.of(Code.RUN_DIVERGED, first.begin, subject=first.subject, nis=first.value, count=len(windows))


def _turned_at_rest(run: Run) -> Iterator[Finding]:
    """Report a long stationary period whose mean rate the drive contradicts: a steady turn resembles gyro bias.

    The comparison uses the bias about down in the minutes after departure.
    """
    at, errors = run.alignment, (run.smoothed or run).sensor_errors
    after = (errors.time > at.left) & (errors.time < at.left + LONG_REST)
    if at.static is None or not at.sway.size or not after.any():
        return
    down = dcm_from_rph(at.rph)[2]
    rate = float((at.gyro_bias - np.median(errors.value[after, :3], axis=0)) @ down)
    sd = float(np.hypot(at.gyro_bias_sd @ np.abs(down), np.median(errors.sd[after, :3], axis=0) @ np.abs(down)))
    turn = abs(rate) * (at.left - at.static[0])
    if abs(rate) > CONTRADICTED * sd and turn > _TURNED:
        begin, limit = float(at.static[0]), CONTRADICTED * sd
        yield Finding.of(
            Code.RUN_TURNED_AT_REST, begin, float(at.left), rate_rad_s=abs(rate), limit_rad_s=limit, angle_rad=turn
        )


def _lost_heading(found: EvaluatedRun) -> Iterator[Finding]:
    """Report a heading that rotates relative to the course, with an implausible gyro bias.

    A vehicle that reverses or flies in wind has its course near an axis: doubled angles have a long mean resultant (K.
    V. Mardia, P. E. Jupp, "Directional Statistics", Wiley 2000, 1.1). Drones may turn: only the bias decides.
    """
    alignment = found.run.alignment
    at_rest = alignment.gyro_bias if alignment.static is not None else np.zeros(3)  # observed at rest, so certain
    bias = np.max(np.abs(found.run.sensor_errors.value[-1:, :3] - at_rest), initial=0.0)
    usual = [figure.prior for figure in found.noise.figures if figure.key == "gyro.bias"] if found.noise else []
    if not (usual and bias > _TURN_ON * usual[0]):
        return
    track = found.best.rows(np.hypot(*found.best.v_n[:, :2].T) > _MOVING)
    apart = track.rph[:, 2] - np.arctan2(track.v_n[:, 1], track.v_n[:, 0])
    if apart.size and abs(np.mean(np.exp(2j * apart))) < _ALONG:
        limit = _TURN_ON * usual[0]
        yield Finding.of(Code.RUN_HEADING_LOST, rate_rad_s=bias, limit_rad_s=limit, ratio=bias / usual[0])


def _impossible_scale(run: Run) -> Iterator[Finding]:
    """Report a scale factor significantly beyond the sensor type: the state absorbs a model error.

    An axis with little signal determines no scale factor, but senses cross-axis signals.
    """
    if len(run.sensor_errors.time) == 0:
        return
    if float(np.max(run.sensor_errors.sd[0, 9:])) > _AT_THE_LIMIT * _LARGEST_SCALE:
        yield Finding.of(Code.RUN_SCALE_OF_ALL, subject="imu", share=_LARGEST_SCALE)
        return
    value, sd = (each[-1, 6:] for each in (run.sensor_errors.value, run.sensor_errors.sd))
    own = _motion(run.solution)
    across = np.sqrt(np.repeat(np.sum(own.reshape(2, 3) ** 2, axis=1), 3) - own**2)
    sd = np.hypot(sd, _ACROSS * across / np.maximum(own, 1e-9))
    names = [f"{sensor} {axis}" for sensor in ("gyro", "accelerometer") for axis in "xyz"]
    sure = np.abs(value) > np.maximum(_LARGEST_SCALE, run.sensor_errors.sd[0, 6:]) + 3.0 * sd
    if sure.any():
        axes = tuple(name for name, impossible in zip(names, sure, strict=True) if impossible)
        yield Finding.of(Code.RUN_SCALE, subject="imu", share=tuple(value[sure]), limit_share=_LARGEST_SCALE, axes=axes)


def _motion(track: Trajectory) -> FloatArray:
    """Compute RMS turn rate [rad/s] and acceleration [m/s^2] about and along the body axes, (6,)."""
    track = track.rows(np.unique(np.searchsorted(track.time, np.arange(track.time[0], track.time[-1], _PACE))))
    c, step = dcm_from_rph(track.rph), np.diff(track.time)[:, None]
    turned = np.swapaxes(c[:-1], 1, 2) @ c[1:]
    rate = np.column_stack([turned[:, k, j] - turned[:, j, k] for j, k in ((1, 2), (2, 0), (0, 1))]) / 2.0
    speed = np.einsum("kji,kj->ki", c[:-1], np.diff(track.v_n, axis=0))
    return np.asarray(np.sqrt(np.mean(np.hstack([rate, speed]) ** 2 / step**2, axis=0)))


def _not_given(result: Result[Any], found: EvaluatedRun) -> Iterator[Finding]:
    """Report assumptions where neither user nor data provide a value."""
    run, errors = found.run, found.errors
    given = {name for name, value in result.options.items() if value is not None}
    point_known = "ref_lever_arm" in given or any(of_code(run.events, Code.REF_HEADING_MISREAD, Code.REF_TILT_MISREAD))
    if errors is not None and not point_known and not np.isfinite(errors.attitude).any():
        yield Finding.of(Code.REF_AT_ANTENNA, subject="ref")
    arm_known = "lever_arm" in given or np.any(run.lever_b) or np.any(run.lever_sd > 0.0)
    if not arm_known and len(run.innovations.time):
        yield Finding.of(Code.RUN_LEVER_ZERO)
    if result.imu_model is not None and result.imu_model[1].severity is Severity.ASSUMPTION:
        yield result.imu_model[1]
    noted = {each.code for each in result.findings}
    of_receiver = noted & findings.CORRELATED_POSITIONS and not noted & findings.ASSUMED_POSITION_SD
    if errors is None and of_receiver and not np.isfinite(run.innovations.nis_velocity).any():
        yield Finding.of(Code.RUN_SLOW_ERRORS, subject="gps")
