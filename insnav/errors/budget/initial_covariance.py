"""The covariance of a filter at the start, errors of its sensors included, as a list of independent sources.

Correlated errors (tilt and the bias that it hides) are no independent sources. A triangular factor of their covariance
makes them so: each source carries its share of those after it. Sensors come first: a bias brings the tilt that hides
it, and ``initial tilt`` is only what is left when the biases are known.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.errors.budget.sources import BODY, LOCAL, Group, Source
from insnav.imu import ImuSpec, SensorSpec
from insnav.types import FloatArray

STATES = 21  # position, velocity, attitude, gyro bias, accelerometer bias, both scale factors
_NAMES: tuple[tuple[Group, str, tuple[str, ...], int], ...] = (
    ("accel", "bias", BODY, 12),
    ("accel", "scale factor", tuple(2 * axis for axis in BODY), 18),
    ("gyro", "bias", BODY, 9),
    ("gyro", "scale factor", tuple(2 * axis for axis in BODY), 15),
    ("initial", "heading", ("down",), 8),
    ("initial", "tilt", LOCAL[:2], 6),
    ("initial", "velocity", LOCAL, 3),
    ("initial", "position", LOCAL, 0),
)
_NOTHING = 1e-9  # of a variance that is left when those before are known


def start_sources(covariance: FloatArray) -> tuple[Source, ...]:
    """Make independent sources of a filter's covariance.

    `covariance` (21, 21): of the errors of position N, E, D [m], velocity [m/s], attitude [rad], gyro and accelerometer
    bias, gyro and accelerometer scale factor, estimate minus truth.
    Returns: with its share of the other errors in `Source.joint`. The sum of their squares is the covariance
    (Cholesky).
    """
    labels = [(group, term, axis, first + i) for group, term, axes, first in _NAMES for i, axis in enumerate(axes)]
    left = covariance.copy()
    found = []
    for group, term, axis, state in labels:
        variance = left[state, state]
        if variance <= _NOTHING * covariance[state, state] or variance <= 0.0:
            continue
        column = left[:, state] / np.sqrt(variance)
        left = left - np.outer(column, column)
        sd = float(column[state])
        found.append(Source(group, term, axis, "constant", sd, joint=tuple(column / sd)))
    return tuple(found)


def in_run_errors(spec: ImuSpec) -> ImuSpec:
    """What an IMU adds to the errors at the start: noise, change of the bias, terms the filter has no states for.

    In-run bias since the start is a random walk that is driven as the Gauss-Markov process of the IMU file is,
    ``2 sd^2 / T`` (Gelb 1974, section 3.6), right for times far below T. Misalignment of accelerometers shows in
    gravity as a bias, and is counted there.
    """
    return replace(
        spec,
        gyro=_since(spec.gyro),
        accel=replace(_since(spec.accel), misalignment=np.zeros(3)),
        initial=None,
    )


def _since(sensor: SensorSpec) -> SensorSpec:
    drive = sensor.rate_random_walk**2 + 2.0 * sensor.bias_instability**2 / sensor.correlation_time
    none = np.zeros(3)
    return replace(sensor, bias=none, bias_instability=none, scale_factor=none, rate_random_walk=np.sqrt(drive))
