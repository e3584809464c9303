"""Kinds of vehicles: what they can do, what they do by default, how they lean."""

from __future__ import annotations

import math
from dataclasses import dataclass

from insnav.units import G0


@dataclass(frozen=True, slots=True)
class Vehicle:
    """How a car body moves on its wheels."""

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
    """What a kind of vehicle can do."""

    name: str
    # largest speed [m/s] and accelerations along and across the way [m/s^2]
    speed: float
    forward: float
    sideways: float
    grade: float  # steepest climb [rad]
    # defaults: along the way [m/s^2], of any force [m/s^3], of the path upwards [m/s^2]
    acceleration: float
    jerk: float
    bend: float
    banks: bool = False  # whether it banks into its turns so that nothing pulls sideways
    on_the_spot: bool = False  # whether it can turn without moving
    body: Vehicle = _RIGID  # how the body leans and shakes


HIGHEST = 100.0 * G0  # of a laboratory device; beyond it a motion is a slip of the pen
FASTEST_SPIN = math.radians(4000.0)
_STEEPEST_BANK = G0 * math.tan(math.radians(75))  # as acceleration across the way [m/s^2]

KINDS = {
    kind.name: kind
    for kind in (
        Kind("car", 100.0, 10.0, 9.0, math.radians(25), 1.5, 2.0, 0.5, body=Vehicle()),
        Kind("aircraft", 1000.0, 50.0, _STEEPEST_BANK, math.radians(60), 2.0, 2.0, 2.0, banks=True),
        Kind("slide", 100.0, HIGHEST, HIGHEST, math.radians(60), 0.5, 5.0, 1.0, on_the_spot=True),
    )
}
