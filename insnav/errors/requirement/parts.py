"""Which real IMUs meet a requirement after GPS ends, and how long each stays below a limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from insnav.errors.requirement.aided import Aiding, Propagation, error_curves
from insnav.errors.requirement.limit import Requirement
from insnav.imu import load_imu
from insnav.imu.library import Part, completed
from insnav.types import FloatArray

Answer = Literal["yes", "likely", "open", "no"]
LIMITS = (1.0, 10.0, 100.0)  # [m]


@dataclass(frozen=True, slots=True)
class Coasting:
    """How the error of an IMU grows after GPS ends."""

    error: float  # at the time of the requirement, at its probability [m]
    least: float  # the same if what no document gives were zero [m]
    answer: Answer
    curve: FloatArray  # (m,) over the times of the study [m]
    reaches: tuple[float, ...]  # when it exceeds each of `LIMITS` [s]; infinite if it does not


@dataclass(frozen=True, slots=True)
class Candidate:
    """A part and what its figures make of the requirement."""

    name: str
    grade: str
    provenance: str
    missing: tuple[str, ...]  # figures that no document gives, taken from its class
    alone: Coasting  # the IMU alone
    nhc: Coasting  # with the non-holonomic constraint


def candidates(required: Requirement, moved: Propagation, parts: Sequence[Part]) -> tuple[Candidate, ...]:
    """Evaluate parts: twice each, with what is missing as in their class, and as zero."""
    grades = {grade: load_imu(grade) for grade in {part.grade for part in parts}}
    specs = [completed(part, grades[part.grade])[0] for part in parts] + [part.spec for part in parts]
    alone, aided = (error_curves(required, moved, specs, Aiding(nhc=nhc)) for nhc in (False, True))
    found = []
    for i, part in enumerate(parts):
        both = [
            coasting(required, moved, curves[i], curves[len(parts) + i], known=not part.missing)
            for curves in (alone, aided)
        ]
        found.append(Candidate(part.name, part.grade, part.provenance, part.missing, *both))
    return tuple(sorted(found, key=lambda each: each.alone.error))


def coasting(
    required: Requirement, moved: Propagation, curve: FloatArray, least: FloatArray, *, known: bool
) -> Coasting:
    """Evaluate one curve: yes and no where the figures are known or decide, likely by those of the class, else open."""
    time = moved.after
    error, smallest = (float(np.interp(required.after, time, values)) for values in (curve, least))
    smallest = error if known else smallest
    if error <= required.error:
        answer: Answer = "yes" if known else "likely"
    else:
        answer = "no" if smallest > required.error else "open"
    return Coasting(error, smallest, answer, curve, tuple(_reaches(time, curve, limit) for limit in LIMITS))


def _reaches(time: FloatArray, curve: FloatArray, limit: float) -> float:
    """First time at which a curve exceeds a limit, between its points by a straight line; infinite if it does not."""
    over = np.flatnonzero(curve > limit)
    if not over.size:
        return float("inf")
    k = int(over[0])
    if k == 0:
        return 0.0
    return float(time[k - 1] + (limit - curve[k - 1]) / (curve[k] - curve[k - 1]) * (time[k] - time[k - 1]))
