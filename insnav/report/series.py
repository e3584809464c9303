"""Series of any number of points made ready to be drawn: time axes, thinning that keeps extremes, robust limits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from insnav.findings import Finding
from insnav.messages import form, sentence
from insnav.types import FloatArray

BINS = 1200  # about one a pixel: more cannot be seen
_TAIL = 0.5  # share on either side that may lie outside of the limits [%]
_WORTH = 1.5  # limits that hold everything are taken where they are no wider than so many times the robust ones


@dataclass(frozen=True, slots=True)
class Clock:
    """Time axis of one run: seconds, minutes or hours since its start."""

    start: float  # zero of the axis, in the time of the data [s]
    unit_s: float  # length of the axis' unit [s]
    unit: str
    label: str  # axis label

    @classmethod
    def of(cls, time: FloatArray) -> Clock:
        """Choose the axis for a run from all its times ``(n,)`` [s]."""
        start = float(time[0]) if len(time) else 0.0
        length = float(time[-1]) - start if len(time) else 0.0
        unit_s, unit = (3600.0, "h") if length > 6 * 3600.0 else (60.0, "min") if length > 900.0 else (1.0, "s")
        since = f" since {start:.1f} s" if start else ""
        return cls(start, unit_s, unit, f"time{since} [{unit}]")

    def __call__(self, time: Any) -> Any:
        """Return times of the data [s] as places on the axis."""
        return (np.asarray(time) - self.start) / self.unit_s

    def moment(self, begin: float, end: float) -> str:
        """Write a time of the data, or a span [s], as it stands on the axis."""
        first, *rest = (self._decimal(abs(time - self.start) + self.start) for time in dict.fromkeys((begin, end)))
        until, before = f" {form('until')} ", form("before_start")
        if begin >= self.start:
            return f"{until.join((first, *rest))} {self.unit}"
        if end < self.start:
            return before.format(f"{until.join((first, *rest))} {self.unit}")
        return f"{before.format(f'{first} {self.unit}')}{until}{rest[0]} {self.unit}"

    def sentence(self, finding: Finding) -> str:
        """Put a finding into words, with its times as they stand on the axis."""
        return sentence(finding, at=self.moment)

    def _decimal(self, time: float) -> str:
        decimals = {"s": 1, "min": 2, "h": 4}[self.unit]
        return f"{self(time):.{decimals}f}"


def envelope(
    time: FloatArray, low: FloatArray, high: FloatArray, bins: int = BINS
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Thin a band ``(n,)`` to at most `bins` points without narrowing it; breaks (NaN) are kept."""
    if len(time) <= bins:
        return time, low, high
    starts = np.linspace(0, len(time), bins + 1).astype(np.int64)[:-1]
    return time[starts], np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)


def thinned(time: FloatArray, value: FloatArray, bins: int = BINS) -> tuple[FloatArray, FloatArray]:
    """Thin a line ``(n,)`` to its smallest and largest value in each of `bins` stretches; breaks (NaN) are kept."""
    if len(time) <= 2 * bins:
        return time, value
    length = -(-len(time) // bins)
    padding = -len(time) % length
    blocks = np.concatenate((value, np.full(padding, value[-1]))).reshape(-1, length)
    broken = np.isnan(blocks)
    low = np.argmin(np.where(broken, np.inf, blocks), axis=1)
    high = np.argmax(np.where(broken, -np.inf, blocks), axis=1)
    gap = np.where(broken.any(axis=1), np.argmax(broken, axis=1), low)
    first = np.arange(len(blocks)) * length
    rows = np.unique(np.concatenate((first + low, first + high, first + gap, [len(time) - 1])))
    rows = rows[rows < len(time)]
    return time[rows], value[rows]


def broken_at_gaps(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Put a row of NaN into every gap of values ``(n, k)``, so that no line is drawn across it."""
    if len(time) < 3:
        return time, values
    step = np.diff(time)
    after = np.flatnonzero(step > 5.0 * np.median(step)) + 1
    if not after.size:
        return time, values
    return np.insert(time, after, time[after]), np.insert(values, after, np.nan, axis=0)


def robust_limits(values: Iterable[FloatArray], least: float = 0.0) -> tuple[float, float] | None:
    """Limits of an axis that a few outliers do not set.

    `values`: arrays (n,) of any lengths, each with the same say; `least`: smallest height of the view.
    Returns: none if no value is finite.
    """
    known = [each[np.isfinite(each)] for each in values]
    known = [each for each in known if each.size]
    if not known:
        return None
    low, high = min(float(each.min()) for each in known), max(float(each.max()) for each in known)
    most = [np.percentile(each, (_TAIL, 100.0 - _TAIL)) for each in known]
    robust = min(float(a) for a, _ in most), max(float(b) for _, b in most)
    if high - low > _WORTH * (robust[1] - robust[0]) > 0.0:
        low, high = robust
    margin = 0.06 * (high - low)
    half = max(0.5 * (high - low) + margin, 0.5 * least, 1e-12 * max(abs(low), abs(high)), 1e-12)
    return 0.5 * (low + high) - half, 0.5 * (low + high) + half


def wrapped(heading: FloatArray) -> FloatArray:
    """Headings (n,) [deg] within 0..360, broken at north."""
    found = heading % 360.0
    found[1:][np.abs(np.diff(found)) > 180.0] = np.nan
    return found
