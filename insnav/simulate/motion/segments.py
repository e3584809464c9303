"""Segments of a motion profile, as written in its file, and their conversion to moves."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, PlainValidator, model_validator

from insnav.config_file import Axes, Table, quantity, scalar, signed_scalar, wrong
from insnav.exceptions import ConfigError
from insnav.simulate.motion import moves
from insnav.simulate.motion.moves import FASTEST_SPIN, HIGHEST, Kind, Move, State

Length = Annotated[float, scalar("length")]
SignedLength = Annotated[float, signed_scalar("length")]
Angle = Annotated[float, signed_scalar("angle")]
Duration = Annotated[float, scalar("time")]
Speed = Annotated[float, scalar("velocity")]
Acceleration = Annotated[float | None, scalar("acceleration")]
Jerk = Annotated[float | None, scalar("jerk")]
Rate = Annotated[float, scalar("rate")]
Frequency = Annotated[float, scalar("frequency")]

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def _axis(value: object) -> Axes:
    if isinstance(value, str) and value.lstrip("-") in _AXES:
        x, y, z = _AXES[value.lstrip("-")]
        sign = -1.0 if value.startswith("-") else 1.0
        return sign * x, sign * y, sign * z
    if isinstance(value, list) and len(value) == 3 and all(isinstance(part, int | float) for part in value):
        size = math.hypot(*value)
        if size > 0.0 and math.isfinite(size):
            return value[0] / size, value[1] / size, value[2] / size
    raise wrong("sim.no_axis")


class Segment(Table):
    """Common interface of all segments."""

    kind: str

    def moves(self, state: State, vehicle: Kind) -> list[Move]:
        """Build the moves of the segment for a vehicle in this state.

        Raises: ConfigError: the move exceeds the limits of the vehicle.
        """
        raise NotImplementedError


def _moving(state: State, vehicle: Kind) -> None:
    if state.speed == 0.0:
        raise ConfigError("sim.at_rest", vehicle=vehicle.name)


def _bearable(code: str, acceleration: float, limit: float, vehicle: Kind) -> None:
    if not acceleration <= limit:
        raise ConfigError(code, vehicle=vehicle.name, acceleration_m_s2=acceleration, limit_m_s2=limit)


class Static(Segment):
    """Stationary time."""

    duration: Duration

    def moves(self, state: State, vehicle: Kind) -> list[Move]:
        if state.speed != 0.0:
            raise ConfigError("sim.static_while_moving", speed_m_s=state.speed)
        return [moves.stay(state, self.duration)]


class ChangeSpeed(Segment):
    """Acceleration or braking to a speed."""

    to: Speed
    acceleration: Acceleration = None
    jerk: Jerk = None

    above_zero = ("acceleration", "jerk")

    def moves(self, state: State, vehicle: Kind) -> list[Move]:
        acceleration = vehicle.acceleration if self.acceleration is None else self.acceleration
        _bearable("sim.too_fast_acceleration", acceleration, vehicle.forward, vehicle)
        if self.to > vehicle.speed:
            raise ConfigError("sim.too_fast", vehicle=vehicle.name, speed_m_s=self.to, limit_m_s=vehicle.speed)
        slower, kind = self.to < state.speed, self.kind
        if (kind == "accelerate" and slower) or (kind in ("brake", "stop") and self.to > state.speed):
            raise ConfigError("sim.wrong_way", speed_m_s=state.speed, to_m_s=self.to)
        if self.to == state.speed:
            return []
        jerk = max(vehicle.jerk, acceleration) if self.jerk is None else self.jerk
        return [moves.change_speed(state, self.to, acceleration, jerk)]


class Stop(ChangeSpeed):
    """Braking to rest, and waiting."""

    to: Annotated[float, Field(ge=0.0, le=0.0)] = 0.0
    wait: Duration = 0.0

    def moves(self, state: State, vehicle: Kind) -> list[Move]:
        built = super().moves(state, vehicle)
        if self.wait > 0.0:
            built.append(moves.stay(replace(state, speed=0.0), self.wait))
        return built


class Cruise(Segment):
    """Constant motion for a time or a distance."""

    duration: Annotated[float | None, scalar("time")] = None
    distance: Annotated[float | None, scalar("length")] = None

    either = above_zero = ("duration", "distance")

    def moves(self, state: State, vehicle: Kind) -> list[Move]:
        _moving(state, vehicle)
        return [moves.stay(state, self.duration or (self.distance or 0.0) / state.speed)]


class Turn(Segment):
    """Turn by an angle, positive to the right, at a rate or on a radius."""

    angle: Angle
    rate: Annotated[float | None, scalar("rate")] = None
    radius: Annotated[float | None, scalar("length")] = None
    jerk: Jerk = None

    either = ("rate", "radius")
    above_zero = ("rate", "radius", "jerk")

    @model_validator(mode="after")
    def _turns(self) -> Self:
        if self.angle == 0.0:
            raise wrong("sim.no_angle")
        return self

    def moves(self, state: State, vehicle: Kind) -> list[Move]:
        if self.radius is not None or not vehicle.on_the_spot:
            _moving(state, vehicle)
        rate = self.rate if self.radius is None else abs(state.speed) / self.radius
        assert rate is not None
        if rate > FASTEST_SPIN:
            raise ConfigError("sim.too_fast_turn", rate_rad_s=rate, limit_rad_s=FASTEST_SPIN)
        _bearable("sim.sideways_in_turn", rate * abs(state.speed), vehicle.sideways, vehicle)
        return [moves.turn(state, self.angle, rate, vehicle.jerk if self.jerk is None else self.jerk)]


class Arc(Turn):
    """Circular arc: a turn on a radius."""

    radius: Length


class Climb(Segment):
    """Climb or descent by a height."""

    height: Length
    angle: Annotated[float | None, scalar("angle")] = None

    above_zero = ("height", "angle")

    def moves(self, state: State, vehicle: Kind) -> list[Move]:
        _moving(state, vehicle)
        angle = math.radians(3.0) if self.angle is None else self.angle
        if angle > vehicle.grade:
            raise ConfigError("sim.too_steep", vehicle=vehicle.name, angle_rad=angle, limit_rad=vehicle.grade)
        height = -self.height if self.kind == "descend" else self.height
        return [moves.climb(state, height, angle, vehicle.bend, vehicle.jerk)]


class Helix(Segment):
    """Turns with a climb, on a radius, to another height."""

    radius: Length
    turns: float
    height: SignedLength

    above_zero = ("radius",)

    @model_validator(mode="after")
    def _turns(self) -> Self:
        if self.turns == 0.0 or not math.isfinite(self.turns):
            raise wrong("sim.no_turns")
        return self

    def moves(self, state: State, vehicle: Kind) -> list[Move]:
        _moving(state, vehicle)
        rate = abs(state.speed) / self.radius
        _bearable("sim.sideways_in_helix", rate * abs(state.speed), vehicle.sideways, vehicle)
        move = moves.helix(state, 2.0 * math.pi * self.turns, rate, self.height, vehicle.jerk)
        assert move.grade is not None
        if not float(np.abs(move.grade(np.array([0.5 * move.duration])))[0]) <= vehicle.grade:
            raise ConfigError(
                "sim.too_steep_helix", vehicle=vehicle.name, height_m=self.height, limit_rad=vehicle.grade
            )
        return [move]


class LaneChange(Segment):
    """Change to another lane."""

    offset: SignedLength
    duration: Duration

    above_zero = ("duration",)

    def moves(self, state: State, vehicle: Kind) -> list[Move]:
        _moving(state, vehicle)
        # lateral acceleration: 9.37 is the largest slope of `bump`, 3.808, over its area, 0.4063
        _bearable("sim.sideways_in_lane_change", 9.37 * abs(self.offset) / self.duration**2, vehicle.sideways, vehicle)
        return [moves.lane_change(state, self.offset, self.duration)]


class Slide(Segment):
    """Linear slide: a length from rest to rest, with a trapezoidal speed."""

    length: Length
    acceleration: Acceleration = None
    speed: Speed = 1.0
    jerk: Jerk = None
    back: bool = False

    above_zero = ("length", "acceleration", "speed", "jerk")

    def moves(self, state: State, vehicle: Kind) -> list[Move]:
        if state.speed != 0.0:
            raise ConfigError("sim.not_from_rest", speed_m_s=state.speed)
        acceleration = vehicle.acceleration if self.acceleration is None else self.acceleration
        _bearable("sim.too_fast_acceleration", acceleration, vehicle.forward, vehicle)
        jerk = max(vehicle.jerk, 10.0 * acceleration) if self.jerk is None else self.jerk
        return [moves.slide(state, -self.length if self.back else self.length, self.speed, acceleration, jerk)]


class Spin(Segment):
    """Rotation of the body about a body axis."""

    axis: Annotated[Axes, PlainValidator(_axis)]
    angle: Annotated[float | None, signed_scalar("angle")] = None
    turns: float | None = None
    rate: Rate
    within: Duration = 0.5

    either = ("angle", "turns")
    above_zero = ("rate", "within")

    def moves(self, state: State, vehicle: Kind) -> list[Move]:
        _still(state, vehicle)
        if self.rate > FASTEST_SPIN:
            raise ConfigError("sim.too_fast_turn", rate_rad_s=self.rate, limit_rad_s=FASTEST_SPIN)
        angle = self.angle if self.angle is not None else 2.0 * math.pi * (self.turns or 0.0)
        return [moves.spin(state, np.array(self.axis), angle, self.rate, self.rate / self.within)]


class Coning(Segment):
    """Coning: one axis moves around a cone."""

    angle: Angle
    frequency: Frequency
    duration: Duration

    above_zero = ("angle", "frequency", "duration")

    def moves(self, state: State, vehicle: Kind) -> list[Move]:
        _still(state, vehicle)
        rate = 2.0 * math.pi * self.frequency * self.angle
        if rate > FASTEST_SPIN:
            raise ConfigError("sim.too_fast_turn", rate_rad_s=rate, limit_rad_s=FASTEST_SPIN)
        return [moves.coning(state, self.angle, self.frequency, self.duration)]


class Sculling(Coning):
    """Sculling: roll, with a rightward acceleration in phase."""

    acceleration: Annotated[float, scalar("acceleration")]

    def moves(self, state: State, vehicle: Kind) -> list[Move]:
        _still(state, vehicle)
        _bearable("sim.too_fast_acceleration", self.acceleration, HIGHEST, vehicle)
        return [moves.sculling(state, self.angle, self.acceleration, self.frequency, self.duration)]


class _Planned(Segment):
    """Segments that move a slide [m] and its table [deg], with limits of speed and acceleration per axis."""

    speed: Speed = 1.0
    acceleration: Acceleration = None
    rate: Rate = math.radians(60.0)
    ramp: Annotated[float, scalar("rate ramp")] = math.radians(120.0)

    above_zero = ("speed", "acceleration", "rate", "ramp")

    def limits(self, state: State, vehicle: Kind, turned: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return largest rates and accelerations, (5,), of `moves.AXES`. `turned` (3,): rotation of the table [rad]."""
        _still(state, vehicle)
        acceleration = vehicle.acceleration if self.acceleration is None else self.acceleration
        if state.speed != 0.0:
            raise ConfigError("sim.not_from_rest", speed_m_s=state.speed)
        if acceleration > HIGHEST or self.speed > vehicle.speed or self.rate > FASTEST_SPIN:
            name, fastest = vehicle.name, vehicle.speed
            raise ConfigError(
                "sim.too_fast_planned", vehicle=name, limit_m_s2=HIGHEST, limit_m_s=fastest, limit_rad_s=FASTEST_SPIN
            )
        if turned.any() and state.table is None:
            raise ConfigError("sim.table_after_spin")
        if np.count_nonzero(turned) > 1 and turned.sum() >= math.pi:
            raise ConfigError("sim.table_turns_far", limit_rad=math.pi)
        return np.repeat([self.speed, self.rate], [2, 3]), np.repeat([acceleration, self.ramp], [2, 3])


class Linear(_Planned):
    """Simultaneous, proportional motion of slide and table axes, from rest to rest."""

    x: SignedLength = 0.0
    y: SignedLength = 0.0
    roll: Angle = 0.0
    pitch: Angle = 0.0
    yaw: Angle = 0.0

    @model_validator(mode="after")
    def _moves(self) -> Self:
        if not any(getattr(self, name) for name in moves.AXES):
            raise wrong("sim.no_move", keys=moves.AXES)
        return self

    def moves(self, state: State, vehicle: Kind) -> list[Move]:
        change = np.array([getattr(self, name) for name in moves.AXES])
        return [moves.linear(state, change, *self.limits(state, vehicle, np.abs(change[2:])))]


class Circular(_Planned):
    """Two axes around a circle, from rest to rest."""

    axes: Annotated[list[Literal["x", "y", "roll", "pitch", "yaw"]], Field(min_length=2, max_length=2)]
    radius: str
    angle: Angle = 2.0 * math.pi
    start: Angle = 0.0

    @model_validator(mode="after")
    def _fits(self) -> Self:
        pair = sorted(moves.AXES.index(name) for name in self.axes)
        if pair[0] == pair[1] or pair[0] < 2 <= pair[1]:
            raise wrong("sim.no_pair_of_axes")
        if not self.angle or not quantity(self.radius, "length" if pair[1] < 2 else "angle", signed=False) > 0.0:
            raise wrong("sim.no_circle")
        return self

    def moves(self, state: State, vehicle: Kind) -> list[Move]:
        first, second = (moves.AXES.index(name) for name in self.axes)
        radius = quantity(self.radius, "length" if first < 2 else "angle", signed=False)
        reach = 2.0 * radius * np.isin(np.arange(2, 5), (first, second))  # largest distance of a circle from its start
        rate, acceleration = (float(each[first]) for each in self.limits(state, vehicle, reach))
        return [moves.circular(state, (first, second), radius, (self.start, self.angle), (rate, acceleration))]


def _still(state: State, vehicle: Kind) -> None:
    if vehicle.name != "slide":
        raise ConfigError("sim.body_fixed", vehicle=vehicle.name)


class Repeat(Segment):
    """Repetition of segments."""

    count: Annotated[int, Field(ge=1, le=10_000)]
    segment: list[dict[str, Any]]


SEGMENTS: dict[str, type[Segment]] = {
    "static": Static,
    "accelerate": ChangeSpeed,
    "brake": ChangeSpeed,
    "stop": Stop,
    "cruise": Cruise,
    "turn": Turn,
    "arc": Arc,
    "climb": Climb,
    "descend": Climb,
    "helix": Helix,
    "lane_change": LaneChange,
    "slide": Slide,
    "linear": Linear,
    "circular": Circular,
    "spin": Spin,
    "coning": Coning,
    "sculling": Sculling,
    "repeat": Repeat,
}
