"""Simulated recording: an exact motion measured by an IMU and a receiver sampled from their specifications, and faults.

A fault is a deliberate error of the receiver, the sensors or the logger, applied by a pure function. It is written
``VERB[:SIZE][@TIME[+LENGTH]]``, times in seconds after the first sample. `VERBS` lists the verbs with examples;
``trajectories/README.md`` describes them, and the receiver file (``gps.toml``) with every key.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tomli_w
from pydantic import Field, PlainValidator, model_validator

from insnav import config_file
from insnav.earth import lla_offset
from insnav.exceptions import ConfigError
from insnav.imu import ImuErrors, ImuSpec
from insnav.simulate.sensor_errors import GpsErrors, GpsSpec, RandomSpells, corrupt_imu, measure_gps, without_fixes
from insnav.simulate.truth import Truth, gps_from_truth, imu_from_truth, reference
from insnav.types import BoolArray, FloatArray, GpsData, ImuData, Sampling, Trajectory
from insnav.units import DEG, G0, UNITS

NORTH_EAST = np.array([0.6, 0.8, 0.0])  # unit vector along which faults move fixes, North, East, Down
_AXES = ("gyro-x", "gyro-y", "gyro-z", "accel-x", "accel-y", "accel-z")
_ALWAYS = "imu-units", "imu-axes"  # faults that affect all samples and have no time
_DIRECTIONS = {"F": (0, 1.0), "B": (0, -1.0), "R": (1, 1.0), "L": (1, -1.0), "D": (2, 1.0), "U": (2, -1.0)}
REFERENCE_RATE = 10.0  # rows of the reference per second [Hz]
IDEAL_GPS_RATE = 1.0  # fixes of an error-free receiver per second [Hz]
SLOWEST, FASTEST = 1.0, 10_000.0  # plausible sampling rates [Hz]
MOTION_STREAM, _IMU_STREAM, _GPS_STREAM = 0, 1, 2  # random streams of a seed, one per source of randomness


@dataclass(frozen=True, slots=True)
class Fault:
    """Fault of a recording."""

    verb: str  # type of the fault; see `VERBS`
    # size in SI units; for some faults an axis, a unit or three directions, as text
    size: float | str | None = None
    begin: float = -math.inf  # start after the first sample [s]; by default all data
    length: float = math.inf  # duration [s]; infinite by default

    def apply(self, imu: ImuData, gps: GpsData, start: float | None = None) -> tuple[ImuData, GpsData]:
        """Apply the fault to copies of the data.

        Times count from `start` [s], by default the first sample. Faulty data may violate the order and finiteness of
        their types.
        """
        begin = self.begin + (float(imu.time[0]) if start is None else start)
        span = (begin, begin + self.length) if begin > -math.inf else (-math.inf, math.inf)
        change = VERBS[self.verb].change
        if self.verb.startswith("gps-"):
            return imu, change(gps, self.size, span)
        return change(imu, self.size, span), gps


def parse_fault(text: str) -> Fault:
    """Parse a fault as written on the command line, such as ``gps-jump:60m@120s+8s``.

    Raises: ConfigError: an unknown verb, or a missing, unexpected or invalid size or time.
    """
    match = re.fullmatch(r"([^:@]+)(?::([^@]+))?(?:@([^+]+)(?:\+(.+))?)?", text.strip())
    name = match[1] if match else text.split(":")[0]
    if match is None or name not in VERBS:
        raise ConfigError("sim.unknown_fault", where="--fault", fault=text[:100], **config_file.similar(name, VERBS))
    verb, where, example = VERBS[name], f"--fault {text}", VERBS[name].example
    if (match[2] is None) != (verb.size is None):
        raise ConfigError(
            "sim.fault_without_size" if match[2] is None else "sim.fault_with_size",
            where=where,
            verb=name,
            example=example,
        )
    if match[3] is not None and name in _ALWAYS:
        raise ConfigError("sim.fault_with_time", where=where, verb=name, example=example)
    if match[3] is None and "@" in example:
        raise ConfigError("sim.fault_without_time", where=where, verb=name, example=example)
    if match[4] is None and "+" in example and name != "gps-jump":
        raise ConfigError("sim.fault_without_length", where=where, verb=name, example=example)
    try:
        size = verb.size(match[2]) if verb.size is not None else None
        begin = -math.inf if match[3] is None else _seconds(match[3])
        length = math.inf if match[4] is None else _seconds(match[4])
    except ConfigError as error:
        error.where = where
        raise
    if (match[3] is not None and begin < 0.0) or length <= 0.0:
        raise ConfigError("sim.fault_times", where=where, example=example)
    return Fault(name, size, begin, length)


def gps_spike(gps: GpsData, size: float, span: tuple[float, float]) -> GpsData:
    """Move the first fix at or after the start of `span` by `size` [m]."""
    rows = np.arange(gps.time.shape[0]) == int(np.searchsorted(gps.time, span[0] - 1e-6))
    return _moved(gps, rows * float(size))


def gps_jump(gps: GpsData, size: float, span: tuple[float, float]) -> GpsData:
    """Move the fixes in `span` by `size` [m]."""
    return _moved(gps, _inside(gps.time, span) * float(size))


def gps_drag(gps: GpsData, size: float, span: tuple[float, float]) -> GpsData:
    """Move the fixes by `size` [m/s] times the time since the start of `span`; the final offset remains afterwards."""
    return _moved(gps, float(size) * np.clip(gps.time - span[0], 0.0, span[1] - span[0]))


def gps_flap(gps: GpsData, size: float, span: tuple[float, float]) -> GpsData:
    """Move four of every five fixes in `span` by `size` [m], each in another direction."""
    rows = np.flatnonzero(_inside(gps.time, span))
    offset = np.zeros((gps.time.shape[0], 3))
    angle = 2.4 * np.arange(rows.shape[0])  # direction of each offset [rad]: successive directions differ
    offset[rows] = float(size) * np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    offset[rows[::5]] = 0.0
    return replace(gps, lla=lla_offset(gps.lla, offset))


def gps_latency(gps: GpsData, size: float, span: tuple[float, float]) -> GpsData:
    """Delay the timestamps of the fixes in `span` by `size` [s]."""
    late = gps.time + size * _inside(gps.time, span)
    order = np.argsort(late, kind="stable")
    return replace(gps.rows(order), time=late[order])


def gps_sd(gps: GpsData, size: float, span: tuple[float, float]) -> GpsData:
    """Multiply the reported standard deviations in `span` by `size`."""
    factor = np.where(_inside(gps.time, span), size, 1.0)[:, None]
    return replace(gps, position_sd=gps.position_sd * factor, velocity_sd=gps.velocity_sd * factor)


def gps_duplicate(gps: GpsData, size: None, span: tuple[float, float]) -> GpsData:
    """Repeat the fix at the start of `span` in a second row, with a position error of 10 m."""
    row = _first(gps.time, span)
    repeated = gps.rows(np.insert(np.arange(gps.time.shape[0]), row + 1, row))
    lla = repeated.lla.copy()
    lla[row + 1] = lla_offset(lla[row + 1], 10.0 * NORTH_EAST)
    return replace(repeated, lla=lla)


def gps_shuffle(gps: GpsData, size: None, span: tuple[float, float]) -> GpsData:
    """Reverse the order of the rows in `span`."""
    order = np.arange(gps.time.shape[0])
    inside = _inside(gps.time, span)
    order[inside] = order[inside][::-1]
    return gps.rows(order)


def imu_clip(imu: ImuData, size: str, span: tuple[float, float]) -> ImuData:
    """Clip gyros or accelerometers in `span` to a range; increments are clipped to the range times the interval."""
    dimension, limit = _sensor_quantity(str(size))
    largest = np.where(_inside(imu.time, span), limit * _scale(imu), np.inf)[:, None]
    gyro, accel = (largest, np.inf) if dimension == "rate" else (np.inf, largest)
    return replace(imu, gyro=np.clip(imu.gyro, -gyro, gyro), accel=np.clip(imu.accel, -accel, accel))


def imu_stuck(imu: ImuData, size: str, span: tuple[float, float]) -> ImuData:
    """Hold an axis, or ``all``, at its value at the start of `span`."""
    rows = np.flatnonzero(_inside(imu.time, span))
    values = np.hstack([imu.gyro, imu.accel])
    if rows.size:
        columns = slice(None) if size == "all" else _AXES.index(str(size))
        values[rows, columns] = values[rows[0], columns]
    return replace(imu, gyro=values[:, :3].copy(), accel=values[:, 3:].copy())


def imu_spike(imu: ImuData, size: str, span: tuple[float, float]) -> ImuData:
    """Add a spike to one sample, of the z gyro or of the x accelerometer."""
    dimension, value = _sensor_quantity(str(size))
    row = _first(imu.time, span)
    gyro, accel = imu.gyro.copy(), imu.accel.copy()
    if dimension == "rate":
        gyro[row, 2] += value * _scale(imu)
    else:
        accel[row, 0] += value * _scale(imu)
    return replace(imu, gyro=gyro, accel=accel)


def _seconds(text: str) -> float:
    return config_file.parse_quantity(text if text.strip()[-1:].isalpha() else f"{text} s", "time")


def _quantity(dimension: str) -> Callable[[str], float]:
    return lambda text: config_file.parse_quantity(text, dimension)


def _factor(text: str) -> float:
    value = config_file.parse_quantity(f"{text} 1", "ratio")
    if value <= 0.0:
        raise ConfigError("sim.not_above_zero", text=text)
    return value


def _one_of(*names: str) -> Callable[[str], str]:
    def chosen(text: str) -> str:
        if text not in names:
            raise ConfigError("sim.not_one_of", text=text, known=names)
        return text

    return chosen


def _directions(text: str) -> str:
    if len(text) != 3 or sorted(_DIRECTIONS.get(letter, (9, 0.0))[0] for letter in text) != [0, 1, 2]:
        raise ConfigError("sim.no_directions", text=text)
    return text


def _sensor_quantity(text: str) -> tuple[str, float]:
    """Parse dimension and value of a rate or an acceleration."""
    dimension = UNITS.get(re.sub(r"^[-+\d.eE\s]*", "", text), ("rate", 1.0))[0]
    return dimension, config_file.parse_quantity(text, dimension if dimension in ("rate", "acceleration") else "rate")


def _sensor_text(text: str) -> str:
    _sensor_quantity(text)
    return text


@dataclass(frozen=True, slots=True)
class Verb:
    """Type of fault: its syntax and the function that applies it."""

    example: str
    size: Callable[[str], float | str] | None
    change: Callable[..., Any]  # (fixes or samples, size, (begin, end) [s]) -> changed data


def _first(time: FloatArray, span: tuple[float, float]) -> int:
    return min(int(np.searchsorted(time, span[0] - 1e-6)), len(time) - 1)


def _inside(time: FloatArray, span: tuple[float, float]) -> BoolArray:
    return (time >= span[0] - 1e-6) & (time < span[1] - 1e-6)


def _times(imu: ImuData, gyro: FloatArray | float, accel: FloatArray | float) -> ImuData:
    return replace(imu, gyro=imu.gyro * gyro, accel=imu.accel * accel)


def _turned(imu: ImuData, size: str, _: tuple[float, float]) -> ImuData:
    turn = np.zeros((3, 3))
    for row, letter in enumerate(size):
        column, sign = _DIRECTIONS[letter]
        turn[row, column] = sign
    return replace(imu, gyro=imu.gyro @ turn.T, accel=imu.accel @ turn.T)


def _moved(gps: GpsData, metres: np.ndarray) -> GpsData:
    return replace(gps, lla=lla_offset(gps.lla, metres[:, None] * NORTH_EAST))


def _scale(imu: ImuData) -> float:
    """Return the factor from a rate to a sample: the interval [s] for increments, else 1."""
    return float(np.median(np.diff(imu.time))) if imu.sampling == "increment" else 1.0


_ALL = (
    Verb("gps-spike:60m@120s", _quantity("length"), gps_spike),
    Verb("gps-jump:60m@120s+8s", _quantity("length"), gps_jump),
    Verb("gps-drag:1m/s@120s+60s", _quantity("velocity"), gps_drag),
    Verb("gps-outage@120s+30s", None, lambda gps, _, span: without_fixes(gps, span[0] - 1e-6, span[1] - 1e-6)),
    Verb("gps-flap:50m@120s+60s", _quantity("length"), gps_flap),
    Verb("gps-latency:0.3s", _quantity("time"), gps_latency),
    Verb("gps-sd:0.1", _factor, gps_sd),
    Verb("gps-duplicate@120s", None, gps_duplicate),
    Verb("gps-shuffle@120s+10s", None, gps_shuffle),
    Verb("imu-gap@120s+0.5s", None, lambda imu, _, span: imu.rows(~_inside(imu.time, span))),
    Verb(
        "imu-nan@120s+0.05s",
        None,
        lambda imu, _, span: _times(imu, *[np.where(_inside(imu.time, span), np.nan, 1.0)[:, None]] * 2),
    ),
    Verb("imu-clip:20deg/s@120s+2s", _sensor_text, imu_clip),
    Verb("imu-stuck:gyro-z@120s+2s", _one_of(*_AXES, "all"), imu_stuck),
    Verb("imu-spike:3rad/s@120s", _sensor_text, imu_spike),
    Verb(
        "imu-units:deg/s",
        _one_of("deg/s", "g"),
        lambda imu, size, _: _times(imu, 1.0 / DEG, 1.0) if size == "deg/s" else _times(imu, 1.0, 1.0 / G0),
    ),
    Verb("imu-axes:FLU", _directions, _turned),
    Verb("imu-reverse@120s", None, lambda imu, _, span: replace(imu, time=imu.time - (imu.time >= span[0] - 1e-6))),
    Verb(
        "imu-duplicate@120s+0.1s",
        None,
        lambda imu, _, span: imu.rows(np.repeat(np.arange(imu.time.shape[0]), 1 + _inside(imu.time, span))),
    ),
)
VERBS = {re.split("[:@]", verb.example)[0]: verb for verb in _ALL}


@dataclass(frozen=True, slots=True)
class Recording:
    """Simulated data with their truth."""

    imu: ImuData  # samples with errors and faults
    gps: GpsData  # fixes with errors and faults
    reference: Trajectory  # exact motion of the IMU at `REFERENCE_RATE`
    errors: ImuErrors | None  # constant errors of the sampled IMU; None without errors
    lever_b: FloatArray  # (3,) antenna position relative to the IMU, body axes [m]


def simulate_recording(
    truth: Truth,
    imu_spec: ImuSpec | None,
    gps_spec: GpsSpec | None,
    seed: int,
    *,
    rate: float = 100.0,
    sampling: Sampling = "mean",
    faults: Sequence[Fault] = (),
    temperature: FloatArray | None = None,
    perfect: ImuData | None = None,
) -> Recording:
    """Measure a motion with sensors sampled from their specifications; None means an error-free sensor.

    `seed`: determines sensor realisations and noise. `rate`: of the IMU [Hz]. `sampling` {"mean", "instant",
    "increment"}. `faults`: applied in order; a fault without effect is refused. `temperature` (n,): of the IMU at each
    sample [deg C]. `perfect`: result of `perfect_imu` for the same truth, rate and sampling, for reuse with many seeds.
    Raises: ConfigError: an implausible rate, or a motion shorter than two samples.
    """
    samples = perfect if perfect is not None else perfect_imu(truth, rate, sampling)
    errors = None
    if imu_spec is not None:
        measured = corrupt_imu(samples, imu_spec, (seed, _IMU_STREAM), temperature=temperature)
        samples, errors = measured.imu, measured.errors
        del measured  # free memory: its biases are as large as the samples
    if gps_spec is not None:
        fixes, lever_b = measure_gps(truth, gps_spec, (seed, _GPS_STREAM)), np.asarray(gps_spec.lever_b)
    else:
        lever_b = np.zeros(3)
        fixes = gps_from_truth(truth, times(truth, IDEAL_GPS_RATE)[1:], lever_b)
    for fault in faults:
        before = samples, fixes
        samples, fixes = fault.apply(samples, fixes, truth.start)
        if _same(before[0], samples) and _same(before[1], fixes):
            begin, duration = max(fault.begin, 0.0), truth.duration
            raise ConfigError(
                "sim.fault_without_effect", where="--fault", verb=fault.verb, begin_s=begin, duration_s=duration
            )
    return Recording(samples, fixes, reference(truth, times(truth, REFERENCE_RATE)), errors, lever_b)


def _same(one: ImuData | GpsData, other: ImuData | GpsData) -> bool:
    """Return whether two records contain the same numbers."""
    first, second = one.columns(), other.columns()
    return first.keys() == second.keys() and all(np.array_equal(v, second[k], equal_nan=True) for k, v in first.items())


def perfect_imu(truth: Truth, rate: float = 100.0, sampling: Sampling = "mean") -> ImuData:
    """Measure a motion with an error-free IMU; see `simulate_recording`."""
    if not SLOWEST <= rate <= FASTEST:
        raise ConfigError("sim.sampling_rate", where="rate", rate_hz=rate, lowest_hz=SLOWEST, highest_hz=FASTEST)
    edges = times(truth, rate)
    if len(edges) < 3:
        raise ConfigError("sim.too_short_to_sample", where="rate", duration_s=truth.duration, rate_hz=rate)
    return imu_from_truth(truth, edges, sampling)


def temperature_ramp(imu: ImuData, ends: tuple[float, float] | None) -> FloatArray | None:
    """Interpolate between the temperatures `ends` at each sample, ``(n,)`` [deg C]; None without `ends`."""
    return None if ends is None else np.linspace(*ends, len(imu.time))


def times(truth: Truth, rate: float) -> FloatArray:
    """Return evenly spaced times of the whole motion at a rate [Hz], including its start, ``(n,)`` [s]."""
    return truth.start + np.arange(math.floor(truth.duration * rate * (1.0 + 1e-12)) + 1) / rate


_FOLDER = Path(__file__).parent / "receivers"
PRESETS = ("single", "dgps", "rtk", "urban")
_MAX_RATE = 100.0  # highest rate of a receiver [Hz]


def _pair(value: object) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise config_file.wrong("sim.no_pair_of_times")
    begin, length = (config_file.quantity(item, "time", signed=False) for item in value)
    return begin, length


def _pairs(value: object) -> tuple[tuple[float, float], ...]:
    if not isinstance(value, list):
        raise config_file.wrong("sim.no_list_of_times")
    return tuple(_pair(item) for item in value)


class _Position(config_file.Table):
    white: Annotated[config_file.Axes, config_file.axes("length")]
    lasting: Annotated[config_file.Axes, config_file.axes("length")] = (0.0, 0.0, 0.0)
    correlation_time: Annotated[float, config_file.scalar("time")] = 60.0

    above_zero = ("correlation_time",)

    @model_validator(mode="after")
    def _sound(self) -> _Position:
        if not all(w > 0.0 or d > 0.0 for w, d in zip(self.white, self.lasting, strict=True)):
            raise config_file.wrong("sim.no_position_noise")
        return self


class _Velocity(config_file.Table):
    white: Annotated[config_file.Axes, config_file.axes("velocity")]

    above_zero = ("white",)


class _Now(config_file.Table):
    every: Annotated[float, config_file.scalar("time")]
    length: Annotated[float, config_file.scalar("time")]

    above_zero = ("every", "length")


class _Multipath(_Now):
    size: Annotated[float, config_file.scalar("length")]


class _Degraded(_Now):
    white: Annotated[float, config_file.scalar("length")]


class _Outage(config_file.Table):
    every: Annotated[float | None, config_file.scalar("time")] = None
    length: Annotated[float | None, config_file.scalar("time")] = None
    period: Annotated[tuple[float, float] | None, PlainValidator(_pair)] = None
    list: Annotated[tuple[tuple[float, float], ...], PlainValidator(_pairs)] = ()

    @model_validator(mode="after")
    def _sound(self) -> _Outage:
        if (self.every is None) != (self.length is None) or self.every == 0.0 or self.length == 0.0:
            raise config_file.wrong("sim.outage_lengths")
        if self.period is not None and not 0.0 < self.period[1] < self.period[0]:
            raise config_file.wrong("sim.outage_period")
        return self


class _GpsFile(config_file.Table):
    name: str | None = None
    source: str = ""
    rate: Annotated[float, config_file.scalar("frequency")] = 1.0
    lever_arm: Annotated[config_file.Axes, config_file.axes("length", signed=True)] = (0.0, 0.0, 0.0)
    latency: Annotated[float, config_file.scalar("time")] = 0.0
    jitter: Annotated[float, config_file.scalar("time")] = 0.0
    fix: Annotated[int, Field(ge=1, le=5)] = 5
    stated: Annotated[float, Field(gt=0.0, le=1000.0, strict=False)] = 1.0
    position: _Position
    velocity: _Velocity | None = None
    multipath: _Multipath | None = None
    degraded: _Degraded | None = None
    outage: _Outage | None = None

    @model_validator(mode="after")
    def _sound(self) -> _GpsFile:
        if not 0.0 < self.rate <= _MAX_RATE:
            raise config_file.wrong("sim.receiver_rate", limit_hz=_MAX_RATE)
        return self


def load_gps(preset_or_path: str) -> GpsSpec:
    """Read a receiver specification.

    `preset_or_path`: ``single``, ``dgps``, ``rtk``, ``urban``, or a receiver file.
    Raises: ConfigError: no such preset or file, invalid TOML, or wrong keys or values, all at once.
    """
    path = config_file.preset_or_file(preset_or_path, _FOLDER, PRESETS)
    if path is None:
        suggestions = config_file.similar(preset_or_path, (*PRESETS, "ideal"))
        raise ConfigError("sim.unknown_receiver", where="--gps", receiver=preset_or_path[:200], **suggestions)
    file = config_file.validate(_GpsFile, config_file.read_toml(path), str(path))
    velocity = (1.0, 1.0, 1.0) if file.velocity is None else file.velocity.white
    outage, multipath, degraded = file.outage or _Outage(), file.multipath, file.degraded
    return GpsSpec(
        file.name or path.stem,
        GpsErrors(file.position.white, file.position.lasting, file.position.correlation_time, velocity),
        file.rate,
        file.lever_arm,
        file.velocity is not None,
        file.latency,
        file.jitter,
        file.fix,
        None if multipath is None else RandomSpells(multipath.every, multipath.length),
        0.0 if multipath is None else multipath.size,
        None if degraded is None else RandomSpells(degraded.every, degraded.length),
        0.0 if degraded is None else degraded.white,
        outage.list,
        outage.period,
        None if outage.every is None or outage.length is None else RandomSpells(outage.every, outage.length),
        file.stated,
        file.source.strip(),
    )


def to_toml(spec: GpsSpec) -> str:
    """Convert a receiver specification to the text of a receiver file, without zero values."""
    errors = spec.errors
    content: dict[str, Any] = {"name": spec.name, **({"source": spec.source} if spec.source else {})}
    content |= _given("Hz", rate=spec.rate) | _given("m", lever_arm=spec.lever_b)
    content |= _given("s", latency=spec.latency, jitter=spec.jitter)
    content |= {"fix": spec.fix, **({} if spec.stated == 1.0 else {"stated": spec.stated})}
    content["position"] = {"white": _text(errors.position_noise, "m")}
    if any(errors.position_drift):
        content["position"] |= _given("m", lasting=errors.position_drift)
        content["position"] |= _given("s", correlation_time=errors.correlation_time)
    if spec.velocities:
        content["velocity"] = _given("m/s", white=errors.velocity_noise)
    if spec.multipath is not None:
        content["multipath"] = {**_now(spec.multipath), "size": _text(spec.multipath_size, "m")}
    if spec.degraded is not None:
        content["degraded"] = {**_now(spec.degraded), "white": _text(spec.degraded_noise, "m")}
    outage = {} if spec.outage is None else _now(spec.outage)
    outage |= _given("s", period=spec.outage_period or (), list=spec.outages)
    return tomli_w.dumps(content | ({"outage": outage} if outage else {}))


def _now(when: RandomSpells) -> dict[str, Any]:
    return {"every": _text(when.every, "s"), "length": _text(when.length, "s")}


def _given(unit: str, **values: Any) -> dict[str, Any]:
    """Return the nonzero quantities as texts with their unit, by key."""
    return {key: _text(value, unit) for key, value in values.items() if np.any(value)}


def _text(value: Any, unit: str) -> Any:
    return [_text(each, unit) for each in value] if isinstance(value, tuple) else f"{float(value)!r} {unit}"
