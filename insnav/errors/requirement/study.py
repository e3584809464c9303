"""A requirement on the position error, what meets it, what is left of the start in it, and simulated runs of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import solve

from insnav.engine import Workers
from insnav.errors.budget.sampled_motion import SampledMotion
from insnav.errors.budget.simulated import free_runs
from insnav.errors.requirement import aided
from insnav.errors.requirement.aided import Propagation
from insnav.errors.requirement.allocation import Allocation, Requirement, binomial_interval, last_sample
from insnav.errors.requirement.parts import Candidate, Elasticity, Remedy
from insnav.imu import ImuSpec, SensorSpec
from insnav.imu.error_terms import terms_of
from insnav.types import FloatArray

# groups of states of the start
GROUPS: dict[str, list[int]] = {
    "position": [0, 1, 2],
    "velocity": [3, 4, 5],
    "tilt": [6, 7],
    "heading": [8],
    "gyro bias": [9, 10, 11, 15, 16, 17],
    "accelerometer bias": [12, 13, 14, 18, 19, 20],
    "gyro scale factor": [21, 22, 23],
    "accelerometer scale factor": [24, 25, 26],
    "gyro misalignment": list(range(27, 33)),
    "accelerometer misalignment": list(range(33, 39)),
    "g-sensitivity": list(range(39, 48)),
}
_RIDGE = 1e-10  # of correlations: errors without any spread, and such as are sums of others, do no harm
NOISE = "noise of the outage"  # independent of the start
LARGER = 1.25  # factor on the set that must not meet the requirement any more


def shapley_effects(gain: FloatArray, covariance: FloatArray, groups: Sequence[Sequence[int]]) -> FloatArray:
    """Share the trace of the variance of ``gain @ x`` among groups of correlated Gaussian inputs x.

    `gain` (m, n); `covariance` (n, n) of x; `groups`: of numbers of inputs, which together are all of them.
    Returns: variance of each group; their sum is the trace.

    Notes
    -----
    A filter leaves errors that are correlated: the tilt that compensates a bias. Their variances do not add up, and
    neither first-order nor total indices of a single error say how much of the whole it is. The Shapley effect shares
    the variance among the errors as the Shapley value shares a gain among players, the gain of a group being the
    variance that it explains (Owen, "Sobol' indices and Shapley value", SIAM/ASA Journal on Uncertainty Quantification
    2 (2014) 245-251; Song, Nelson and Staum, "Shapley effects for global sensitivity analysis: theory and computation",
    the same 4 (2016) 1060-1083). For a linear map of Gaussian errors that variance is in closed form, and all groups
    are enumerated.
    """
    count = len(groups)
    explained = np.zeros(1 << count)
    for subset in range(1, 1 << count):
        inside = [i for k in range(count) if subset >> k & 1 for i in groups[k]]
        across = gain @ covariance[:, inside]
        own = covariance[np.ix_(inside, inside)]
        # scaled: the states have different units
        size = np.sqrt(np.maximum(np.diag(own), 1e-300))
        known = own / np.outer(size, size) + _RIDGE * np.eye(len(inside))
        explained[subset] = np.sum((across / size) * solve(known, (across / size).T, assume_a="pos").T)
    weights = [math.factorial(s) * math.factorial(count - s - 1) / math.factorial(count) for s in range(count)]
    found = np.zeros(count)
    for subset in range(1 << count):
        members = subset.bit_count()
        for k in range(count):
            if not subset >> k & 1:
                found[k] += weights[members] * (explained[subset | 1 << k] - explained[subset])
    return found


def start_shares(
    moved: Propagation, at_end: FloatArray, through: FloatArray, axes: Sequence[int], after: int
) -> dict[str, float]:
    """Shares of the errors at the start of outages, and of the noise in them, in the variance of the position.

    `at_end` (w, 52, 52): covariance when GPS ends; `through` (w, m, 9, 9): of the navigation errors in the outages;
    `axes`: North, East, Down that count; `after`: time of the outage that counts [s].
    """
    here = np.diagonal(at_end, axis1=1, axis2=2).max(axis=0)
    present = {name: states for name, states in GROUPS.items() if np.any(here[states] > 0.0)}
    values, total = np.zeros(len(present)), 0.0
    below = np.eye(aided.SENSED)[aided.NAV :]
    for begin, start, errors in zip(moved.begins, at_end, through, strict=True):
        gain = np.eye(aided.SENSED)
        for by_state in moved.by_state[begin : begin + after]:
            gain = np.vstack([by_state @ gain, below])
        covariance = start[: aided.SENSED, : aided.SENSED]
        values += shapley_effects(gain[list(axes)], covariance, list(present.values()))
        total += float(np.trace(errors[after][np.ix_(axes, axes)]))
    shares = {name: float(value) / total for name, value in zip(present, values, strict=True)}
    return {**shares, NOISE: max(1.0 - sum(shares.values()), 0.0)}


@dataclass(frozen=True, slots=True)
class Verified:
    """Runs of a set of errors."""

    factor: float  # on the whole set
    runs: int
    within: int  # runs within the limit
    error: float  # error of the runs that the share `probability` of them does not exceed [m]
    interval: tuple[float, float]  # 95 % interval of the probability to be within

    def meets(self, probability: float) -> bool:
        """Whether the probability asked for is within the interval, or below it."""
        return self.interval[1] >= probability


def scaled(spec: ImuSpec, factor: float) -> ImuSpec:
    """Make every error of a specification larger by a factor."""

    def larger(sensor: SensorSpec, name: str) -> SensorSpec:
        keys = [term.key for term in terms_of("gyro" if name == "gyro" else "accel") if term.in_budget]
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
    count = int(required.within(error).sum())
    size = np.linalg.norm(error[:, list(required.axes)], axis=1)
    return Verified(factor, runs, count, float(np.quantile(size, required.probability)), binomial_interval(count, runs))


@dataclass(frozen=True, slots=True)
class RequirementStudy:
    """A requirement, on a motion, with the errors that just meet it and the IMUs that do."""

    required: Requirement
    motion: str  # what motion it is
    imu: str  # name of the IMU that some errors are given by; empty if none
    allocation: Allocation
    hold: bool  # the vertical channel was constrained to the reference height
    verified: tuple[Verified, ...] = ()  # the set, and a larger one, simulated
    begins: tuple[int, ...] = ()  # when GPS ends in what follows, a mean over these outages [s]
    time: FloatArray = field(default_factory=lambda: np.zeros(0))  # (m,) of the curves of the candidates [s]
    candidates: tuple[Candidate, ...] = ()  # real IMUs, the best first; none for outages that are too long for it
    # IMU that the rest is of: the one given, else the best that does not meet the requirement alone; and what helps it
    example: str = ""
    remedies: tuple[Remedy, ...] = ()
    elasticities: tuple[Elasticity, ...] = ()
    shares: Mapping[str, float] = field(default_factory=dict)  # of the errors at the start, and of the noise after it


TYPICAL = 1.6  # geometric mean of recorded over predicted error
SPAN = (0.53, 4.9)  # 95 % of further tests
TEXT = (
    f"Field factor: recorded errors are typically {TYPICAL:g} times those predicted from the figures of an IMU, "
    f"between {SPAN[0]:g} and {SPAN[1]:g} times (95 % of tests; reports/published.md)."
)
