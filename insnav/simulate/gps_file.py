"""Receiver file (``gps.toml``): error specification of a receiver, with a unit in every value.

An example with every key is in ``trajectories/README.md``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tomli_w
from pydantic import Field, PlainValidator, model_validator

from insnav.config_file import Axes, Table, axes, preset_or_file, quantity, read_toml, scalar, similar, validate, wrong
from insnav.exceptions import ConfigError
from insnav.simulate.sensor_errors import GpsErrors, GpsSpec, RandomSpells

_FOLDER = Path(__file__).parent / "receivers"
PRESETS = ("single", "dgps", "rtk", "urban")
_MAX_RATE = 100.0  # [Hz]


def _pair(value: object) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise wrong("sim.no_pair_of_times")
    begin, length = (quantity(item, "time", signed=False) for item in value)
    return begin, length


def _pairs(value: object) -> tuple[tuple[float, float], ...]:
    if not isinstance(value, list):
        raise wrong("sim.no_list_of_times")
    return tuple(_pair(item) for item in value)


class _Position(Table):
    white: Annotated[Axes, axes("length")]
    lasting: Annotated[Axes, axes("length")] = (0.0, 0.0, 0.0)
    correlation_time: Annotated[float, scalar("time")] = 60.0

    above_zero = ("correlation_time",)

    @model_validator(mode="after")
    def _sound(self) -> _Position:
        if not all(w > 0.0 or d > 0.0 for w, d in zip(self.white, self.lasting, strict=True)):
            raise wrong("sim.no_position_noise")
        return self


class _Velocity(Table):
    white: Annotated[Axes, axes("velocity")]

    above_zero = ("white",)


class _Now(Table):
    every: Annotated[float, scalar("time")]
    length: Annotated[float, scalar("time")]

    above_zero = ("every", "length")


class _Multipath(_Now):
    size: Annotated[float, scalar("length")]


class _Degraded(_Now):
    white: Annotated[float, scalar("length")]


class _Outage(Table):
    every: Annotated[float | None, scalar("time")] = None
    length: Annotated[float | None, scalar("time")] = None
    period: Annotated[tuple[float, float] | None, PlainValidator(_pair)] = None
    list: Annotated[tuple[tuple[float, float], ...], PlainValidator(_pairs)] = ()

    @model_validator(mode="after")
    def _sound(self) -> _Outage:
        if (self.every is None) != (self.length is None) or self.every == 0.0 or self.length == 0.0:
            raise wrong("sim.outage_lengths")
        if self.period is not None and not 0.0 < self.period[1] < self.period[0]:
            raise wrong("sim.outage_period")
        return self


class _GpsFile(Table):
    name: str | None = None
    source: str = ""
    rate: Annotated[float, scalar("frequency")] = 1.0
    lever_arm: Annotated[Axes, axes("length", signed=True)] = (0.0, 0.0, 0.0)
    latency: Annotated[float, scalar("time")] = 0.0
    jitter: Annotated[float, scalar("time")] = 0.0
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
            raise wrong("sim.receiver_rate", limit_hz=_MAX_RATE)
        return self


def load_gps(preset_or_path: str) -> GpsSpec:
    """Read a receiver specification.

    `preset_or_path`: ``single``, ``dgps``, ``rtk``, ``urban``, or a receiver file.
    Raises: ConfigError: no such preset or file, invalid TOML, or wrong keys or values, all at once.
    """
    path = preset_or_file(preset_or_path, _FOLDER, PRESETS)
    if path is None:
        known = similar(preset_or_path, (*PRESETS, "ideal"))
        raise ConfigError("sim.unknown_receiver", where="--gps", receiver=preset_or_path[:200], **known)
    file = validate(_GpsFile, read_toml(path), str(path))
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
    """Write a receiver file without zero values."""
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
    """Return the nonzero quantities by key."""
    return {key: _text(value, unit) for key, value in values.items() if np.any(value)}


def _text(value: Any, unit: str) -> Any:
    return [_text(each, unit) for each in value] if isinstance(value, tuple) else f"{float(value)!r} {unit}"
