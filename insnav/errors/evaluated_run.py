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

LENGTH = 60.0  # length of a short-duration window [s]
KEEP = 0.5  # interval of the compared states [s]
HOLDS = 0.95  # a smaller share of errors inside 3 sd is reported as over-confidence [-]
_LARGEST_SCALE = LARGEST["scale_factor"]["accel"]
_MANY = 0.1  # a larger share of rejected fixes is reported [-]
_LARGE, _ONE_ROW = 0.5, 0.8  # limit `_LARGE` replaces `_MANY` if over `_ONE_ROW` of rejected fixes are consecutive
_ROW, _ROW_TIME = 3, 1.9  # least number of consecutive rejected fixes, and least duration [s], beyond chance
_LONG_GAP = 1.0  # IMU data gap in which a car may turn and brake [s]
# a constant difference is the cause if its removal leaves less than this share of the errors outside 3 sd [-]
_EXPLAINED = 0.5
_AT_THE_LIMIT = 0.99  # an initial scale factor sd above this share of the search limit: fixes and IMU disagree
_ACROSS = 0.02  # cross-axis sensitivity: share of the signals of the other axes in the output of an axis [-]
# an implausible bias exceeds the turn-on bias by this factor: clean drives reach 1.4, or 4 at navigation grade [-]
_TURN_ON = 2.0
# least resultant of heading minus course in a valid solution [-] (clean drives: 0.84), above this speed [m/s]
_ALONG, _MOVING = 0.5, 3.0
_UNUSED = 0.3  # a larger share of fixes before the start of navigation is reported [-]
_TURNED = 5.0 * DEG  # least reported heading error by a steady turn during the initial stationary period [rad]
_PACE = 1.0  # averaging time of turn rates and accelerations, to remove vibration [s]
_DATA_LOST = {
    Code.IMU_SATURATED: Code.RUN_SATURATED,
    Code.IMU_LIMITED: Code.RUN_LIMITED,
    Code.IMU_STUCK: Code.RUN_STUCK,
    Code.IMU_FROZEN: Code.RUN_STUCK,
    Code.ROWS_GAP: Code.RUN_GAPS,
}


@dataclass(frozen=True, slots=True)
class ShortWindow:
    """Short-duration mechanization (short form) minus full mechanization (full form) in one window, from one state."""

    start: float  # start of the window [s]
    speed: float  # mean horizontal speed [m/s]
    elapsed: FloatArray  # (n,) time since the start [s]
    # (n, 3) difference North, East, Down [m], [m/s]; the attitude of both comes from the full form
    position: FloatArray
    velocity: FloatArray
    dropped: FloatArray  # (n, 3) position error due to the omitted Coriolis term, from the full form [m]
    # (n, 3) `position` if the attitude of the short form also omits Earth and transport rate [m]
    untilted: FloatArray

    @property
    def rest(self) -> FloatArray:
        """Position difference that Euler's rule causes, after subtraction of the omitted terms [m], ``(n, 3)``."""
        return self.position - self.dropped


def short_windows(imu: ImuData, solution: Trajectory, sensor_errors: SensorErrors | None = None) -> list[ShortWindow]:
    """Navigate successive windows of a drive without aiding, by the short-duration and the full mechanization.

    `sensor_errors`: estimated biases and scale factors. Their estimate at the start of a window corrects its samples.
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
        # both forms start from the same state, so an error of one sample in the index is irrelevant
        row = int(np.searchsorted(solution.time, begin))
        first = int(np.searchsorted(starts, solution.time[row] - tolerance))
        last = int(np.searchsorted(inc.time, starts[min(first, len(starts) - 1)] + LENGTH + tolerance))
        if last <= first or inc.time[last - 1] - starts[first] < LENGTH - KEEP or parts.gap[first:last].any():
            continue
        if not np.isfinite(solution.rph[row]).all():  # the attitude is undefined near a pole
            continue
        piece = inc.rows(slice(first, last))
        windows.append(_compared(_corrected(piece, sensor_errors, begin), solution, row, every))
    if not windows:
        raise InputError("diagnosis.no_short_window", length_s=LENGTH, duration_s=solution.time[-1] - solution.time[0])
    return windows


def size_at(windows: Sequence[ShortWindow], name: str, elapsed: float) -> FloatArray:
    """Compute the horizontal difference of short-form and full navigation in each window at a time since its start.

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
    velocity_error = _integral(elapsed, np.cross(rate, full.v_n))  # the short form omits the Coriolis term
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
    """Integrate values from time zero by the trapezoid rule. The first value also serves as the value at time zero."""
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


# equal positions: least number of common epochs, least share of equal ones, and tolerance [rad], 0.6 mm
_FEW, _MOST, _SAME = 10, 0.9, 1e-10
_WHOLE = 1e-3  # tolerance of a whole number of decimal steps, for the rounding of a double [steps]
_SIGNIFICANT = 5.0  # significant difference in standard deviations
_REJECTED = 0.5  # a larger share of rejected positions makes the solution unusable [-]
_LOST, _LOST_RESETS = 0.2, 3  # a larger share, with as many filter resets or more, does so, too [-]
_UNKNOWN = 300.0  # limit of the median horizontal sd at used fixes, larger than with any receiver [m]
SHORTEST_OUTAGE_S = 2.0
MISSED_FIXES = 3.0  # least length of an outage in median intervals between fixes


@dataclass(frozen=True)
class EvaluatedRun:
    """Run with the fixes it used, and its errors."""

    run: Run
    gps: GpsData | None = None  # processed fixes, every value with a standard deviation
    errors: TrajectoryErrors | None = None  # errors of the filtered solution against the reference
    smoothed_errors: TrajectoryErrors | None = None  # errors of the smoothed solution against the reference
    short_duration: tuple[ShortWindow, ...] = ()  # comparison of short-duration and full mechanization, if requested
    noise: NoiseEstimate | None = None  # noise parameters estimated from the innovations
    reference_is_gps: bool = False  # the reference equals the fixes
    backdrop: FloatArray | None = None  # (n, 2) latitude, longitude of lines on the map, NaN between lines [rad]

    @property
    def reference_offset(self) -> ReferenceOffset | None:
        """Offset of the positions from the reference, if turns and epochs suffice."""
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
        """Errors of the solutions compared with a reference, the better solution first."""
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
    errors, smoothed_errors, same_as_gps = None, None, False
    if reference is not None:
        ref, notes = fixed_epochs(reference)
        best = (done.run.smoothed or done.run).solution
        same_as_gps = same_positions(done.ready.gps, ref)
        ref = _held(ref, best.time)
        if not same_as_gps:
            point = done.run.lever_b if lever_b is None else lever_b
            ref, doubts = check_reference(ref, best, done.ready.gps, point, delay_shown(done.run), done.run.lever_sd)
            done = replace(done, run=replace(done.run, events=by_time((*doubts, *done.run.events))))
        errors = position_errors(done.run.solution, ref, lever_b=lever_b)
        if done.run.smoothed is not None:
            smoothed_errors = position_errors(done.run.smoothed.solution, ref, lever_b=lever_b)
        noisy = None if same_as_gps else noisier_reference(done.run, smoothed_errors or errors)
        if noisy is not None:
            done = replace(done, run=replace(done.run, events=by_time((noisy, *done.run.events))))
    return EvaluatedRun(done.run, done.ready.gps, errors, smoothed_errors, reference_is_gps=same_as_gps), notes


def _held(reference: Trajectory, time: FloatArray) -> Trajectory:
    """Return the reference, sampled at times (n,) [s] if it is stationary and has no epochs in their span."""
    inside = (reference.time >= time[0]) & (reference.time <= time[-1]) if len(time) else np.ones(1, dtype=np.bool_)
    stationary = len(reference.time) > 1 and not np.any(np.ptp(reference.lla, axis=0)) and not np.any(reference.v_n)
    if inside.any() or not stationary or reference.time[0] > time[0] or reference.time[-1] < time[-1]:
        return reference
    return replace(reference.rows(np.zeros(len(time), dtype=np.int64)), time=time)


def noisier_reference(run: Run, errors: TrajectoryErrors) -> Finding | None:
    """Report that most of the error is noise of the reference, if it exceeds the noise of the fixes.

    The user may have exchanged the two files. The solution is smooth, so the white noise of its errors comes from the
    reference. White noise of innovations comes from fixes and prediction. Medians of n third differences estimate a
    noise sd with a relative sd of about 2 / sqrt(n).
    """
    used = run.innovations.used_position
    fixes, n = white_noise(run.innovations.time[used], run.innovations.innovation[used, :2])
    of_reference, m = white_noise(errors.time, errors.position[:, :2])
    least = 1.0 + 2.0 * _SIGNIFICANT / math.sqrt(max(min(n, m), 1))
    if min(n, m) < _FEW or of_reference < least * fixes or of_reference**2 < 0.5 * rms(errors.horizontal) ** 2:
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
    """Return the largest rounding error [rad] of positions (n, 3) with few decimals of a degree or minute, or zero."""
    degrees = lla[:, :2] / DEG
    for resolution in sorted((step / part for step in (1e-5, 1e-6, 1e-7, 1e-8) for part in (1.0, 60.0)), reverse=True):
        if np.abs(degrees / resolution - np.round(degrees / resolution)).max() < _WHOLE:
            return 0.5 * resolution * (1.0 + _WHOLE) * DEG
    return 0.0


def fixed_epochs(reference: Reading[Trajectory]) -> tuple[Trajectory, tuple[Finding, ...]]:
    """Select reference epochs with fixed ambiguities, and report the omitted ones. Keep all if all or none is fixed."""
    if reference.fix is None or not (reference.fix == 1).any() or (reference.fix == 1).all():
        return reference.data, ()
    fixed = np.asarray(reference.fix == 1)
    finding = Finding.of(Code.REF_NOT_FIXED, subject="ref", count=int(np.count_nonzero(~fixed)))
    return reference.data.rows(fixed), (finding,)


def failure(run: Run) -> Finding | None:
    """Report an unusable solution: many rejected fixes, repeated filter resets, or a large sd; otherwise None."""
    resets = len(list(of_code(run.events, Code.FILTER_RESET)))
    fixes = run.innovations
    # positions with an sd of `UNUSABLE`, such as frozen fixes, are not counted as rejected
    processed = np.isfinite(fixes.innovation[:, :3]).any(axis=1) & ~(fixes.sd[:, 0] >= UNUSABLE)
    rejected = float(np.mean(~fixes.used_position[processed])) if processed.any() else 0.0
    if rejected > _REJECTED:
        by_record = any(of_code(run.events, Code.GATE_RECORD_POSITION))
        code = Code.RUN_CONTRADICTED if by_record else Code.RUN_REJECTED
        return Finding.of(code, share=rejected, limit_share=_REJECTED)
    if resets >= _LOST_RESETS and rejected > _LOST:
        return Finding.of(Code.RUN_LOST, count=resets, limit_count=_LOST_RESETS, share=rejected, limit_share=_LOST)
    time, sd = run.solution.time, run.solution.sd
    if sd is not None and len(time) and fixes.used_position.any():
        rows = np.clip(np.searchsorted(time, fixes.time[fixes.used_position]), 0, len(time) - 1)
        median_sd = float(np.median(np.hypot(*sd[rows, :2].T)))
        if median_sd > _UNKNOWN:
            return Finding.of(Code.RUN_UNKNOWN, sd_m=median_sd, limit_m=_UNKNOWN)
    return None


class Unaided(NamedTuple):
    """Time without a used position fix."""

    start: float  # start of the time [s]
    end: float  # end of the time [s]
    rejected: int  # number of rejected fixes in this time; zero in an outage


def outages(run: Run) -> list[Unaided]:
    """Find times without a used position fix, including the ends of the run.

    Returns: times longer than `MISSED_FIXES` median intervals between fixes and than `SHORTEST_OUTAGE_S`. Empty if the
    run processed fewer than two position fixes.
    """
    fixes = run.innovations
    processed = fixes.time[np.isfinite(fixes.innovation[:, 0:3]).any(axis=1)]
    used = fixes.time[fixes.used_position]
    if len(processed) < 2 or len(run.solution.time) == 0:
        return []
    limit = max(MISSED_FIXES * float(np.median(np.diff(processed))), SHORTEST_OUTAGE_S)
    start, end = run.solution.time[0], run.solution.time[-1]
    edges = np.concatenate(([start], used[(used > start) & (used < end)], [end]))
    rejected = np.setdiff1d(processed, used)
    return [
        Unaided(float(a), float(b), int(np.count_nonzero((rejected >= a) & (rejected <= b))))
        for a, b in pairwise(edges)
        if b - a > limit
    ]


def judged(result: Result[Any], run: EvaluatedRun) -> Result[Any]:
    """Add the findings about its run to a result, and sort all findings by importance.

    `result`: with the findings of the drive, the filter and the reference.
    """
    assumptions = [each for each in result.findings if each.severity is Severity.ASSUMPTION]
    file_evidence = [each for facts in result.inputs.values() for each in facts.evidence]
    ordered = (
        *run_warnings(run),
        *file_warnings(result),
        *assumptions,
        *_not_given(result, run),
        *(each for each in file_evidence if each.severity is Severity.ASSUMPTION),
        *result.findings,
    )
    return replace(result, findings=tuple(sorted(dict.fromkeys(ordered), key=_place)))


def _place(each: Finding) -> tuple[bool, bool]:
    """Return a sort key: unusable solutions first, then warnings about given values, which can cause other findings."""
    return each.severity is not Severity.UNUSABLE, each.severity is not Severity.WARNING or "given" not in each.code


def run_warnings(found: EvaluatedRun) -> tuple[Finding, ...]:
    """Report problems that make a solution worse than its stated uncertainty, most important first."""
    stated, same_as_gps = found.errors_on_clock, found.reference_is_gps
    overconfidence = [each for mode in ("filtered", "smoothed") for each in overconfident(mode, stated.get(mode))]
    unusable, lost = failure(found.run), tuple(_lost_heading(found))
    delay = delay_shown(found.run)  # with such a delay, the time of the solution is ambiguous
    turn = reference_check.turned_in_place(found.best)  # rotation of a stationary wheeled vehicle
    of_drive, of_reference = event_warnings(found.run)
    return (
        *([unusable] if unusable else []),
        *lost,
        *(() if lost else _impossible_scale(found.run)),
        *([Finding.of(Code.REF_SAME_AS_GPS, subject="ref")] if same_as_gps else []),
        *of_drive,
        *([Finding.of(Code.RUN_LATE_FIXES, subject="gps", delay_s=delay)] if delay else []),
        *of_reference,
        *_many_rejected(found.run),
        *(() if found.useless_reference else overconfidence[:1]),
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
    """Return the serious findings of a run: about fixes and samples, and about the reference."""
    after_start = run.solution.time[0] + 1.0
    reported = findings.SUMMED | {Code.ROWS_CUT}
    serious = [event for event in run.events if event.severity >= Severity.WARNING and event.code not in reported]
    # a fault that begins during the run precedes a problem that exists from the start
    serious.sort(key=lambda event: not event.begin >= after_start)
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
    """Report that navigation started long after the first fix, as the attitude was unknown before."""
    early = sum(event.value for event in of_code(run.events, Code.GPS_OUTSIDE) if event.begin <= run.solution.time[0])
    total = early + run.innovations.time.size
    if early > _UNUSED * total:
        yield Finding.of(Code.RUN_LATE_START, float(run.solution.time[0]), count=int(early), of=int(total))


def _samples_lost(run: Run) -> Iterator[Finding]:
    """Report invalid samples and long data gaps, whose errors only the standard deviations cover."""
    lost: dict[tuple[Code, str], list[Finding]] = {}
    for event in of_code(run.events, *_DATA_LOST):
        if event.code is not Code.ROWS_GAP or (event.subject == "imu" and event.value > _LONG_GAP):
            lost.setdefault((_DATA_LOST[event.code], event.subject), []).append(event)
    for (code, subject), events in lost.items():
        length = sum(event.value for event in events)
        yield Finding.of(code, events[0].begin, subject=subject, duration_s=length, count=len(events))


def _many_rejected(run: Run) -> Iterator[Finding]:
    """Report many rejected headings, and rejected fixes without a known cause: many, or several consecutive ones."""
    for use in run.aiding:
        if use.name == "heading" and use.rejected > _MANY * use.processed:
            yield Finding.of(Code.RUN_HEADINGS_REJECTED, subject="gps", count=use.rejected, total=use.processed)
    fixes = run.innovations
    codes = {event.code for event in run.events}
    shares: dict[str, Any] = {}
    long_sequences = []
    for name, key, first, used, causes in (
        ("position", "share", 0, fixes.used_position, findings.NOT_MEASURED | {Code.GATE_RECORD_POSITION}),
        ("velocity", "velocity_share", 3, fixes.used_velocity, findings.NOT_MEASURED | {Code.GATE_RECORD_VELOCITY}),
    ):
        if codes & causes:
            continue
        processed = np.isfinite(fixes.innovation[:, first : first + 3]).any(axis=1)
        time, rejected = fixes.time[processed], ~used[processed]
        sequences = [(stop - start, name, time[start], time[stop - 1]) for start, stop in runs_of(rejected)]
        long_sequences += [each for each in sequences if each[0] >= _ROW and each[3] - each[2] >= _ROW_TIME]
        share = float(rejected.mean()) if processed.any() else 0.0
        row = max(sequences)[0] if sequences else 0
        if share > (_LARGE if row > _ONE_ROW * rejected.sum() else _MANY):
            shares[key] = share
    if shares:
        yield Finding.of(Code.RUN_MANY_REJECTED, subject="gps", **shares)
    elif long_sequences:
        _, name, start, stop = max(long_sequences, key=lambda row: row[3] - row[2])
        others: dict[str, Any] = {"count": len(long_sequences) - 1} if long_sequences[1:] else {}
        yield Finding.of(Code.RUN_ROW_REJECTED, start, stop, subject=name, **others)


def overconfident(name: str, errors: TrajectoryErrors | None) -> list[Finding]:
    """Report errors outside 3 sd far more often than expected. `name`: name of the solution."""
    position = None if errors is None else (nees(errors) or {}).get("position")
    if errors is None or not position or position["inside_3_sd"] >= HOLDS:
        return []
    outside = 1.0 - position["inside_3_sd"]
    constant = np.nanmedian(errors.position, axis=0)
    centred = (nees(replace(errors, position=errors.position - constant)) or {}).get("position")
    if centred and (remaining := 1.0 - centred["inside_3_sd"]) < _EXPLAINED * outside:
        offset = dict(zip(("north_m", "east_m", "down_m"), constant.tolist(), strict=True))
        return [Finding.of(Code.RUN_OVERCONFIDENT_OFFSET, subject=name, share=outside, rest=remaining, **offset)]
    return [Finding.of(Code.RUN_OVERCONFIDENT, subject=name, share=outside)]


def _diverged(run: Run) -> Iterator[Finding]:
    windows = list(of_code(run.events, Code.FILTER_DIVERGED))
    for first in windows[:1]:
        yield Finding.of(Code.RUN_DIVERGED, first.begin, subject=first.subject, nis=first.value, count=len(windows))


def _turned_at_rest(run: Run) -> Iterator[Finding]:
    """Report a long stationary period in which the vehicle probably turned: a steady turn resembles gyro bias.

    The gyro bias about down in the minutes after departure contradicts the mean rate in that period.
    """
    aligned, errors = run.alignment, (run.smoothed or run).sensor_errors
    after = (errors.time > aligned.left) & (errors.time < aligned.left + LONG_REST)
    if aligned.static is None or not aligned.sway.size or not after.any():
        return
    down = dcm_from_rph(aligned.rph)[2]
    rate = float((aligned.gyro_bias - np.median(errors.value[after, :3], axis=0)) @ down)
    sd = float(np.hypot(aligned.gyro_bias_sd @ np.abs(down), np.median(errors.sd[after, :3], axis=0) @ np.abs(down)))
    turn = abs(rate) * (aligned.left - aligned.static[0])
    if abs(rate) > CONTRADICTED * sd and turn > _TURNED:
        begin, limit = float(aligned.static[0]), CONTRADICTED * sd
        yield Finding.of(
            Code.RUN_TURNED_AT_REST, begin, float(aligned.left), rate_rad_s=abs(rate), limit_rad_s=limit, angle_rad=turn
        )


def _lost_heading(found: EvaluatedRun) -> Iterator[Finding]:
    """Report a heading that rotates relative to the course, with an implausible gyro bias.

    If a vehicle reverses or flies in wind, its course stays near its longitudinal axis. The doubled angles between
    heading and course then have a long mean resultant (K. V. Mardia, P. E. Jupp, "Directional Statistics", Wiley 2000,
    1.1). Heading and course of a drone are unrelated, so only the bias decides.
    """
    alignment = found.run.alignment
    at_rest = alignment.gyro_bias if alignment.static is not None else np.zeros(3)  # directly observed at rest
    bias = np.max(np.abs(found.run.sensor_errors.value[-1:, :3] - at_rest), initial=0.0)
    prior = [figure.prior for figure in found.noise.figures if figure.key == "gyro.bias"] if found.noise else []
    if not (prior and bias > _TURN_ON * prior[0]):
        return
    track = found.best.rows(np.hypot(*found.best.v_n[:, :2].T) > _MOVING)
    from_course = track.rph[:, 2] - np.arctan2(track.v_n[:, 1], track.v_n[:, 0])
    if from_course.size and abs(np.mean(np.exp(2j * from_course))) < _ALONG:
        limit = _TURN_ON * prior[0]
        yield Finding.of(Code.RUN_HEADING_LOST, rate_rad_s=bias, limit_rad_s=limit, ratio=bias / prior[0])


def _impossible_scale(run: Run) -> Iterator[Finding]:
    """Report a scale factor that is significantly too large for any sensor: its state absorbs a model error.

    Cross-axis signals limit the accuracy of the scale factor of an axis with little signal.
    """
    if len(run.sensor_errors.time) == 0:
        return
    if float(np.max(run.sensor_errors.sd[0, 9:])) > _AT_THE_LIMIT * _LARGEST_SCALE:
        yield Finding.of(Code.RUN_SCALE_OF_ALL, subject="imu", share=_LARGEST_SCALE)
        return
    value, sd = (each[-1, 6:] for each in (run.sensor_errors.value, run.sensor_errors.sd))
    signal = _motion(run.solution)
    cross_signal = np.sqrt(np.repeat(np.sum(signal.reshape(2, 3) ** 2, axis=1), 3) - signal**2)
    sd = np.hypot(sd, _ACROSS * cross_signal / np.maximum(signal, 1e-9))
    names = [f"{sensor} {axis}" for sensor in ("gyro", "accelerometer") for axis in "xyz"]
    big = np.abs(value) > np.maximum(_LARGEST_SCALE, run.sensor_errors.sd[0, 6:]) + 3.0 * sd
    if big.any():
        axes = tuple(name for name, impossible in zip(names, big, strict=True) if impossible)
        yield Finding.of(Code.RUN_SCALE, subject="imu", share=tuple(value[big]), limit_share=_LARGEST_SCALE, axes=axes)


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
