"""Figures of merit: names, units, and criteria for equality."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from insnav.types import FloatArray

Kind = Literal["size", "ratio", "cpu"]
FAILS_FROM = 0.05  # relative worsening that fails, if significant; for most figures
CAUTION = 0.5  # weight of a too large standard deviation against a too small one
LIKELY = 1e-3  # floor of innovation likelihoods: a thousandth of a standard deviation in the logarithm


@dataclass(frozen=True, slots=True)
class Metric:
    """Figure of merit."""

    key: str  # key in files, including the unit
    label: str  # its name in words
    unit: str
    # added to every value before ratios are taken [`unit`]: smaller values count as equal, so that rounding on another
    # computer is no change
    floor: float
    kind: Kind = "size"  # a size is better if smaller, a ratio if nearer to one; CPU time has a separate rule
    fails_from: float = FAILS_FROM

    def logarithm(self, value: FloatArray) -> FloatArray:
        """Compute the logarithm for comparison by drive, floor added, (n,)."""
        if self.kind == "ratio":
            return np.log(np.maximum(value, 1e-6))
        return np.log(value + self.floor)

    def badness(self, logarithm: float) -> float:
        """Convert a mean logarithm to badness, smaller is better: for a ratio its distance from one.

        A too large ratio is over-confidence and counts fully; a too small ratio is caution and counts half.
        """
        if self.kind != "ratio":
            return logarithm
        return logarithm if logarithm > 0.0 else -CAUTION * logarithm

    def typical(self, value: FloatArray) -> float:
        """Compute the geometric mean of known values, the median for CPU time; NaN without values.

        `value` (n,).
        """
        known = value[np.isfinite(value)]
        if not known.size:
            return float("nan")
        if self.kind == "cpu":
            return float(np.median(known))
        floor = 1e-6 if self.kind == "ratio" else self.floor
        return float(max(np.exp(np.mean(np.log(known + floor))) - floor, 0.0))


STATISTICS = (("rms", "RMS"), ("p95", "95 %"), ("max", "max"))
OUTAGES = (30.0, 60.0)  # [s]
FREE = 60.0  # [s]


def _sizes(name: str, words: str, suffix: str, unit: str, floor: float) -> tuple[Metric, ...]:
    return tuple(Metric(f"{name}_{key}_{suffix}", f"{words}, {text}", unit, floor) for key, text in STATISTICS)


METRICS: tuple[Metric, ...] = (
    *_sizes("north", "north", "m", "m", 1e-3),
    *_sizes("east", "east", "m", "m", 1e-3),
    *_sizes("down", "down", "m", "m", 1e-3),
    Metric("cep50_m", "horizontal, CEP50", "m", 1e-3),
    *_sizes("velocity", "velocity", "m_s", "m/s", 1e-4),
    *_sizes("roll_pitch", "roll, pitch", "deg", "deg", 1e-4),
    *_sizes("heading", "heading", "deg", "deg", 1e-3),
    Metric("smoothed_horizontal_rms_m", "smoothed, horizontal, RMS", "m", 1e-3),
    Metric("smoothed_heading_rms_deg", "smoothed, heading, RMS", "deg", 1e-3),
    *(Metric(f"outage_{t:.0f}s_m", f"{t:.0f} s without GPS", "m", 1e-2) for t in OUTAGES),
    Metric("free_inertial_60s_m", "free inertial, one minute", "m", 1e-2),
    Metric("nees_position", "NEES / 3, position", "", 0.0, "ratio"),
    Metric("nees_velocity", "NEES / 3, velocity", "", 0.0, "ratio"),
    Metric("nees_attitude", "NEES / 3, attitude", "", 0.0, "ratio"),
    Metric("nis_position", "NIS / 3, position", "", 0.0, "ratio"),
    Metric("nis_velocity", "NIS / 3, velocity", "", 0.0, "ratio"),
    Metric("innovation_position_m", "innovations by likelihood, position", "m", 1e-4, fails_from=LIKELY),
    Metric("innovation_velocity_m_s", "innovations by likelihood, velocity", "m/s", 1e-5, fails_from=LIKELY),
    Metric("rejected_fixes", "rejected fixes", "", 1.0),
    Metric("cpu_ratio", "CPU a sample / calibration loop", "", 0.0, "cpu"),
)
BY_KEY = {metric.key: metric for metric in METRICS}
