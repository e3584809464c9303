"""Motion profile (``*.toml``): start and segments of a drive, in order, and their conversion to an exact motion.

Moves or waypoints determine commanded speed, heading and climb angle. These commands determine the body motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PlainValidator
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import PchipInterpolator, PPoly, make_interp_spline

from insnav.attitude import dcm_from_quat, quat_from_rotvec, quat_from_rph, quat_multiply
from insnav.config_file import Table, checked, quantity, read_toml, refuse, scalar, signed_scalar, similar, wrong
from insnav.earth import earth_from_lla, metres_per_unit, ned_offset, quat_earth_from_level, radii
from insnav.exceptions import ConfigError
from insnav.simulate.motion.moves import KINDS, Kind, Move, State, Vibration, shaken
from insnav.simulate.motion.segments import SEGMENTS, Repeat, Segment
from insnav.simulate.sensor_errors import Seed
from insnav.simulate.truth import EarthTruth, LevelTruth, Spline, Truth, Turns, spline_through
from insnav.types import FloatArray
from insnav.units import G0

_SPACINGS = (0.04, 0.02, 0.01, 0.005, 0.0025, 0.002, 0.001)  # of knots: round, so that knots meet samples [s]
_PER_PERIOD = 20.0  # knots per shortest period of a move, for example of coning
_POLAR = math.radians(80.0)  # latitude beyond which Earth-fixed axes are used [rad]
_DEGREE = 7  # degree of the splines
_PASSES = 4  # iterations of `earth_path`
_LONGEST = 48.0 * 3600.0  # longest duration of a motion [s]
_MAX_MOVES = 20_000
_HIGHEST_VIBRATION = 100.0  # highest frequency of a vibration [Hz]


@dataclass(frozen=True, slots=True)
class Start:
    """Initial state of a motion."""

    lla: FloatArray  # (3,) latitude [rad], longitude [rad], height [m]
    # heading [rad], forward speed [m/s]
    heading: float
    speed: float
    # attitude of the IMU in the level vehicle [rad]
    roll: float
    pitch: float
    time: float  # time at the start [s]


@dataclass(frozen=True, slots=True)
class Commands:
    """Commanded motion of the vehicle at n evenly spaced instants."""

    time: FloatArray  # (n,) time since the start [s]
    # (n,) forward speed [m/s], heading [rad], climb angle [rad], velocity to the right [m/s]
    speed: FloatArray
    heading: FloatArray
    grade: FloatArray
    right: FloatArray
    duration: float  # duration of the motion [s]


def spacing_of(moves: Sequence[Move], vibration: Vibration) -> float:
    """Choose the knot spacing for the highest frequency of moves and vibration [s]."""
    fastest = max((move.frequency for move in moves), default=0.0)
    needed = min(1.0 / (_PER_PERIOD * fastest) if fastest else 1.0, 0.25 / vibration.highest)
    return next((spacing for spacing in _SPACINGS if spacing <= needed * (1.0 + 1e-9)), _SPACINGS[-1])


def commands_of(moves: Sequence[Move], spacing: float) -> Commands:
    """Convert successive moves to commands at instants `spacing` [s] apart."""
    edges = np.concatenate([[0.0], np.cumsum([move.duration for move in moves])])
    # knots at round times coincide with samples, which avoids slivers in the quadrature
    t: FloatArray = spacing * np.arange(math.ceil(edges[-1] / spacing - 1e-9) + 1.0)
    clipped = np.minimum(t, edges[-1])  # times after the last move repeat its end
    first = np.searchsorted(clipped, edges, side="left")  # number of the first instant of each move
    first[-1] = len(t)
    speed, heading, grade, right = (np.zeros(len(t)) for _ in range(4))
    for move, begin, a, b in zip(moves, edges, first[:-1], first[1:], strict=False):
        local = clipped[a:b] - begin
        speed[a:b] = move.begin.speed if move.speed is None else move.speed(local)
        heading[a:b] = move.begin.heading if move.heading is None else move.heading(local)
        grade[a:b] = 0.0 if move.grade is None else move.grade(local)
        right[a:b] = 0.0 if move.right is None else move.right(local)
    return Commands(t, speed, heading, grade, right, float(edges[-1]))


def truth_of(
    commands: Commands, moves: Sequence[Move], start: Start, vehicle: Kind, vibration: Vibration, seed: Seed
) -> Truth:
    """Build the exact motion of a vehicle from its commands, and from moves that rotate its body.

    The velocity is a spline through the commanded velocity; its exact integral is the position. Attitude is a spline,
    too. All outputs of the truth are derivatives of these splines. The knots determine how closely the motion follows
    the commands, not its consistency.

    Returns: truth in latitude, longitude, height and roll, pitch, heading. Beyond 80 deg of latitude or pitch, or with
    body rotation, the truth uses Earth-fixed axes. Its heading then counts from the great circle that starts northward.
    """
    t = commands.time
    rates = spline_through(t, np.column_stack([commands.speed, commands.heading, commands.grade]))(t, 1)
    shake, rock = shaken(t, commands.speed, vehicle.body, vibration, seed)
    sideways = commands.speed * rates[:, 1]
    roll = np.arctan(sideways / G0) if vehicle.banks else -vehicle.body.lean * sideways
    pitch = commands.grade + vehicle.body.squat * rates[:, 0]
    rph = np.column_stack([start.roll + roll, start.pitch + pitch, commands.heading]) + rock
    ahead = commands.speed * np.cos(commands.grade) + shake[:, 0]
    right = commands.right + shake[:, 1]
    climb = commands.speed * np.sin(commands.grade) - shake[:, 2]
    cos, sin = np.cos(commands.heading), np.sin(commands.heading)
    velocity = np.column_stack([ahead * cos - right * sin, ahead * sin + right * cos, climb])
    if abs(start.lla[0]) < _POLAR and not any(move.body for move in moves) and np.abs(rph[:, 1]).max() < _POLAR:
        curve = position_curve(t, velocity, start.lla)
        return LevelTruth(start.lla, curve, spline_through(t, rph), commands.duration, start.time)
    position, axes = earth_path(t, velocity, start.lla)
    q_ev = quat_multiply(axes, quat_from_rph(rph))
    turns = turns_of(moves, t[1] - t[0]) if any(move.body for move in moves) else None
    origin = earth_from_lla(start.lla[None])[0]
    return EarthTruth(origin, position, spline_through(t, q_ev), turns, commands.duration, start.time)


def position_curve(t: FloatArray, velocity: FloatArray, lla: FloatArray) -> Spline:
    """Integrate a velocity North, East, up ``(n, 3)`` [m/s] over the ellipsoid: position minus its start `lla`.

    Latitude [rad], longitude [rad], height [m].
    """
    positions = np.tile(np.asarray(lla, dtype=np.float64), (len(t), 1))
    # The rates depend on position only through the radii of curvature and the length of the parallel, which change by
    # parts in 1e7 per metre. Trapezoids are accurate enough, and each pass gains five digits on 100 km.
    for _ in range(3):
        rates = velocity / metres_per_unit(positions)
        positions = lla + cumulative_trapezoid(rates, t, axis=0, initial=0.0)
    return spline_through(t, rates).integral()


def earth_path(t: FloatArray, velocity: FloatArray, lla: FloatArray) -> tuple[Spline, FloatArray]:
    """Integrate a velocity over the ellipsoid, in Earth-fixed axes, also across a pole.

    `t` (n,): times [s]. `velocity` (n, 3): along two level axes, initially North and East, that rotate with the
    vertical but not about it, and up [m/s]. `lla` (3,): start: latitude [rad], longitude [rad], height [m].
    Returns: `position`: Earth-fixed position since the start [m]. `axes` (n, 4): quaternion of the level axes and down
    in Earth-fixed axes.
    """
    start = quat_earth_from_level(lla[None])[0]
    axes = np.tile(start, (len(t), 1))
    height = lla[2] + cumulative_trapezoid(velocity[:, 2], t, initial=0.0)
    # In the moving axes, the rotation depends on position only through the radii of curvature: each pass gains two
    # digits.
    for _ in range(_PASSES):
        north_axis, east_axis, down = _columns(axes)
        sine = -down[:, 2]
        meridian, transverse = radii(np.arcsin(np.clip(sine, -1.0, 1.0)))
        # split the velocity along meridian and parallel, whose radii of curvature differ (Euler's theorem)
        northward = np.column_stack([-sine * -down[:, 0], -sine * -down[:, 1], 1.0 - sine**2])
        northward /= np.maximum(np.linalg.norm(northward, axis=1, keepdims=True), 1e-12)
        eastward = np.cross(down, northward)
        v_e = velocity[:, :1] * north_axis + velocity[:, 1:2] * east_axis
        along = np.einsum("ij,ij->i", v_e, northward) / (meridian + height)
        aside = np.einsum("ij,ij->i", v_e, eastward) / (transverse + height)
        tilt = along[:, None] * northward + aside[:, None] * eastward  # rotation rate of the upward normal [rad/s]
        turn_e = np.cross(-down, tilt)
        # resolved in the moving axes, the rotation multiplies from the right; it is a sum of small rotations
        turn = np.column_stack([np.einsum("ij,ij->i", turn_e, axis) for axis in (north_axis, east_axis, down)])
        angle = cumulative_trapezoid(turn, t, axis=0, initial=0.0)  # sum of small rotations
        axes = quat_multiply(np.tile(start, (len(t), 1)), _wound(angle))
    north_axis, east_axis, down = _columns(axes)
    v_e = velocity[:, :1] * north_axis + velocity[:, 1:2] * east_axis - velocity[:, 2:] * down
    return spline_through(t, v_e).integral(), axes


def _wound(angle: FloatArray) -> FloatArray:
    """Compute quaternions (n, 4) after successive small rotations, from their cumulative sums ``(n, 3)`` [rad]."""
    steps = quat_from_rotvec(np.diff(angle, axis=0, prepend=angle[:1]))
    reach = 1  # length of the products so far; it doubles in each turn of the loop
    while reach < len(steps):
        steps[reach:] = quat_multiply(steps[:-reach], steps[reach:])
        reach *= 2
    return np.asarray(steps / np.linalg.norm(steps, axis=1, keepdims=True))


def _columns(q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    C = dcm_from_quat(q)
    return C[:, :, 0], C[:, :, 1], C[:, :, 2]


def turns_of(moves: Sequence[Move], spacing: float) -> Turns:
    """Build the rotation of the body relative to the vehicle, one section per move."""
    edges, base = [0.0], [np.array([1.0, 0.0, 0.0, 0.0])]
    pieces, breaks = [], [np.zeros(1)]
    for move in moves:
        begin = edges[-1]
        if move.body is None:
            pieces.append(np.zeros((_DEGREE + 1, 1, 3)))  # no rotation during this move
            breaks.append(np.array([begin + move.duration]))
            after = base[-1]
        else:
            count = max(_DEGREE + 2, math.ceil(move.duration / spacing) + 1)
            local = np.linspace(0.0, move.duration, count)
            polynomials = spline_through(local, move.body(local), _DEGREE).polynomials
            pieces.append(polynomials.c)
            breaks.append(begin + polynomials.x[1:])
            after = quat_multiply(base[-1][None], quat_from_rotvec(move.body(local[-1:])))[0]  # attitude after the move
        edges.append(float(breaks[-1][-1]))
        base.append(after)
    polynomials = PPoly(np.concatenate(pieces, axis=1), np.concatenate(breaks))
    return Turns(np.array(edges[:-1]), np.array(base[:-1]), Spline(polynomials))


_SMOOTHING = 2.0  # time over which a change of acceleration is spread [s]
_FINE = 4001


def way_through(
    lla: FloatArray, speed: FloatArray, spacing: float, vehicle: Kind
) -> tuple[Commands | None, list[ConfigError]]:
    """Build the commands of a drive through waypoints, at instants `spacing` apart [s], or report why it is infeasible.

    `lla` (m, 3): waypoints. `speed` (m,): zero at the first and last for a drive from rest to rest. Errors name
    waypoints.

    Notes
    -----
    The line is a cubic spline through the points over chord length, without curvature at its ends. Between two points
    the squared speed changes linearly with distance, that is at constant acceleration. The speed over time is then
    smoothed. Heights follow a monotone interpolation, without new hills.
    """
    offset = ned_offset(lla, lla[0])
    chords = np.linalg.norm(np.diff(offset[:, :2], axis=0), axis=1)
    legs = [f"waypoints {i + 1} and {i + 2}" for i in range(len(chords))]
    problems = [ConfigError("sim.same_place", where=legs[i]) for i in np.flatnonzero(chords < 1e-3)]
    standing = (speed[:-1] == 0.0) & (speed[1:] == 0.0)
    problems += [ConfigError("sim.no_speed", where=legs[i]) for i in np.flatnonzero(standing)]
    values_common: dict[str, Any] = {"vehicle": vehicle.name}
    acceleration = np.abs(np.diff(speed**2)) / np.maximum(2.0 * chords, 1e-3)
    for i in np.flatnonzero(acceleration > vehicle.forward):
        values = values_common | {"acceleration_m_s2": float(acceleration[i]), "limit_m_s2": vehicle.forward}
        problems.append(ConfigError("sim.too_fast_acceleration", where=legs[i], **values))
    for i in np.flatnonzero(speed > vehicle.speed):
        values = values_common | {"speed_m_s": float(speed[i]), "limit_m_s": vehicle.speed}
        problems.append(ConfigError("sim.too_fast", where=f"waypoint {i + 1}", **values))
    if problems:
        return None, problems
    chord = np.concatenate([[0.0], np.cumsum(chords)])
    line = make_interp_spline(chord, offset[:, :2], k=3, bc_type="natural") if len(chord) > 2 else None
    fine = np.linspace(0.0, chord[-1], max(_FINE, 20 * len(chord)))
    slope = line(fine, nu=1) if line is not None else np.tile(offset[1, :2] / chord[1], (len(fine), 1))
    bend = line(fine, nu=2) if line is not None else np.zeros_like(slope)
    stretch = np.linalg.norm(slope, axis=1)  # length of the line per length of chord
    curvature = np.abs(slope[:, 0] * bend[:, 1] - slope[:, 1] * bend[:, 0]) / stretch**3
    square = np.interp(fine, chord, speed**2)
    sideways = curvature * square
    worst = int(np.argmax(sideways))
    if sideways[worst] > vehicle.sideways:
        number = int(np.searchsorted(chord, fine[worst], side="right"))
        values_common |= {"acceleration_m_s2": float(sideways[worst]), "limit_m_s2": vehicle.sideways}
        return None, [ConfigError("sim.sideways_at_waypoint", where=f"near waypoint {number}", **values_common)]
    # length and time along the line; time is exact for constant acceleration between neighbouring points
    length = np.concatenate([[0.0], np.cumsum(0.5 * (stretch[1:] + stretch[:-1]) * np.diff(fine))])
    v = np.sqrt(square)
    arrival = np.concatenate([[0.0], np.cumsum(np.diff(length) * 2.0 / np.maximum(v[1:] + v[:-1], 1e-9))])
    lead = 0.0 if v[0] else _SMOOTHING  # a drive from rest begins with this time at rest [s]
    count = int(np.ceil((arrival[-1] + lead + _SMOOTHING) / spacing)) + 1
    t: FloatArray = spacing * np.arange(count, dtype=np.float64)
    # smooth symmetrically, which preserves the total length
    half = max(1, round(0.5 * _SMOOTHING / spacing))
    x = np.arange(-half, half + 1) / (half + 1.0)
    kernel = (1.0 - x**2) ** 4
    pace = np.interp(t - lead, arrival, v, left=float(v[0]), right=float(v[-1]))
    smooth = np.convolve(np.pad(pace, half, mode="edge"), kernel / kernel.sum(), mode="valid")
    travelled = np.concatenate([[0.0], np.cumsum(0.5 * (smooth[1:] + smooth[:-1]) * spacing)])
    chord_at = np.interp(travelled, length, fine)
    course = np.unwrap(np.arctan2(slope[:, 1], slope[:, 0]))
    rise = PchipInterpolator(chord, lla[:, 2])(chord_at, nu=1) / np.interp(chord_at, fine, stretch)
    return Commands(t, smooth, np.interp(chord_at, fine, course), np.arctan(rise), np.zeros_like(t), float(t[-1])), []


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
        """Build the exact motion; only its vibration depends on `seed`."""
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
        segments, errors = _read(listed, "segment")
        problems += errors
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
    # put the name into the text, so that a copy of the file under another name is the same profile
    text = path.read_text(encoding="utf-8-sig")
    if file.name is None:
        text = f'name = "{name}"\n{text}'
    return MotionProfile(name, file.purpose, duration, text, start, vehicle, vibration, tuple(moves), way)


def _read(listed: list[Any], path: str) -> tuple[list[tuple[str, Segment]], list[ConfigError]]:
    """Read segments with names, such as ``segment 3 (turn)``, and their errors."""
    segments: list[tuple[str, Segment]] = []
    problems: list[ConfigError] = []
    for number, data in enumerate(listed, start=1):
        label = f"{path} {number}"
        kind = data.get("kind") if isinstance(data, dict) else None
        if kind not in SEGMENTS:
            if kind is None:
                problems.append(ConfigError("sim.segment_without_kind", where=label, known=tuple(SEGMENTS)))
            else:
                kinds = similar(str(kind), SEGMENTS)
                problems.append(ConfigError("sim.unknown_kind", where=label, kind=str(kind)[:100], **kinds))
            continue
        label = f"{label} ({kind})"
        segment, errors = checked(SEGMENTS[kind], data)
        for problem in errors:
            problem.where = ": ".join(filter(None, (label, problem.where)))
        problems += errors
        if kind == "repeat":
            listed_inside = data.get("segment")
            inner, errors = _read(listed_inside if isinstance(listed_inside, list) else [], f"{label}, segment")
            problems += errors
            count = segment.count if isinstance(segment, Repeat) else 0
            if len(segments) + count * len(inner) > _MAX_MOVES:
                problems.append(ConfigError("sim.many_moves", where=path, limit=_MAX_MOVES))
                break
            segments += inner * count
        elif segment is not None:
            segments.append((label, segment))
    return segments, problems


def _segments(
    file: _ProfileFile, segments: list[tuple[str, Segment]], vehicle: Kind, problems: list[ConfigError]
) -> tuple[Start, list[Move], None]:
    table = file.start
    assert table is not None
    if table.speed > vehicle.speed:
        values: dict[str, Any] = {"speed_m_s": table.speed, "limit_m_s": vehicle.speed}
        problems.append(ConfigError("sim.too_fast", where="start.speed", vehicle=vehicle.name, **values))
    lla = np.array([table.lat, table.lon, table.height])
    start = Start(lla, table.heading, table.speed, table.roll, table.pitch, table.time)
    state, moves = State(start.speed, start.heading), list[Move]()
    for name, segment in segments:
        try:
            built = segment.moves(state, vehicle)
        except ConfigError as problem:
            problem.where = name
            if problem.as_dict() not in [each.as_dict() for each in problems]:  # report it once, not in each repetition
                problems.append(problem)
            # continue from the intended end state, so that later segments are checked from there
            state = State(float(getattr(segment, "to", state.speed)), state.heading)
            continue
        moves += built
        state = built[-1].end if built else state
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
    way, way_problems = way_through(lla, speed, spacing_of((), vibration), vehicle)
    problems += way_problems
    return Start(lla[0], 0.0 if way is None else float(way.heading[0]), float(speed[0]), 0.0, 0.0, 0.0), [], way


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
    profiles = {file.stem: file for file in library(folder)}
    if str(name_or_path) in profiles:
        return profiles[str(name_or_path)]
    raise ConfigError(
        "sim.unknown_profile" if profiles else "sim.no_profiles",
        where="PROFILE",
        profile=str(name_or_path)[:200],
        **(similar(str(name_or_path), profiles) if profiles else {}),
    )
