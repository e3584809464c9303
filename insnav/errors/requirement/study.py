"""Study of a requirement on the position error: real IMUs that meet it after GPS ends, improvements for the others.

Simulated runs verify its solutions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from insnav.engine import Workers
from insnav.errors.budget.error_budget import free_runs
from insnav.errors.budget.sources import SampledMotion, families, sources_of, term_of
from insnav.errors.requirement.aided import Aiding, Propagation, error_curves
from insnav.errors.requirement.allocation import Allocation, Requirement, binomial_interval, last_sample
from insnav.findings import Code, Finding
from insnav.imu import ImuSpec, SensorSpec, load_imu
from insnav.imu.error_terms import Sensor, terms_of
from insnav.imu.library import Part, completed
from insnav.types import FloatArray
from insnav.units import PPM, UG

Answer = Literal["yes", "likely", "open", "no"]
LIMITS = (1.0, 10.0, 100.0)  # [m]
# errors after a calibration, one standard deviation: assumptions for good benches
RATE_TABLE = {"scale_factor": 50.0 * PPM, "misalignment": 0.1e-3}  # of gyros
NINE_POSITION = {"bias": 100.0 * UG, "scale_factor": 50.0 * PPM, "misalignment": 0.1e-3}  # of accelerometers
STOPS = 10.0  # between zero-velocity updates [s]
SHORT, LONG = 60.0, 300.0  # GPS before the outage [s]
LARGER = 1.25  # factor on the set that must fail the requirement


@dataclass(frozen=True, slots=True)
class Coasting:
    """Error growth of an IMU after GPS ends."""

    error: float  # at the time of the requirement, at its probability [m]
    least: float  # lower bound with undocumented figures as zero [m]
    answer: Answer
    curve: FloatArray  # (m,) at the times of the study [m]
    reaches: tuple[float, ...]  # times at which it exceeds each of `LIMITS` [s]; infinite if never


@dataclass(frozen=True, slots=True)
class Candidate:
    """Real IMU evaluated for the requirement."""

    name: str
    grade: str
    provenance: str
    missing: tuple[str, ...]  # undocumented figures, taken from its class
    alone: Coasting  # the IMU alone
    nhc: Coasting  # with the non-holonomic constraint


def candidates(required: Requirement, moved: Propagation, parts: Sequence[Part]) -> tuple[Candidate, ...]:
    """Evaluate parts twice: with undocumented figures from their class, and with zero."""
    grades = {grade: load_imu(grade) for grade in {part.grade for part in parts}}
    specs = [completed(part, grades[part.grade])[0] for part in parts] + [part.spec for part in parts]
    alone, aided = (error_curves(required, moved, specs, Aiding(nhc=nhc)) for nhc in (False, True))
    found = []
    for i, part in enumerate(parts):
        both = [
            coasting(required, moved, curves[i], curves[len(parts) + i], known=not part.missing)
            for curves in (alone, aided)
        ]
        found.append(Candidate(part.name, part.grade, part.provenance, part.missing, *both))
    return tuple(sorted(found, key=lambda each: each.alone.error))


def coasting(
    required: Requirement, moved: Propagation, curve: FloatArray, least: FloatArray, *, known: bool
) -> Coasting:
    """Evaluate one curve: yes or no if documented figures decide, likely by class figures, else open."""
    time = moved.after
    error, smallest = (float(np.interp(required.after, time, values)) for values in (curve, least))
    smallest = error if known else smallest
    if error <= required.error:
        answer: Answer = "yes" if known else "likely"
    else:
        answer = "no" if smallest > required.error else "open"
    return Coasting(error, smallest, answer, curve, tuple(_reaches(time, curve, limit) for limit in LIMITS))


def _reaches(time: FloatArray, curve: FloatArray, limit: float) -> float:
    """Find the first time at which a curve exceeds a limit, by linear interpolation; infinite if never."""
    over = np.flatnonzero(curve > limit)
    if not over.size:
        return float("inf")
    k = int(over[0])
    if k == 0:
        return 0.0
    return float(time[k - 1] + (limit - curve[k - 1]) / (curve[k] - curve[k - 1]) * (time[k] - time[k - 1]))


@dataclass(frozen=True, slots=True)
class Remedy:
    """Measure that changes the error."""

    name: str
    error: float  # at the time of the requirement, at its probability [m]
    ratio: float  # relative to the error of the unchanged IMU


@dataclass(frozen=True, slots=True)
class Elasticity:
    """Sensitivity of the error to one family of errors of the IMU."""

    family: str
    halved: float  # relative change of the error if this family were halved
    elasticity: float  # d log(error) / d log(size)


def remedies(
    required: Requirement, moved: Propagation, spec: ImuSpec, part: Part | None = None
) -> tuple[tuple[Remedy, ...], tuple[Elasticity, ...]]:
    """Evaluate every remedy for an IMU, and halve each of its errors. The first remedy is the unchanged IMU."""
    aiding = {
        "as it is": Aiding(),
        "NHC": Aiding(nhc=True),
        "odometer": Aiding(odometer=True),
        "NHC and odometer": Aiding(nhc=True, odometer=True),
        f"ZUPT: a stop every {STOPS:g} s": Aiding(zupt_every=STOPS),
        "barometer": Aiding(barometer=True),
        "dual antenna: heading at every fix": Aiding(dual_antenna=True),
        f"GPS of {SHORT:g} s only before the outage": Aiding(before=SHORT),
    }
    if min(moved.begins) <= SHORT:
        aiding.popitem()
    changed = {
        "rate table: gyro scale factor, misalignment": at_most(spec, "gyro", RATE_TABLE),
        "nine positions: accelerometer bias, scale factor, misalignment": at_most(spec, "accel", NINE_POSITION),
    }
    warm = None if part is None else at_constant_temperature(spec, part)
    if warm is not None:
        changed["warm-up, constant temperature: in-run bias of the Allan deviation"] = warm
    names = [name for name in families(sources_of(spec)) if not name.startswith("initial")]
    halves = [halved(spec, name) for name in names]
    errors = {name: _errors(required, moved, [spec], each)[0] for name, each in aiding.items()}
    others = _errors(required, moved, [*changed.values(), *halves], Aiding())
    errors |= dict(zip(changed, others, strict=False))
    base = errors["as it is"]
    found = tuple(Remedy(name, error, error / base) for name, error in errors.items())
    changes = [error / base for error in others[len(changed) :]]
    return found, tuple(
        Elasticity(name, change - 1.0, math.log(change) / math.log(0.5))
        for name, change in zip(names, changes, strict=True)
    )


def _errors(required: Requirement, moved: Propagation, specs: Sequence[ImuSpec], aiding: Aiding) -> list[float]:
    curves = error_curves(required, moved, specs, aiding)
    return [float(np.interp(required.after, moved.after, curve)) for curve in curves]


def at_most(spec: ImuSpec, sensor: Sensor, sizes: dict[str, float]) -> ImuSpec:
    """Limit the errors of a sensor to the remainder after a calibration."""
    old = getattr(spec, sensor)
    new = replace(old, **{key: np.minimum(getattr(old, key), size) for key, size in sizes.items()})
    return replace(spec, **{sensor: new})


def at_constant_temperature(spec: ImuSpec, part: Part) -> ImuSpec | None:
    """Use the in-run bias of the Allan deviation; None if undocumented or already used."""
    changed = {}
    for sensor in ("gyro", "accel"):
        old = getattr(spec, sensor)
        floors = [
            figure.sd
            for figure in part.figures
            if figure.key == f"{sensor}.bias_instability" and figure.statistic == "Allan minimum"
        ]
        least: FloatArray = np.minimum.reduce([old.bias_instability, *floors])
        if not np.array_equal(least, old.bias_instability):
            changed[sensor] = replace(old, bias_instability=least)
    return replace(spec, **changed) if changed else None


def halved(spec: ImuSpec, family: str) -> ImuSpec:
    """Halve one family of errors of a specification."""
    term = term_of(family)
    old = getattr(spec, term.sensor)
    return replace(spec, **{term.sensor: replace(old, **{term.key: 0.5 * getattr(old, term.key)})})


@dataclass(frozen=True, slots=True)
class Verified:
    """Simulated runs of a set of errors."""

    factor: float  # on the whole set
    runs: int
    within: int  # runs within the limit
    error: float  # error that the share `probability` of the runs does not exceed [m]
    interval: tuple[float, float]  # 95 % interval of the probability of an error within the limit

    def meets(self, probability: float) -> bool:
        """Return whether the interval reaches the requested probability."""
        return self.interval[1] >= probability


def scaled(spec: ImuSpec, factor: float) -> ImuSpec:
    """Scale every error of a specification by a factor."""

    def larger(sensor: SensorSpec, name: Sensor) -> SensorSpec:
        keys = [term.key for term in terms_of(name) if term.in_budget]
        return replace(sensor, **{key: factor * getattr(sensor, key) for key in keys})

    start = spec.initial
    if start is not None:
        start = replace(start, **{key: factor * getattr(start, key) for key in start.__dataclass_fields__})
    return replace(spec, gyro=larger(spec.gyro, "gyro"), accel=larger(spec.accel, "accel"), initial=start)


def verify(
    required: Requirement,
    spec: ImuSpec,
    motion: SampledMotion,
    runs: int,
    seed: int,
    *,
    factor: float = 1.0,
    hold: bool = False,
    workers: Workers = 1,
    progress: Callable[[float], None] | None = None,
) -> Verified:
    """Count the runs that stay within the limit."""
    row = np.array([last_sample(motion, required.after)])
    seeds, larger = (seed, round(100 * factor)), scaled(spec, factor)
    error = free_runs(larger, motion, row, runs, seeds, hold=hold, workers=workers, progress=progress)[:, 0]
    size = np.linalg.norm(error[:, list(required.axes)], axis=1)
    count = int(np.count_nonzero(size <= required.error))
    return Verified(factor, runs, count, float(np.quantile(size, required.probability)), binomial_interval(count, runs))


@dataclass(frozen=True, slots=True)
class RequirementStudy:
    """Requirement on a motion, the errors that just meet it, and suitable IMUs."""

    required: Requirement
    motion: str  # description of the motion
    imu: str  # name of the IMU with given errors; empty if none
    allocation: Allocation
    hold: bool  # the vertical channel was constrained to the reference height
    verified: tuple[Verified, ...] = ()  # the set, and a larger one, simulated
    begins: tuple[int, ...] = ()  # end of GPS in the following outages, whose mean is shown [s]
    time: FloatArray = field(default_factory=lambda: np.zeros(0))  # (m,) of the curves of the candidates [s]
    candidates: tuple[Candidate, ...] = ()  # real IMUs, the best first; empty for too long outages
    # IMU of the following fields: the given one, else the best that fails the requirement alone. Then its remedies
    example: str = ""
    remedies: tuple[Remedy, ...] = ()
    elasticities: tuple[Elasticity, ...] = ()
    shares: Mapping[str, float] = field(default_factory=dict)  # of initial errors, and of later noise


TYPICAL = 1.6  # geometric mean of recorded over predicted error
SPAN = (0.53, 4.9)  # 95 % of further tests
FIELD_FACTOR = Finding.of(Code.REQUIREMENT_FIELD_FACTOR, factor=TYPICAL, low=SPAN[0], high=SPAN[1])
