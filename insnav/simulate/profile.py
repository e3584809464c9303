"""A drive as a list of segments, and the smooth speed, heading and grade that it commands."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PPoly

from insnav.exceptions import ConfigError
from insnav.simulate.curves import Spline, spline_of
from insnav.simulate.motion.smooth_steps import STEP
from insnav.types import FloatArray

_DEGREE = 9
MAX_GRADE = math.radians(60.0)


@dataclass(frozen=True, slots=True)
class Segment:
    """One manoeuvre: everything changes smoothly over `duration` and is steady at both ends.

    Attributes
    ----------
    duration : float
        How long it takes [s].
    speed : float or None
        Forward speed at the end [m/s]; None keeps the speed.
    turn : float
        Change of heading [rad], positive to the right.
    grade : float or None
        Climb angle at the end [rad], positive upwards; None keeps the grade.
    """

    duration: float
    speed: float | None = None
    turn: float = 0.0
    grade: float | None = None


@dataclass(frozen=True, slots=True)
class Profile:
    """A drive: starts at rest on level ground and goes through its segments.

    Attributes
    ----------
    segments : tuple of Segment
        In order of time.
    heading : float
        Heading at the start [rad].
    """

    segments: tuple[Segment, ...]
    heading: float = 0.0

    @property
    def duration(self) -> float:
        """Length of the drive [s]."""
        return math.fsum(segment.duration for segment in self.segments)


def check_profile(profile: Profile) -> None:
    """Refuse a drive that cannot be driven.

    Raises
    ------
    ConfigError
        No segment, or one with a duration, speed, turn or grade that cannot be meant.
    """
    if not profile.segments:
        raise ConfigError("the motion profile has no segments", fix="give at least one segment with a duration")
    if not math.isfinite(profile.heading):
        raise ConfigError("the heading at the start is not finite", where="heading", why=f"it is {profile.heading}")
    for number, segment in enumerate(profile.segments, start=1):
        speed = 0.0 if segment.speed is None else segment.speed
        grade = 0.0 if segment.grade is None else segment.grade
        wrong = [
            (not (math.isfinite(segment.duration) and segment.duration > 0.0), "duration", "above 0 s"),
            (not (math.isfinite(speed) and speed >= 0.0), "speed", "0 m/s or more"),
            (not math.isfinite(segment.turn), "turn", "a finite angle"),
            (not (math.isfinite(grade) and abs(grade) <= MAX_GRADE), "grade", "between -60 and 60 deg"),
        ]
        for bad, name, rule in wrong:
            if bad:
                raise ConfigError(
                    f"segment {number} of the motion profile cannot be driven",
                    where=f"segment {number}: {name}",
                    why=f"{name} is {getattr(segment, name)} and must be {rule}",
                )


def commands(profile: Profile) -> Spline:
    """Forward speed [m/s], heading [rad, not wrapped] and grade [rad] as functions of time [s].

    Continuous in four derivatives; time starts at 0.

    Parameters
    ----------
    profile : Profile
        The drive.

    Raises
    ------
    ConfigError
        See `check_profile`.
    """
    check_profile(profile)
    state = np.array([0.0, profile.heading, 0.0])
    breaks = [0.0]
    coefficients = np.zeros((_DEGREE + 1, len(profile.segments), 3))  # highest power first
    for i, segment in enumerate(profile.segments):
        after = target(state, segment)
        powers = segment.duration ** -np.arange(5.0, _DEGREE + 1)
        coefficients[: len(STEP), i] = (np.array(STEP) * powers)[::-1, None] * (after - state)
        coefficients[-1, i] = state
        state = after
        breaks.append(breaks[-1] + segment.duration)
    return spline_of(PPoly(coefficients, np.array(breaks)))


def target(state: FloatArray, segment: Segment) -> FloatArray:
    """Speed, heading and grade ``(3,)`` at the end of a segment that starts with `state`."""
    speed, heading, grade = state
    return np.array(
        [
            speed if segment.speed is None else segment.speed,
            heading + segment.turn,
            grade if segment.grade is None else segment.grade,
        ]
    )
