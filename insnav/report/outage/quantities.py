"""Errors of outage windows as they were measured, and without the noise of the reference."""

from __future__ import annotations

import numpy as np

from insnav.errors.outage.statistics import Growth
from insnav.quantity import Quantity
from insnav.report.numbers import number
from insnav.units import UNITS

BELOW = "below reference noise"
INTERVALS = (
    "Intervals: RMS error of drives like this one, 95 % intended. In simulations they hold it in 90 to 99 % of cases "
    "where windows differ by chance, in 85 to 97 % where half of the variance is common to all windows of a drive: "
    "that part counts as one window."
)
_SHARED = 0.25  # share of the mean square that is common to all windows, from which it is said


def corrected(found: Growth, i: int, unit: str = "m", meaning: str = "corrected (95 %)") -> Quantity:
    """RMS error without the reference at the last time, with its interval; in words where nothing is left."""
    low, high = float(found.low[-1, i]), float(found.high[-1, i])
    if found.below_noise[-1, i]:
        text = below_noise(high / UNITS[unit][1]).replace(" reference", "")  # in a table of 80 columns
        return Quantity("rms_corrected", text, unit, meaning=meaning)
    return Quantity("rms_corrected", float(found.corrected[-1, i]), unit, interval=(low, high), meaning=meaning)


def below_noise(high: float, unit: str = "") -> str:
    """Say that an error is below the noise of the reference, and how large it may be, in the unit shown."""
    return f"{BELOW} (< {number(high)}{unit})" if np.isfinite(high) and high > 0.0 else BELOW


def corrected_text(value: float, low: float, high: float) -> str:
    """Write an RMS error without the reference, which may be below its noise, with its interval [m]."""
    if not np.isfinite(value):
        return below_noise(high, " m")
    return f"{number(value)} m RMS" + (f" ({number(low)} … {number(high)} m)" if np.isfinite(low) else "")


def common_text(found: Growth) -> str:
    """Say how much of the horizontal error is common to all windows, if it is much."""
    share = float(found.common[-1, found.column("horizontal")])
    if not share >= _SHARED:
        return ""
    return (
        f"{100.0 * share:.0f} % of the mean square horizontal error after {found.length:g} s is common to all windows "
        "of this drive and counts as one of them: the interval is wide, as another drive has another such error."
    )
