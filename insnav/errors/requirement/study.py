"""A requirement on the position error, and what meets it."""

from __future__ import annotations

from dataclasses import dataclass

from insnav.errors.requirement.allocation import Allocation
from insnav.errors.requirement.limit import Requirement
from insnav.errors.requirement.verification import Verified


@dataclass(frozen=True, slots=True)
class RequirementStudy:
    """A requirement, on a motion, with the errors that just meet it."""

    required: Requirement
    motion: str  # what motion it is
    imu: str  # name of the IMU that some errors are given by; empty if none
    allocation: Allocation
    hold: bool  # the vertical channel was constrained to the reference height
    verified: tuple[Verified, ...] = ()  # the set, and a larger one, simulated
