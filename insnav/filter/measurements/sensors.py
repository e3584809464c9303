"""Measurements of sensors and assumptions: stops, no sideways velocity, speed, heading, height, magnetometer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from insnav.alignment.in_motion import SLOWEST, Velocity
from insnav.alignment.static import WINDOW
from insnav.attitude import dcm_from_rph, wrap_pi
from insnav.filter.measurements import measurement
from insnav.filter.measurements.measurement import INTERVAL, LONGEST_GAP, NOTHING, FilterView, FirstPass
from insnav.findings import Code, Finding
from insnav.imu.specification import ImuSpec
from insnav.kernels.measurements import body_heading, vehicle_velocity, zero_velocity
from insnav.strapdown import nearest_rows
from insnav.tabular import runs_of
from insnav.types import BoolArray, FloatArray, ImuData
from insnav.units import DEG

STATIONARY, MOVING = 0.15, 1.0  # certainly stationary below, certainly moving above [m/s]
FALSE_STOPS = 0.002  # share of moving windows misclassified as stationary: a false ZUPT costs metres
FEWEST_STOPS = 0.5  # least share of detected stationary windows for a useful ZUPT
# Largest deviation of specific force from its median at rest [m/s^2]: a soft stop or start shakes no more below 1 m/s
STEADY = 0.05
VELOCITY_SD = 0.02  # of a stationary vehicle with a running engine [m/s]


@dataclass(frozen=True, slots=True)
class ZeroVelocity:
    """Velocity and angular rate against the Earth are zero."""

    stops: FloatArray  # (k, 2) begin and end of the stationary intervals [s]
    # (6,) standard deviation of the velocity [m/s] and of the mean gyro output over `INTERVAL` [rad/s]; infinite: rate
    # unused
    sd: FloatArray

    order: ClassVar[int] = 20
    name: ClassVar[str] = "zupt"
    unit: ClassVar[str] = "m/s, rad/s"
    excluded_by: ClassVar[frozenset[str]] = frozenset()

    def observe(self, at: FilterView, z: FloatArray, h: FloatArray) -> slice:
        """See `Measurement`."""
        row = int(np.searchsorted(self.stops[:, 0], at.begin, side="right")) - 1
        if row < 0 or at.time > float(self.stops[row, 1]):
            return NOTHING
        zero_velocity(at.x, at.correction[:3], at.mean_gyro, z, h)
        return slice(0, 6 if np.isfinite(self.sd).all() else 3)

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """See `Measurement`."""
        stops, rate_sd, note = find_stops(first.imu, first.speed, first.spec)
        return (cls(stops, np.array([*[VELOCITY_SD] * 3, *rate_sd])) if stops.size else None), note


def find_stops(imu: ImuData, speed: Velocity, spec: ImuSpec) -> tuple[FloatArray, FloatArray, Finding]:
    """Detect stationary intervals by the IMU alone; a speed signal determines the limits.

    Times are sample times.

    Returns: `stops` (k, 2): begin and end [s]; empty if standing and moving cannot be separated. `rate_sd` (3,):
    standard deviation of the mean gyro output over `INTERVAL` at a stop [rad/s]. Then a finding.
    """
    none = np.empty((0, 2))
    no_sd = np.full(3, np.inf)
    step = float(np.median(np.diff(imu.time)))
    size = max(4, round(WINDOW / step))
    n = imu.time.shape[0] // size
    if n < 20 or speed.time.shape[0] < 10:
        return none, no_sd, Finding.of(Code.ZUPT_SHORT)
    scale = 1.0 / step if imu.sampling == "increment" else 1.0
    blocks = [v[: n * size].reshape(n, size, 3) * scale for v in (imu.gyro, imu.accel)]
    begin, end = imu.time[: n * size : size] - step, imu.time[size - 1 : n * size : size]
    still, moving = _seen(speed, begin, end)
    if still.sum() < 10 or moving.sum() < 50:
        return none, no_sd, Finding.of(Code.ZUPT_UNSEEN)
    stationary = np.ones(n, dtype=bool)
    for feature in np.log([np.linalg.norm(b.std(axis=1), axis=1) + 1e-9 for b in blocks]):
        high, low = np.quantile(feature[still], 0.9), np.quantile(feature[moving], 0.01)
        if high < low:
            stationary &= feature < 0.5 * (high + low)
    wrong, right = float(np.mean(stationary[moving])), float(np.mean(stationary[still]))
    if stationary.all() or wrong > FALSE_STOPS or right < FEWEST_STOPS:
        return none, no_sd, Finding.of(Code.ZUPT_POOR, share=right, false_share=wrong, limit_false_share=FALSE_STOPS)
    force = blocks[1].mean(axis=1)
    for a, b in runs_of(stationary):
        stationary[a:b] = np.linalg.norm(force[a:b] - np.median(force[a:b], axis=0), axis=1) < STEADY
    # the first and the last window of a stop may contain braking or starting
    stops = np.array([[begin[a] + 0.5 * WINDOW, end[b - 1] - 0.5 * WINDOW] for a, b in runs_of(stationary)])
    stops = stops[stops[:, 1] - stops[:, 0] >= WINDOW]
    if not stops.size:
        return none, no_sd, Finding.of(Code.ZUPT_NONE)
    few = max(2, round(INTERVAL / step))
    quiet = blocks[0][still & stationary]
    means = quiet[:, : size // few * few].reshape(quiet.shape[0], -1, few, 3).mean(axis=2)
    # two means per window: the scatter about their common mean is smaller by the root of two
    scatter = (means - means.mean(axis=1, keepdims=True)).std(axis=(0, 1)) * np.sqrt(2.0)
    # doubled: people and wind sometimes move a stationary vehicle, which most windows do not contain
    rate_sd = 2.0 * np.hypot(scatter, spec.gyro.random_walk / np.sqrt(INTERVAL))
    total = float(np.sum(stops[:, 1] - stops[:, 0]))
    note = Finding.of(Code.ZUPT_USED, count=stops.shape[0], duration_s=total, share=right, false_share=wrong)
    return stops, rate_sd, note


def _seen(speed: Velocity, begin: FloatArray, end: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Find windows in which the vehicle is certainly stationary, and certainly moving."""
    fast = np.linalg.norm(speed.v_n, axis=1)
    margin = np.maximum(0.5, 0.6 * float(np.median(np.diff(speed.time))))
    first, last = np.searchsorted(speed.time, begin - margin), np.searchsorted(speed.time, end + margin)
    seen = last > first
    most = np.array([fast[a:b].max() if b > a else np.nan for a, b in zip(first, last, strict=True)])
    least = np.array([fast[a:b].min() if b > a else np.nan for a, b in zip(first, last, strict=True)])
    noise = 3.0 * float(np.median(speed.sd))
    return seen & (most < max(STATIONARY, noise)), seen & (least > max(MOVING, 2.0 * noise))


LEAST_VEHICLE_SD = 0.05  # suspension, tyre pressure and wheel slip keep every vehicle above this [m/s]


@dataclass(frozen=True, slots=True)
class NonHolonomic:
    """Zero velocity across the direction of travel, at a point on the unsteered axle."""

    to_vehicle: FloatArray  # (3, 3) rotation from IMU axes to vehicle axes
    lever_b: FloatArray  # (3,) the point seen from the IMU, body axes [m]
    sd: FloatArray  # (2,) standard deviation of the velocity to the right and down [m/s]

    order: ClassVar[int] = 90
    name: ClassVar[str] = "nhc"
    unit: ClassVar[str] = "m/s"
    excluded_by: ClassVar[frozenset[str]] = frozenset({"zupt"})

    def observe(self, at: FilterView, z: FloatArray, h: FloatArray) -> slice:
        """See `Measurement`; rows 1 and 2, since row 0 would be the forward speed."""
        if at.speed < SLOWEST:
            return NOTHING
        vehicle_velocity(at.x, at.rate, self.to_vehicle, self.lever_b, np.nan, z, h)
        return slice(1, 3)

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """See `Measurement`."""
        found = first.mounting
        if found is None:
            return None, Finding.of(
                Code.NHC_SLOW, duration_s=first.fast_time, limit_s=measurement.ENOUGH, speed_m_s=SLOWEST
            )
        # angles of the IMU in the vehicle, as everywhere: opposite in sign to `angles`
        (right, down), (pitch, yaw), (pitch_sd, yaw_sd) = found.rms, -found.angles, found.sd
        if max(found.rms) > measurement.LARGEST_RMS:
            return None, Finding.of(
                Code.NHC_LATERAL, lateral_m_s=right, vertical_m_s=down, limit_m_s=measurement.LARGEST_RMS
            )
        if not found.holds:
            return None, Finding.of(Code.NHC_TURNED, yaw_rad=yaw, pitch_rad=pitch, limit_rad=measurement.WIDEST)
        sd = np.maximum(
            LEAST_VEHICLE_SD, [measurement.time_correlated_sd(each, first.step) for each in (found.right, found.down)]
        )
        note = Finding.of(
            Code.NHC_USED,
            lateral_m_s=right,
            vertical_m_s=down,
            pitch_rad=pitch,
            pitch_sd_rad=pitch_sd,
            yaw_rad=yaw,
            yaw_sd_rad=yaw_sd,
            axle_m=found.lever_b[0],
        )
        return cls(found.to_vehicle, found.lever_b, sd), note


# Of a useful speed: the free-inertial error after tens of seconds. Where the first pass is worse, between fixes far
# apart, it calibrates none [m/s]
LARGEST_SPEED_RMS = 0.5
LAGS = np.arange(-0.2, 2.0, 0.02)  # odometer lag; buses and filters delay it by up to a second [s]
SCALES = (0.5, 2.0)  # plausible scale factors in the unit of the header
FEWEST = 100  # values for a calibration


@dataclass(frozen=True, slots=True)
class Odometer:
    """Forward speed of the point on the axle, over time."""

    time: FloatArray  # (n,) times [s] and speed corrected by the scale factor [m/s]
    speed: FloatArray
    to_vehicle: FloatArray  # (3, 3) as in `insnav.filter.measurements.sensors`
    lever_b: FloatArray
    sd: FloatArray  # (1,) standard deviation [m/s]

    order: ClassVar[int] = 30
    name: ClassVar[str] = "odometer"
    unit: ClassVar[str] = "m/s"
    excluded_by: ClassVar[frozenset[str]] = frozenset({"zupt"})

    def observe(self, at: FilterView, z: FloatArray, h: FloatArray) -> slice:
        """See `Measurement`."""
        row = int(np.clip(np.searchsorted(self.time, at.time), 1, self.time.shape[0] - 1))
        near = self.time[row] - self.time[row - 1] <= LONGEST_GAP and abs(self.time[row] - at.time) <= LONGEST_GAP
        if at.speed < SLOWEST or not near:
            return NOTHING
        speed = float(np.interp(at.time, self.time, self.speed))
        vehicle_velocity(at.x, at.rate, self.to_vehicle, self.lever_b, speed, z, h)
        return slice(0, 1)

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """See `Measurement`."""
        if first.imu.odometer is None or first.mounting is None or not first.mounting.holds:
            return None, None
        known = np.isfinite(first.imu.odometer)
        return cls.fitted(first, first.fast, first.imu.time[known], first.imu.odometer[known], LAGS)

    @classmethod
    def fitted(
        cls, first: FirstPass, rows: BoolArray, time: FloatArray, speed: FloatArray, lags: FloatArray
    ) -> tuple[Self | None, Finding]:
        """Fit scale factor and lag of a speed at `rows` of the solution: the best of all `lags` [s]."""
        if time.shape[0] < FEWEST:
            return None, Finding.of(Code.ODOMETER_FEW, subject=cls.name, count=time.shape[0], limit_count=FEWEST)
        assert first.mounting is not None
        at, forward = first.solution.time[rows], first.forward[rows]
        fits = []
        for lag in lags:
            shown = np.interp(at + lag, time, speed)
            scale = float(shown @ forward / max(float(shown @ shown), 1e-9))
            fits.append((float(np.sqrt(np.mean((forward - scale * shown) ** 2))), scale))
        best = int(np.argmin([rms for rms, _ in fits]))
        (rms, scale), lag = fits[best], float(lags[best])
        code = Code.ODOMETER_USED if SCALES[0] < scale < SCALES[1] else Code.ODOMETER_SCALE
        code = Code.ODOMETER_POOR if rms > LARGEST_SPEED_RMS else code
        found = Finding.of(code, subject=cls.name, rms_m_s=rms, limit_m_s=LARGEST_SPEED_RMS, lag_s=lag, scale=scale)
        if code is not Code.ODOMETER_USED:
            return None, found
        residual = forward - scale * np.interp(at + lag, time, speed)
        sd = np.array([max(LEAST_VEHICLE_SD, measurement.time_correlated_sd(residual, first.step))])
        return cls(time - lag, scale * speed, first.mounting.to_vehicle, first.mounting.lever_b, sd), found


LOG_LAGS = np.arange(-1.0, 1.0, 0.02)  # around the offset by correlation [s]


MOST_OUTLIERS = 0.15  # a log with a larger share of speeds that contradict the drive is not used
OUTLIER, LEAST_OUTLIER = 4.0, 1.0  # standard deviations, and [m/s], from which a speed is excluded from calibration


class Speedometer(Odometer):
    """Forward speed from a log; clock offset, lag and scale factor are calibrated from the drive."""

    __slots__ = ()
    order: ClassVar[int] = 40
    name: ClassVar[str] = "speedometer"

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """Calibrate a speed log by the forward speed: clock offset, outliers, lag and scale factor."""
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
        offset = measurement.clock_offset(first.solution.time, horizontal, time, speed)
        if offset is None:
            return None, Finding.of(Code.SPEEDOMETER_CLOCK)
        sd = first.solution.sd
        sure = first.fast if sd is None else first.fast & (np.hypot(sd[:, 3], sd[:, 4]) < LARGEST_SPEED_RMS)
        rows = sure & measurement.near_values(time - offset, first.solution.time)
        if rows.sum() < FEWEST:
            return None, Finding.of(Code.SPEEDOMETER_UNKNOWN, count=rows.sum(), limit_count=FEWEST)
        shown = np.interp(first.solution.time + offset, time, speed)
        wrong = _outliers(first.forward, shown, rows)
        if (share := float(wrong.sum() / rows.sum())) > MOST_OUTLIERS:
            return None, Finding.of(Code.SPEEDOMETER_OUTLIERS, share=share, limit_share=MOST_OUTLIERS)
        rows &= ~_spread(wrong, round(2.0 * LOG_LAGS[-1] / first.step))  # the longest lag before and after each
        found, note = cls.fitted(first, rows, time, speed, offset + LOG_LAGS)
        if found is not None and "sd" in log.values:
            reported = float(np.nanmedian(log.values["sd"][known]))
            found = cls(found.time, found.speed, found.to_vehicle, found.lever_b, np.fmax(found.sd, reported))
        return found, note


def _outliers(forward: FloatArray, shown: FloatArray, rows: BoolArray) -> BoolArray:
    """Find speeds that do not fit a common scale factor."""
    factor = float(np.median(forward[rows] / np.maximum(shown[rows], SLOWEST)))
    residual = np.abs(forward - factor * shown)
    return np.asarray(rows & (residual > max(LEAST_OUTLIER, OUTLIER * 1.4826 * float(np.median(residual[rows])))))


def _spread(wrong: BoolArray, rows: int) -> BoolArray:
    """Extend outliers by half of `rows` rows on both sides: any lag is tried."""
    return np.asarray(np.convolve(wrong, np.ones(rows + 1), mode="same") > 0.5)


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
        sd = np.array([max(LEAST_HEIGHT_SD, measurement.time_correlated_sd(residual, first.step))])
        return cls(imu.time[known], imu.baro[known] + zero, sd), Finding.of(Code.BAROMETER_USED, rms_m=rms, zero_m=zero)


LARGEST_RMS = 10.0 * DEG  # of a useful heading; steel nearby makes more. A worse first pass calibrates none [rad]
LEAST_SD = 1.0 * DEG  # bridges, tram lines and other cars rotate the field by this much [rad]
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
            seen = measurement.near_values(log.time[finite], solution.time)
        known = seen if solution.sd is None else seen & (solution.sd[:, 8] < LARGEST_RMS)
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
        sd = np.array([max(LEAST_SD, measurement.time_correlated_sd(residual, first.step))])
        return cls(time, heading + declination, sd), found


def _from_field(field_b: FloatArray, rph: FloatArray, known: BoolArray) -> tuple[FloatArray, float]:
    """Return magnetic heading (n,) from the field in body axes (n, 3), and hard iron relative to the horizontal field.

    ``m_b = C_bn m_n + b`` with the constant field ``m_n`` and hard iron ``b`` is linear in both.
    """
    some = dcm_from_rph(rph)[known]
    design = np.concatenate([np.swapaxes(some, 1, 2), np.broadcast_to(np.eye(3), some.shape)], axis=2).reshape(-1, 6)
    found = np.linalg.lstsq(design, field_b[known].reshape(-1), rcond=SINGULAR)[0]
    level = rph.copy()
    level[:, 2] = 0.0
    field = np.einsum("nij,nj->ni", dcm_from_rph(level), field_b - found[3:])
    share = float(np.hypot(*found[3:5]) / max(np.hypot(*found[:2]), 1e-12))
    return -np.arctan2(field[:, 1], field[:, 0]), share
