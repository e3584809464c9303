"""Inertial measurement unit: its errors, their specification, and functions that add and remove them.

`ImuErrors` is a set of known errors (calibrated or sampled). `corrupt` adds and `correct` removes exactly these errors.
`ImuSpec` is the IMU error specification; `load_imu` reads it from a preset or a file.

Reading files needs pydantic, which is imported only when one of the reading functions is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from insnav.imu.model import ErrorTerms, ImuErrors, correct, corrupt, sample_errors, sample_intervals
from insnav.imu.specification import PRESETS, ClockSpec, ImuSpec, InitialSpec, SensorSpec

if TYPE_CHECKING:
    from insnav.imu.imu_file import calibration_to_toml, load_calibration, load_imu, to_kalibr, to_toml
    from insnav.imu.noise_density import identify, nearest_preset, white_noise

_LAZY = {
    "imu_file": ("calibration_to_toml", "load_calibration", "load_imu", "to_kalibr", "to_toml"),
    "noise_density": ("identify", "nearest_preset", "white_noise"),
}

__all__ = [
    "PRESETS",
    "ClockSpec",
    "ErrorTerms",
    "ImuErrors",
    "ImuSpec",
    "InitialSpec",
    "SensorSpec",
    "calibration_to_toml",
    "correct",
    "corrupt",
    "identify",
    "load_calibration",
    "load_imu",
    "nearest_preset",
    "sample_errors",
    "sample_intervals",
    "to_kalibr",
    "to_toml",
    "white_noise",
]


def __getattr__(name: str) -> Any:
    for module, names in _LAZY.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
