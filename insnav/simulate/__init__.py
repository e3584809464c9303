"""Simulated drives: exact truth over the rotating Earth, sensors that measure it, and their errors.

    profile or track -> Truth -> imu_from_truth -> corrupt_imu
                              -> gps_from_truth -> corrupt_gps
                              -> reference

A truth consists of two curves over time, position and attitude, from which all other quantities are derived. `straight`
and `circle` are truths in closed form. `insnav.simulate.motion` builds truths from motion profiles, and
`truth_from_track` from recorded tracks.

The package itself can be called: ``insnav.simulate("city", imu="automotive")`` is `insnav.session.simulation.simulate`.
"""

from __future__ import annotations

import inspect
import sys
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Unpack

from insnav.simulate.sensor_errors import GpsErrors, ImuSimulation, corrupt_gps, corrupt_imu, without_fixes
from insnav.simulate.truth import (
    Kinematics,
    LevelTruth,
    Truth,
    circle,
    gps_from_truth,
    imu_from_truth,
    reference,
    straight,
)

if TYPE_CHECKING:
    from insnav.session.drive import Drive
    from insnav.session.simulation import SimulationOptions

__all__ = [
    "GpsErrors",
    "ImuSimulation",
    "Kinematics",
    "LevelTruth",
    "Truth",
    "circle",
    "corrupt_gps",
    "corrupt_imu",
    "gps_from_truth",
    "imu_from_truth",
    "reference",
    "straight",
    "without_fixes",
]


class _Simulate(ModuleType):
    """Package that can be called like `insnav.session.simulation.simulate`."""

    def __call__(self, profile: str | Path, **options: Unpack[SimulationOptions]) -> Drive:
        """Simulate a drive; see `insnav.session.simulation.simulate`."""
        from insnav.session.simulation import simulate

        return simulate(profile, **options)

    @property
    def __signature__(self) -> inspect.Signature:
        """Signature of the function, for editors that inspect the package."""
        from insnav.session.simulation import simulate

        return inspect.signature(simulate)


sys.modules[__name__].__class__ = _Simulate
