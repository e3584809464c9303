"""Accuracy of corpus recordings against references: with all fixes, in outages, free-inertial; its figures of merit.

A figure of merit has a name, a unit, and a criterion for equality.
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
FAILS_FROM = 0.05  # relative worsening that fails, if significant; for most figures
CAUTION = 0.5  # weight of a too large standard deviation against a too small one
LIKELY = 1e-3  # floor of innovation likelihoods: a thousandth of a standard deviation in the logarithm
SLICES = 8  # parts of a recording for comparing predicted and actual error
_SHORTEST = 0.2  # a last piece with a smaller share of the usual length joins the previous one
_FAR = 7.0  # NIS / 3 at the end of the gate
_LOOP = 400  # iterations of the calibration loop
GROWTH = (5.0, 10.0, 20.0, 30.0, 45.0, 60.0)  # times without GPS of the stored errors [s]
_WINDOWS = 20  # at most, per recording
_NEAR = 1.5  # largest distance of a fix from these times [s]
AnyCase = SimulatedCase | RecordedCase
SERIES = 8  # master seed
_made: dict[str, Source] = {}  # source of the current case in this process


@dataclass(frozen=True, slots=True)
class Metric:
    """Figure of merit."""

    key: str  # key in files, including the unit
    label: str  # its name in words
    unit: str
    # added to every value before ratios are taken [`unit`]: smaller values count as equal, so that rounding on another
    # computer is no change
    floor: float
    kind: Kind = "size"  # a size is better if smaller, a ratio if nearer to one; CPU time has a separate rule
    fails_from: float = FAILS_FROM

    def logarithm(self, value: FloatArray) -> FloatArray:
        """Compute the logarithm for comparison by drive, floor added, (n,)."""
        if self.kind == "ratio":
            return np.log(np.maximum(value, 1e-6))
        return np.log(value + self.floor)

    def badness(self, logarithm: float) -> float:
        """Convert a mean logarithm to badness, smaller is better: for a ratio its distance from one.

        A too large ratio is over-confidence and counts fully; a too small ratio is caution and counts half.
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
OUTAGES = (30.0, 60.0)  # [s]
FREE = 60.0  # [s]


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

    values: dict[str, FloatArray]  # (n,) by metric: one value per recording, or per piece
    # (6, 3) at each of `GROWTH` the number of windows, the sum of squared horizontal errors [m^2], and the sum of
    # predicted variances [m^2]
    growth: FloatArray
    # (8, 9, 2) mean squared error and mean stated variance per slice, NaN if unknown. Columns: N, E, D position [m],
    # N, E, D velocity [m/s], roll, pitch, heading [deg]
    spread: FloatArray


NOTHING = Measured({}, np.zeros((len(GROWTH), 3)), np.full((SLICES, 9, 2), np.nan))  # of a failed drive


def measure(material: Material) -> Measured:
    """Navigate a recording in every way and summarise the errors.

    Returns: metrics, except those unavailable for lack of a reference or of time.
    Raises: InsnavError: the recording cannot be navigated.
    """
    loop = loop_time()
    begin = clock.process_time()
    done = navigate_recording(material.imu, material.gps, material.spec, material.receiver, gates=material.gates)
    cpu = clock.process_time() - begin
    values = {"cpu_ratio": np.array([cpu / len(material.imu.time) / loop])}
    time = settled(done.run.solution, material)
    spread = np.full((SLICES, 9, 2), np.nan)
    if len(time):
        errors = errors_of(done.run.solution, time, material)
        edges = _edges(time, material.block)
        values |= _accuracy(errors, edges)
        spread = _spread(errors)
        if done.run.smoothed is not None:
            values |= _smoothed(errors_of(done.run.smoothed.solution, time, material), edges)
        values |= _fixes(done.run, edges)
    windows, growth = _outages(material)
    values |= windows | _free_inertial(done, material)
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
    """Return the evaluated times of the reference."""
    begin = max(solution.time[0], material.gps.time[0]) + material.settle
    time = material.truth.time
    return np.asarray(time[(time >= begin) & (time <= solution.time[-1])])


def errors_of(solution: Trajectory, time: FloatArray, material: Material) -> TrajectoryErrors:
    """Compute errors at the evaluated times; NaN in quantities beyond the reference's accuracy."""
    first, last = np.searchsorted(material.truth.time, [time[0], time[-1] + 1e-9])
    part = material.truth.rows(slice(first, last))
    lever_b = material.truth_lever_b if material.truth_lever_b.any() else None
    errors = position_errors(solution, part, lever_b=lever_b)
    position, velocity, attitude = errors.position.copy(), errors.velocity.copy(), errors.attitude.copy()
    if material.remove_offset:
        position -= np.median(position, axis=0)
    groups = {"position": position, "velocity": velocity, "attitude": attitude[:, :2], "heading": attitude[:, 2]}
    for name, each in groups.items():
        each[(errors.speed < material.min_speed) | (name not in material.groups)] = np.nan
    return replace(errors, position=position, velocity=velocity, attitude=attitude)


def _edges(time: FloatArray, block: float) -> FloatArray:
    """Return the borders of the pieces: of the whole, or of blocks of one length."""
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
    found = {}
    for name, error in sizes.items():
        found[name.format("rms")] = np.array([rms(error[rows]) for rows in pieces])
        for key, percent in (("p95", 95.0), ("max", 100.0)):
            found[name.format(key)] = np.array([_quantile(error[rows], percent) for rows in pieces])
    found["cep50_m"] = np.array([_quantile(errors.horizontal[rows], 50.0) for rows in pieces])
    sums = [nees(errors.rows(rows)) for rows in pieces]
    for group in ("position", "velocity", "attitude"):
        parts = [None if each is None else each[group] for each in sums]
        found[f"nees_{group}"] = np.array([np.nan if part is None else part["nees"] for part in parts])
    return found


def _smoothed(errors: TrajectoryErrors, edges: FloatArray) -> dict[str, FloatArray]:
    pieces = _pieces(errors.time, edges)
    return {
        "smoothed_horizontal_rms_m": np.array([rms(errors.horizontal[rows]) for rows in pieces]),
        "smoothed_heading_rms_deg": np.array([rms(errors.attitude[rows, 2] / DEG) for rows in pieces]),
    }


def _fixes(run: Run, edges: FloatArray) -> dict[str, FloatArray]:
    """Compute innovation and rejection statistics of the fixes."""
    processed = run.innovations
    found: dict[str, FloatArray] = {}
    pieces = _pieces(processed.time, edges)
    rejected = np.zeros(len(pieces))
    for group, unit, columns in (("position", "m", slice(0, 3)), ("velocity", "m_s", slice(3, 6))):
        nis, used = getattr(processed, f"nis_{group}"), getattr(processed, f"used_{group}")
        known = np.isfinite(nis)
        size = _likely_size(processed.innovation[:, columns], processed.sd[:, columns])
        found[f"innovation_{group}_{unit}"] = np.array(
            [math.exp(_mean(size[rows & np.isfinite(size)])) for rows in pieces]
        )
        found[f"nis_{group}"] = np.array([_mean(nis[rows & used & known]) / 3.0 for rows in pieces])
        rejected += [np.count_nonzero(rows & known & ~used) for rows in pieces]
    found["rejected_fixes"] = rejected
    return found


def _likely_size(innovation: FloatArray, sd: FloatArray) -> FloatArray:
    """Compute the log size of the innovations by likelihood, per fix and component, (n,).

    ``ln S + z^2 / 2 - 1/2`` has its minimum, on average, at the true S: too large and too small predictions are both
    worse (logarithmic score: Gneiting and Raftery, J. Amer. Statist. Assoc. 102 (2007) 359-378). An outlier counts like
    a fix at the gate limit, used or not.
    """
    z2 = np.minimum(np.mean((innovation / sd) ** 2, axis=1), _FAR)
    return np.asarray(np.mean(np.log(sd), axis=1) + 0.5 * z2 - 0.5)


def _spread(errors: TrajectoryErrors) -> FloatArray:
    found = np.full((SLICES, 9, 2), np.nan)
    if errors.sd is None:
        return found
    unit = np.array([1.0] * 6 + [1.0 / DEG] * 3)
    error = np.column_stack([errors.position, errors.velocity, errors.attitude]) * unit
    sd = errors.sd * unit
    for number, rows in enumerate(np.array_split(np.arange(len(errors.time)), SLICES)):
        if len(rows):
            known = np.isfinite(error[rows]).sum(axis=0)
            some = known > 0
            found[number, some, 0] = np.nansum(error[rows][:, some] ** 2, axis=0) / known[some]
            found[number, some, 1] = np.mean(sd[rows][:, some] ** 2, axis=0)
    return found


def _outages(material: Material) -> tuple[dict[str, FloatArray], FloatArray]:
    """Compute horizontal errors after times without fixes, and `Measured.growth`; no metrics for a short drive."""
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
    chosen = {f"outage_{t:.0f}s_m": error[:, GROWTH.index(t)] for t in OUTAGES}
    return {key: _by_recording(value, material.block) for key, value in chosen.items()}, growth


def _free_inertial(done: Navigated, material: Material) -> dict[str, FloatArray]:
    """Compute the horizontal error after a free-inertial minute; empty for a short drive.

    Without reference velocity, the smoothed solution replaces it.
    """
    clock = done.run.gps_delay - material.receiver.delay.value  # the solution uses fix time
    reference, reference_clock = material.truth, 0.0
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
    """Return every window's error for a drive in pieces, else their root mean square."""
    return value if block > 0.0 else np.array([rms(value)])


def _mean(value: FloatArray) -> float:
    return float(np.mean(value)) if value.size else float("nan")


def _quantile(error: FloatArray, percent: float) -> float:
    known = np.abs(error[np.isfinite(error)])
    return float(np.percentile(known, percent)) if known.size else float("nan")


def joined(parts: Sequence[Measured]) -> Measured:
    """Combine the recordings of one case: concatenate values, add sums."""
    order = [metric.key for metric in METRICS if any(metric.key in part.values for part in parts)]
    nothing = np.array([np.nan])
    values = {key: np.concatenate([part.values.get(key, nothing) for part in parts]) for key in order}
    spread = np.array([part.spread for part in parts])
    known = np.isfinite(spread)
    count = known.sum(axis=0)
    mean = np.where(count > 0, np.where(known, spread, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)
    return Measured(values, np.sum([part.growth for part in parts], axis=0), mean)


@dataclass(frozen=True, slots=True)
class CaseResult:
    """Accuracy of one case."""

    digest: str  # of the case and its files
    pieces: bool  # values of successive pieces of one drive; otherwise of independent drives
    measured: Measured  # empty if every drive failed
    failures: Mapping[int, ErrorFacts | None]  # failed drives by number, from 1; None in a baseline
    files: dict[str, str]  # digest of each recorded file


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Accuracy of the whole corpus."""

    cases: dict[str, CaseResult]  # by name
    skipped: dict[str, Finding]  # skipped cases with the reason
    quick: bool  # partial run


def run_corpus(
    corpus: Corpus,
    data: Path,
    *,
    quick: bool = False,
    workers: Workers = 1,
    progress: Callable[[float], None] | None = None,
) -> Accuracy:
    """Navigate all drives. Raises: ConfigError: no worker, or a wrong profile or model name in a case."""
    skipped: dict[str, Finding] = {}
    jobs: list[tuple[AnyCase, int]] = []
    for case in corpus.cases:
        if isinstance(case, RecordedCase) and not (data / case.data).is_dir():
            no_data = Finding.of(Code.REGRESSION_NO_DATA, subject=case.name, data=str(case.data), folder=str(data))
            skipped[case.name] = no_data
            continue
        count = min(case.quick, case.seeds) if quick else case.seeds
        if not count:
            skipped[case.name] = Finding.of(Code.REGRESSION_NOT_QUICK, subject=case.name)
        jobs += [(case, number) for number in range(1, count + 1)]
    drives: dict[str, list[CaseResult]] = {}
    for (case, _), drive in zip(jobs, every(_attempt, jobs, workers, (data,), progress), strict=True):
        drives.setdefault(case.name, []).append(drive)
    cases = {}
    for name, own in drives.items():
        failures = {number: error for each in own for number, error in each.failures.items()}
        cases[name] = replace(own[0], measured=joined([each.measured for each in own]), failures=failures)
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
