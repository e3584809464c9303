"""Where the errors of free-inertial navigation come from: a list of independent scalar sources with their sizes.

The list holds all 39 sources of the covariance budget of the PSINS toolbox (attitude, velocity, position, gyro and
accelerometer bias, white noise of both, and the nine elements of both sensor matrices) and what it leaves out: in-run
bias, flicker, random walk and ramp of the bias, asymmetry, non-linearity, g-sensitivity, gravity model, timing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from insnav.imu import ClockSpec, ImuSpec, InitialSpec, SensorSpec
from insnav.types import FloatArray
from insnav.units import G0

Group = Literal["initial", "gyro", "accel", "gravity", "timing"]
Kind = Literal["constant", "ramp", "white", "random walk", "Gauss-Markov", "flicker"]

BODY, LOCAL = ("x", "y", "z"), ("north", "east", "down")
# of a sensor triad: name, key of the IMU file, how it goes on in time, and over what it is spread
_VECTOR, _DIAGONAL, _BESIDE, _MATRIX = "vector", "diagonal", "beside the diagonal", "matrix"
_SENSOR: tuple[tuple[str, str, Kind, str], ...] = (
    ("bias", "bias", "constant", _VECTOR),
    ("bias instability", "bias_instability", "Gauss-Markov", _VECTOR),
    ("white noise", "random_walk", "white", _VECTOR),
    ("scale factor", "scale_factor", "constant", _DIAGONAL),
    ("misalignment", "misalignment", "constant", _BESIDE),
    ("rate random walk", "rate_random_walk", "random walk", _VECTOR),
    ("flicker noise", "flicker", "flicker", _VECTOR),
    ("bias ramp", "rate_ramp", "ramp", _VECTOR),
    ("asymmetry", "asymmetry", "constant", _DIAGONAL),
    ("non-linearity", "quadratic", "constant", _DIAGONAL),
    ("g-sensitivity", "g_sensitivity", "constant", _MATRIX),
)
_NOT_HELD = {
    "quantisation": "quantisation",
    "resolution": "resolution",
    "range": "end of the range",
    "vibration_rectification": "vibration rectification",
    "bias_slope": "bias by temperature",
    "scale_slope": "scale factor by temperature",
}


@dataclass(frozen=True, slots=True)
class Source:
    """One independent scalar error.

    Attributes
    ----------
    group : {"initial", "gyro", "accel", "gravity", "timing"}
        What it belongs to.
    term : str
        What it is, such as ``scale factor``.
    axis : str
        ``x``, ``y``, ``z`` of the body; ``north``, ``east``, ``down``; two letters for an element of a matrix, the axis
        that shows it first.
    kind : {"constant", "ramp", "white", "random walk", "Gauss-Markov", "flicker"}
        How it goes on in time.
    sd : float
        Standard deviation; root power spectral density of white noise and of what drives a random walk; coefficient of
        flicker noise. SI units and radians.
    correlation_time : float
        Of a Gauss-Markov process [s].
    joint : tuple of float
        What a unit of it carries along, in 21 states; see `insnav.errors.budget.initial_covariance`.
    """

    group: Group
    term: str
    axis: str
    kind: Kind
    sd: float
    correlation_time: float = math.inf
    joint: tuple[float, ...] = ()

    @property
    def family(self) -> str:
        """Name shared by the sources that differ in the axis alone, such as ``gyro bias``."""
        return f"{self.group} {self.term}"

    @property
    def name(self) -> str:
        """Name of its own, such as ``gyro bias x``."""
        return f"{self.family} {self.axis}"


def sources_of(spec: ImuSpec, deflection: float = 0.0) -> tuple[Source, ...]:
    """List every source, also those of size zero.

    Parameters
    ----------
    spec : ImuSpec
        How large the errors of the IMU and of the start are.
    deflection : float
        Deflection of the vertical about each horizontal axis [rad]: real gravity is off the normal gravity of the model
        by this angle times gravity, and by as much in size.

    Returns
    -------
    tuple of Source
        In the order of the report: initial, gyro, accel, gravity, timing.
    """
    start = spec.initial or InitialSpec()
    listed = [Source("initial", "position", axis, "constant", start.position) for axis in LOCAL]
    listed += [Source("initial", "velocity", axis, "constant", start.velocity) for axis in LOCAL]
    listed += [Source("initial", "tilt", axis, "constant", start.tilt) for axis in LOCAL[:2]]
    listed += [Source("initial", "heading", "down", "constant", start.heading)]
    listed += _of_sensor("gyro", spec.gyro) + _of_sensor("accel", spec.accel)
    listed += [Source("gravity", "model", axis, "constant", deflection * G0) for axis in LOCAL]
    listed += [
        Source("timing", "offset", "t", "constant", abs(spec.clock.offset)),
        Source("timing", "drift", "t", "constant", abs(spec.clock.drift)),
    ]
    return tuple(listed)


def _of_sensor(group: Literal["gyro", "accel"], sensor: SensorSpec) -> list[Source]:
    found = []
    for term, key, kind, spread in _SENSOR:
        if key == "g_sensitivity" and group == "accel":
            continue
        size: FloatArray = getattr(sensor, key)
        tau = sensor.correlation_time if kind == "Gauss-Markov" else math.inf
        for i, j in _elements(spread):
            axis = BODY[i] if spread == _VECTOR else BODY[i] + BODY[j]
            found.append(Source(group, term, axis, kind, float(size[i]), tau))
    return found


def _elements(spread: str) -> list[tuple[int, int]]:
    pairs = [(i, j) for i in range(3) for j in range(3)]
    if spread == _BESIDE:
        return [(i, j) for i, j in pairs if i != j]
    return pairs if spread == _MATRIX else [(i, i) for i in range(3)]


def families(sources: tuple[Source, ...]) -> tuple[str, ...]:
    """Names of the families of sources that are not all zero, in the order of the list."""
    return tuple(dict.fromkeys(source.family for source in sources if source.sd > 0.0))


def only(spec: ImuSpec, family: str) -> ImuSpec:
    """Leave one family of sources in an IMU, and nothing else.

    Parameters
    ----------
    spec : ImuSpec
        Whole.
    family : str
        See `Source.family`; the family ``gravity model`` is not of the IMU and leaves nothing.
    """
    group, _, term = family.partition(" ")
    bare = ImuSpec(spec.name, SensorSpec(), SensorSpec())
    if group == "initial":
        return replace(bare, initial=InitialSpec(**{term: getattr(spec.initial or InitialSpec(), term)}))
    if group == "timing":
        return replace(bare, clock=ClockSpec(**{term: getattr(spec.clock, term)}))
    if group == "gravity":
        return bare
    key = next(key for name, key, _, _ in _SENSOR if name == term)
    whole: SensorSpec = getattr(spec, group)
    left = SensorSpec(**{key: getattr(whole, key)}, correlation_time=whole.correlation_time)
    return replace(bare, gyro=left) if group == "gyro" else replace(bare, accel=left)


def left_out(spec: ImuSpec) -> tuple[str, ...]:
    """Errors that the IMU has and the budget does not, in words.

    Parameters
    ----------
    spec : ImuSpec
        Sizes.
    """
    found = [
        f"{group} {words}"
        for group, sensor in (("gyro", spec.gyro), ("accel", spec.accel))
        for key, words in _NOT_HELD.items()
        if np.any(getattr(sensor, key))
    ]
    if np.any(spec.positions):
        found.append("places of the accelerometers")
    found += ["clock jitter"] * (spec.clock.jitter > 0.0) + ["lost samples"] * (spec.clock.lost_every > 0.0)
    return tuple(found)


def not_given(spec: ImuSpec) -> tuple[str, ...]:
    """Keys of the IMU file that are absent and count as zero, such as ``accel.scale_factor``.

    Parameters
    ----------
    spec : ImuSpec
        As read.
    """
    initial = () if spec.initial is not None else tuple(f"initial.{key}" for key in InitialSpec.__dataclass_fields__)
    return tuple(key for key in spec.absent if not key.endswith("correlation_time")) + initial
