"""Study of a requirement on the position error: its solutions, and simulated runs that verify it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from insnav.engine import Workers
from insnav.errors.budget.sampled_motion import SampledMotion
from insnav.errors.budget.simulated import free_runs
from insnav.errors.requirement.allocation import Allocation, last_sample
from insnav.errors.requirement.limit import Requirement, binomial_interval
from insnav.errors.requirement.parts import Candidate, Elasticity, Remedy
from insnav.findings import Code, Finding
from insnav.imu import ImuSpec, SensorSpec
from insnav.imu.error_terms import Sensor, terms_of
from insnav.types import FloatArray

LARGER = 1.25  # factor on the set that must fail the requirement


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
