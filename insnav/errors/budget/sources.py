"""Sources of free-inertial errors: a list of independent scalar sources with their sizes.

`insnav.imu.error_terms.TERMS` defines the sensor terms; errors of initial state, gravity and timing are added. The list
contains all 39 sources of the covariance budget of the PSINS toolbox, and more. The 39 are attitude, velocity,
position, bias and white noise of both sensor triads, and the nine elements of both sensor matrices.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from insnav.imu import ClockSpec, ImuSpec, InitialSpec, SensorSpec
from insnav.imu.error_terms import SENSORS, TERMS, ErrorTerm, Process, terms_of
from insnav.types import FloatArray
from insnav.units import G0

Group = Literal["initial", "gyro", "accel", "gravity", "timing"]

BODY, LOCAL = ("x", "y", "z"), ("north", "east", "down")
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
_NOTHING = 1e-9  # smallest remaining share of a variance, given the previous ones


@dataclass(frozen=True, slots=True)
class Source:
    """Independent scalar error."""

    group: Group  # group of the source
    term: str  # error type, such as ``scale factor``
    # ``x``, ``y``, ``z`` of the body; ``north``, ``east``, ``down``. A matrix element has two letters, first the
    # sensitive axis
    axis: str
    kind: Process  # its process in time
    # standard deviation, or root power spectral density of white noise or of a random walk's driving noise, or
    # coefficient of flicker noise. SI, radians.
    sd: float
    correlation_time: float = math.inf  # of a Gauss-Markov process [s]
    # for a source of correlated errors, its unit vector in 21 states; see `insnav.errors.budget.from_windows`
    joint: tuple[float, ...] = ()

    @property
    def family(self) -> str:
        """Family: the name without the axis, such as ``gyro bias``."""
        return f"{self.group} {self.term}"

    @property
    def name(self) -> str:
        """Full name, such as ``gyro bias x``."""
        return f"{self.family} {self.axis}"

    @property
    def error_term(self) -> ErrorTerm:
        """Sensor error term; KeyError if it belongs to no sensor."""
        return term_of(self.family)

    @property
    def element(self) -> tuple[int, int]:
        """Sensitive axis of the sensor, and axis of the driving signal."""
        return BODY.index(self.axis[0]), BODY.index(self.axis[-1])


def sources_of(spec: ImuSpec, deflection: float = 0.0) -> tuple[Source, ...]:
    """List every source, including zero ones.

    `deflection`: deflection of the vertical about each horizontal axis [rad]. Real gravity differs from the model's
    normal gravity by this angle times gravity, and as much in magnitude.
    Returns: in the order of the report: initial, gyro, accel, gravity, timing.
    """
    start = spec.initial or InitialSpec()
    listed = [Source("initial", "position", axis, "constant", start.position) for axis in LOCAL]
    listed += [Source("initial", "velocity", axis, "constant", start.velocity) for axis in LOCAL]
    listed += [Source("initial", "tilt", axis, "constant", start.tilt) for axis in LOCAL[:2]]
    listed += [Source("initial", "heading", "down", "constant", start.heading)]
    for term in (term for sensor in SENSORS for term in terms_of(sensor) if term.in_budget):
        sizes: SensorSpec = getattr(spec, term.sensor)
        size, tau = getattr(sizes, term.key), sizes.correlation_time if term.process == "Gauss-Markov" else math.inf
        for axis, (i, _) in zip(term.axes, term.elements, strict=True):
            listed.append(Source(term.sensor, term.name, axis, term.process, float(size[i]), tau))
    listed += [Source("gravity", "model", axis, "constant", deflection * G0) for axis in LOCAL]
    timing = {"offset": spec.clock.offset, "drift": spec.clock.drift}
    listed += [Source("timing", term, "t", "constant", abs(size)) for term, size in timing.items()]
    return tuple(listed)


def start_sources(covariance: FloatArray) -> tuple[Source, ...]:
    """Derive independent sources from a filter's covariance at the start, including sensor errors.

    Correlated errors (a tilt and the bias that compensates it) are not independent. A triangular factor of their
    covariance gives independent sources: each includes its share of the later errors. Sensors come first: a bias
    includes its tilt, and ``initial tilt`` is the remainder for known biases.

    `covariance` (21, 21): of position N, E, D [m], velocity [m/s], attitude [rad], bias and scale factor (gyro,
    accelerometer), estimate minus truth.
    Returns: sources with their shares in `Source.joint`. The sum of squares is the covariance (Cholesky).
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


def term_of(family: str) -> ErrorTerm:
    """Return the error term of a sensor by family, such as ``gyro bias``; KeyError if there is none."""
    return {term.family: term for term in TERMS}[family]


def families(sources: tuple[Source, ...]) -> tuple[str, ...]:
    """List the families of nonzero sources, in order."""
    return tuple(dict.fromkeys(source.family for source in sources if source.sd > 0.0))


def only(spec: ImuSpec, family: str) -> ImuSpec:
    """Reduce an IMU to one family of sources.

    `family`: see `Source.family`; ``gravity model`` is not part of the IMU and leaves nothing.
    """
    group, _, term = family.partition(" ")
    bare = ImuSpec(spec.name, SensorSpec(), SensorSpec())
    if group == "initial":
        return replace(bare, initial=InitialSpec(**{term: getattr(spec.initial or InitialSpec(), term)}))
    if group == "timing":
        return replace(bare, clock=ClockSpec(**{term: getattr(spec.clock, term)}))
    if group == "gravity":
        return bare
    whole: SensorSpec = getattr(spec, group)
    key = term_of(family).key
    left = SensorSpec(correlation_time=whole.correlation_time, **{key: getattr(whole, key)})
    return replace(bare, gyro=left) if group == "gyro" else replace(bare, accel=left)


def left_out(spec: ImuSpec) -> tuple[str, ...]:
    """List the IMU errors that the budget does not include, in words."""
    found = [
        term.family
        for sensor in SENSORS
        for term in terms_of(sensor)
        if not term.in_budget and np.any(getattr(getattr(spec, sensor), term.key))
    ]
    if np.any(spec.positions):
        found.append("places of the accelerometers")
    found += ["clock jitter"] * (spec.clock.jitter > 0.0) + ["lost samples"] * (spec.clock.lost_every > 0.0)
    return tuple(found)


def not_given(spec: ImuSpec) -> tuple[str, ...]:
    """List the absent keys of the IMU file, taken as zero, such as ``accel.scale_factor``."""
    initial = () if spec.initial is not None else tuple(f"initial.{key}" for key in InitialSpec.__dataclass_fields__)
    return tuple(key for key in spec.absent if not key.endswith("correlation_time")) + initial
