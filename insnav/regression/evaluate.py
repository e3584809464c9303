"""Accuracy of corpus recordings against their references: with all fixes, in GPS outages, and free-inertial.

`METRICS` lists the figures of merit, with name, unit, and the difference below which two values count as equal.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from insnav.engine import Workers, every
from insnav.errors.metrics import TrajectoryErrors, nees, position_errors
from insnav.errors.outage.free_inertial import end_errors
from insnav.errors.outage.gnss_outage import horizontal_at, outages
from insnav.exceptions import InputError, InsnavError
from insnav.filter.navigate import Navigated, aided, navigate_recording
from insnav.filter.prepare import prepare
from insnav.findings import Code, ErrorFacts, Finding
from insnav.regression.corpus import Corpus, Material, RecordedCase, SimulatedCase, Source, source_of
from insnav.sample_statistics import rms
from insnav.simulate.montecarlo import run_seed
from insnav.types import BoolArray, FloatArray, Run, Trajectory
from insnav.units import DEG

Kind = Literal["size", "ratio", "cpu"]
FAILS_FROM = 0.05  # default of `Metric.fails_from`
CAUTION = 0.5  # weight of under-confidence (sd too large) relative to over-confidence
LIKELY = 1e-3  # `Metric.fails_from` of innovation metrics: a thousandth of the innovation size
SLICES = 8  # equal parts of a recording in which predicted and actual errors are compared
_SHORTEST = 0.2  # a remainder at the end, shorter than this share of a piece, joins the last piece
_FAR = 7.0  # upper limit of NIS / 3 of one fix, about the limit of the filter's gate
_LOOP = 400  # iterations of the calibration loop
GROWTH = (5.0, 10.0, 20.0, 30.0, 45.0, 60.0)  # times since the start of an outage at which errors are stored [s]
_WINDOWS = 20  # largest number of outage windows, and of free-inertial windows, per recording
_NEAR = 1.5  # largest difference between an epoch of an outage and a time of `GROWTH` [s]
AnyCase = SimulatedCase | RecordedCase
SERIES = 8  # master seed of all runs
_made: dict[str, Source] = {}  # cache in each process: only the source of the current case


@dataclass(frozen=True, slots=True)
class Metric:
    """Figure of merit: name, unit, and rules to compare two values."""

    key: str  # key in files, including the unit
    label: str  # name in words
    unit: str
    # [`unit`] added to both values before their ratio is taken. Differences far below the floor, such as rounding on
    # another computer, thus hardly change the ratio
    floor: float
    kind: Kind = "size"  # size: smaller is better; ratio: nearer to one is better; cpu: a separate rule
    fails_from: float = FAILS_FROM  # smallest relative worsening that fails, if significant

    def logarithm(self, value: FloatArray) -> FloatArray:
        """Compute the logarithm of values (n,), after adding `floor`: versions are compared by these logarithms."""
        if self.kind == "ratio":
            return np.log(np.maximum(value, 1e-6))
        return np.log(value + self.floor)

    def badness(self, logarithm: float) -> float:
        """Convert a mean logarithm to a badness, of which smaller is better: for a ratio its distance from one.

        A ratio above one means over-confidence and counts fully. A ratio below one means caution and counts half.
        """
        if self.kind != "ratio":
            return logarithm
        return logarithm if logarithm > 0.0 else -CAUTION * logarithm

    def typical(self, value: FloatArray) -> float:
        """Compute the geometric mean of known values, the median for CPU time; NaN without values. `value` (n,)."""
        known = value[np.isfinite(value)]
        if not known.size:
            return float("nan")
        if self.kind == "cpu":
            return float(np.median(known))
        floor = 1e-6 if self.kind == "ratio" else self.floor
        return float(max(np.exp(np.mean(np.log(known + floor))) - floor, 0.0))


STATISTICS = (("rms", "RMS"), ("p95", "95 %"), ("max", "max"))
OUTAGES = (30.0, 60.0)  # outage times of the outage metrics [s]
FREE = 60.0  # length of free-inertial windows [s]


def _sizes(name: str, words: str, suffix: str, unit: str, floor: float) -> tuple[Metric, ...]:
    return tuple(Metric(f"{name}_{key}_{suffix}", f"{words}, {text}", unit, floor) for key, text in STATISTICS)


METRICS: tuple[Metric, ...] = (
    *_sizes("north", "north", "m", "m", 1e-3),
    *_sizes("east", "east", "m", "m", 1e-3),
    *_sizes("down", "down", "m", "m", 1e-3),
    Metric("cep50_m", "horizontal, CEP50", "m", 1e-3),
    *_sizes("velocity", "velocity", "m_s", "m/s", 1e-4),
    *_sizes("roll_pitch", "roll, pitch", "deg", "deg", 1e-4),
    *_sizes("heading", "heading", "deg", "deg", 1e-3),
    Metric("smoothed_horizontal_rms_m", "smoothed, horizontal, RMS", "m", 1e-3),
    Metric("smoothed_heading_rms_deg", "smoothed, heading, RMS", "deg", 1e-3),
    *(Metric(f"outage_{t:.0f}s_m", f"{t:.0f} s without GPS", "m", 1e-2) for t in OUTAGES),
    Metric("free_inertial_60s_m", "free inertial, one minute", "m", 1e-2),
    Metric("nees_position", "NEES / 3, position", "", 0.0, "ratio"),
    Metric("nees_velocity", "NEES / 3, velocity", "", 0.0, "ratio"),
    Metric("nees_attitude", "NEES / 3, attitude", "", 0.0, "ratio"),
    Metric("nis_position", "NIS / 3, position", "", 0.0, "ratio"),
    Metric("nis_velocity", "NIS / 3, velocity", "", 0.0, "ratio"),
    Metric("innovation_position_m", "innovations by likelihood, position", "m", 1e-4, fails_from=LIKELY),
    Metric("innovation_velocity_m_s", "innovations by likelihood, velocity", "m/s", 1e-5, fails_from=LIKELY),
    Metric("rejected_fixes", "rejected fixes", "", 1.0),
    Metric("cpu_ratio", "CPU a sample / calibration loop", "", 0.0, "cpu"),
)
BY_KEY = {metric.key: metric for metric in METRICS}


@dataclass(frozen=True, slots=True)
class Measured:
    """Accuracy of one recording."""

    values: dict[str, FloatArray]  # (n,) by `Metric.key`: one value per recording, or per piece of it
    # (6, 3) a row for each time of `GROWTH`: number of outage windows, sum of squared horizontal errors [m^2], and sum
    # of predicted variances [m^2]
    growth: FloatArray
    # (8, 9, 2) by slice of the recording and component: mean squared error, mean predicted variance; NaN if unknown.
    # Components: N, E, D position [m], N, E, D velocity [m/s], roll, pitch, heading [deg]
    spread: FloatArray


NOTHING = Measured({}, np.zeros((len(GROWTH), 3)), np.full((SLICES, 9, 2), np.nan))  # result of a failed drive


def measure(material: Material) -> Measured:
    """Navigate a recording with all fixes, in GPS outages and free-inertial, and summarise the errors.

    Returns: metrics, without metrics that need a better reference or a longer recording.
    Raises: InsnavError: the recording cannot be navigated.
    """
    loop = loop_time()
    cpu_begin = clock.process_time()
    navigated = navigate_recording(material.imu, material.gps, material.spec, material.receiver, gates=material.gates)
    cpu = clock.process_time() - cpu_begin
    values = {"cpu_ratio": np.array([cpu / len(material.imu.time) / loop])}
    time = settled(navigated.run.solution, material)
    spread = np.full((SLICES, 9, 2), np.nan)
    if len(time):
        errors = errors_of(navigated.run.solution, time, material)
        edges = _edges(time, material.block)
        values |= _accuracy(errors, edges)
        spread = _spread(errors)
        if navigated.run.smoothed is not None:
            values |= _smoothed(errors_of(navigated.run.smoothed.solution, time, material), edges)
        values |= _fixes(navigated.run, edges)
    windows, growth = _outages(material)
    values |= windows | _free_inertial(navigated, material)
    order = [metric.key for metric in METRICS if metric.key in values and np.isfinite(values[metric.key]).any()]
    return Measured({key: values[key] for key in order}, growth, spread)


def loop_time() -> float:
    """Measure the CPU time of one iteration of a fixed loop [s], to normalise the speed of the computer.

    The loop multiplies matrices of the filter's size.
    """
    best = np.inf
    transition = np.eye(21) + 0.01 * np.sin(np.arange(441.0)).reshape(21, 21)
    for _ in range(3):
        covariance = np.eye(21)
        begin = clock.process_time()
        for _ in range(_LOOP):
            covariance = transition @ covariance @ transition.T
            covariance *= 21.0 / np.trace(covariance)
        best = min(best, (clock.process_time() - begin) / _LOOP)
    return float(best)


def settled(solution: Trajectory, material: Material) -> FloatArray:
    """Return the times of the reference at which errors count, (n,) [s]: after the settling time."""
    begin = max(solution.time[0], material.gps.time[0]) + material.settle
    time = material.truth.time
    return np.asarray(time[(time >= begin) & (time <= solution.time[-1])])


def errors_of(solution: Trajectory, time: FloatArray, material: Material) -> TrajectoryErrors:
    """Compute errors at these reference times; NaN below `min_speed`, and where the reference is too inaccurate."""
    first, last = np.searchsorted(material.truth.time, [time[0], time[-1] + 1e-9])
    reference = material.truth.rows(slice(first, last))
    lever_b = material.truth_lever_b if material.truth_lever_b.any() else None
    errors = position_errors(solution, reference, lever_b=lever_b)
    position, velocity, attitude = errors.position.copy(), errors.velocity.copy(), errors.attitude.copy()
    if material.remove_offset:
        position -= np.median(position, axis=0)
    groups = {"position": position, "velocity": velocity, "attitude": attitude[:, :2], "heading": attitude[:, 2]}
    for name, error in groups.items():  # in place: these arrays are views of position, velocity and attitude
        error[(errors.speed < material.min_speed) | (name not in material.groups)] = np.nan
    return replace(errors, position=position, velocity=velocity, attitude=attitude)


def _edges(time: FloatArray, block: float) -> FloatArray:
    """Return the borders of pieces of length `block` [s], or begin and end if `block` is zero."""
    if block <= 0.0:
        return np.array([time[0], time[-1] + 1e-6])
    count = max(1, int((time[-1] - time[0]) / block + 1.0 - _SHORTEST))
    edges = time[0] + block * np.arange(count + 1.0)
    edges[-1] = max(edges[-1], time[-1] + 1e-6)
    return np.asarray(edges)


def _pieces(time: FloatArray, edges: FloatArray) -> list[BoolArray]:
    return [(time >= a) & (time < b) for a, b in pairwise(edges)]


def _accuracy(errors: TrajectoryErrors, edges: FloatArray) -> dict[str, FloatArray]:
    pieces = _pieces(errors.time, edges)
    sizes = {
        "north_{}_m": errors.position[:, 0],
        "east_{}_m": errors.position[:, 1],
        "down_{}_m": errors.position[:, 2],
        "velocity_{}_m_s": np.linalg.norm(errors.velocity, axis=1),
        "roll_pitch_{}_deg": np.linalg.norm(errors.attitude[:, :2], axis=1) / DEG,
        "heading_{}_deg": errors.attitude[:, 2] / DEG,
    }
    metrics = {}
    for name, error in sizes.items():
        metrics[name.format("rms")] = np.array([rms(error[rows]) for rows in pieces])
        for key, percent in (("p95", 95.0), ("max", 100.0)):
            metrics[name.format(key)] = np.array([_quantile(error[rows], percent) for rows in pieces])
    metrics["cep50_m"] = np.array([_quantile(errors.horizontal[rows], 50.0) for rows in pieces])
    piece_nees = [nees(errors.rows(rows)) for rows in pieces]
    for group in ("position", "velocity", "attitude"):
        parts = [None if piece is None else piece[group] for piece in piece_nees]
        metrics[f"nees_{group}"] = np.array([np.nan if part is None else part["nees"] for part in parts])
    return metrics


def _smoothed(errors: TrajectoryErrors, edges: FloatArray) -> dict[str, FloatArray]:
    pieces = _pieces(errors.time, edges)
    return {
        "smoothed_horizontal_rms_m": np.array([rms(errors.horizontal[rows]) for rows in pieces]),
        "smoothed_heading_rms_deg": np.array([rms(errors.attitude[rows, 2] / DEG) for rows in pieces]),
    }


def _fixes(run: Run, edges: FloatArray) -> dict[str, FloatArray]:
    """Compute metrics of the innovations and the number of rejected fixes, per piece."""
    processed = run.innovations
    metrics: dict[str, FloatArray] = {}
    pieces = _pieces(processed.time, edges)
    rejected = np.zeros(len(pieces))
    for group, unit, columns in (("position", "m", slice(0, 3)), ("velocity", "m_s", slice(3, 6))):
        nis, used = getattr(processed, f"nis_{group}"), getattr(processed, f"used_{group}")
        known = np.isfinite(nis)
        score = _likely_size(processed.innovation[:, columns], processed.sd[:, columns])
        metrics[f"innovation_{group}_{unit}"] = np.array(
            [math.exp(_mean(score[rows & np.isfinite(score)])) for rows in pieces]
        )
        metrics[f"nis_{group}"] = np.array([_mean(nis[rows & used & known]) / 3.0 for rows in pieces])
        rejected += [np.count_nonzero(rows & known & ~used) for rows in pieces]
    metrics["rejected_fixes"] = rejected
    return metrics


def _likely_size(innovation: FloatArray, sd: FloatArray) -> FloatArray:
    """Compute the logarithmic score of the innovations of each fix, mean of its components, (n,).

    The score is ``ln S + z^2 / 2 - 1/2``, with predicted sd S and normalised innovation z. On average it is smallest at
    the true S, so too large and too small predictions are both worse (Gneiting and Raftery, J. Amer.
    Statist. Assoc. 102 (2007) 359-378). Used or not, an outlier counts like a fix at the gate limit.
    """
    z2 = np.minimum(np.mean((innovation / sd) ** 2, axis=1), _FAR)
    return np.asarray(np.mean(np.log(sd), axis=1) + 0.5 * z2 - 0.5)


def _spread(errors: TrajectoryErrors) -> FloatArray:
    spread = np.full((SLICES, 9, 2), np.nan)
    if errors.sd is None:
        return spread
    unit = np.array([1.0] * 6 + [1.0 / DEG] * 3)
    error = np.column_stack([errors.position, errors.velocity, errors.attitude]) * unit
    sd = errors.sd * unit
    for number, rows in enumerate(np.array_split(np.arange(len(errors.time)), SLICES)):
        if len(rows):
            known = np.isfinite(error[rows]).sum(axis=0)
            columns = known > 0
            spread[number, columns, 0] = np.nansum(error[rows][:, columns] ** 2, axis=0) / known[columns]
            spread[number, columns, 1] = np.mean(sd[rows][:, columns] ** 2, axis=0)
    return spread


def _outages(material: Material) -> tuple[dict[str, FloatArray], FloatArray]:
    """Compute the horizontal error metrics of outages, and `Measured.growth`; no metrics for a short drive."""
    growth = np.zeros((len(GROWTH), 3))
    ready, _ = prepare(material.imu, material.gps, material.spec, material.receiver)
    ready = aided(replace(ready, gates=material.gates), material.spec)
    longest = max(OUTAGES)
    spacing = max(longest, float(material.imu.time[-1] - material.imu.time[0]) / _WINDOWS)
    try:
        windows = outages(ready, lengths=(longest,), spacing=spacing, reference=material.exact)
    except InputError:
        return {}, growth
    error, sd = horizontal_at(windows, GROWTH, _NEAR)
    growth = np.stack([np.isfinite(error).sum(axis=0), np.nansum(error**2, axis=0), np.nansum(sd**2, axis=0)], axis=1)
    errors = {f"outage_{t:.0f}s_m": error[:, GROWTH.index(t)] for t in OUTAGES}
    return {key: _by_recording(value, material.block) for key, value in errors.items()}, growth


def _free_inertial(done: Navigated, material: Material) -> dict[str, FloatArray]:
    """Compute the horizontal error after a free-inertial minute; empty for a short drive.

    If the reference lacks a part of the state, the smoothed solution replaces it; empty without one.
    """
    clock = done.run.gps_delay - material.receiver.delay.value  # solution times minus sample times [s]
    reference, reference_clock = material.truth, 0.0  # a whole state has sample times
    if not material.whole_state:
        if done.run.smoothed is None:
            return {}
        reference, reference_clock = done.run.smoothed.solution, clock
    error = end_errors(
        done.run,
        material.imu,
        reference,
        FREE,
        _WINDOWS,
        settle=material.settle,
        run_clock=clock,
        reference_clock=reference_clock,
    )
    return {"free_inertial_60s_m": _by_recording(error, material.block)} if error.size else {}


def _by_recording(value: FloatArray, block: float) -> FloatArray:
    """Return the errors of all windows if the drive is evaluated in pieces, else their root mean square."""
    return value if block > 0.0 else np.array([rms(value)])


def _mean(value: FloatArray) -> float:
    return float(np.mean(value)) if value.size else float("nan")


def _quantile(error: FloatArray, percent: float) -> float:
    known = np.abs(error[np.isfinite(error)])
    return float(np.percentile(known, percent)) if known.size else float("nan")


def joined(parts: Sequence[Measured]) -> Measured:
    """Combine the recordings of one case: concatenate values, add the sums of `growth`, average `spread`."""
    order = [metric.key for metric in METRICS if any(metric.key in part.values for part in parts)]
    missing = np.array([np.nan])
    values = {key: np.concatenate([part.values.get(key, missing) for part in parts]) for key in order}
    spread = np.array([part.spread for part in parts])
    finite = np.isfinite(spread)
    count = finite.sum(axis=0)
    mean = np.where(count > 0, np.where(finite, spread, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)
    return Measured(values, np.sum([part.growth for part in parts], axis=0), mean)


@dataclass(frozen=True, slots=True)
class CaseResult:
    """Accuracy of one case."""

    digest: str  # identifies the case and its files; see `corpus.digest`
    pieces: bool  # True: values are of successive pieces of one drive; False: of independent drives
    measured: Measured  # empty if every drive failed
    failures: Mapping[int, ErrorFacts | None]  # by number of the failed drive, from 1; None in a baseline
    files: dict[str, str]  # digest of each recorded file


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Accuracy of the whole corpus."""

    cases: dict[str, CaseResult]  # results by name of the case
    skipped: dict[str, Finding]  # by case: reason why it was skipped
    quick: bool  # True: only some cases and seeds were run


def run_corpus(
    corpus: Corpus,
    data: Path,
    *,
    quick: bool = False,
    workers: Workers = 1,
    progress: Callable[[float], None] | None = None,
) -> Accuracy:
    """Navigate all drives of a corpus. Raises: ConfigError: no worker, or an unknown profile or model in a case."""
    skipped: dict[str, Finding] = {}
    jobs: list[tuple[AnyCase, int]] = []
    for case in corpus.cases:
        if isinstance(case, RecordedCase) and not (data / case.data).is_dir():
            no_data = Finding.of(Code.REGRESSION_NO_DATA, subject=case.name, data=str(case.data), folder=str(data))
            skipped[case.name] = no_data
            continue
        seeds = min(case.quick, case.seeds) if quick else case.seeds
        if not seeds:
            skipped[case.name] = Finding.of(Code.REGRESSION_NOT_QUICK, subject=case.name)
        jobs += [(case, seed) for seed in range(1, seeds + 1)]
    drives: dict[str, list[CaseResult]] = {}
    for (case, _), drive in zip(jobs, every(_attempt, jobs, workers, (data,), progress), strict=True):
        drives.setdefault(case.name, []).append(drive)
    cases = {}
    for name, results in drives.items():
        failures = {seed: error for result in results for seed, error in result.failures.items()}
        cases[name] = replace(results[0], measured=joined([result.measured for result in results]), failures=failures)
    return Accuracy(cases, skipped, quick)


def _attempt(data: Path, job: tuple[AnyCase, int]) -> CaseResult:
    """Compute the accuracy of one drive of a case, or return its error."""
    case, number = job
    key = f"{case.folder} {case.name} {case!r}"
    if key not in _made:
        _made.clear()
        _made[key] = source_of(case, data)
    source, pieces = _made[key], isinstance(case, RecordedCase) and case.seeds == 1
    try:
        measured = measure(source.material(run_seed(SERIES, number)))
    except InsnavError as error:
        return CaseResult(source.digest, pieces, NOTHING, {number: error.facts}, source.files)
    return CaseResult(source.digest, pieces, measured, {}, source.files)
