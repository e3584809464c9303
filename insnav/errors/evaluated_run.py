"""Run of the filter, evaluated against a reference if available, its GPS outages, and short-duration windows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from insnav import strapdown
from insnav.earth import earth_rate_n, ned_offset, transport_rate_n
from insnav.errors.metrics import TrajectoryErrors, on_clock, position_errors
from insnav.errors.reference_check import ReferenceOffset, check_reference, known_delay, reference_offset
from insnav.exceptions import InputError
from insnav.filter.gates import UNUSABLE
from insnav.filter.gps_noise import white_noise
from insnav.filter.navigate import Navigated
from insnav.filter.noise_estimate import NoiseEstimate
from insnav.findings import Code, Finding, by_time, of_code
from insnav.input.readers.reading import Reading
from insnav.sample_statistics import rms
from insnav.strapdown import navigate_short
from insnav.types import FloatArray, GpsData, ImuData, Increments, Run, SensorErrors, Trajectory
from insnav.units import DEG

LENGTH = 60.0  # of a window [s]
KEEP = 0.5  # interval of the compared states [s]


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
    """Compute the horizontal size of a difference in each window at a time since its start.

    `name` {"position", "velocity", "dropped", "rest", "untilted"}. `elapsed` [s].
    Returns: (n,): per window [m] or [m/s].
    """
    rows = [int(np.argmin(np.abs(window.elapsed - elapsed))) for window in windows]
    return np.array([np.hypot(*getattr(window, name)[row, :2]) for window, row in zip(windows, rows, strict=True)])


def _compared(piece: Increments, solution: Trajectory, state: int, every: int) -> ShortWindow:
    start = solution.lla[state], solution.v_n[state], solution.rph[state]
    full = strapdown.navigate(piece, *start, every=every)
    short = navigate_short(piece, *start, every=every)
    untilted = navigate_short(piece, *start, every=every, turning=False)
    begin = float(piece.time[0] - piece.dt[0])
    elapsed = full.time - begin
    rate = 2.0 * earth_rate_n(full.lla[:, 0]) + transport_rate_n(full.lla[:, 0], full.lla[:, 2], full.v_n)
    speed = _integral(elapsed, np.cross(rate, full.v_n))
    return ShortWindow(
        begin,
        float(np.mean(np.hypot(full.v_n[:, 0], full.v_n[:, 1]))),
        elapsed,
        ned_offset(short.lla, full.lla),
        short.v_n - full.v_n,
        _integral(elapsed, speed),
        ned_offset(untilted.lla, full.lla),
    )


def _integral(elapsed: FloatArray, values: FloatArray) -> FloatArray:
    """Integrate by the trapezoid rule from zero, with the first value as value before it."""
    step = np.diff(elapsed, prepend=0.0)[:, None]
    before = np.concatenate([values[:1], values[:-1]])
    return np.asarray(np.cumsum(0.5 * step * (before + values), axis=0))


def _corrected(piece: Increments, errors: SensorErrors | None, begin: float) -> Increments:
    """Correct biases and scale factor errors known at the start of the window."""
    if errors is None or len(errors.time) == 0:
        return piece
    row = max(0, int(np.searchsorted(errors.time, begin, side="right")) - 1)
    known = np.nan_to_num(errors.value[row])
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
        same = done.gps is not None and same_positions(done.gps, good)
        good = _held(good, best.time)
        if not same:
            point = done.run.lever_b if lever_b is None else lever_b
            good, doubts = check_reference(good, best, done.gps, point, known_delay(done.run), done.run.lever_sd)
            done = replace(done, run=replace(done.run, events=by_time((*doubts, *done.run.events))))
        errors = position_errors(done.run.solution, good, lever_b=lever_b)
        if done.run.smoothed is not None:
            smoothed_errors = position_errors(done.run.smoothed.solution, good, lever_b=lever_b)
        noisy = None if same else noisier_reference(done.run, smoothed_errors or errors)
        if noisy is not None:
            done = replace(done, run=replace(done.run, events=by_time((noisy, *done.run.events))))
    return EvaluatedRun(done.run, done.gps, errors, smoothed_errors, reference_is_gps=same), notes


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
    inside = used[(used > start) & (used < end)]
    edges = np.concatenate(([start], inside, [end]))
    lost = np.setdiff1d(processed, used)
    return [
        Unaided(float(a), float(b), int(np.count_nonzero((lost >= a) & (lost <= b))))
        for a, b in pairwise(edges)
        if b - a > limit
    ]
