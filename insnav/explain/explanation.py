"""What a recording contains, handed to the filter: fixes to leave out, changes of the IMU, and what stays ambiguous.

Attitude errors of many degrees are no linear function of a gyro fault: where the IMU has one, the linear record is made
again about a run with it, until it stays the same (Gauss-Newton).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from insnav.earth import lla_offset
from insnav.exceptions import DivergenceError
from insnav.explain.kinds import FADES, KINDS, RETURN, Kind, cost_of_end
from insnav.explain.proposals import MOVING, SIZES, gains_of, misfit_of
from insnav.explain.record import CLEARED, NAMES, LinearRecord, Pass, Step, usual_correlated
from insnav.explain.search import ACCEPT, Search, prior_of, search
from insnav.filter.ambiguity import with_wider_sd
from insnav.filter.gps_correlation import Rough
from insnav.filter.prepare import Prepared
from insnav.findings import Code, Finding
from insnav.types import BoolArray, FloatArray, GpsData, Run, StateChange, Trajectory

ROUNDS = 5  # runs of the filter, each about the faults of the IMU found before
CHANGE_KNOWN = 0.3  # part of a change of the IMU by which it may be another [-]
SAME = 0.1  # part of its size by which a fault may change in the last of them [-]
FEWEST = 20  # epochs with a fix, below which a record shows no fault
MINUTE, PLACES, NEARLY_ALL = 60.0, 20, 0.9  # drag whose least size is stated [s]; where it is looked for; part of these
NINE_IN_TEN = 1.28  # standard deviations by which a fault exceeds the limit to be found nine times in ten [-]
UNSEEN = 1e3  # times the typical size from which nothing is seen [-]
OFFSET = next(kind for kind in KINDS if kind.name == "offset")
EITHER = 0.5  # probability of either side of a lasting change: a record is the same read backwards [-]
LATE = 0.2  # that fixes on the larger of two delays are on time, at least [-]
# what a finding of a kind says: its code where the fault passes and where it stays, and the name of its size
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
SUBJECTS = {"turned": "imu", "heading": "imu", "velocity": ""}  # beside sensors; else the fixes


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault that the record contains."""

    kind: Kind
    begin: float  # [s], in the time of the samples
    end: float  # infinite for one that stays [s]
    size: FloatArray  # (d,) of each column of the kind
    sd: FloatArray  # (d,) of that
    gain: float  # of the evidence by it [-]
    back: float = np.inf  # from when on positions are again where they were before [s]

    @property
    def family(self) -> str:
        """Name of the kind without an axis."""
        return self.kind.name.removesuffix("_x").removesuffix("_y").removesuffix("_z")

    def inside(self, time: FloatArray) -> BoolArray:
        """Times between begin and end."""
        return np.asarray((time >= self.begin) & (time < self.end))

    def displaces(self, time: FloatArray) -> BoolArray:
        """Times at which positions are off by a constant: from a jump that stays or the end of a drag to a return."""
        begin = self.begin if self.family == "offset" and np.isinf(self.end) else self.end
        return np.asarray((time >= begin) & (time < self.back) & (self.family in MOVING))


@dataclass(frozen=True, slots=True)
class Tried:
    """A fault that the search has tried, as a row of the table of the explanation."""

    name: str  # of its kind
    begin: float  # [s]
    end: float  # infinite for one that stays [s]
    gain: float  # of the evidence [-]
    prior: float  # what of that its prior has cost [-]
    unit: str  # in which its size is shown
    accepted: bool
    size: float | None = None  # [SI]; of one that was accepted
    left_out: int = 0  # fixes
    moved: int = 0  # fixes moved back


@dataclass(frozen=True, slots=True)
class Explanation:
    """The faults of a recording, and how they were found."""

    faults: tuple[Fault, ...] = ()
    tried: tuple[Tried, ...] = ()
    passes: int = 0  # over the linear record
    runs: int = 0  # of the filter over the samples
    findings: tuple[Finding, ...] = ()
    # times (m,) [s] and variances (m, 9) of position, velocity and attitude between explanations that are nearly alike
    between: tuple[FloatArray, FloatArray] = (np.zeros(0), np.zeros((0, 9)))

    def after(self, earlier: Sequence[Explanation]) -> Explanation:
        """The same with the work of explanations whose delays the fixes are free of, and with these delays."""
        tried = (row for each in earlier for row in each.tried if row.accepted and row.name == "delay")
        passes, runs = (sum(getattr(each, name) for each in (*earlier, self)) for name in ("passes", "runs"))
        return replace(self, tried=(*tried, *self.tried), passes=passes, runs=runs)

    def of_delay(self) -> tuple[Fault, ...]:
        """Steps of the delay of the fixes, which no run takes into account: whoever aligns puts them on one delay."""
        return tuple(fault for fault in self.faults if fault.family == "delay")

    def widen(self, run: Run) -> Run:
        """Standard deviations that hold what the record cannot tell: which side of a lasting change is true."""

        def wider(solution: Trajectory, sd: FloatArray) -> FloatArray:
            variance = sd[:, :3] ** 2
            for fault in self.faults:
                if (off := fault.displaces(solution.time)).any():
                    variance += off[:, None] * _moved(replace(fault, size=fault.sd)) ** 2
                    variance += EITHER * np.isinf(fault.back) * _moved(fault) ** 2
            for fault in self.of_delay():
                variance += LATE * (fault.size[0] * solution.v_n) ** 2
            sd[:, :3] = np.sqrt(variance)
            time, more = self.between
            for column, each in enumerate(more.T if time.size else ()):
                sd[:, column] = np.hypot(sd[:, column], np.sqrt(np.interp(solution.time, time, each)))
            return sd

        return with_wider_sd(run, wider)


def explain_faults(ready: Prepared, kinds: Sequence[Kind]) -> tuple[Prepared, Explanation]:
    """Find the faults of a recording, and prepare it for the filter with them."""
    parts, tried, passes, runs = list[Part](), list[Tried](), 0, 0
    for _ in range(ROUNDS):
        records: list[LinearRecord] = []
        with suppress(DivergenceError):
            records = LinearRecord.of(apply_faults(ready, of_imu(faults_of(parts))))
            runs += 1
        if not records or np.count_nonzero(records[0].known.any(axis=1)) < FEWEST:
            break
        before: Sequence[Part | None] = parts or [None] * len(records)
        parts = []
        for record, known in zip(records, before, strict=True):
            if known is not None and not of_imu(known.faults):
                parts.append(known)
                continue
            found = search(record, kinds, () if known is None else known.found.best.steps)
            if not np.isfinite(found.best.cost):  # too far from linear to be calculated
                return ready, Explanation()
            passes, tried = passes + found.passes, [*tried, *considered_of(record, found)]
            parts.append(Part(record, found, faults_in(record, found)))
        if alike(of_imu(faults_of(filter(None, before))), of_imu(faults_of(parts))):
            break
    if not parts:
        return ready, Explanation()
    faults = faults_of(parts)
    explained = apply_faults(ready, faults)
    findings = tuple(find(fault, explained.gps) for fault in faults if fault.family != "delay")
    rows = {(each.name, each.begin, each.end): each for each in sorted(tried, key=lambda each: each.gain)}
    for part in parts:
        steps = (step for step in part.found.best.steps if step.kind is not RETURN)
        for fault, step in zip(part.faults, steps, strict=True):
            rows[fault.kind.name, fault.begin, fault.end] = accepted_as(ready, fault, step, part.record.interval)
    best_first = sorted(rows.values(), key=lambda each: (not each.accepted, -each.gain))
    times, variances = zip(*(mix(part.record, part.found) for part in parts), strict=True)
    between = np.concatenate(times), np.concatenate(variances)
    explanation = Explanation(tuple(faults), tuple(best_first), passes, runs, findings, between)
    notes = (*explained.notes, state_detectable(parts[0].record, parts[0].found.best.seen, kinds))
    return replace(explained, explanation=explanation, notes=notes), explanation


class Part(NamedTuple):
    """A part of a recording, and what was found in it."""

    record: LinearRecord
    found: Search
    faults: list[Fault]


def faults_of(parts: Iterable[Part]) -> list[Fault]:
    """Faults of all parts, in order of time."""
    return [fault for part in parts for fault in part.faults]


def mix(record: LinearRecord, found: Search) -> tuple[FloatArray, FloatArray]:
    """Variance of the mean between explanations by their probability, at the epochs (m,) [s], (m, 9)."""
    every = [found.best, *found.others]
    part = np.exp(-0.5 * (np.array([each.cost for each in every]) - found.best.cost))
    off = np.array([each.seen.nav - found.best.seen.nav for each in every])
    off[:, :, 6:8] = np.linalg.norm(off[:, :, 6:8], axis=2, keepdims=True)  # tilts are of the level axes
    return record.time, np.asarray(np.tensordot(part / part.sum(), off**2, axes=1))


def of_imu(faults: Sequence[Fault]) -> list[Fault]:
    """Faults about which the error model is made anew: of many degrees, they are not linear."""
    return [fault for fault in faults if not fault.kind.of_fixes]


def alike(some: Sequence[Fault], others: Sequence[Fault]) -> bool:
    """Whether the faults are the same, up to a tenth of their size: what is left then is linear."""
    return len(some) == len(others) and all(
        (one.kind.name, one.begin, one.end) == (two.kind.name, two.begin, two.end)
        and np.linalg.norm(one.size - two.size) <= SAME * np.linalg.norm(two.size)
        for one, two in zip(some, others, strict=True)
    )


def faults_in(record: LinearRecord, found: Search) -> list[Fault]:
    """The accepted steps of a search as faults in time; a return ends what has moved the fixes before it."""
    faults: list[Fault] = []
    for step, gain in zip(found.best.steps, found.gains, strict=True):
        begin = float(record.time[step.begin])
        if step.kind is RETURN:
            faults = [
                replace(each, end=min(each.end, begin), back=begin) if np.isinf(each.back) else each for each in faults
            ]
            continue
        columns = record.columns(step.kind)
        size = step.variance * found.best.seen.score[step.begin] @ columns
        if step.kind.fills:
            size = np.full(1, np.sqrt(step.variance / record.interval))
        known = np.diagonal(columns.T @ found.best.seen.information[step.begin] @ columns)
        sd = np.sqrt(np.maximum(step.variance - step.variance**2 * known, 0.0))
        end = float(record.time[step.end]) if step.end else np.inf
        back = end if step.kind.name not in MOVING or step.kind.name in CLEARED else np.inf
        faults.append(Fault(step.kind, begin, end, size, sd, gain, back))
    return faults


def considered_of(record: LinearRecord, found: Search) -> list[Tried]:
    """Rows of the table of the explanation, of faults that the search has not accepted."""
    rows = []
    for each in found.considered:
        if not each.accepted:
            step = each.steps[0]
            end = float(record.time[step.end]) if step.end else np.inf
            prior = prior_of(each.steps, record.interval)
            begin, kind = float(record.time[step.begin]), step.kind
            rows.append(Tried(kind.name, begin, end, each.gain, prior, kind.unit, accepted=False))
    return rows


def accepted_as(ready: Prepared, fault: Fault, step: Step, interval: float) -> Tried:
    """Row of a fault that explains the record."""
    false, time = apply_faults(ready, [fault]).settings.false, ready.gps.time - ready.settings.delay
    left_out = 0 if false is None else int(np.count_nonzero(false.any(axis=0)))
    moved = int(np.count_nonzero(fault.displaces(time)))
    kind, size, prior = fault.kind, float(np.linalg.norm(fault.size)), prior_of((step,), interval)
    return Tried(kind.name, fault.begin, fault.end, fault.gain, prior, kind.unit, True, size, left_out, moved)


def state_detectable(record: LinearRecord, of: Pass, kinds: Sequence[Kind]) -> Finding:
    """The least faults of the fixes that are found nine times in ten in nearly all of the record.

    Minimal detectable bias: W. Baarda, "A testing procedure for use in geodetic networks", Netherlands Geodetic
    Commission 2/5 (1968), with the gain that the search asks for as the critical value.
    """
    values: dict[str, Any] = {}
    length = max(int(MINUTE / record.interval), 2)
    rows = np.linspace(1, max(record.time.size - length - 1, 1), PLACES).astype(int)
    for name, key in (("offset", "jump_m"), ("followed_drag", "drift_m_s"), ("drag", "minute_m_s")):
        kind = next(each for each in kinds if each.name == name)
        columns, ends = record.columns(kind), cost_of_end(record.interval) * (name == "drag")
        known = columns.T @ of.information[rows] @ columns
        if name == "drag":
            later = np.minimum(rows + length, record.time.size - 1)
            cross = np.array([record.cross(of, columns, a, length)[b] for a, b in zip(rows, later, strict=True)])
            known = known + columns.T @ of.information[later] @ columns - cross - np.swapaxes(cross, 1, 2)
        misfit = misfit_of(record, of, kind)
        least = [_least_found(each, kind, record.interval, ends, misfit) for each in known]
        value = float(np.quantile(least, NEARLY_ALL, method="lower"))  # some are infinite
        if value < UNSEEN * kind.size:
            values[key] = value
    return Finding.of(Code.GPS_DETECTABLE, **values)


def _least_found(known: FloatArray, kind: Kind, interval: float, ends: float, misfit: float) -> float:
    """Least size of a step with some information (d, d) that gains enough nine times in ten, where it is seen least."""
    value, vectors = np.linalg.eigh(known[:2, :2])
    sizes, variances = kind.size * np.geomspace(1.0 / UNSEEN, UNSEEN, 121), kind.size**2 * SIZES
    score = sizes[:, None] * (known[:, :2] @ vectors[:, 0])
    prior = kind.cost(variances, interval) + ends
    gain = (gains_of(score, np.tile(known, (sizes.size, 1, 1)), variances) - prior[:, None]).max(axis=0)
    enough = gain >= max(ACCEPT, misfit - float(prior.min()))
    return float(sizes[np.argmax(enough)] + NINE_IN_TEN / np.sqrt(max(value[0], 1e-30))) if enough.any() else np.inf


def apply_faults(ready: Prepared, faults: Sequence[Fault]) -> Prepared:
    """The recording with some faults: what the filter leaves out, takes off its state, and doubts."""
    gps, changes, rough = ready.gps, [*ready.settings.changes], list[Rough]()
    time = ready.gps.time - ready.settings.delay
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
            # larger than an offset usually is, they are worth nothing, and need not be random at all
            false[0] |= inside & (rough[-1].sd > OFFSET.size)
        elif fault.family != "delay":
            changes += _changes_of(fault)
    changes.sort(key=lambda change: change.time)
    settings = replace(ready.settings, changes=tuple(changes), rough=tuple(rough))
    settings = replace(settings, false=false if false.any() else None)
    if rough and settings.correlated is None:
        settings = replace(settings, correlated=usual_correlated(gps.position_sd))
    return replace(ready, gps=gps, settings=settings)


def _changes_of(fault: Fault) -> list[StateChange]:
    """A fault of the IMU as changes of the state."""
    name, axis = fault.kind.steps[0][0].rsplit(" ", 1)
    change = np.zeros(3)
    change[int(axis) :][: fault.size.size] = fault.size
    variance = np.full(3, (CHANGE_KNOWN * np.linalg.norm(change)) ** 2)
    found = [StateChange(fault.begin, NAMES[name], change, variance)]
    if np.isfinite(fault.end):
        found.append(StateChange(fault.end, NAMES[name], -change, variance))
    return found


def _moved(fault: Fault) -> FloatArray:
    """By how much positions are off after a fault, North, East, Down (3,) [m]."""
    if fault.family == "offset":
        return fault.size
    return np.asarray(fault.size * (fault.end - fault.begin))


def find(fault: Fault, gps: GpsData) -> Finding:
    """Report a fault."""
    passes, stays, name = CODES[fault.family]
    size = _moved(fault) if name == "distance_m" and np.isfinite(fault.end) else fault.size
    code = passes if np.isfinite(fault.end) else stays
    value = float(np.linalg.norm(size))
    if code in SIGNED:
        value = -float(size[0])  # errors are estimate minus truth
    subject = (
        fault.kind.name.replace("_", " ") if fault.family in ("gyro", "accel") else SUBJECTS.get(fault.family, "gps")
    )
    values: dict[str, Any] = {name: value}
    if code in (Code.RECORD_FALSE_POSITIONS, Code.RECORD_FALSE_VELOCITIES):
        values = {
            "count": int(np.count_nonzero(fault.inside(gps.time))),
            name.replace("distance_m", "residual_m"): value,
        }
    inside = gps.time[fault.inside(gps.time)]
    last = float(inside[-1]) if inside.size else fault.begin
    end = last if np.isfinite(fault.end) or fault.family == "delay" else None
    return Finding.of(code, fault.begin, end, subject=subject, **values)
