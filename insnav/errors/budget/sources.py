"""Input of all parts of a budget: the motion as sensed by an IMU, sample by sample, and independent scalar sources.

`insnav.imu.specification.TERMS` defines the sensor terms; errors of initial state, gravity, timing are added. The list
contains all 39 sources of the covariance budget of the PSINS toolbox, and more. The 39 are attitude, velocity,
position, bias and white noise of both sensor triads, and the nine elements of both sensor matrices.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from scipy.optimize import brentq

from insnav.attitude import dcm_from_rph
from insnav.earth import gravity_n
from insnav.exceptions import ConfigError
from insnav.imu import ClockSpec, ImuSpec, InitialSpec, SensorSpec
from insnav.imu.specification import SENSORS, TERMS, ErrorTerm, Process, terms_of
from insnav.kernels.mechanization import POLAR_CAP
from insnav.simulate.truth import Truth, imu_from_truth, reference, straight
from insnav.strapdown import increments, intervals
from insnav.types import FloatArray, Increments, Trajectory
from insnav.units import DEG, G0

RATE = 100.0  # default sampling rate of a motion [Hz]
REST = np.array([45.0 * DEG, 0.0, 0.0])  # latitude, longitude [rad], height [m] of the stationary motion
HIGHEST = 1e5  # limit of the search for the height with a given gravity [m]
Group = Literal["initial", "gyro", "accel", "gravity", "timing"]

BODY, LOCAL = ("x", "y", "z"), ("north", "east", "down")
STATES = 21  # number of filter states: position, velocity, attitude, gyro bias, accelerometer bias, both scale factors
# group, term, axes and first filter state of the errors, in the order of their factorisation by `start_sources`
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
_NOTHING = 1e-9  # a smaller share of a variance, conditional on the previous states, counts as zero [-]


@dataclass(frozen=True, slots=True)
class SampledMotion:
    """Section of an exact motion, divided into n sample intervals."""

    truth: Trajectory  # true states at the n + 1 ends of the samples
    dt: FloatArray  # (n,) length of each sample [s]
    lla: FloatArray  # (n, 3) latitude, longitude [rad], height [m] in the middle of each sample
    v_n: FloatArray  # (n, 3) velocity North, East, Down in the middle of each sample [m/s]
    C_nb: FloatArray  # (n, 3, 3) attitude in the middle of each sample
    rate: FloatArray  # (n, 3) mean angular rate of each sample, body axes [rad/s]
    force: FloatArray  # (n, 3) mean specific force of each sample, body axes [m/s^2]
    increments: Increments  # input of the mechanization, with coning and sculling
    description: str = ""  # description of the motion

    @property
    def elapsed(self) -> FloatArray:
        """Time since the start at the end of every sample, ``(n,)`` [s]."""
        return np.cumsum(self.dt)

    @property
    def force_n(self) -> FloatArray:
        """Specific force North, East, Down, ``(n, 3)`` [m/s^2]."""
        return np.asarray(np.einsum("kij,kj->ki", self.C_nb, self.force))


def sampled(truth: Truth, begin: float, duration: float, description: str = "", rate: float = RATE) -> SampledMotion:
    """Sample a section of a motion as an IMU senses it.

    `begin`: start of the section, after the start of the motion [s]. `duration`: length of the section [s].
    `rate`: sampling rate [Hz].
    Raises: ConfigError: the section exceeds the motion, or approaches a pole.
    """
    if begin < 0.0 or begin + duration > truth.duration + 1e-6:
        raise ConfigError("budget.motion_too_short", after_s=duration, begin_s=begin, duration_s=truth.duration)
    time = truth.start + begin + np.arange(round(duration * rate) + 1) / rate
    time[-1] = min(time[-1], truth.start + truth.duration)
    samples = imu_from_truth(truth, time, "mean")
    middle = truth.evaluate(time[:-1] + 0.5 * np.diff(time))
    if float(np.cos(middle.lla[:, 0]).min()) < POLAR_CAP:
        raise ConfigError("budget.near_pole")
    places = middle.lla, middle.v_n, dcm_from_rph(middle.rph)
    sensed = samples.gyro, samples.accel, increments(intervals(samples))
    return SampledMotion(reference(truth, time), np.diff(time), *places, *sensed, description)


def at_rest(
    duration: float, lat: float = float(REST[0]), heading: float = 0.0, gravity: float | None = None
) -> SampledMotion:
    """Build the default motion of a budget: stationary and level.

    `duration`: length [s]. `lat`, `heading` [rad]. `gravity`: choose the height at which gravity has this value
    [m/s^2]; None for height zero.
    Raises: ConfigError: a gravity value that does not occur near the ellipsoid, or a pole.
    """
    height = 0.0 if gravity is None else _height_of(gravity, lat)
    truth = straight(np.array([lat, 0.0, height]), 0.0, heading, duration + 1.0)
    toward = "north" if heading == 0.0 else f"{heading / DEG % 360.0:g} deg"
    motion = f"at rest, level, heading {toward}, at a latitude of {lat / DEG:g} deg"
    where = "" if gravity is None else f", where gravity is {gravity:g} m/s^2 (height {height:.0f} m)"
    return sampled(truth, 0.0, duration, motion + where)


def _height_of(gravity: float, lat: float) -> float:
    """Find the height [m] at which normal gravity has a given value [m/s^2]."""

    def excess(height: float) -> float:
        return float(np.linalg.norm(gravity_n(lat, height))) - gravity

    if not excess(HIGHEST) < 0.0 < excess(-HIGHEST):
        values: dict[str, Any] = {"gravity_m_s2": gravity, "lat_deg": lat / DEG, "height_km": HIGHEST / 1e3}
        values |= {"low_m_s2": gravity + excess(HIGHEST), "high_m_s2": gravity + excess(-HIGHEST)}
        raise ConfigError("budget.impossible_gravity", where="--gravity", **values)
    return float(brentq(excess, -HIGHEST, HIGHEST, xtol=1e-3))


def first_movement(truth: Truth) -> float:
    """Compute the time from the start to one second before the first movement [s]; 0 without a pause or movement."""
    tau = np.arange(0.0, truth.duration, 0.5)
    moving = np.flatnonzero(np.linalg.norm(truth.evaluate(truth.start + tau).v_n, axis=1) > 0.05)
    return float(max(tau[moving[0]] - 1.0, 0.0)) if moving.size else 0.0


@dataclass(frozen=True, slots=True)
class Source:
    """Independent scalar source of errors in a budget."""

    group: Group  # group of the source
    term: str  # error type, such as ``scale factor``
    # ``x``, ``y``, ``z`` of the body; ``north``, ``east``, ``down``. A matrix element has two letters, first the
    # sensitive axis
    axis: str
    kind: Process  # random process of the error
    # standard deviation, or root power spectral density of white noise or of a random walk's driving noise, or
    # coefficient of flicker noise. SI, radians.
    sd: float
    correlation_time: float = math.inf  # correlation time of a Gauss-Markov process [s]
    # for correlated errors: errors of the 21 filter states per unit of this source; see `start_sources`
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
        """Sensor error term of this source; KeyError if no sensor causes it."""
        return term_of(self.family)

    @property
    def element(self) -> tuple[int, int]:
        """Indices of the sensitive axis of the sensor and of the axis of the driving signal."""
        return BODY.index(self.axis[0]), BODY.index(self.axis[-1])


def sources_of(spec: ImuSpec, deflection: float = 0.0) -> tuple[Source, ...]:
    """List all error sources of an IMU and its start, including sources of zero size.

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

    A tilt and the bias that compensates it are correlated. The Cholesky factor of the covariance gives independent
    sources, each with its effect on all later states. Sensor errors come first, so a bias source includes the tilt
    correlated with it. ``initial tilt`` is the part of the tilt that is independent of the biases.

    `covariance` (21, 21): of position N, E, D [m], velocity [m/s], attitude [rad], bias and scale factor (gyro,
    accelerometer), estimate minus truth.
    Returns: sources with their effects in `Source.joint`. The sum of their outer products is the covariance.
    """
    labels = [(group, term, axis, first + i) for group, term, axes, first in _NAMES for i, axis in enumerate(axes)]
    remainder = covariance.copy()
    sources = []
    for group, term, axis, state in labels:
        variance = remainder[state, state]
        if variance <= _NOTHING * covariance[state, state] or variance <= 0.0:
            continue
        column = remainder[:, state] / np.sqrt(variance)
        remainder = remainder - np.outer(column, column)
        sd = float(column[state])
        sources.append(Source(group, term, axis, "constant", sd, joint=tuple(column / sd)))
    return tuple(sources)


def term_of(family: str) -> ErrorTerm:
    """Return the sensor error term of a family, such as ``gyro bias``; KeyError if no sensor has it."""
    return {term.family: term for term in TERMS}[family]


def families(sources: tuple[Source, ...]) -> tuple[str, ...]:
    """List the families of nonzero sources, in order."""
    return tuple(dict.fromkeys(source.family for source in sources if source.sd > 0.0))


def only(spec: ImuSpec, family: str) -> ImuSpec:
    """Return the specification of an IMU with one family of error sources only.

    `family`: see `Source.family`; ``gravity model`` is not part of the IMU, so all IMU errors are then zero.
    """
    group, _, term = family.partition(" ")
    error_free = ImuSpec(spec.name, SensorSpec(), SensorSpec())
    if group == "initial":
        return replace(error_free, initial=InitialSpec(**{term: getattr(spec.initial or InitialSpec(), term)}))
    if group == "timing":
        return replace(error_free, clock=ClockSpec(**{term: getattr(spec.clock, term)}))
    if group == "gravity":
        return error_free
    sensor: SensorSpec = getattr(spec, group)
    key = term_of(family).key
    reduced = SensorSpec(correlation_time=sensor.correlation_time, **{key: getattr(sensor, key)})
    return replace(error_free, gyro=reduced) if group == "gyro" else replace(error_free, accel=reduced)


def left_out(spec: ImuSpec) -> tuple[str, ...]:
    """List the IMU errors that the budget does not include, in words."""
    errors = [
        term.family
        for sensor in SENSORS
        for term in terms_of(sensor)
        if not term.in_budget and np.any(getattr(getattr(spec, sensor), term.key))
    ]
    if np.any(spec.positions):
        errors.append("places of the accelerometers")
    errors += ["clock jitter"] * (spec.clock.jitter > 0.0) + ["lost samples"] * (spec.clock.lost_every > 0.0)
    return tuple(errors)


def not_given(spec: ImuSpec) -> tuple[str, ...]:
    """List the absent keys of the IMU file, taken as zero, such as ``accel.scale_factor``."""
    initial = () if spec.initial is not None else tuple(f"initial.{key}" for key in InitialSpec.__dataclass_fields__)
    return tuple(key for key in spec.absent if not key.endswith("correlation_time")) + initial
