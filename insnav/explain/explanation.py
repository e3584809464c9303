"""Faults of a recording, as instructions for the filter: excluded fixes, state changes and larger standard deviations.

Attitude errors of many degrees are not a linear function of a gyro fault. The filter therefore runs again with the IMU
faults found so far. The search repeats on the linear record of this run until the faults are unchanged (Gauss-Newton).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain, repeat
from typing import Any, NamedTuple

import numpy as np

from insnav import spill
from insnav.earth import lla_offset
from insnav.exceptions import DivergenceError
from insnav.explain.kinds import FADES, KINDS, RETURN, Kind, cost_of_end
from insnav.explain.proposals import MOVING, SIZES, gains_of, misfit_of
from insnav.explain.record import CLEARED, NAMES, LinearRecord, Pass, Step, usual_correlated
from insnav.explain.search import ACCEPT, BUDGET, FEWEST, SAME, Search, prior_of, search_part
from insnav.filter.ambiguity import with_wider_sd
from insnav.filter.filter_input import Explained, FilterInput
from insnav.filter.gps_noise import Rough
from insnav.findings import Code, Finding
from insnav.types import BoolArray, FloatArray, GpsData, Run, StateChange, Trajectory

ROUNDS = 9  # largest number of filter runs, each with the IMU faults of the previous search
CHANGE_KNOWN = 0.3  # assumed standard deviation of an IMU fault, relative to its size [-]
# minimal detectable fault: length of a temporary drag [s], number of tested epochs, share of epochs with detection
MINUTE, PLACES, NEARLY_ALL = 60.0, 20, 0.9
NINE_IN_TEN = 1.28  # a fault this many sd above the detection limit is detected nine times in ten [-]
UNSEEN = 1e3  # largest tested size of a fault, relative to the typical size [-]
OFFSET = next(kind for kind in KINDS if kind.name == "offset")
EITHER = 0.5  # at a lasting jump, earlier and later fixes are equally likely to be the true ones [-]
LATE = 0.2  # at a step of the GPS delay, probability that the fixes of larger delay are on time, not the others [-]
# by kind: code of the finding for a temporary fault, code for a permanent fault, and name of the size in the finding
CODES = {
    "offset": (Code.RECORD_FALSE_POSITIONS, Code.RECORD_JUMP, "distance_m"),
    "drag": (Code.RECORD_DRIFT, Code.RECORD_DRIFT, "distance_m"),
    "followed_drag": (Code.RECORD_DRIFT, Code.RECORD_DRIFT, "distance_m"),
    "velocity_offset": (Code.RECORD_FALSE_VELOCITIES, Code.RECORD_FALSE_VELOCITIES, "residual_m_s"),
    "rough": (Code.RECORD_ROUGH, Code.RECORD_ROUGH, "sd_m"),
    "velocity": (Code.RECORD_VELOCITY_MISSED, Code.RECORD_VELOCITY_MISSED, "speed_m_s"),
    "turned": (Code.CHANGE_TURNED, Code.CHANGE_TURNED, "angle_rad"),
    "heading": (Code.CHANGE_TURNED, Code.CHANGE_TURNED, "angle_rad"),
    "gyro": (Code.CHANGE_GYRO_FAULT, Code.CHANGE_GYRO_BIAS, "rate_rad_s"),
    "accel": (Code.CHANGE_ACCEL_BIAS, Code.CHANGE_ACCEL_BIAS, "acceleration_m_s2"),
    "delay": (Code.CHANGE_DELAY, Code.CHANGE_DELAY, "delay_s"),
}
SIGNED = Code.CHANGE_GYRO_FAULT, Code.CHANGE_DELAY  # findings that report the sign of the size
SUBJECTS = {"turned": "imu", "heading": "imu", "velocity": ""}  # subject by fault family; other families: GPS


@dataclass(frozen=True, slots=True)
class Fault:
    """Accepted fault of a recording."""

    kind: Kind
    begin: float  # time of the begin, on the clock of the samples [s]
    end: float  # time of the end; infinite for a permanent fault [s]
    size: FloatArray  # (d,) size along each column of the kind, as estimate minus truth
    sd: FloatArray  # (d,) standard deviation of the size
    gain: float  # decrease of the cost (-2 ln of the evidence) by this fault [-]
    back: float = np.inf  # time at which displaced positions return to the true track [s]

    @property
    def family(self) -> str:
        """Name of the kind without the axis: ``gyro`` for ``gyro_x``."""
        return self.kind.name.removesuffix("_x").removesuffix("_y").removesuffix("_z")

    def inside(self, time: FloatArray) -> BoolArray:
        """Test which times [s] are between begin and end."""
        return np.asarray((time >= self.begin) & (time < self.end))

    def displaces(self, time: FloatArray) -> BoolArray:
        """Test at which times [s] the fixes are displaced: from a lasting jump or the end of a drag to their return."""
        begin = self.begin if self.family == "offset" and np.isinf(self.end) else self.end
        return np.asarray((time >= begin) & (time < self.back) & (self.family in MOVING))


@dataclass(frozen=True, slots=True)
class Tried:
    """Fault that the search has tested: a row of the fault table in the report."""

    name: str  # name of the kind of the fault
    begin: float  # time of the begin [s]
    end: float  # time of the end; infinite for a permanent fault [s]
    gain: float  # decrease of the cost, which includes the prior [-]
    prior: float  # -2 ln of the prior of the fault [-]
    unit: str  # unit for display of the size
    accepted: bool
    size: float | None = None  # size of an accepted fault [SI]; None if rejected
    left_out: int = 0  # number of excluded fixes
    moved: int = 0  # number of fixes moved back to the true track


@dataclass(frozen=True, slots=True)
class Explanation:
    """Result of the search: accepted faults, tested faults, and the number of passes and runs."""

    faults: tuple[Fault, ...] = ()
    tried: tuple[Tried, ...] = ()
    passes: int = 0  # passes over the linear record
    runs: int = 0  # filter runs over the samples
    findings: tuple[Finding, ...] = ()
    # times (m,) [s], variances (m, 9) of position, velocity and attitude between explanations of nearly equal cost
    between: tuple[FloatArray, FloatArray] = (np.zeros(0), np.zeros((0, 9)))

    def after(self, earlier: Sequence[Explanation]) -> Explanation:
        """Add passes, runs and delay steps of earlier explanations. The fixes are corrected for these delays by now."""
        tried = (row for each in earlier for row in each.tried if row.accepted and row.name == "delay")
        passes, runs = (sum(getattr(each, name) for each in (*earlier, self)) for name in ("passes", "runs"))
        return replace(self, tried=(*tried, *self.tried), passes=passes, runs=runs)

    def of_delay(self) -> tuple[Fault, ...]:
        """Return the steps of the GPS delay. The caller corrects the fix times and repeats the initial alignment."""
        return tuple(fault for fault in self.faults if fault.family == "delay")

    def widen(self, run: Run) -> Run:
        """Enlarge the sds of a run to cover ambiguities: for example, either side of a lasting jump may be true."""
        displaced = [fault for fault in self.faults if fault.displaces(run.solution.time).any()]
        if not (displaced or self.of_delay() or self.between[1].any()):
            return run

        def wider(solution: Trajectory, sd: FloatArray) -> FloatArray:
            variance = sd[:, :3] ** 2
            for fault in displaced:
                variance += fault.displaces(solution.time)[:, None] * _moved(replace(fault, size=fault.sd)) ** 2
                variance += EITHER * np.isinf(fault.back) * _moved(fault) ** 2
            for fault in self.of_delay():
                variance += LATE * (fault.size[0] * solution.v_n) ** 2
            sd[:, :3] = np.sqrt(variance)
            time, ambiguity = self.between
            for column, column_variance in enumerate(ambiguity.T if ambiguity.any() else ()):
                sd[:, column] = np.hypot(sd[:, column], np.sqrt(np.interp(solution.time, time, column_variance)))
            return sd

        return with_wider_sd(run, wider)


def explain_faults(ready: FilterInput, kinds: Sequence[Kind]) -> tuple[FilterInput, Explanation]:
    """Find the faults of a recording and apply them. Each round runs the filter with the IMU faults found so far."""
    parts, tried, runs = list[Part](), list[Tried](), 0
    for _ in range(ROUNDS):
        try:
            records = LinearRecord.of(apply_faults(ready, of_imu(faults_of(parts))))
        except DivergenceError:
            break
        runs, first = runs + 1, next(records)
        if np.count_nonzero(first.known.any(axis=1)) < FEWEST:
            break
        previous_parts, parts = parts, []
        for record, previous in zip(chain([first], records), chain(previous_parts, repeat(None)), strict=False):
            # a part without IMU faults whose search is complete keeps its result
            if previous is not None and previous.search.complete and not of_imu(previous.faults):
                parts.append(previous)
                continue
            neighbour = parts[-1].search.best if parts else None  # the noise of the previous part is similar
            record, result = search_part(record, kinds, previous and previous.search, neighbour)
            if not np.isfinite(result.best.cost):  # errors are too large for the linear model: give up
                return ready, Explanation()
            tried += considered_of(record, result)
            if not parts:
                detectable = state_detectable(record, result.best.seen, kinds)  # from the first part
            faults = faults_in(record, result)
            if result.complete:  # free memory; an incomplete search continues from this pass
                result = replace(result, best=replace(result.best, seen=result.best.seen.bare()))
            parts.append(Part(record.time, record.interval, result, faults))
            spill.release()
        unchanged = alike(of_imu(faults_of(previous_parts)), of_imu(faults_of(parts)))
        if unchanged and all(part.search.complete or part.search.passes > BUDGET for part in parts):
            break
    if not parts:
        return ready, Explanation()
    faults = faults_of(parts)
    explained = apply_faults(ready, faults)
    findings = *(find(fault, explained.gps) for fault in faults if fault.family != "delay"), detectable
    rows = {(each.name, each.begin, each.end): each for each in sorted(tried, key=lambda each: each.gain)}
    for part in parts:
        steps = (step for step in part.search.best.steps if step.kind is not RETURN)
        for fault, step in zip(part.faults, steps, strict=True):
            rows[fault.kind.name, fault.begin, fault.end] = accepted_as(ready, fault, step, part.interval)
    best_first = sorted(rows.values(), key=lambda each: (not each.accepted, -each.gain))
    ambiguity = np.concatenate([part.time for part in parts]), np.concatenate([mix(part.search) for part in parts])
    passes = sum(part.search.passes for part in parts)
    return explained, Explanation(tuple(faults), tuple(best_first), passes, runs, findings, ambiguity)


class Part(NamedTuple):
    """Part of a recording, with its search and its faults."""

    time: FloatArray  # (m,) times of the epochs [s]
    interval: float  # usual time between epochs [s]
    search: Search
    faults: list[Fault]


def faults_of(parts: Iterable[Part]) -> list[Fault]:
    """Return the faults of all parts in order of time."""
    return [fault for part in parts for fault in part.faults]


def mix(search: Search) -> FloatArray:
    """Compute the variance of the smoothed errors between explanations, weighted by their probability, (m, 9)."""
    # explanations from an earlier filter run may have other epochs, and are left out
    fits = [search.best, *(each for each in search.others if each.seen.nav.shape == search.best.seen.nav.shape)]
    probability = np.exp(-0.5 * (np.array([each.cost for each in fits]) - search.best.cost))
    difference = np.array([each.seen.nav - search.best.seen.nav for each in fits])
    # tilts are about north and east: roll and pitch each get the norm of both
    difference[:, :, 6:8] = np.linalg.norm(difference[:, :, 6:8], axis=2, keepdims=True)
    return np.asarray(np.tensordot(probability / probability.sum(), difference**2, axes=1))


def of_imu(faults: Sequence[Fault]) -> list[Fault]:
    """Return the faults of the IMU. The filter must run again to apply them."""
    return [fault for fault in faults if not fault.kind.of_fixes]


def alike(some: Sequence[Fault], others: Sequence[Fault]) -> bool:
    """Test whether two lists have faults of equal kinds and times, and of sizes that differ by less than `SAME`."""
    return len(some) == len(others) and all(
        (one.kind.name, one.begin, one.end) == (two.kind.name, two.begin, two.end)
        and np.linalg.norm(one.size - two.size) <= SAME * np.linalg.norm(two.size)
        for one, two in zip(some, others, strict=True)
    )


def faults_in(record: LinearRecord, search: Search) -> list[Fault]:
    """Convert the accepted steps of a search to faults. A step `RETURN` ends the earlier displacements of the fixes."""
    faults: list[Fault] = []
    for step, gain in zip(search.best.steps, search.gains, strict=True):
        begin, end = record.span_of(step)
        if step.kind is RETURN:
            for row, earlier in enumerate(faults):
                if earlier.family in MOVING and np.isinf(earlier.back):
                    faults[row] = replace(earlier, end=min(earlier.end, begin), back=begin)
            continue
        columns = record.columns(step.kind)
        score, information = search.best.seen.at(step.begin, step.begin + 1, columns)
        size = step.variance * score[0]
        if step.kind.fills:
            size = np.full(1, np.sqrt(step.variance / record.interval))
        information_of_size = np.diagonal(information[0])
        sd = np.sqrt(np.maximum(step.variance - step.variance**2 * information_of_size, 0.0))
        back = end if step.kind.name in CLEARED else np.inf
        faults.append(Fault(step.kind, begin, end, size, sd, gain, back))
    return faults


def considered_of(record: LinearRecord, search: Search) -> list[Tried]:
    """Build the table rows of the faults that the search has tested and rejected."""
    tested = ((each, each.steps[0], prior_of(each.steps, record.interval)) for each in search.considered)
    return [
        Tried(step.kind.name, *record.span_of(step), each.gain, prior, step.kind.unit, accepted=False)
        for each, step, prior in tested
        if not each.accepted
    ]


def accepted_as(ready: FilterInput, fault: Fault, step: Step, interval: float) -> Tried:
    """Build the table row of an accepted fault, with the numbers of excluded and moved fixes."""
    false, time = apply_faults(ready, [fault]).explained.false, ready.fix_time
    left_out = 0 if false is None else int(np.count_nonzero(false.any(axis=0)))
    moved = int(np.count_nonzero(fault.displaces(time)))
    kind, size, prior = fault.kind, float(np.linalg.norm(fault.size)), prior_of((step,), interval)
    return Tried(kind.name, fault.begin, fault.end, fault.gain, prior, kind.unit, True, size, left_out, moved)


def state_detectable(record: LinearRecord, of: Pass, kinds: Sequence[Kind]) -> Finding:
    """Compute the smallest faults of the fixes that the search detects with probability 0.9, in 90 % of the record.

    Minimal detectable bias: W. Baarda, "A testing procedure for use in geodetic networks", Netherlands Geodetic
    Commission 2/5 (1968). The critical value is the gain that the search requires.
    """
    values, information = dict[str, Any](), of.scores[1]  # (m, n, n): of a step before each epoch
    length = max(int(MINUTE / record.interval), 2)
    rows = np.linspace(1, max(record.time.size - length - 1, 1), PLACES).astype(int)
    followed = "followed_drag" if "velocity offset" in record.states else "drag"  # drag with consistent velocities
    for name, key in (("offset", "jump_m"), (followed, "drift_m_s"), ("drag", "minute_m_s")):
        kind = next(each for each in kinds if each.name == name)
        columns, end_cost = record.columns(kind), cost_of_end(record.interval) * (key == "minute_m_s")
        of_step = columns.T @ information[rows] @ columns
        if key == "minute_m_s":  # the opposite step ends the drag a minute later
            later = np.minimum(rows + length, record.time.size - 1)
            cross = np.array([record.cross(of, columns, a, length)[b] for a, b in zip(rows, later, strict=True)])
            of_step = of_step + columns.T @ information[later] @ columns - cross - np.swapaxes(cross, 1, 2)
        misfit = misfit_of(record, of, kind)
        least = [_least_found(each, kind, record.interval, end_cost, misfit) for each in of_step]
        value = float(np.quantile(least, NEARLY_ALL, method="lower"))  # infinite if undetectable
        if value < UNSEEN * kind.size:
            values[key] = value
    return Finding.of(Code.GPS_DETECTABLE, **values)


def _least_found(known: FloatArray, kind: Kind, interval: float, ends: float, misfit: float) -> float:
    """Compute the size of a step that is detected with probability 0.9 in its least observable horizontal direction.

    `known`: information (d, d) of the step. `ends`: prior cost of its end. `misfit`: gain of model errors by chance.
    """
    value, vectors = np.linalg.eigh(known[:2, :2])
    sizes, variances = kind.size * np.geomspace(1.0 / UNSEEN, UNSEEN, 121), kind.size**2 * SIZES
    score = sizes[:, None] * (known[:, :2] @ vectors[:, 0])
    prior = kind.cost(variances, interval) + ends
    gain = (gains_of(score, np.tile(known, (sizes.size, 1, 1)), variances) - prior[:, None]).max(axis=0)
    enough = gain >= max(ACCEPT, misfit - float(prior.min()))
    return float(sizes[np.argmax(enough)] + NINE_IN_TEN / np.sqrt(max(value[0], 1e-30))) if enough.any() else np.inf


def apply_faults(ready: FilterInput, faults: Sequence[Fault]) -> FilterInput:
    """Apply faults to a recording: exclude or move fixes, list changes of the filter state, and increase the noise."""
    gps, time, changes, rough = ready.gps, ready.fix_time, [*ready.explained.changes], list[Rough]()
    false = np.zeros((2, time.size), dtype=np.bool_)
    for fault in faults:
        inside = fault.inside(time)
        if fault.family in MOVING:
            temporary = np.isfinite(fault.end) or fault.family != "offset"
            false[0] |= inside & temporary
            false[1] |= inside & (fault.family == "followed_drag")
            if (displaced := fault.displaces(time)).any():
                gps = replace(gps, lla=lla_offset(gps.lla, -_moved(fault) * displaced[:, None]))
        elif fault.family == "velocity_offset":
            false[1] |= inside
        elif fault.kind.fills:
            rough.append(Rough(fault.begin, fault.end, float(fault.size[0]), FADES))
            # exclude positions with larger errors than a typical offset: the errors may not be random
            false[0] |= inside & (rough[-1].sd > OFFSET.size)
        elif fault.family != "delay":
            changes += _changes_of(fault)
    changes.sort(key=lambda change: change.time)
    if rough and ready.receiver.correlated is None:
        ready = ready.replace_correlated(usual_correlated(gps.position_sd))
    return replace(ready, gps=gps, explained=Explained(tuple(changes), false if false.any() else None, tuple(rough)))


def _changes_of(fault: Fault) -> list[StateChange]:
    """Convert a fault of the IMU to changes of the filter state."""
    name, axis = fault.kind.steps[0][0].rsplit(" ", 1)
    change = np.zeros(3)
    change[int(axis) :][: fault.size.size] = fault.size
    variance = np.full(3, (CHANGE_KNOWN * np.linalg.norm(change)) ** 2)
    changes = [StateChange(fault.begin, NAMES[name], change, variance)]
    if np.isfinite(fault.end):
        changes.append(StateChange(fault.end, NAMES[name], -change, variance))
    return changes


def _moved(fault: Fault) -> FloatArray:
    """Compute the final displacement of the positions by an offset or a drag, North, East, Down (3,) [m]."""
    return fault.size if fault.family == "offset" else np.asarray(fault.size * (fault.end - fault.begin))


def find(fault: Fault, gps: GpsData) -> Finding:
    """Build the finding that reports a fault, with its subject, times and size."""
    code_temporary, code_permanent, name = CODES[fault.family]
    size = _moved(fault) if name == "distance_m" and np.isfinite(fault.end) else fault.size
    code = code_temporary if np.isfinite(fault.end) else code_permanent
    value = -float(size[0]) if code in SIGNED else float(np.linalg.norm(size))  # truth minus estimate
    sensor = fault.family in ("gyro", "accel")
    subject = fault.kind.name.replace("_", " ") if sensor else SUBJECTS.get(fault.family, "gps")
    inside = gps.time[fault.inside(gps.time)]
    values: dict[str, Any] = {name: value}
    if code in (Code.RECORD_FALSE_POSITIONS, Code.RECORD_FALSE_VELOCITIES):
        values = {"count": inside.size, name.replace("distance_m", "residual_m"): value}
    last = float(inside[-1]) if inside.size else fault.begin
    end = last if np.isfinite(fault.end) or fault.family == "delay" else None
    return Finding.of(code, fault.begin, end, subject=subject, **values)
