"""Which error explains the position and velocity error at the end of a free-inertial run, from these two numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.errors.diagnosis.growth_curves import FITS, fit_curve, position_terms, velocity_terms
from insnav.errors.evaluated_run import EvaluatedRun
from insnav.exceptions import InputError
from insnav.sample_statistics import chi_square
from insnav.types import FloatArray

AXES = ("north", "east")
SHORTEST = 5.0  # without fixes, before an error has grown out of that of the last fix [s]


@dataclass(frozen=True, slots=True)
class EndAxis:
    """One horizontal axis at the end of a run."""

    axis: str  # ``north`` or ``east``
    position: float  # error [m]
    velocity: float  # error [m/s]
    power: float  # of the time with which both grow, ``v t / p``; NaN without a position error
    # (3,) velocity at the start [m/s], acceleration [m/s^2], jerk [m/s^3], each taken alone; and one sd of each
    alone: FloatArray
    sd: FloatArray
    left: FloatArray  # (3,) what each alone leaves unexplained, in standard deviations of the reference
    terms: tuple[str, ...]  # the fewest of t, t², t³ that explain it; two of them: any two do

    @property
    def fits(self) -> tuple[bool, ...]:
        """Whether each alone explains it, at 95 %."""
        return tuple(bool(each**2 <= chi_square(1, FITS)) for each in self.left)


def explain_end(
    time: float, position: FloatArray, velocity: FloatArray, position_sd: float, velocity_sd: float
) -> tuple[EndAxis, ...]:
    """Explain the errors at the end of a run that began without error.

    `time`: length of the run [s]; `position`, `velocity` (2,): errors North, East [m], [m/s]; `position_sd`,
    `velocity_sd`: standard deviations of the reference [m], [m/s].
    """
    at = np.array([time])
    sd = np.array([position_sd, velocity_sd])
    design = np.vstack([position_terms(at), velocity_terms(at)]) / sd[:, None]
    found = []
    for axis, p, v in zip(AXES, position, velocity, strict=True):
        observed = np.array([p, v]) / sd
        size = np.sum(design**2, axis=0)
        alone = design.T @ observed / size
        left = np.linalg.norm(observed[:, None] - design * alone, axis=0)
        curve = fit_curve(at, np.array([p]), np.array([v]), np.diag(sd**2))
        power = float(v * time / p) if p != 0.0 else float("nan")
        found.append(EndAxis(axis, float(p), float(v), power, alone, 1.0 / np.sqrt(size), left, curve.terms))
    return tuple(found)


def end_of_run(found: EvaluatedRun) -> tuple[float, FloatArray, FloatArray]:
    """Time since the last fix of a run [s], what its position error grew by, and its velocity error, (2,) North, East.

    Raises: InputError: a run without a reference of position and velocity, or that ends with fixes.
    """
    errors, fixes = found.errors, found.run.innovations
    if errors is None or not np.isfinite(errors.velocity[-1, :2]).all():
        raise InputError("diagnosis.no_end_error")
    used = fixes.time[fixes.used_position]
    begin = float(used[-1]) if used.size else float(errors.time[0])
    first = int(np.searchsorted(errors.time, begin - 1e-6))
    time = float(errors.time[-1]) - begin
    if time < SHORTEST:
        raise InputError("diagnosis.ends_with_fixes", before_s=max(time, 0.0))
    return time, errors.position[-1, :2] - errors.position[first, :2], errors.velocity[-1, :2]
