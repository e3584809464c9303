"""Measurements of heading and height: from the receiver, a magnetometer, a height that changes slowly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from insnav.attitude import dcm_from_rph, wrap_pi
from insnav.filter.measurements.measurement import (
    INTERVAL,
    NOTHING,
    FilterView,
    FirstPass,
    near_values,
    time_correlated_sd,
)
from insnav.findings import Code, Finding
from insnav.kernels.measurements import body_heading
from insnav.strapdown import nearest_rows
from insnav.types import BoolArray, FloatArray
from insnav.units import DEG


@dataclass(frozen=True, slots=True)
class Heading:
    """Heading measured with the fixes."""

    time: FloatArray  # (n,) times [s] and heading [rad]; ``NaN`` where unknown
    heading: FloatArray
    sd: FloatArray  # (1,) standard deviation [rad]

    order: ClassVar[int] = 0
    name: ClassVar[str] = "heading"
    unit: ClassVar[str] = "rad"
    excluded_by: ClassVar[frozenset[str]] = frozenset()

    def observe(self, at: FilterView, z: FloatArray, h: FloatArray) -> slice:
        """See `Measurement`."""
        row = int(nearest_rows(self.time, at.time))
        if not abs(self.time[row] - at.time) < 0.5 * INTERVAL or not np.isfinite(self.heading[row]):
            return NOTHING
        body_heading(at.x, float(self.heading[row]), z, h)
        return slice(0, 1)

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """Calibrate nothing: the user specifies the accuracy, and the first pass already uses the heading."""
        return None, None


LARGEST_HEIGHT_RMS = 20.0  # a larger error means no barometer, or another unit [m]
LEAST_HEIGHT_SD = 0.3  # wind and doors change the pressure by this much [m]


@dataclass(frozen=True, slots=True)
class HeightAiding:
    """Height over time, constant before the first and after the last value."""

    time: FloatArray  # (n,) times [s] and height above the ellipsoid [m]
    height: FloatArray
    sd: FloatArray  # (1,) standard deviation [m]

    order: ClassVar[int] = 10
    name: ClassVar[str] = "height"
    unit: ClassVar[str] = "m"
    excluded_by: ClassVar[frozenset[str]] = frozenset()

    def observe(self, at: FilterView, z: FloatArray, h: FloatArray) -> slice:
        """See `Measurement`."""
        h[0] = 0.0
        h[0, 2] = -1.0  # the position error is North, East, Down
        z[0] = at.x[2] - float(np.interp(at.time, self.time, self.height))
        return slice(0, 1)

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """See `Measurement`."""
        imu, solution = first.imu, first.solution
        if imu.baro is None or not np.isfinite(imu.baro).any():
            return None, None
        known = np.isfinite(imu.baro)
        offset = solution.lla[:, 2] - np.interp(solution.time, imu.time[known], imu.baro[known])
        zero = float(np.median(offset))
        residual = offset - zero
        rms = float(np.sqrt(np.mean(residual**2)))
        if rms > LARGEST_HEIGHT_RMS:
            return None, Finding.of(Code.BAROMETER_POOR, rms_m=rms, limit_m=LARGEST_HEIGHT_RMS, zero_m=zero)
        sd = np.array([max(LEAST_HEIGHT_SD, time_correlated_sd(residual, first.step))])
        return cls(imu.time[known], imu.baro[known] + zero, sd), Finding.of(Code.BAROMETER_USED, rms_m=rms, zero_m=zero)


KNOWN_HEADING = 3.0 * DEG  # largest heading sd of the first pass for calibration [rad]
LARGEST_RMS = 10.0 * DEG  # of a useful heading; steel nearby makes more [rad]
LEAST_SD = 1.0 * DEG  # bridges, tram lines and other cars rotate the field by this much [rad]
FEWEST = 100  # rows for a calibration
# Vertical field and vertical hard iron differ only by body tilt: smaller singular values are dropped.
SINGULAR = 0.05


class Magnetometer(Heading):
    """Heading over time; hard iron and declination are calibrated by the headings of the first pass."""

    __slots__ = ()
    order: ClassVar[int] = 50
    name: ClassVar[str] = "magnetometer"
    # at a stop the field error is constant, not a series of independent errors
    excluded_by: ClassVar[frozenset[str]] = frozenset({"zupt"})

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """See `insnav.filter.measurements.measurement.Measurement`."""
        log = first.logs.get(cls.name)
        if log is None:
            return None, None
        solution = first.solution
        values = np.column_stack(list(log.values.values()))
        finite = np.isfinite(values).all(axis=1)
        seen = np.zeros(solution.time.shape[0], dtype=np.bool_)
        if finite.sum() >= FEWEST:
            seen = near_values(log.time[finite], solution.time)
        known = seen if solution.sd is None else seen & (solution.sd[:, 8] < KNOWN_HEADING)
        if known.sum() < FEWEST:
            return None, Finding.of(Code.MAGNETOMETER_FEW, count=known.sum(), limit_count=FEWEST)
        time, rph = solution.time[seen], solution.rph[seen]
        if "heading" in log.values:
            angle = np.unwrap(log.values["heading"][finite])
            heading, iron = np.interp(time, log.time[finite], angle), np.nan
        else:
            field_b = np.column_stack([np.interp(time, log.time[finite], column[finite]) for column in values.T])
            heading, iron = _from_field(field_b, rph, known[seen])
        offset = wrap_pi(rph[:, 2] - heading)[known[seen]]
        declination = float(np.arctan2(np.median(np.sin(offset)), np.median(np.cos(offset))))
        residual = wrap_pi(offset - declination)
        rms = float(np.sqrt(np.mean(residual**2)))
        code = Code.MAGNETOMETER_POOR if rms > LARGEST_RMS else Code.MAGNETOMETER_USED
        found = Finding.of(code, rms_rad=rms, limit_rad=LARGEST_RMS, declination_rad=declination, iron_share=iron)
        if rms > LARGEST_RMS:
            return None, found
        sd = np.array([max(LEAST_SD, time_correlated_sd(residual, first.step))])
        return cls(time, heading + declination, sd), found


def _from_field(field_b: FloatArray, rph: FloatArray, known: BoolArray) -> tuple[FloatArray, float]:
    """Return magnetic heading (n,) from the field in body axes (n, 3), and hard iron relative to the horizontal field.

    ``m_b = C_bn m_n + b`` with the constant field ``m_n`` and hard iron ``b`` is linear in both.
    """
    c_nb = dcm_from_rph(rph)
    some = c_nb[known]
    design = np.concatenate([np.swapaxes(some, 1, 2), np.broadcast_to(np.eye(3), some.shape)], axis=2).reshape(-1, 6)
    found = np.linalg.lstsq(design, field_b[known].reshape(-1), rcond=SINGULAR)[0]
    level = rph.copy()
    level[:, 2] = 0.0
    field = np.einsum("nij,nj->ni", dcm_from_rph(level), field_b - found[3:])
    share = float(np.hypot(*found[3:5]) / max(np.hypot(*found[:2]), 1e-12))
    return -np.arctan2(field[:, 1], field[:, 0]), share
