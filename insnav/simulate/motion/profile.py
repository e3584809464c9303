"""The motion profile (``*.toml``): where a drive starts and what it does, one segment after the other."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PlainValidator
from pydantic_core import PydanticCustomError

from insnav.config_file import Table, checked, quantity, read_toml, refuse, scalar, signed_scalar
from insnav.exceptions import ConfigError
from insnav.simulate.imu_errors import Seed
from insnav.simulate.motion.assemble import Commands, Start, commands_of, spacing_of, truth_of
from insnav.simulate.motion.kinds import KINDS, Kind
from insnav.simulate.motion.moves import Move, State
from insnav.simulate.motion.segments import SEGMENTS, Impossible, Repeat, Segment
from insnav.simulate.motion.vibration import Vibration
from insnav.simulate.motion.waypoints import way_through
from insnav.simulate.truth import Truth
from insnav.types import FloatArray

_LONGEST = 48.0 * 3600.0  # [s]
_MAX_MOVES = 20_000
_HIGHEST_VIBRATION = 100.0  # [Hz]
_NEEDED = (("start", "[start] with lat and lon"), ("segment", "[[segment]], or [[waypoint]]"))


def _latitude(value: object) -> float:
    angle = quantity(value, "angle", signed=True)
    if abs(angle) > math.pi / 2:
        raise PydanticCustomError("wrong_value", "must be between -90 deg and 90 deg")
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
    """A motion that can be driven: its name, its purpose in one line, how long it takes [s], and its file."""

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
        """Make the exact motion; only its vibration is random."""
        commands = self._way or commands_of(self._moves, spacing_of(self._moves, self._vibration))
        return truth_of(commands, self._moves, self._start, self._vehicle, self._vibration, seed)


def load_profile(name_or_path: str | Path, library: Path | None = None) -> MotionProfile:
    """Read a motion profile, by its name in the library or as a file, and check that it can be driven.

    Raises: ConfigError: no such profile, no TOML, unknown or wrong keys, or a motion that cannot be driven: everything
    at once, each with the number and kind of its segment.
    """
    path = _find(name_or_path, library)
    data = read_toml(path)
    file, problems = checked(_ProfileFile, data)
    segments: list[tuple[str, Segment]] = []
    listed = data.get("segment")
    if isinstance(listed, list):
        segments, wrong = _read(listed, "segment")
        problems += wrong
    if not data.get("waypoint"):
        problems += [f"{key}: is missing; a motion needs {what}" for key, what in _NEEDED if not data.get(key)]
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
        refuse([f"the motion takes {duration / 3600.0:.4g} h, and the longest is {_LONGEST / 3600.0:g} h"], str(path))
    name = path.stem if file.name is None else file.name
    # the name goes with the text, so that a copy of it under another name is the same profile
    text = path.read_text(encoding="utf-8-sig")
    if file.name is None:
        text = f'name = "{name}"\n{text}'
    return MotionProfile(name, file.purpose, duration, text, start, vehicle, vibration, tuple(moves), way)


def _read(listed: list[Any], path: str) -> tuple[list[tuple[str, Segment]], list[str]]:
    """Segments with their names, such as ``segment 3 (turn)``, and what is wrong with them."""
    segments: list[tuple[str, Segment]] = []
    problems: list[str] = []
    for number, data in enumerate(listed, start=1):
        place = f"{path} {number}"
        kind = data.get("kind") if isinstance(data, dict) else None
        if kind not in SEGMENTS:
            close = difflib.get_close_matches(str(kind), SEGMENTS, n=1)
            hint = f"did you mean {close[0]!r}?" if close else f"known are {', '.join(SEGMENTS)}"
            problems.append(f"{place}: " + ("has no kind" if kind is None else f"unknown kind {kind!r}") + f", {hint}")
            continue
        place = f"{place} ({kind})"
        segment, wrong = checked(SEGMENTS[kind], data)
        problems += [f"{place}: {text}" for text in wrong]
        if kind == "repeat":
            listed_inside = data.get("segment")
            inner, wrong = _read(listed_inside if isinstance(listed_inside, list) else [], f"{place}, segment")
            problems += wrong
            segments += inner * (segment.count if isinstance(segment, Repeat) else 0)
        elif segment is not None:
            segments.append((place, segment))
    return segments, problems


def _segments(
    file: _ProfileFile, segments: list[tuple[str, Segment]], vehicle: Kind, problems: list[str]
) -> tuple[Start, list[Move], None]:
    given = file.start
    assert given is not None
    if given.speed > vehicle.speed:
        problems.append(f"start.speed: {given.speed:.4g} m/s is faster than a {vehicle.name} goes")
    place = np.array([given.lat, given.lon, given.height])
    start = Start(place, given.heading, given.speed, given.roll, given.pitch, given.time)
    state, moves = State(start.speed, start.heading), list[Move]()
    for name, segment in segments:
        try:
            made = segment.moves(state, vehicle)
        except Impossible as reason:
            text = f"{name}: {reason}"
            if text not in problems:
                problems.append(text)
            # where it was meant to end, so that those after it are judged fairly
            state = State(float(getattr(segment, "to", state.speed)), state.heading)
            continue
        moves += made
        state = made[-1].end if made else state
        if len(moves) > _MAX_MOVES:
            problems.append(f"segment: more than {_MAX_MOVES} moves, with all repetitions")
            break
    return start, moves, None


def _waypoints(
    file: _ProfileFile, vehicle: Kind, vibration: Vibration, problems: list[str]
) -> tuple[Start, list[Move], Commands | None]:
    if file.segment:
        problems.append("segment, waypoint: a motion has either segments or waypoints")
    if file.start is not None and "lat" in file.start.model_fields_set:
        problems.append("start: a motion through waypoints starts at the first of them; leave [start] out")
    if len(file.waypoint) < 2:
        problems.append("waypoint: a way needs two or more")
    if problems:
        return Start(np.zeros(3), 0.0, 0.0, 0.0, 0.0, 0.0), [], None
    lla = np.array([[point.lat, point.lon, point.height] for point in file.waypoint])
    speed: FloatArray = np.array([point.speed for point in file.waypoint])
    way, wrong = way_through(lla, speed, spacing_of((), vibration), vehicle)
    problems += wrong
    heading = 0.0 if way is None else float(way.heading[0])
    return Start(lla[0], heading, float(speed[0]), 0.0, 0.0, 0.0), [], way


def _vibration(table: _Vibration, problems: list[str]) -> Vibration:
    for number, band in enumerate(table.band, start=1):
        if not 0.0 < band.low < band.high:
            problems.append(f"vibration.band {number}: needs 0 < low < high")
    fastest = [line.frequency for line in table.engine] + [band.high for band in table.band]
    if any(not 0.0 < frequency <= _HIGHEST_VIBRATION for frequency in fastest):
        problems.append(f"vibration: frequencies must be above 0 and at most {_HIGHEST_VIBRATION:g} Hz")
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
    close = difflib.get_close_matches(str(name_or_path), profiles, n=1)
    known = f"did you mean {close[0]!r}?" if close else f"known are {', '.join(profiles)}; or give a .toml file"
    raise ConfigError(
        f"there is no motion profile {str(name_or_path)[:200]!r}",
        where="PROFILE",
        why="" if profiles else "the library of profiles is not here",
        fix=known if profiles else "give a .toml file",
    )
