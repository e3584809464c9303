"""Speedometer: log of speed with its own clock."""

from __future__ import annotations

from typing import ClassVar, Self

import numpy as np

from insnav.filter.measurements.clock import clock_offset, near_values
from insnav.filter.measurements.first_pass import FAST, FirstPass
from insnav.filter.measurements.odometer import FEWEST, Odometer
from insnav.findings import Code, Finding
from insnav.types import BoolArray, FloatArray

# Between fixes far apart the first pass drifts, and would spoil scale factor and lag.
KNOWN_SPEED = 0.3  # standard deviation of a velocity that is good enough for them [m/s]
LAGS = np.arange(-1.0, 1.0, 0.02)  # around the offset by correlation [s]


MOST_OUTLIERS = 0.15  # a log with a larger share of speeds that contradict the drive is not used
OUTLIER, LEAST_OUTLIER = 4.0, 1.0  # standard deviations, and [m/s], from which a speed is excluded from calibration


class Speedometer(Odometer):
    """Forward speed from a log; clock offset, lag and scale factor are calibrated from the drive."""

    __slots__ = ()
    order: ClassVar[int] = 40
    name: ClassVar[str] = "speedometer"

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """See `insnav.filter.measurements.measurement.Measurement`."""
        log = first.logs.get(cls.name)
        if log is None:
            return None, None
        if first.mounting is None or not first.mounting.holds:
            return None, Finding.of(Code.SPEEDOMETER_AXES)
        known = np.isfinite(log.values["speed"])
        if known.sum() < FEWEST:
            return None, Finding.of(Code.ODOMETER_FEW, subject=cls.name, count=known.sum(), limit_count=FEWEST)
        time, speed = log.time[known], log.values["speed"][known]
        horizontal = np.hypot(*first.solution.v_n[:, :2].T)
        offset = clock_offset(first.solution.time, horizontal, time, speed)
        if offset is None:
            return None, Finding.of(Code.SPEEDOMETER_CLOCK)
        sd = first.solution.sd
        sure = first.fast if sd is None else first.fast & (np.hypot(sd[:, 3], sd[:, 4]) < KNOWN_SPEED)
        rows = sure & near_values(time - offset, first.solution.time)
        if rows.sum() < FEWEST:
            return None, Finding.of(Code.SPEEDOMETER_UNKNOWN, count=rows.sum(), limit_count=FEWEST)
        shown = np.interp(first.solution.time + offset, time, speed)
        wrong = _outliers(first.forward, shown, rows)
        if (share := float(wrong.sum() / rows.sum())) > MOST_OUTLIERS:
            return None, Finding.of(Code.SPEEDOMETER_OUTLIERS, share=share, limit_share=MOST_OUTLIERS)
        rows &= ~_spread(wrong, round(2.0 * LAGS[-1] / first.step))
        found, note = cls.fitted(first, rows, time, speed, offset + LAGS)
        if found is not None and "sd" in log.values:
            reported = float(np.nanmedian(log.values["sd"][known]))
            found = cls(found.time, found.speed, found.to_vehicle, found.lever_b, np.fmax(found.sd, reported))
        return found, note


def _outliers(forward: FloatArray, shown: FloatArray, rows: BoolArray) -> BoolArray:
    """Find speeds that do not fit a common scale factor."""
    factor = float(np.median(forward[rows] / np.maximum(shown[rows], FAST)))
    residual = np.abs(forward - factor * shown)
    return np.asarray(rows & (residual > max(LEAST_OUTLIER, OUTLIER * 1.4826 * float(np.median(residual[rows])))))


def _spread(wrong: BoolArray, rows: int) -> BoolArray:
    """Extend outliers by half of `rows` rows on both sides: any lag is tried."""
    return np.asarray(np.convolve(wrong, np.ones(rows + 1), mode="same") > 0.5)
