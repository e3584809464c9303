"""Vehicle kinds and their moves: changes of speed, heading, grade and lateral position, and body rotation.

A kind has limits, defaults, lean and vibration. All changes are smooth: four derivatives of every quantity are
continuous between moves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import brentq

from insnav.attitude import quat_conjugate, quat_from_rph, quat_multiply, rotvec_from_quat
from insnav.simulate.sensor_errors import Seed
from insnav.types import FloatArray
from insnav.units import G0

# x^5 ... x^9 of a rise from 0 to 1 on [0, 1], with four derivatives zero at both ends: the normalised integral of x^4
# (1 - x)^4
STEP = (126.0, -420.0, 540.0, -315.0, 70.0)
STEEPEST = 315.0 / 128.0  # slope of this polynomial in the middle
BUMP_AREA = 128.0 / 315.0  # integral of `bump`


@dataclass(frozen=True, slots=True)
class Vehicle:
    """Motion of a car body on its wheels."""

    lean: float = 0.009  # roll per acceleration to the right [rad/(m/s^2)]; a car leans out of the turn
    squat: float = 0.006  # pitch per forward acceleration [rad/(m/s^2)]
    # standard deviation of the vibration velocity forward, right, down at 20 m/s [m/s]
    velocity_shake: tuple[float, float, float] = (0.01, 0.01, 0.04)
    # standard deviation of the vibration of roll, pitch, heading at 20 m/s [rad]
    angle_shake: tuple[float, float, float] = (0.0020, 0.0016, 0.0005)
    band: tuple[float, float] = (0.8, 6.0)  # lowest and highest frequency of the vibration [Hz]


_RIGID = Vehicle(lean=0.0, squat=0.0, velocity_shake=(0.0, 0.0, 0.0), angle_shake=(0.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True)
class Kind:
    """Limits and defaults of a vehicle kind."""

    name: str
    # largest speed [m/s] and accelerations along and across the path [m/s^2]
    speed: float
    forward: float
    sideways: float
    grade: float  # steepest climb [rad]
    # defaults: along the path [m/s^2], jerk [m/s^3], upward path acceleration [m/s^2]
    acceleration: float
    jerk: float
    bend: float
    banks: bool = False  # the vehicle banks into turns, without lateral force
    on_the_spot: bool = False  # the vehicle can turn without moving
    body: Vehicle = _RIGID  # lean and vibration of the body


HIGHEST = 100.0 * G0  # largest acceleration of a laboratory device [m/s^2]; a larger input is an error
FASTEST_SPIN = math.radians(4000.0)  # largest turn rate [rad/s]
_STEEPEST_BANK = G0 * math.tan(math.radians(75))  # bank of 75 deg as acceleration across the path [m/s^2]

KINDS = {
    kind.name: kind
    for kind in (
        Kind("car", 100.0, 10.0, 9.0, math.radians(25), 1.5, 2.0, 0.5, body=Vehicle()),
        Kind("aircraft", 1000.0, 50.0, _STEEPEST_BANK, math.radians(60), 2.0, 2.0, 2.0, banks=True),
        Kind("slide", 100.0, HIGHEST, HIGHEST, math.radians(60), 0.5, 5.0, 1.0, on_the_spot=True),
    )
}


_TONES = 24  # number of sine waves of a band, or of the suspension, on each axis
_REFERENCE_SPEED = 20.0  # speed of the specified vibration [m/s]
_STREAM = 1  # random stream of engine lines and bands


@dataclass(frozen=True, slots=True)
class Vibration:
    """Vibration of a vehicle."""

    # factor of the suspension vibration of the vehicle kind, which is proportional to speed
    suspension: float = 1.0
    # frequency [Hz] and amplitude [m/s^2] of each engine line, along all three axes, with random phases
    lines: tuple[tuple[float, float], ...] = ()
    # lowest and highest frequency [Hz], and one-sided density of the acceleration in between [(m/s^2)^2/Hz]
    bands: tuple[tuple[float, float, float], ...] = ()

    @property
    def highest(self) -> float:
        """Highest frequency of the vibration [Hz]; at least 6.25, for the suspension."""
        return max([6.25, *(line[0] for line in self.lines), *(band[1] for band in self.bands)])


def shaken(
    t: FloatArray, speed: FloatArray, body: Vehicle, vibration: Vibration, seed: Seed
) -> tuple[FloatArray, FloatArray]:
    """Simulate vibration of velocity forward, right, down [m/s] and of roll, pitch, heading [rad], each ``(n, 3)``."""
    velocity, angle = _suspension(t, speed, body, vibration.suspension, seed)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM,)))
    for frequency, amplitude in vibration.lines:
        velocity += _tones(t, np.full((1, 3), frequency), amplitude, rng)
    for low, high, density in vibration.bands:
        # divide the band into slices, each with one sine wave of equal power
        slices = low + (high - low) * (np.arange(_TONES)[:, None] + rng.uniform(size=(_TONES, 3))) / _TONES
        velocity += _tones(t, slices, math.sqrt(2.0 * density * (high - low) / _TONES), rng)
    return velocity, angle


def _suspension(
    t: FloatArray, speed: FloatArray, vehicle: Vehicle, factor: float, seed: Seed
) -> tuple[FloatArray, FloatArray]:
    """Simulate `factor` times the vehicle's vibration: sine waves proportional to `speed` ``(n,)`` [m/s]."""
    rng = np.random.default_rng(seed)
    result = np.empty((len(t), 6))
    for i, sd in enumerate(vehicle.velocity_shake + vehicle.angle_shake):
        omega = 2.0 * np.pi * rng.uniform(*vehicle.band, _TONES)
        phase = rng.uniform(0.0, 2.0 * np.pi, _TONES)
        tones = np.zeros(len(t))
        for w, p in zip(omega, phase, strict=True):
            tones += np.sin(w * t + p)
        result[:, i] = factor * sd * math.sqrt(2.0 / _TONES) * speed / _REFERENCE_SPEED * tones
    return result[:, :3], result[:, 3:]


def _tones(t: FloatArray, frequency: FloatArray, size: float, rng: np.random.Generator) -> FloatArray:
    """Sum velocity sine waves ``(n, 3)`` of acceleration amplitude `size` [m/s^2] and frequencies ``(m, 3)`` [Hz]."""
    phase = rng.uniform(0.0, 2.0 * np.pi, frequency.shape)
    total = np.zeros((len(t), 3))
    for f, p in zip(frequency, phase, strict=True):
        omega = 2.0 * np.pi * f
        total += size / omega * np.sin(omega * t[:, None] + p)
    return total


def step(x: FloatArray) -> FloatArray:
    """Rise smoothly from 0 to 1 on [0, 1], with four zero derivatives at both ends; constant outside."""
    x = np.clip(x, 0.0, 1.0)
    value: FloatArray = x**5 * np.polyval(STEP[::-1], x)
    return value


def step_area(x: FloatArray) -> FloatArray:
    """Integrate `step` from 0."""
    inside = np.clip(x, 0.0, 1.0)
    area: FloatArray = inside**6 * np.polyval(
        [c / k for k, c in zip(range(10, 5, -1), STEP[::-1], strict=True)], inside
    )
    return area + np.maximum(x - 1.0, 0.0)


def bump(x: FloatArray) -> FloatArray:
    """Rise smoothly from 0 to 1 and back on [0, 1], three derivatives zero at both ends: the scaled slope of `step`."""
    x = np.clip(x, 0.0, 1.0)
    value: FloatArray = (4.0 * x * (1.0 - x)) ** 4
    return value


@dataclass(frozen=True)
class Rise:
    """Change by `total` at a rate that rises smoothly to `rate`, stays constant, and falls: a rounded trapezoid.

    If `total` is too small the rate remains lower, and rises and falls with the same slope.
    """

    total: float  # total change, of either sign
    limit: float  # upper limit of the rate, above 0 [1/s]
    ramp_limit: float  # time in which the rate goes from 0 to `limit` [s]

    @cached_property
    def rate(self) -> float:
        """Largest rate reached, with the sign of `total`."""
        share = min(1.0, math.sqrt(abs(self.total) / (self.limit * self.ramp_limit))) if self.ramp_limit else 1.0
        return math.copysign(self.limit * share, self.total)

    @cached_property
    def ramp(self) -> float:
        """Time from rate 0 to `rate` [s]."""
        return self.ramp_limit * abs(self.rate) / self.limit

    @cached_property
    def duration(self) -> float:
        """Time of the whole change [s]."""
        return self.total / self.rate + self.ramp if self.total else 0.0

    @property
    def frequency(self) -> float:
        """Equivalent frequency of the ramps, if a ramp is three quarters of a period [Hz]; 0 without ramps."""
        return 0.75 / self.ramp if self.total and self.ramp else 0.0

    def slope(self, t: FloatArray) -> FloatArray:
        """Evaluate the rate of change at times ``(n,)`` since the beginning [s]."""
        if not self.total:
            return np.zeros_like(t)
        return np.asarray(self.rate * (step(t / self.ramp) - step((t - self.duration + self.ramp) / self.ramp)))

    def __call__(self, t: FloatArray) -> FloatArray:
        """Evaluate the change at times ``(n,)`` since the beginning [s]."""
        if not self.total:
            return np.zeros_like(t)
        begin, end = step_area(t / self.ramp), step_area((t - self.duration + self.ramp) / self.ramp)
        return self.rate * self.ramp * (begin - end)


Course = Callable[[FloatArray], FloatArray]  # function of the time since the beginning of the move [s]

_FINE = 2001  # instants for the integration of a height
_TRANSITION = 0.5  # shortest time to begin or end a turn [s]


@dataclass(frozen=True, slots=True)
class State:
    """State of a vehicle between two moves."""

    speed: float = 0.0  # forward speed [m/s]
    heading: float = 0.0  # heading, not wrapped [rad]
    # roll, pitch, yaw of a table on a slide [rad]: pitch turns the roll axis, yaw turns both axes. None after a spin
    table: tuple[float, float, float] | None = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Move:
    """Move of a vehicle."""

    duration: float  # duration of the move [s]
    # initial and final state of the vehicle
    begin: State
    end: State
    # forward speed [m/s], heading [rad], climb angle [rad] over time; None if constant
    speed: Course | None = None
    heading: Course | None = None
    grade: Course | None = None
    right: Course | None = None  # velocity to the right [m/s]
    body: Course | None = None  # rotation vector ``(n, 3)`` of the body in the vehicle since the beginning [rad]
    # highest frequency of the move [Hz], from its oscillation or from its fastest change; 0: no change
    frequency: float = 0.0


def stay(state: State, duration: float) -> Move:
    """Continue unchanged for a time [s]."""
    return Move(duration, state, state)


def change_speed(state: State, to: float, acceleration: float, jerk: float) -> Move:
    """Change to another speed [m/s], with a largest acceleration [m/s^2] and jerk [m/s^3]."""
    rise = Rise(to - state.speed, acceleration, STEEPEST * acceleration / jerk)
    end = replace(state, speed=to)
    return Move(rise.duration, state, end, speed=lambda t: state.speed + rise(t), frequency=rise.frequency)


def turn(state: State, angle: float, rate: float, jerk: float) -> Move:
    """Turn by an angle [rad] with a largest rate [rad/s] and a largest lateral jerk [m/s^3]."""
    rise = _turning(state, angle, rate, jerk)
    end = replace(state, heading=state.heading + angle)
    return Move(rise.duration, state, end, heading=lambda t: state.heading + rise(t), frequency=rise.frequency)


def _turning(state: State, angle: float, rate: float, jerk: float) -> Rise:
    return Rise(angle, rate, max(_TRANSITION, STEEPEST * rate * abs(state.speed) / jerk))


def climb(state: State, height: float, angle: float, acceleration: float, jerk: float) -> Move:
    """Climb or descend by a height [m] at an angle [rad]; the path bends with this acceleration [m/s^2] and jerk."""
    sign = math.copysign(1.0, height)

    def bend(gamma: float) -> Rise:
        return Rise(sign * gamma, acceleration / state.speed, STEEPEST * acceleration / jerk)

    def gained(gamma: float) -> float:
        rise = bend(gamma)
        t = np.linspace(0.0, rise.duration, _FINE)
        return 2.0 * state.speed * float(np.trapezoid(np.sin(rise(t)), t))

    if abs(gained(angle)) > abs(height):  # the bends alone would exceed the height: use a flatter path
        angle = float(brentq(lambda gamma: abs(gained(gamma)) - abs(height), 0.0, angle, xtol=1e-12))
    rise = bend(angle)
    fall_at = rise.duration + max(0.0, (abs(height) - abs(gained(angle))) / (state.speed * math.sin(angle)))
    return Move(fall_at + rise.duration, state, state, grade=_up_and_down(rise, fall_at), frequency=rise.frequency)


def helix(state: State, angle: float, rate: float, height: float, jerk: float) -> Move:
    """Turn by an angle [rad] and climb by a height [m] at the same time."""
    rise = _turning(state, angle, rate, jerk)
    edge = min(0.25 * rise.duration, 5.0)

    def grade(gamma: float) -> Course:
        return lambda t: gamma * _envelope(t, rise.duration, edge)

    t = np.linspace(0.0, rise.duration, _FINE)

    def missing(gamma: float) -> float:
        return state.speed * float(np.trapezoid(np.sin(grade(gamma)(t)), t)) - height

    steep = math.radians(89.0)
    gamma = float(brentq(missing, -steep, steep, xtol=1e-12)) if missing(-steep) * missing(steep) < 0.0 else math.nan
    end = replace(state, heading=state.heading + angle)
    frequency = max(rise.frequency, 0.75 / edge)
    return Move(
        rise.duration, state, end, heading=lambda t: state.heading + rise(t), grade=grade(gamma), frequency=frequency
    )


def lane_change(state: State, offset: float, duration: float) -> Move:
    """Drive to a lane `offset` [m] to the right, in a time [s], and continue in the original direction."""
    sine = offset / (duration * BUMP_AREA) / state.speed

    def heading(t: FloatArray) -> FloatArray:
        return np.asarray(state.heading + np.arcsin(np.clip(sine * bump(t / duration), -1.0, 1.0)))

    return Move(duration, state, state, heading=heading, frequency=2.0 / duration)


def slide(state: State, length: float, speed: float, acceleration: float, jerk: float) -> Move:
    """Move by a length [m], backwards if negative, from rest to rest: a trapezoid of speed with rounded corners."""
    ramp = STEEPEST * acceleration / jerk

    def least(v: float) -> float:
        return v * Rise(v, acceleration, ramp).duration

    distance = abs(length)
    if least(speed) > distance:
        speed = float(brentq(lambda v: least(v) - distance, 1e-9, speed, xtol=1e-15))
    rise = Rise(speed, acceleration, ramp)
    fall_at = max(rise.duration, distance / speed)
    sign = math.copysign(1.0, length)
    pace = _up_and_down(rise, fall_at)
    return Move(fall_at + rise.duration, state, state, speed=lambda t: sign * pace(t), frequency=rise.frequency)


def spin(state: State, axis: FloatArray, angle: float, rate: float, acceleration: float) -> Move:
    """Rotate the body about a body axis by an angle [rad], at a rate [rad/s] reached with [rad/s^2]."""
    rise = Rise(angle, rate, STEEPEST * rate / acceleration)

    def body(t: FloatArray) -> FloatArray:
        return np.asarray(rise(t)[:, None] * axis)

    return Move(rise.duration, state, replace(state, table=None), body=body, frequency=rise.frequency)


AXES = ("x", "y", "roll", "pitch", "yaw")  # of a slide: forward, right [m]; of its table: angles [rad]
_SMALL_TURN = 0.01  # rotation of a table axis, to find its direction in the body [rad]
_BOTH = 0.96  # largest acceleration along, and across, a circle, as a share of the given limit


def linear(state: State, change: FloatArray, rate: FloatArray, acceleration: FloatArray) -> Move:
    """Move all axes by `change`, proportionally, at the pace of the slowest axis.

    `change`, `rate`, `acceleration` (5,): change, largest rate and largest acceleration of each of the `AXES`.
    """
    distances = np.abs(change)[change != 0.0]
    pace, gain = (float(np.min(limit[change != 0.0] / distances)) for limit in (rate, acceleration))
    rise = Rise(1.0, pace, STEEPEST * pace / gain)
    return _carried(state, rise, lambda s: s[:, None] * change, lambda s: np.tile(change, (len(s), 1)))


def circular(
    state: State, pair: tuple[int, int], radius: float, angles: tuple[float, float], limits: tuple[float, float]
) -> Move:
    """Move two axes around a circle.

    `pair`: two of `AXES`. `radius`: in their unit. `angles`: direction of the start seen from the centre, and angle of
    the arc [rad]. `limits`: largest rate and acceleration along the circle and towards its centre.
    """
    start, angle = angles
    gain = _BOTH * limits[1] / radius
    pace = min(limits[0] / radius, math.sqrt(gain))
    first, second = radius * np.eye(len(AXES))[list(pair)]

    def way(s: FloatArray) -> FloatArray:
        cos, sin = np.cos(start + s) - math.cos(start), np.sin(start + s) - math.sin(start)
        return np.asarray(cos[:, None] * first + sin[:, None] * second)

    def slope(s: FloatArray) -> FloatArray:
        return np.asarray(np.cos(start + s)[:, None] * second - np.sin(start + s)[:, None] * first)

    return _carried(state, Rise(angle, pace, STEEPEST * pace / gain), way, slope)


def _carried(state: State, rise: Rise, way: Course, slope: Course) -> Move:
    """Move slide and table along a path `way` with derivative `slope`, (n, 5), over a parameter that follows `rise`."""
    turned = np.abs(way(np.linspace(0.0, rise.total, _FINE))[:, 2:]).max(axis=0)
    table = np.array(state.table or (0.0, 0.0, 0.0))
    inverse = quat_conjugate(quat_from_rph(table[None]))

    def rotation(angles: FloatArray) -> FloatArray:
        return rotvec_from_quat(quat_multiply(np.tile(inverse, (len(angles), 1)), quat_from_rph(table + angles)))

    def body(t: FloatArray) -> FloatArray:
        angles = way(rise(t))[:, 2:]
        if np.count_nonzero(turned) > 1:
            return rotation(angles)
        axes = rotation(_SMALL_TURN * np.eye(3)) / _SMALL_TURN  # a single axis keeps its direction: any angle is valid
        return np.asarray(angles @ axes)

    def along(axis: int) -> Course:
        return lambda t: slope(rise(t))[:, axis] * rise.slope(t)

    table_end = table + way(np.array([rise.total]))[0, 2:]
    end, turning = (replace(state, table=tuple(table_end.tolist())), body) if turned.any() else (state, None)
    return Move(rise.duration, state, end, speed=along(0), right=along(1), body=turning, frequency=rise.frequency)


def coning(state: State, angle: float, frequency: float, duration: float) -> Move:
    """Move the x axis around a cone of a half-angle [rad], for a time [s], with smooth start and end."""
    omega = 2.0 * math.pi * frequency

    def body(t: FloatArray) -> FloatArray:
        size = angle * _swell(t, duration, frequency)
        return np.column_stack([np.zeros_like(t), size * np.cos(omega * t), size * np.sin(omega * t)])

    return Move(duration, state, state, body=body, frequency=frequency)


def sculling(state: State, angle: float, acceleration: float, frequency: float, duration: float) -> Move:
    """Roll by an angle [rad] with a rightward acceleration [m/s^2] in phase, for a time [s]."""
    omega = 2.0 * math.pi * frequency

    def body(t: FloatArray) -> FloatArray:
        roll = angle * _swell(t, duration, frequency) * np.sin(omega * t)
        return np.column_stack([roll, np.zeros_like(t), np.zeros_like(t)])

    def right(t: FloatArray) -> FloatArray:
        return np.asarray(-acceleration / omega * _swell(t, duration, frequency) * np.cos(omega * t))

    return Move(duration, state, state, right=right, body=body, frequency=frequency)


def _up_and_down(rise: Rise, held: float) -> Course:
    """Build a course that follows `rise`, and falls likewise from `held` [s] on."""
    return lambda t: np.asarray(rise(np.minimum(t, held)) - rise(t - held))


def _swell(t: FloatArray, duration: float, frequency: float) -> FloatArray:
    return _envelope(t, duration, min(0.25 * duration, max(1.0, 5.0 / frequency)))


def _envelope(t: FloatArray, duration: float, edge: float) -> FloatArray:
    """Build an envelope from 0 to 1 within `edge` [s], and back to 0 at the end."""
    return step(t / edge) - step((t - duration + edge) / edge)
