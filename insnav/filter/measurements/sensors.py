"""Aiding measurements: zero velocity at stops, non-holonomic constraint, speed, heading, height, magnetometer."""

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

STATIONARY, MOVING = 0.15, 1.0  # upper limit of a certainly stationary, lower limit of a certainly moving speed [m/s]
FALSE_STOPS = 0.002  # largest share of moving windows classified as stationary: a false ZUPT causes metres of error
FEWEST_STOPS = 0.5  # least share of stationary windows that must be detected for a useful ZUPT
# Largest deviation of specific force from its median in a stop: soft stops and starts hardly vibrate [m/s^2]
STEADY = 0.05
VELOCITY_SD = 0.02  # velocity sd of a stationary vehicle with a running engine [m/s]


@dataclass(frozen=True, slots=True)
class ZeroVelocity:
    """Zero-velocity update: at a stop, velocity and angular rate relative to the Earth are zero."""

    stops: FloatArray  # (k, 2) begin and end of the stationary intervals [s]
    # (6,) sd of the velocity [m/s] and of the mean gyro output over `INTERVAL` [rad/s]; infinite: rate not used
    sd: FloatArray

    order: ClassVar[int] = 20
    name: ClassVar[str] = "zupt"
    unit: ClassVar[str] = "m/s, rad/s"
    excluded_by: ClassVar[frozenset[str]] = frozenset()

    def observe(self, at: FilterView, z: FloatArray, h: FloatArray) -> slice:
        """Compare velocity and angular rate with zero during a stop; see `Measurement.observe`."""
        row = int(np.searchsorted(self.stops[:, 0], at.begin, side="right")) - 1
        if row < 0 or at.time > float(self.stops[row, 1]):
            return NOTHING
        zero_velocity(at.x, at.correction[:3], at.mean_gyro, z, h)
        return slice(0, 6 if np.isfinite(self.sd).all() else 3)

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """Detect the stops of the drive; see `Measurement.from_drive`."""
        stops, rate_sd, note = find_stops(first.imu, first.speed, first.spec)
        return (cls(stops, np.array([*[VELOCITY_SD] * 3, *rate_sd])) if stops.size else None), note


def find_stops(imu: ImuData, speed: Velocity, spec: ImuSpec) -> tuple[FloatArray, FloatArray, Finding]:
    """Detect stationary intervals from IMU vibration. A speed signal determines the limits of vibration for this drive.

    Returns: `stops` (k, 2): begin and end in sample time [s]; empty if vibration does not separate stops from motion.
    `rate_sd` (3,): standard deviation of the mean gyro output over `INTERVAL` at a stop [rad/s]. Then a finding.
    """
    none = np.empty((0, 2))
    no_sd = np.full(3, np.inf)
    step = float(np.median(np.diff(imu.time)))
    size = max(4, round(WINDOW / step))
    number = imu.time.shape[0] // size
    if number < 20 or speed.time.shape[0] < 10:
        return none, no_sd, Finding.of(Code.ZUPT_SHORT)
    scale = 1.0 / step if imu.sampling == "increment" else 1.0
    blocks = [v[: number * size].reshape(number, size, 3) * scale for v in (imu.gyro, imu.accel)]
    begin, end = imu.time[: number * size : size] - step, imu.time[size - 1 : number * size : size]
    still, moving = _seen(speed, begin, end)
    if still.sum() < 10 or moving.sum() < 50:
        return none, no_sd, Finding.of(Code.ZUPT_UNSEEN)
    stationary = np.ones(number, dtype=bool)
    for feature in np.log([np.linalg.norm(b.std(axis=1), axis=1) + 1e-9 for b in blocks]):
        high, low = np.quantile(feature[still], 0.9), np.quantile(feature[moving], 0.01)
        if high < low:
            stationary &= feature < 0.5 * (high + low)
    wrong, share = float(np.mean(stationary[moving])), float(np.mean(stationary[still]))
    if stationary.all() or wrong > FALSE_STOPS or share < FEWEST_STOPS:
        return none, no_sd, Finding.of(Code.ZUPT_POOR, share=share, false_share=wrong, limit_false_share=FALSE_STOPS)
    force = blocks[1].mean(axis=1)
    for a, b in runs_of(stationary):
        stationary[a:b] = np.linalg.norm(force[a:b] - np.median(force[a:b], axis=0), axis=1) < STEADY
    # shorten each stop by half a window on both sides, which may contain braking or starting
    stops = np.array([[begin[a] + 0.5 * WINDOW, end[b - 1] - 0.5 * WINDOW] for a, b in runs_of(stationary)])
    stops = stops[stops[:, 1] - stops[:, 0] >= WINDOW]
    if not stops.size:
        return none, no_sd, Finding.of(Code.ZUPT_NONE)
    block_size = max(2, round(INTERVAL / step))
    gyro = blocks[0][still & stationary]
    means = gyro[:, : size // block_size * block_size].reshape(gyro.shape[0], -1, block_size, 3).mean(axis=2)
    # correct for two means per window: their scatter about the common mean is smaller by the root of two
    scatter = (means - means.mean(axis=1, keepdims=True)).std(axis=(0, 1)) * np.sqrt(2.0)
    # twice the scatter: people and wind sometimes move a stationary vehicle, in few of these windows
    rate_sd = 2.0 * np.hypot(scatter, spec.gyro.random_walk / np.sqrt(INTERVAL))
    total = float(np.sum(stops[:, 1] - stops[:, 0]))
    note = Finding.of(Code.ZUPT_USED, count=stops.shape[0], duration_s=total, share=share, false_share=wrong)
    return stops, rate_sd, note


def _seen(speed: Velocity, begin: FloatArray, end: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Find the windows in which the vehicle is certainly stationary, and the windows in which it certainly moves."""
    fast = np.linalg.norm(speed.v_n, axis=1)
    margin = np.maximum(0.5, 0.6 * float(np.median(np.diff(speed.time))))
    begin_row, end_row = np.searchsorted(speed.time, begin - margin), np.searchsorted(speed.time, end + margin)
    has_speed = end_row > begin_row
    fastest = np.array([fast[a:b].max() if b > a else np.nan for a, b in zip(begin_row, end_row, strict=True)])
    slowest = np.array([fast[a:b].min() if b > a else np.nan for a, b in zip(begin_row, end_row, strict=True)])
    noise = 3.0 * float(np.median(speed.sd))
    return has_speed & (fastest < max(STATIONARY, noise)), has_speed & (slowest > max(MOVING, 2.0 * noise))


LEAST_VEHICLE_SD = 0.05  # least sd of vehicle velocities: suspension, tyre pressure and wheel slip [m/s]


@dataclass(frozen=True, slots=True)
class NonHolonomic:
    """Non-holonomic constraint: no lateral and no vertical velocity at a point on the unsteered axle."""

    to_vehicle: FloatArray  # (3, 3) rotation from IMU axes to vehicle axes
    lever_b: FloatArray  # (3,) the point seen from the IMU, body axes [m]
    sd: FloatArray  # (2,) standard deviation of the velocity to the right and down [m/s]

    order: ClassVar[int] = 90
    name: ClassVar[str] = "nhc"
    unit: ClassVar[str] = "m/s"
    excluded_by: ClassVar[frozenset[str]] = frozenset({"zupt"})

    def observe(self, at: FilterView, z: FloatArray, h: FloatArray) -> slice:
        """See `Measurement`. Rows 1 and 2 are lateral and vertical; row 0, the forward speed, is not used."""
        if at.speed < SLOWEST:
            return NOTHING
        vehicle_velocity(at.x, at.rate, self.to_vehicle, self.lever_b, np.nan, z, h)
        return slice(1, 3)

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """Estimate the vehicle axes and the sd of the constraint; see `Measurement.from_drive`."""
        axes = first.mounting
        if axes is None:
            return None, Finding.of(
                Code.NHC_SLOW, duration_s=first.fast_time, limit_s=measurement.ENOUGH, speed_m_s=SLOWEST
            )
        # report angles of the IMU in the vehicle, which have the opposite sign of `angles`
        (right, down), (pitch, yaw), (pitch_sd, yaw_sd) = axes.rms, -axes.angles, axes.sd
        if max(axes.rms) > measurement.LARGEST_RMS:
            return None, Finding.of(
                Code.NHC_LATERAL, lateral_m_s=right, vertical_m_s=down, limit_m_s=measurement.LARGEST_RMS
            )
        if not axes.holds:
            return None, Finding.of(Code.NHC_TURNED, yaw_rad=yaw, pitch_rad=pitch, limit_rad=measurement.WIDEST)
        sd = np.maximum(
            LEAST_VEHICLE_SD, [measurement.time_correlated_sd(each, first.step) for each in (axes.right, axes.down)]
        )
        note = Finding.of(
            Code.NHC_USED,
            lateral_m_s=right,
            vertical_m_s=down,
            pitch_rad=pitch,
            pitch_sd_rad=pitch_sd,
            yaw_rad=yaw,
            yaw_sd_rad=yaw_sd,
            axle_m=axes.lever_b[0],
        )
        return cls(axes.to_vehicle, axes.lever_b, sd), note


# Largest RMS error of a useful speed: the free-inertial error after tens of seconds [m/s]. Where the velocity sd of the
# first pass is larger, between sparse fixes, rows are not used for calibration
LARGEST_SPEED_RMS = 0.5
LAGS = np.arange(-0.2, 2.0, 0.02)  # tested lags of the odometer: data buses and filters delay it by up to a second [s]
SCALES = (0.5, 2.0)  # plausible scale factors, if the unit is as in the header [-]
FEWEST = 100  # least number of values for a calibration


@dataclass(frozen=True, slots=True)
class Odometer:
    """Forward speed of a point on the unsteered axle, as recorded by an odometer."""

    time: FloatArray  # (n,) times [s] and speed corrected by the scale factor [m/s]
    speed: FloatArray
    to_vehicle: FloatArray  # (3, 3), and point on the axle (3,) [m], as in `NonHolonomic`
    lever_b: FloatArray
    sd: FloatArray  # (1,) standard deviation of the speed [m/s]

    order: ClassVar[int] = 30
    name: ClassVar[str] = "odometer"
    unit: ClassVar[str] = "m/s"
    excluded_by: ClassVar[frozenset[str]] = frozenset({"zupt"})

    def observe(self, at: FilterView, z: FloatArray, h: FloatArray) -> slice:
        """Compare the forward speed with the recorded speed; see `Measurement.observe`."""
        row = int(np.clip(np.searchsorted(self.time, at.time), 1, self.time.shape[0] - 1))
        close = self.time[row] - self.time[row - 1] <= LONGEST_GAP and abs(self.time[row] - at.time) <= LONGEST_GAP
        if at.speed < SLOWEST or not close:
            return NOTHING
        speed = float(np.interp(at.time, self.time, self.speed))
        vehicle_velocity(at.x, at.rate, self.to_vehicle, self.lever_b, speed, z, h)
        return slice(0, 1)

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """Calibrate the odometer column of the IMU file; see `Measurement.from_drive`."""
        if first.imu.odometer is None or first.mounting is None or not first.mounting.holds:
            return None, None
        rows = np.isfinite(first.imu.odometer)
        return cls.fitted(first, first.fast, first.imu.time[rows], first.imu.odometer[rows], LAGS)

    @classmethod
    def fitted(
        cls, first: FirstPass, rows: BoolArray, time: FloatArray, speed: FloatArray, lags: FloatArray
    ) -> tuple[Self | None, Finding]:
        """Fit scale factor and lag of a recorded speed at `rows` of the solution. The best of `lags` [s] is used."""
        if time.shape[0] < FEWEST:
            return None, Finding.of(Code.ODOMETER_FEW, subject=cls.name, count=time.shape[0], limit_count=FEWEST)
        assert first.mounting is not None
        at_rows, forward = first.solution.time[rows], first.forward[rows]
        fits = []
        for lag in lags:
            recorded = np.interp(at_rows + lag, time, speed)
            scale = float(recorded @ forward / max(float(recorded @ recorded), 1e-9))
            fits.append((float(np.sqrt(np.mean((forward - scale * recorded) ** 2))), scale))
        best = int(np.argmin([rms for rms, _ in fits]))
        (rms, scale), lag = fits[best], float(lags[best])
        code = Code.ODOMETER_USED if SCALES[0] < scale < SCALES[1] else Code.ODOMETER_SCALE
        code = Code.ODOMETER_POOR if rms > LARGEST_SPEED_RMS else code
        finding = Finding.of(code, subject=cls.name, rms_m_s=rms, limit_m_s=LARGEST_SPEED_RMS, lag_s=lag, scale=scale)
        if code is not Code.ODOMETER_USED:
            return None, finding
        residual = forward - scale * np.interp(at_rows + lag, time, speed)
        sd = np.array([max(LEAST_VEHICLE_SD, measurement.time_correlated_sd(residual, first.step))])
        return cls(time - lag, scale * speed, first.mounting.to_vehicle, first.mounting.lever_b, sd), finding


LOG_LAGS = np.arange(-1.0, 1.0, 0.02)  # tested lags around the clock offset by correlation [s]


MOST_OUTLIERS = 0.15  # largest share of speeds that contradict the drive, in a log that is used [-]
OUTLIER, LEAST_OUTLIER = 4.0, 1.0  # least error, in sd and in [m/s], of a speed that is excluded from calibration


class Speedometer(Odometer):
    """Forward speed from a separate log. Clock offset, lag and scale factor are calibrated from the drive."""

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
        finite = np.isfinite(log.values["speed"])
        if finite.sum() < FEWEST:
            return None, Finding.of(Code.ODOMETER_FEW, subject=cls.name, count=finite.sum(), limit_count=FEWEST)
        time, speed = log.time[finite], log.values["speed"][finite]
        horizontal = np.hypot(*first.solution.v_n[:, :2].T)
        offset = measurement.clock_offset(first.solution.time, horizontal, time, speed)
        if offset is None:
            return None, Finding.of(Code.SPEEDOMETER_CLOCK)
        sd = first.solution.sd
        reliable = first.fast if sd is None else first.fast & (np.hypot(sd[:, 3], sd[:, 4]) < LARGEST_SPEED_RMS)
        rows = reliable & measurement.near_values(time - offset, first.solution.time)
        if rows.sum() < FEWEST:
            return None, Finding.of(Code.SPEEDOMETER_UNKNOWN, count=rows.sum(), limit_count=FEWEST)
        recorded = np.interp(first.solution.time + offset, time, speed)
        outliers = _outliers(first.forward, recorded, rows)
        if (share := float(outliers.sum() / rows.sum())) > MOST_OUTLIERS:
            return None, Finding.of(Code.SPEEDOMETER_OUTLIERS, share=share, limit_share=MOST_OUTLIERS)
        rows &= ~_spread(outliers, round(2.0 * LOG_LAGS[-1] / first.step))  # and rows less than a lag away
        fit, note = cls.fitted(first, rows, time, speed, offset + LOG_LAGS)
        if fit is not None and "sd" in log.values:
            reported = float(np.nanmedian(log.values["sd"][finite]))
            fit = cls(fit.time, fit.speed, fit.to_vehicle, fit.lever_b, np.fmax(fit.sd, reported))
        return fit, note


def _outliers(forward: FloatArray, shown: FloatArray, rows: BoolArray) -> BoolArray:
    """Find speeds among `rows` that do not fit a common scale factor."""
    factor = float(np.median(forward[rows] / np.maximum(shown[rows], SLOWEST)))
    residual = np.abs(forward - factor * shown)
    return np.asarray(rows & (residual > max(LEAST_OUTLIER, OUTLIER * 1.4826 * float(np.median(residual[rows])))))


def _spread(wrong: BoolArray, rows: int) -> BoolArray:
    """Extend each outlier by half of `rows` rows on both sides."""
    return np.asarray(np.convolve(wrong, np.ones(rows + 1), mode="same") > 0.5)


@dataclass(frozen=True, slots=True)
class Heading:
    """Heading measured with the fixes."""

    time: FloatArray  # (n,) times [s] and heading [rad]; ``NaN`` where unknown
    heading: FloatArray
    sd: FloatArray  # (1,) standard deviation of the heading [rad]

    order: ClassVar[int] = 0
    name: ClassVar[str] = "heading"
    unit: ClassVar[str] = "rad"
    excluded_by: ClassVar[frozenset[str]] = frozenset()

    def observe(self, at: FilterView, z: FloatArray, h: FloatArray) -> slice:
        """Compare the heading with the recorded heading nearest in time; see `Measurement.observe`."""
        row = int(nearest_rows(self.time, at.time))
        if not abs(self.time[row] - at.time) < 0.5 * INTERVAL or not np.isfinite(self.heading[row]):
            return NOTHING
        body_heading(at.x, float(self.heading[row]), z, h)
        return slice(0, 1)

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """Return no measurement: the user specifies the accuracy, and the first pass already uses the heading."""
        return None, None


LARGEST_HEIGHT_RMS = 20.0  # largest RMS error of a barometer: with more, the column has another content or unit [m]
LEAST_HEIGHT_SD = 0.3  # least height sd: wind and doors change the pressure by this much [m]


@dataclass(frozen=True, slots=True)
class HeightAiding:
    """Height as a function of time, constant before the first and after the last value."""

    time: FloatArray  # (n,) times [s] and height above the ellipsoid [m]
    height: FloatArray
    sd: FloatArray  # (1,) standard deviation of the height [m]

    order: ClassVar[int] = 10
    name: ClassVar[str] = "height"
    unit: ClassVar[str] = "m"
    excluded_by: ClassVar[frozenset[str]] = frozenset()

    def observe(self, at: FilterView, z: FloatArray, h: FloatArray) -> slice:
        """Compare the height with the recorded height; see `Measurement.observe`."""
        h[0] = 0.0
        h[0, 2] = -1.0  # height is the negative of the position component down
        z[0] = at.x[2] - float(np.interp(at.time, self.time, self.height))
        return slice(0, 1)

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """Calibrate the barometer by the heights of the first pass; see `Measurement.from_drive`."""
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


LARGEST_RMS = 10.0 * DEG  # largest RMS error of a useful heading [rad], and sd of headings to calibrate it
LEAST_SD = 1.0 * DEG  # least heading sd: bridges, tram lines and other cars rotate the field this much [rad]
# Relative limit of singular values: only tilt of the vehicle separates vertical field from vertical hard iron [-]
SINGULAR = 0.05


class Magnetometer(Heading):
    """Heading from a magnetometer. The headings of the first pass calibrate hard iron and declination."""

    __slots__ = ()
    order: ClassVar[int] = 50
    name: ClassVar[str] = "magnetometer"
    # no use at a stop, where the field error is constant and not a series of independent errors
    excluded_by: ClassVar[frozenset[str]] = frozenset({"zupt"})

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """Calibrate hard iron, declination and sd of a magnetometer log; see `Measurement.from_drive`."""
        log = first.logs.get(cls.name)
        if log is None:
            return None, None
        solution = first.solution
        values = np.column_stack(list(log.values.values()))
        finite = np.isfinite(values).all(axis=1)
        has_data = np.zeros(solution.time.shape[0], dtype=np.bool_)
        if finite.sum() >= FEWEST:
            has_data = measurement.near_values(log.time[finite], solution.time)
        reliable = has_data if solution.sd is None else has_data & (solution.sd[:, 8] < LARGEST_RMS)
        if reliable.sum() < FEWEST:
            return None, Finding.of(Code.MAGNETOMETER_FEW, count=reliable.sum(), limit_count=FEWEST)
        time, rph = solution.time[has_data], solution.rph[has_data]
        if "heading" in log.values:
            angle = np.unwrap(log.values["heading"][finite])
            heading, iron = np.interp(time, log.time[finite], angle), np.nan
        else:
            field_b = np.column_stack([np.interp(time, log.time[finite], column[finite]) for column in values.T])
            heading, iron = _from_field(field_b, rph, reliable[has_data])
        offset = wrap_pi(rph[:, 2] - heading)[reliable[has_data]]
        declination = float(np.arctan2(np.median(np.sin(offset)), np.median(np.cos(offset))))
        residual = wrap_pi(offset - declination)
        rms = float(np.sqrt(np.mean(residual**2)))
        code = Code.MAGNETOMETER_POOR if rms > LARGEST_RMS else Code.MAGNETOMETER_USED
        finding = Finding.of(code, rms_rad=rms, limit_rad=LARGEST_RMS, declination_rad=declination, iron_share=iron)
        if rms > LARGEST_RMS:
            return None, finding
        sd = np.array([max(LEAST_SD, measurement.time_correlated_sd(residual, first.step))])
        return cls(time, heading + declination, sd), finding


def _from_field(field_b: FloatArray, rph: FloatArray, known: BoolArray) -> tuple[FloatArray, float]:
    """Compute magnetic heading (n,) from the field in body axes (n, 3), and hard iron relative to the horizontal field.

    Least squares at `known` rows give the constant field ``m_n`` and the hard iron ``b`` of ``m_b = C_bn m_n + b``.
    """
    c_nb = dcm_from_rph(rph)[known]
    design = np.concatenate([np.swapaxes(c_nb, 1, 2), np.broadcast_to(np.eye(3), c_nb.shape)], axis=2).reshape(-1, 6)
    solution = np.linalg.lstsq(design, field_b[known].reshape(-1), rcond=SINGULAR)[0]
    level = rph.copy()
    level[:, 2] = 0.0
    field = np.einsum("nij,nj->ni", dcm_from_rph(level), field_b - solution[3:])
    share = float(np.hypot(*solution[3:5]) / max(np.hypot(*solution[:2]), 1e-12))
    return -np.arctan2(field[:, 1], field[:, 0]), share
