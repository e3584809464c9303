"""Motion profile (``*.toml``): start and segments of a drive, in order."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PlainValidator

from insnav.config_file import Table, checked, quantity, read_toml, refuse, scalar, signed_scalar, similar, wrong
from insnav.exceptions import ConfigError
from insnav.simulate.motion.assemble import Commands, Start, commands_of, spacing_of, truth_of, way_through
from insnav.simulate.motion.moves import KINDS, Kind, Move, State, Vibration
from insnav.simulate.motion.segments import SEGMENTS, Repeat, Segment
from insnav.simulate.sensor_errors import Seed
from insnav.simulate.truth import Truth
from insnav.types import FloatArray

_LONGEST = 48.0 * 3600.0  # [s]
_MAX_MOVES = 20_000
_HIGHEST_VIBRATION = 100.0  # [Hz]


def _latitude(value: object) -> float:
    angle = quantity(value, "angle", signed=True)
    if abs(angle) > math.pi / 2:
        raise wrong("sim.no_latitude")
    return angle


class _Start(Table):
    lat: Annotated[float, PlainValidator(_latitude)]
    lon: Annotated[float, signed_scalar("angle")]
    height: Annotated[float, signed_scalar("length")] = 0.0
    heading: Annotated[float, signed_scalar("angle")] = 0.0
    roll: Annotated[float, signed_scalar("angle")] = 0.0
    pitch: Annotated[float, signed_scalar("angle")] = 0.0
    speed: Annotated[float, scalar("velocity")] = 0.0
    time: Annotated[float, signed_scalar("time")] = 0.0


class _Line(Table):
    frequency: Annotated[float, scalar("frequency")]
    acceleration: Annotated[float, scalar("acceleration")]


class _Band(Table):
    low: Annotated[float, scalar("frequency")]
    high: Annotated[float, scalar("frequency")]
    density: Annotated[float, scalar("vibration density")]


class _Vibration(Table):
    suspension: Annotated[float, Field(ge=0.0, le=100.0, strict=False)] = 1.0
    engine: list[_Line] = Field(default_factory=list)
    band: list[_Band] = Field(default_factory=list)


class _Waypoint(Table):
    lat: Annotated[float, PlainValidator(_latitude)]
    lon: Annotated[float, signed_scalar("angle")]
    height: Annotated[float, signed_scalar("length")] = 0.0
    speed: Annotated[float, scalar("velocity")]


class _ProfileFile(Table):
    purpose: str
    name: str | None = None
    vehicle: Literal["car", "aircraft", "slide"] = "car"
    start: _Start | None = None
    vibration: _Vibration = Field(default_factory=_Vibration)
    segment: list[dict[str, Any]] = Field(default_factory=list)
    waypoint: list[_Waypoint] = Field(default_factory=list)


@dataclass(frozen=True)
class MotionProfile:
    """Feasible motion: name, purpose in one line, duration [s], and file."""

    name: str
    purpose: str
    duration: float
    text: str
    _start: Start
    _vehicle: Kind
    _vibration: Vibration
    _moves: tuple[Move, ...]
    _way: Commands | None

    def truth(self, seed: Seed) -> Truth:
        """Build the exact motion; only its vibration is random."""
        commands = self._way or commands_of(self._moves, spacing_of(self._moves, self._vibration))
        return truth_of(commands, self._moves, self._start, self._vehicle, self._vibration, seed)


def load_profile(name_or_path: str | Path, library: Path | None = None) -> MotionProfile:
    """Read a motion profile, by library name or file, and check its feasibility.

    Raises: ConfigError: no such profile, invalid TOML, wrong keys, or an infeasible motion: all errors at once, each
    with the number and kind of its segment.
    """
    path = _find(name_or_path, library)
    data = read_toml(path)
    file, problems = checked(_ProfileFile, data)
    segments: list[tuple[str, Segment]] = []
    listed = data.get("segment")
    if isinstance(listed, list):
        segments, more = _read(listed, "segment")
        problems += more
    if not data.get("waypoint"):
        if not data.get("start"):
            problems.append(ConfigError("sim.no_start", where="start"))
        if not data.get("segment"):
            problems.append(ConfigError("sim.no_segments", where="segment"))
    if file is None or problems:
        refuse(problems, str(path))
    vehicle, vibration = KINDS[file.vehicle], _vibration(file.vibration, problems)
    if file.waypoint:
        start, moves, way = _waypoints(file, vehicle, vibration, problems)
    else:
        start, moves, way = _segments(file, segments, vehicle, problems)
    if problems:
        refuse(problems, str(path))
    duration = way.duration if way is not None else math.fsum(move.duration for move in moves)
    if duration > _LONGEST:
        raise ConfigError("sim.too_long", where=str(path), duration_s=duration, limit_s=_LONGEST)
    name = path.stem if file.name is None else file.name
    # the name is part of the text: a copy under another name is the same profile
    text = path.read_text(encoding="utf-8-sig")
    if file.name is None:
        text = f'name = "{name}"\n{text}'
    return MotionProfile(name, file.purpose, duration, text, start, vehicle, vibration, tuple(moves), way)


def _read(listed: list[Any], path: str) -> tuple[list[tuple[str, Segment]], list[ConfigError]]:
    """Read segments with names, such as ``segment 3 (turn)``, and their errors."""
    segments: list[tuple[str, Segment]] = []
    problems: list[ConfigError] = []
    for number, data in enumerate(listed, start=1):
        place = f"{path} {number}"
        kind = data.get("kind") if isinstance(data, dict) else None
        if kind not in SEGMENTS:
            if kind is None:
                problems.append(ConfigError("sim.segment_without_kind", where=place, known=tuple(SEGMENTS)))
            else:
                kinds = similar(str(kind), SEGMENTS)
                problems.append(ConfigError("sim.unknown_kind", where=place, kind=str(kind)[:100], **kinds))
            continue
        place = f"{place} ({kind})"
        segment, more = checked(SEGMENTS[kind], data)
        for problem in more:
            problem.where = ": ".join(filter(None, (place, problem.where)))
        problems += more
        if kind == "repeat":
            listed_inside = data.get("segment")
            inner, more = _read(listed_inside if isinstance(listed_inside, list) else [], f"{place}, segment")
            problems += more
            count = segment.count if isinstance(segment, Repeat) else 0
            if len(segments) + count * len(inner) > _MAX_MOVES:
                problems.append(ConfigError("sim.many_moves", where=path, limit=_MAX_MOVES))
                break
            segments += inner * count
        elif segment is not None:
            segments.append((place, segment))
    return segments, problems


def _segments(
    file: _ProfileFile, segments: list[tuple[str, Segment]], vehicle: Kind, problems: list[ConfigError]
) -> tuple[Start, list[Move], None]:
    given = file.start
    assert given is not None
    if given.speed > vehicle.speed:
        values: dict[str, Any] = {"speed_m_s": given.speed, "limit_m_s": vehicle.speed}
        problems.append(ConfigError("sim.too_fast", where="start.speed", vehicle=vehicle.name, **values))
    place = np.array([given.lat, given.lon, given.height])
    start = Start(place, given.heading, given.speed, given.roll, given.pitch, given.time)
    state, moves = State(start.speed, start.heading), list[Move]()
    for name, segment in segments:
        try:
            made = segment.moves(state, vehicle)
        except ConfigError as problem:
            problem.where = name
            if problem.as_dict() not in [each.as_dict() for each in problems]:  # reported once, not in each repetition
                problems.append(problem)
            # continue from the intended end, to judge later segments fairly
            state = State(float(getattr(segment, "to", state.speed)), state.heading)
            continue
        moves += made
        state = made[-1].end if made else state
        if len(moves) > _MAX_MOVES:
            problems.append(ConfigError("sim.many_moves", where="segment", limit=_MAX_MOVES))
            break
    return start, moves, None


def _waypoints(
    file: _ProfileFile, vehicle: Kind, vibration: Vibration, problems: list[ConfigError]
) -> tuple[Start, list[Move], Commands | None]:
    if file.segment:
        problems.append(ConfigError("sim.segments_and_waypoints", where="segment, waypoint"))
    if file.start is not None and "lat" in file.start.model_fields_set:
        problems.append(ConfigError("sim.start_and_waypoints", where="start"))
    if len(file.waypoint) < 2:
        problems.append(ConfigError("sim.one_waypoint", where="waypoint"))
    if problems:
        return Start(np.zeros(3), 0.0, 0.0, 0.0, 0.0, 0.0), [], None
    lla = np.array([[point.lat, point.lon, point.height] for point in file.waypoint])
    speed: FloatArray = np.array([point.speed for point in file.waypoint])
    way, more = way_through(lla, speed, spacing_of((), vibration), vehicle)
    problems += more
    heading = 0.0 if way is None else float(way.heading[0])
    return Start(lla[0], heading, float(speed[0]), 0.0, 0.0, 0.0), [], way


def _vibration(table: _Vibration, problems: list[ConfigError]) -> Vibration:
    for number, band in enumerate(table.band, start=1):
        if not 0.0 < band.low < band.high:
            problems.append(ConfigError("sim.no_band", where=f"vibration.band {number}"))
    fastest = [line.frequency for line in table.engine] + [band.high for band in table.band]
    if any(not 0.0 < frequency <= _HIGHEST_VIBRATION for frequency in fastest):
        problems.append(ConfigError("sim.vibration_frequency", where="vibration", limit_hz=_HIGHEST_VIBRATION))
    return Vibration(
        table.suspension,
        tuple((line.frequency, line.acceleration) for line in table.engine),
        tuple((band.low, band.high, band.density) for band in table.band),
    )


def _find(name_or_path: str | Path, folder: Path | None) -> Path:
    from insnav.library import library

    path = Path(name_or_path)
    if path.suffix == ".toml" or isinstance(name_or_path, Path):
        return path
    profiles = {found.stem: found for found in library(folder)}
    if str(name_or_path) in profiles:
        return profiles[str(name_or_path)]
    raise ConfigError(
        "sim.unknown_profile" if profiles else "sim.no_profiles",
        where="PROFILE",
        profile=str(name_or_path)[:200],
        **(similar(str(name_or_path), profiles) if profiles else {}),
    )
