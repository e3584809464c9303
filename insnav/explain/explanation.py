"""Faults of a recording, as instructions for the filter: excluded fixes, state changes and larger standard deviations.

Attitude errors of many degrees are not a linear function of a gyro fault. The filter therefore runs again with each
fault of the IMU. The search repeats on the new linear record until the fault is unchanged (Gauss-Newton).
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

ROUNDS = 9  # filter runs, each with the IMU faults of the previous search
CHANGE_KNOWN = 0.3  # standard deviation of a change of the IMU, relative to the change [-]
MINUTE, PLACES, NEARLY_ALL = 60.0, 20, 0.9  # duration of the reported drag [s]; epochs tested for it; detected share
NINE_IN_TEN = 1.28  # standard deviations by which a fault exceeds the limit to be found nine times in ten [-]
UNSEEN = 1e3  # largest tested size, relative to the typical size [-]
OFFSET = next(kind for kind in KINDS if kind.name == "offset")
EITHER = 0.5  # probability of each side of a lasting change: the likelihood is symmetric in time [-]
LATE = 0.2  # least probability that the fixes with the larger of two delays are on time [-]
# codes of the finding of each kind, for a fault that ends and for one that stays, and the name of its size
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
SIGNED = Code.CHANGE_GYRO_FAULT, Code.CHANGE_DELAY
SUBJECTS = {"turned": "imu", "heading": "imu", "velocity": ""}  # except sensors; the default is the fixes


@dataclass(frozen=True, slots=True)
class Fault:
    """Accepted fault of a recording."""

    kind: Kind
    begin: float  # [s], in the time of the samples
    end: float  # infinity for a fault that stays [s]
    size: FloatArray  # (d,) of each column of the kind
    sd: FloatArray  # (d,) standard deviation of the size
    gain: float  # decrease of the cost by this fault [-]
    back: float = np.inf  # time at which displaced positions return [s]

    @property
    def family(self) -> str:
        """Name of the kind without the axis."""
        return self.kind.name.removesuffix("_x").removesuffix("_y").removesuffix("_z")

    def inside(self, time: FloatArray) -> BoolArray:
        """Return which times are between begin and end."""
        return np.asarray((time >= self.begin) & (time < self.end))

    def displaces(self, time: FloatArray) -> BoolArray:
        """Return at which times the fixes have a constant offset: after a lasting jump or a drag, until they return."""
        begin = self.begin if self.family == "offset" and np.isinf(self.end) else self.end
        return np.asarray((time >= begin) & (time < self.back) & (self.family in MOVING))


@dataclass(frozen=True, slots=True)
class Tried:
    """Fault that the search has tested: a row of the table of the explanation."""

    name: str  # of its kind
    begin: float  # [s]
    end: float  # infinity for a fault that stays [s]
    gain: float  # decrease of the cost, prior included [-]
    prior: float  # cost of its prior [-]
    unit: str  # in which its size is shown
    accepted: bool
    size: float | None = None  # of an accepted fault [SI]
    left_out: int = 0  # fixes
    moved: int = 0  # fixes moved back


@dataclass(frozen=True, slots=True)
class Explanation:
    """Faults of a recording, tested faults, and the work of the search."""

    faults: tuple[Fault, ...] = ()
    tried: tuple[Tried, ...] = ()
    passes: int = 0  # over the linear record
    runs: int = 0  # of the filter over the samples
    findings: tuple[Finding, ...] = ()
    # times (m,) [s] and variances (m, 9) of position, velocity and attitude between explanations that are nearly alike
    between: tuple[FloatArray, FloatArray] = (np.zeros(0), np.zeros((0, 9)))

    def after(self, earlier: Sequence[Explanation]) -> Explanation:
        """Add the work and the delay steps of earlier explanations, whose delays the fixes no longer have."""
        tried = (row for each in earlier for row in each.tried if row.accepted and row.name == "delay")
        passes, runs = (sum(getattr(each, name) for each in (*earlier, self)) for name in ("passes", "runs"))
        return replace(self, tried=(*tried, *self.tried), passes=passes, runs=runs)

    def of_delay(self) -> tuple[Fault, ...]:
        """Return the jumps of the GPS delay. The caller corrects the fix times and repeats the initial alignment."""
        return tuple(fault for fault in self.faults if fault.family == "delay")

    def widen(self, run: Run) -> Run:
        """Enlarge the standard deviations for ambiguities, such as the true side of a lasting change."""
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
            time, more = self.between
            for column, each in enumerate(more.T if more.any() else ()):
                sd[:, column] = np.hypot(sd[:, column], np.sqrt(np.interp(solution.time, time, each)))
            return sd

        return with_wider_sd(run, wider)


def explain_faults(ready: FilterInput, kinds: Sequence[Kind]) -> tuple[FilterInput, Explanation]:
    """Find the faults in rounds of filter runs, each with the IMU faults found before; apply them to the recording."""
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
            if previous is not None and previous.search.complete and not of_imu(previous.faults):
                parts.append(previous)
                continue
            like = parts[-1].search.best if parts else None  # of the part before, which has similar noise
            record, found = search_part(record, kinds, previous and previous.search, like)
            if not np.isfinite(found.best.cost):  # too far from linear to be calculated
                return ready, Explanation()
            tried += considered_of(record, found)
            if not parts:
                detectable = state_detectable(record, found.best.seen, kinds)  # in the first part alone
            faults = faults_in(record, found)
            if found.complete:  # otherwise the search may return to it
                found = replace(found, best=replace(found.best, seen=found.best.seen.bare()))
            parts.append(Part(record.time, record.interval, found, faults))
            spill.release()
        same = alike(of_imu(faults_of(previous_parts)), of_imu(faults_of(parts)))
        if same and all(part.search.complete or part.search.passes > BUDGET for part in parts):
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

    time: FloatArray  # of the epochs [s]
    interval: float  # usual time between epochs [s]
    search: Search
    faults: list[Fault]


def faults_of(parts: Iterable[Part]) -> list[Fault]:
    """Return the faults of all parts in order of time."""
    return [fault for part in parts for fault in part.faults]


def mix(search: Search) -> FloatArray:
    """Compute the variance between explanations, weighted by their probability, (m, 9)."""
    # a run again about faults of the IMU may have other epochs
    every = [search.best, *(each for each in search.others if each.seen.nav.shape == search.best.seen.nav.shape)]
    part = np.exp(-0.5 * (np.array([each.cost for each in every]) - search.best.cost))
    off = np.array([each.seen.nav - search.best.seen.nav for each in every])
    off[:, :, 6:8] = np.linalg.norm(off[:, :, 6:8], axis=2, keepdims=True)  # tilts are of the level axes
    return np.asarray(np.tensordot(part / part.sum(), off**2, axes=1))


def of_imu(faults: Sequence[Fault]) -> list[Fault]:
    """Return the faults of the IMU, with which the filter must run again."""
    return [fault for fault in faults if not fault.kind.of_fixes]


def alike(some: Sequence[Fault], others: Sequence[Fault]) -> bool:
    """Compare two lists of faults: equal kinds and times, and sizes within `SAME`."""
    return len(some) == len(others) and all(
        (one.kind.name, one.begin, one.end) == (two.kind.name, two.begin, two.end)
        and np.linalg.norm(one.size - two.size) <= SAME * np.linalg.norm(two.size)
        for one, two in zip(some, others, strict=True)
    )


def faults_in(record: LinearRecord, search: Search) -> list[Fault]:
    """Convert the accepted steps of a search to faults in time. A return ends earlier displacements of the fixes."""
    faults: list[Fault] = []
    for step, gain in zip(search.best.steps, search.gains, strict=True):
        begin, end = record.span_of(step)
        if step.kind is RETURN:
            for row, each in enumerate(faults):
                if each.family in MOVING and np.isinf(each.back):
                    faults[row] = replace(each, end=min(each.end, begin), back=begin)
            continue
        columns = record.columns(step.kind)
        score, information = search.best.seen.at(step.begin, step.begin + 1, columns)
        size = step.variance * score[0]
        if step.kind.fills:
            size = np.full(1, np.sqrt(step.variance / record.interval))
        known = np.diagonal(information[0])
        sd = np.sqrt(np.maximum(step.variance - step.variance**2 * known, 0.0))
        back = end if step.kind.name in CLEARED else np.inf
        faults.append(Fault(step.kind, begin, end, size, sd, gain, back))
    return faults


def considered_of(record: LinearRecord, search: Search) -> list[Tried]:
    """Return the table rows of the faults that the search has rejected."""
    tested = ((each, each.steps[0], prior_of(each.steps, record.interval)) for each in search.considered)
    return [
        Tried(step.kind.name, *record.span_of(step), each.gain, prior, step.kind.unit, accepted=False)
        for each, step, prior in tested
        if not each.accepted
    ]


def accepted_as(ready: FilterInput, fault: Fault, step: Step, interval: float) -> Tried:
    """Return the table row of an accepted fault."""
    false, time = apply_faults(ready, [fault]).explained.false, ready.fix_time
    left_out = 0 if false is None else int(np.count_nonzero(false.any(axis=0)))
    moved = int(np.count_nonzero(fault.displaces(time)))
    kind, size, prior = fault.kind, float(np.linalg.norm(fault.size)), prior_of((step,), interval)
    return Tried(kind.name, fault.begin, fault.end, fault.gain, prior, kind.unit, True, size, left_out, moved)


def state_detectable(record: LinearRecord, of: Pass, kinds: Sequence[Kind]) -> Finding:
    """Compute the smallest faults of the fixes that the search detects with probability 0.9 in most of the record.

    Minimal detectable bias: W. Baarda, "A testing procedure for use in geodetic networks", Netherlands Geodetic
    Commission 2/5 (1968). The critical value is the gain that the search requires.
    """
    values, information = dict[str, Any](), of.scores[1]  # (m, n, n), of a step before each epoch
    length = max(int(MINUTE / record.interval), 2)
    rows = np.linspace(1, max(record.time.size - length - 1, 1), PLACES).astype(int)
    followed = "followed_drag" if "velocity offset" in record.states else "drag"  # measured velocities drift, too
    for name, key in (("offset", "jump_m"), (followed, "drift_m_s"), ("drag", "minute_m_s")):
        kind = next(each for each in kinds if each.name == name)
        columns, end_cost = record.columns(kind), cost_of_end(record.interval) * (key == "minute_m_s")
        known = columns.T @ information[rows] @ columns
        if key == "minute_m_s":  # the opposite step ends the drag a minute later
            later = np.minimum(rows + length, record.time.size - 1)
            cross = np.array([record.cross(of, columns, a, length)[b] for a, b in zip(rows, later, strict=True)])
            known = known + columns.T @ information[later] @ columns - cross - np.swapaxes(cross, 1, 2)
        misfit = misfit_of(record, of, kind)
        least = [_least_found(each, kind, record.interval, end_cost, misfit) for each in known]
        value = float(np.quantile(least, NEARLY_ALL, method="lower"))  # some are infinite
        if value < UNSEEN * kind.size:
            values[key] = value
    return Finding.of(Code.GPS_DETECTABLE, **values)


def _least_found(known: FloatArray, kind: Kind, interval: float, ends: float, misfit: float) -> float:
    """Compute the smallest detectable size of a step in its weakest horizontal direction.

    `known`: information (d, d) of the step. The detection probability is 0.9.
    """
    value, vectors = np.linalg.eigh(known[:2, :2])
    sizes, variances = kind.size * np.geomspace(1.0 / UNSEEN, UNSEEN, 121), kind.size**2 * SIZES
    score = sizes[:, None] * (known[:, :2] @ vectors[:, 0])
    prior = kind.cost(variances, interval) + ends
    gain = (gains_of(score, np.tile(known, (sizes.size, 1, 1)), variances) - prior[:, None]).max(axis=0)
    enough = gain >= max(ACCEPT, misfit - float(prior.min()))
    return float(sizes[np.argmax(enough)] + NINE_IN_TEN / np.sqrt(max(value[0], 1e-30))) if enough.any() else np.inf


def apply_faults(ready: FilterInput, faults: Sequence[Fault]) -> FilterInput:
    """Apply faults to a recording: exclude false fixes, change the filter state, and increase the noise."""
    gps, time, changes, rough = ready.gps, ready.fix_time, [*ready.explained.changes], list[Rough]()
    false = np.zeros((2, time.size), dtype=np.bool_)
    for fault in faults:
        inside = fault.inside(time)
        if fault.family in MOVING:
            passes = np.isfinite(fault.end) or fault.family != "offset"
            false[0] |= inside & passes
            false[1] |= inside & (fault.family == "followed_drag")
            if (off := fault.displaces(time)).any():
                gps = replace(gps, lla=lla_offset(gps.lla, -_moved(fault) * off[:, None]))
        elif fault.family == "velocity_offset":
            false[1] |= inside
        elif fault.kind.fills:
            rough.append(Rough(fault.begin, fault.end, float(fault.size[0]), FADES))
            # errors larger than a typical offset carry no information and may not be random
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
    found = [StateChange(fault.begin, NAMES[name], change, variance)]
    if np.isfinite(fault.end):
        found.append(StateChange(fault.end, NAMES[name], -change, variance))
    return found


def _moved(fault: Fault) -> FloatArray:
    """Compute the displacement of the positions by a fault, North, East, Down (3,) [m]."""
    return fault.size if fault.family == "offset" else np.asarray(fault.size * (fault.end - fault.begin))


def find(fault: Fault, gps: GpsData) -> Finding:
    """Build the finding of a fault."""
    passes, stays, name = CODES[fault.family]
    size = _moved(fault) if name == "distance_m" and np.isfinite(fault.end) else fault.size
    code = passes if np.isfinite(fault.end) else stays
    value = -float(size[0]) if code in SIGNED else float(np.linalg.norm(size))  # errors are estimate minus truth
    sensor = fault.family in ("gyro", "accel")
    subject = fault.kind.name.replace("_", " ") if sensor else SUBJECTS.get(fault.family, "gps")
    inside = gps.time[fault.inside(gps.time)]
    values: dict[str, Any] = {name: value}
    if code in (Code.RECORD_FALSE_POSITIONS, Code.RECORD_FALSE_VELOCITIES):
        values = {"count": inside.size, name.replace("distance_m", "residual_m"): value}
    last = float(inside[-1]) if inside.size else fault.begin
    end = last if np.isfinite(fault.end) or fault.family == "delay" else None
    return Finding.of(code, fault.begin, end, subject=subject, **values)
