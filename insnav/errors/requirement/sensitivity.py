"""Shares of correlated initial errors in the error after an outage: Shapley effects.

A filter leaves correlated errors, such as a tilt that compensates a bias. Their variances do not add up, and neither
first-order nor total indices give the share of a single error. The Shapley effect shares the variance among the errors
as the Shapley value shares a gain among players. The gain of a group is the variance that it explains (Owen, "Sobol'
indices and Shapley value", SIAM/ASA Journal on Uncertainty Quantification 2 (2014) 245-251; Song, Nelson and Staum,
"Shapley effects for global sensitivity analysis: theory and computation", the same 4 (2016) 1060-1083). For a linear
map of Gaussian errors it has a closed form, and all groups are enumerated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.linalg import solve

from insnav.errors.requirement import aided
from insnav.errors.requirement.aided import Propagation
from insnav.types import FloatArray

# groups of initial states
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
_RIDGE = 1e-10  # of correlations: permits errors without spread, and linearly dependent errors
NOISE = "noise of the outage"  # independent of the start


def shapley_effects(gain: FloatArray, covariance: FloatArray, groups: Sequence[Sequence[int]]) -> FloatArray:
    """Share the trace of the variance of ``gain @ x`` among groups of correlated Gaussian inputs x.

    `gain` (m, n). `covariance` (n, n) of x. `groups`: of input numbers, covering all inputs.
    Returns: variance of each group; their sum is the trace.
    """
    count = len(groups)
    explained = np.zeros(1 << count)
    for subset in range(1, 1 << count):
        inside = [i for k in range(count) if subset >> k & 1 for i in groups[k]]
        across = gain @ covariance[:, inside]
        own = covariance[np.ix_(inside, inside)]
        # scaled, as the states have different units
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
    """Compute the shares of initial errors and outage noise in the position variance of outages.

    `at_end` (w, 52, 52): covariance when GPS ends. `through` (w, m, 9, 9): of the navigation errors in the outages.
    `axes`: relevant axes of North, East, Down. `after`: relevant time of the outage [s].
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
