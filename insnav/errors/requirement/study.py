"""A requirement on the position error, and what meets it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from insnav.errors.requirement.allocation import Allocation
from insnav.errors.requirement.limit import Requirement
from insnav.errors.requirement.parts import Candidate, Elasticity, Remedy
from insnav.errors.requirement.verification import Verified
from insnav.findings import Code, Finding
from insnav.types import FloatArray


@dataclass(frozen=True, slots=True)
class RequirementStudy:
    """A requirement, on a motion, with the errors that just meet it and the IMUs that do."""

    required: Requirement
    motion: str  # what motion it is
    imu: str  # name of the IMU that some errors are given by; empty if none
    allocation: Allocation
    hold: bool  # the vertical channel was constrained to the reference height
    verified: tuple[Verified, ...] = ()  # the set, and a larger one, simulated
    begins: tuple[int, ...] = ()  # when GPS ends in what follows, a mean over these outages [s]
    time: FloatArray = field(default_factory=lambda: np.zeros(0))  # (m,) of the curves of the candidates [s]
    candidates: tuple[Candidate, ...] = ()  # real IMUs, the best first; none for outages that are too long for it
    # IMU that the rest is of: the one given, else the best that does not meet the requirement alone; and what helps it
    example: str = ""
    remedies: tuple[Remedy, ...] = ()
    elasticities: tuple[Elasticity, ...] = ()
    shares: Mapping[str, float] = field(default_factory=dict)  # of the errors at the start, and of the noise after it


TYPICAL = 1.6  # geometric mean of recorded over predicted error
SPAN = (0.53, 4.9)  # 95 % of further tests
FIELD_FACTOR = Finding.of(Code.REQUIREMENT_FIELD_FACTOR, factor=TYPICAL, low=SPAN[0], high=SPAN[1])
