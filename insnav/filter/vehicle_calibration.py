"""What a drive tells about its vehicle: how the IMU sits in it, whether its wheels slip, when it stands.

The smoothed solution of a first pass has the velocity in the axes of the IMU. A vehicle on wheels moves along one of
its own axes: the direction of that axis in the IMU, and how well the rest is zero, follow by least squares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.alignment import in_motion as motion
from insnav.attitude import dcm_from_rph
from insnav.filter.aiding import INTERVAL, Aiding, HeightAid, Odometer, Wheels
from insnav.imu.specification import ImuSpec
from insnav.types import BoolArray, FloatArray, GpsData, ImuData, Trajectory
from insnav.units import DEG

FAST = 2.0  # velocity whose direction counts [m/s]
ENOUGH = 60.0  # time at such speeds that is needed [s]
LARGEST = 0.3  # velocity across the direction of travel that wheels may show, RMS [m/s]
LEAST_SD = 0.05  # nobody drives straighter [m/s]
MOST_LASTING = 3.0  # residuals that last count as noise so many times larger
WIDEST = 45.0 * DEG  # an IMU that points farther from the direction of travel was not meant to point there
LONGEST_LAG = 2.0  # of a wheel speed behind the motion [s]
ODOMETER_WORTH = 0.5  # RMS of a wheel speed that is of use [m/s]
BARO_WORTH, BARO_LEAST = 20.0, 0.3  # RMS of a barometer that is of use, and the least of its noise [m]
WINDOW = 0.5  # length of the pieces that are judged to be rest [s]
STILL, MOVING = 0.15, 1.0  # speed by GPS that surely is rest, or motion [m/s]
FALSE_REST = 0.002  # share of moving pieces that may be taken for rest
REST_SD = 0.02  # velocity of a vehicle that stands with its engine running [m/s]


@dataclass(frozen=True, slots=True)
class Learned:
    """What helps a filter on this drive, and what was found of the vehicle.

    Attributes
    ----------
    aiding : Aiding
        For the settings of the filter.
    mount : (2,) array
        Pitch and yaw of the direction of travel in the axes of the IMU [rad]; ``NaN`` if not found.
    mount_sd : (2,) array
        Their standard deviations [rad].
    notes : tuple of str
        In words.
    """

    aiding: Aiding
    mount: FloatArray
    mount_sd: FloatArray
    notes: tuple[str, ...]


def learn(solution: Trajectory, imu: ImuData, gps: GpsData, spec: ImuSpec) -> Learned:
    """Find out what helps besides fixes.

    Parameters
    ----------
    solution : Trajectory
        Smoothed, in the time of the samples, at several rows a second.
    imu : ImuData
        Samples.
    gps : GpsData
        Fixes, in the time of the samples.
    spec : ImuSpec
        How good the sensors are.

    Returns
    -------
    Learned
        Nothing is in it that the data do not support.
    """
    stretches, rate_sd, rest_note = rests(imu, gps, spec)
    height, height_note = barometer(solution, imu)
    v_b = np.einsum("nji,nj->ni", dcm_from_rph(solution.rph), solution.v_n)
    fast = np.linalg.norm(solution.v_n, axis=1) > FAST
    step = float(np.median(np.diff(solution.time))) if solution.time.shape[0] > 1 else INTERVAL
    unknown = np.full(2, np.nan)
    if fast.sum() * step < ENOUGH:
        note = f"wheels: not assumed, only {fast.sum() * step:.0f} s are faster than {FAST:g} m/s"
        aiding = Aiding(None, None, stretches, REST_SD, rate_sd, height)
        return Learned(aiding, unknown, unknown, (note, rest_note, *height_note))
    rate = _rates_at(solution.time, imu)
    right, right_residual, right_sd = _robust(
        np.column_stack([v_b[:, 0], -rate[:, 2], rate[:, 0]])[fast], v_b[fast, 1], step
    )
    down, down_residual, down_sd = _robust(
        np.column_stack([v_b[:, 0], rate[:, 1], -rate[:, 0]])[fast], v_b[fast, 2], step
    )
    mount = np.array([-np.arctan(down[0]), np.arctan(right[0])])
    mount_sd = np.array([down_sd, right_sd])
    rms = [float(np.sqrt(np.mean(each**2))) for each in (right_residual, down_residual)]
    found = f"across the direction of travel the velocity is {rms[0]:.2f} m/s (right) and {rms[1]:.2f} m/s (down) RMS"
    if max(rms) > LARGEST or np.abs(mount).max() > WIDEST:
        notes = (f"wheels: not assumed, {found}", rest_note, *height_note)
        return Learned(Aiding(None, None, stretches, REST_SD, rate_sd, height), mount, mount_sd, notes)
    ahead = np.array([1.0, right[0], down[0]])
    ahead /= np.linalg.norm(ahead)
    side = np.cross([0.0, 0.0, 1.0], ahead)
    side /= np.linalg.norm(side)
    sd = np.array([_lasting(each, step) for each in (right_residual, down_residual)])
    wheels = Wheels(np.array([ahead, side, np.cross(ahead, side)]), np.array([right[1], 0.0, 0.0]), sd)
    pitch, yaw = mount / DEG
    said = (
        f"wheels: {found}; it points {pitch:.2f} ± {mount_sd[0] / DEG:.2f} deg up and {yaw:.2f} ± "
        f"{mount_sd[1] / DEG:.2f} deg to the right of the IMU, whose distance to the axle is {-right[1]:.1f} m"
    )
    odometer, odometer_note = _odometer(solution, imu, v_b @ ahead, fast)
    aiding = Aiding(wheels, odometer, stretches, REST_SD, rate_sd, height)
    return Learned(aiding, mount, mount_sd, (said, *odometer_note, rest_note, *height_note))


def _rates_at(time: FloatArray, imu: ImuData) -> FloatArray:
    """Angular rate at the rows of a solution, mean over about a tenth of a second [rad/s]."""
    step = np.gradient(imu.time)[:, None]
    turned = np.cumsum(imu.gyro if imu.sampling == "increment" else imu.gyro * step, axis=0)
    half = 0.05
    at = [np.column_stack([np.interp(time + s * half, imu.time, turned[:, i]) for i in range(3)]) for s in (-1.0, 1.0)]
    return np.asarray((at[1] - at[0]) / (2.0 * half))


def _robust(design: FloatArray, values: FloatArray, step: float) -> tuple[FloatArray, FloatArray, float]:
    """Least squares with Huber's weights; solution, residuals and standard deviation of the first parameter.

    P. J. Huber, Robust Statistics, 1981, chapter 7. Residuals last: so many rows count as one as the residuals are
    alike.
    """
    weight = np.ones(values.shape[0])
    found: FloatArray = np.zeros(design.shape[1])
    residual: FloatArray = values.copy()
    for _ in range(10):
        found[:] = np.linalg.lstsq(design * weight[:, None], values * weight, rcond=None)[0]
        residual[:] = values - design @ found
        scale = 1.4826 * float(np.median(np.abs(residual))) or 1.0
        weight = np.sqrt(np.minimum(1.0, 1.5 * scale / np.maximum(np.abs(residual), 1e-12)))
    covariance = np.linalg.inv((design * weight[:, None] ** 2).T @ design) * float(np.mean((weight * residual) ** 2))
    alike = _sum_of_correlations(residual, max(1, round(INTERVAL / step))) * max(1, round(INTERVAL / step))
    return found, residual, float(np.sqrt(covariance[0, 0] * alike))


def _sum_of_correlations(residual: FloatArray, stride: int) -> float:
    """``1 + 2 sum rho_k`` over lags of `stride` rows, up to the first that is not positive."""
    r = residual[::stride]
    power = float(np.mean(r * r)) or 1.0
    total = 1.0
    for lag in range(1, min(r.shape[0] // 3, 400)):
        rho = float(np.mean(r[lag:] * r[:-lag])) / power
        if rho <= 0.05:
            break
        total += 2.0 * rho
    return total


def _lasting(residual: FloatArray, step: float) -> float:
    """Standard deviation of noise, new every `INTERVAL`, that averages out as slowly as a residual does."""
    rms = float(np.sqrt(np.mean(residual**2)))
    alike = _sum_of_correlations(residual, max(1, round(INTERVAL / step)))
    return max(LEAST_SD, rms * min(MOST_LASTING, float(np.sqrt(alike))))


def _odometer(
    solution: Trajectory, imu: ImuData, forward: FloatArray, fast: BoolArray
) -> tuple[Odometer | None, tuple[str, ...]]:
    """Scale factor and lag of the wheel speed."""
    if imu.odometer is None:
        return None, ()
    known = np.isfinite(imu.odometer)
    if known.sum() < 100:
        return None, ("wheel speed: too few values",)
    time, speed = imu.time[known], imu.odometer[known]
    lags = np.arange(-0.2, LONGEST_LAG, 0.02)
    fits = []
    for lag in lags:
        shown = np.interp(solution.time[fast] + lag, time, speed)
        scale = float(shown @ forward[fast] / max(float(shown @ shown), 1e-9))
        fits.append((float(np.sqrt(np.mean((forward[fast] - scale * shown) ** 2))), scale))
    best = int(np.argmin([rms for rms, _ in fits]))
    rms, scale = fits[best]
    said = f"wheel speed: {rms:.2f} m/s RMS off, {lags[best]:.2f} s late, to be multiplied by {scale:.4f}"
    if rms > ODOMETER_WORTH or not 0.5 < scale < 2.0:
        return None, (f"{said}: not used",)
    residual = forward[fast] - scale * np.interp(solution.time[fast] + lags[best], time, speed)
    step = float(np.median(np.diff(solution.time)))
    return Odometer(time - lags[best], scale * speed, _lasting(residual, step)), (said,)


def barometer(solution: Trajectory, imu: ImuData) -> tuple[HeightAid | None, tuple[str, ...]]:
    """Zero of a barometer and how well it follows the height.

    Parameters
    ----------
    solution : Trajectory
        Smoothed, in the time of the samples.
    imu : ImuData
        Samples.

    Returns
    -------
    aid : HeightAid or None
        None if there is no barometer, or one that is of no use.
    notes : tuple of str
        In words.
    """
    if imu.baro is None or not np.isfinite(imu.baro).any():
        return None, ()
    known = np.isfinite(imu.baro)
    shown = np.interp(solution.time, imu.time[known], imu.baro[known])
    zero = float(np.median(solution.lla[:, 2] - shown))
    residual = solution.lla[:, 2] - shown - zero
    rms = float(np.sqrt(np.mean(residual**2)))
    said = f"barometer: {rms:.2f} m RMS off, zero at {zero:.2f} m"
    if rms > BARO_WORTH:
        return None, (f"{said}: not used",)
    step = float(np.median(np.diff(solution.time)))
    return HeightAid(imu.time[known], imu.baro[known] + zero, max(BARO_LEAST, _lasting(residual, step))), (said,)


def rests(imu: ImuData, gps: GpsData, spec: ImuSpec) -> tuple[FloatArray, FloatArray, str]:
    """Stretches at rest, by the IMU alone, with limits learned where GPS shows rest and motion.

    Parameters
    ----------
    imu : ImuData
        Samples.
    gps : GpsData
        Fixes, in the time of the samples.
    spec : ImuSpec
        How good the sensors are.

    Returns
    -------
    stretches : (k, 2) array
        Begin and end [s]; none if rest and motion cannot be told apart.
    rate_sd : (3,) array
        Standard deviation of the gyros' mean over `INTERVAL` at rest [rad/s].
    note : str
        In words.
    """
    none = np.empty((0, 2))
    no_sd = np.full(3, np.inf)
    step = float(np.median(np.diff(imu.time)))
    size = max(4, round(WINDOW / step))
    n = imu.time.shape[0] // size
    speed = motion.velocity(gps)
    if n < 20 or speed.time.shape[0] < 10:
        return none, no_sd, "rest: the record is too short to know it"
    scale = 1.0 / step if imu.sampling == "increment" else 1.0
    blocks = [v[: n * size].reshape(n, size, 3) * scale for v in (imu.gyro, imu.accel)]
    begin, end = imu.time[: n * size : size] - step, imu.time[size - 1 : n * size : size]
    loud = np.log(np.column_stack([np.linalg.norm(b.std(axis=1), axis=1) + 1e-9 for b in blocks]))
    fast = np.linalg.norm(speed.v_n, axis=1)
    margin = np.maximum(0.5, 0.6 * float(np.median(np.diff(speed.time))))
    first, last = np.searchsorted(speed.time, begin - margin), np.searchsorted(speed.time, end + margin)
    seen = last > first
    most = np.array([fast[a:b].max() if b > a else np.nan for a, b in zip(first, last, strict=True)])
    least = np.array([fast[a:b].min() if b > a else np.nan for a, b in zip(first, last, strict=True)])
    noise = 3.0 * float(np.median(speed.sd))
    still, moving = seen & (most < max(STILL, noise)), seen & (least > max(MOVING, 2.0 * noise))
    if still.sum() < 10 or moving.sum() < 50:
        return none, no_sd, "rest: not assumed, too little of both rest and motion is seen by GPS"
    resting = np.ones(n, dtype=bool)
    for feature in loud.T:
        high, low = np.quantile(feature[still], 0.9), np.quantile(feature[moving], 0.01)
        if high < low:
            resting &= feature < 0.5 * (high + low)
    wrong, right = float(np.mean(resting[moving])), float(np.mean(resting[still]))
    told = f"{100 * right:.0f} % of the rests seen by GPS are known by the IMU alone, {100 * wrong:.2f} % of the motion"
    if resting.all() or wrong > FALSE_REST or right < 0.5:
        return none, no_sd, f"rest: not assumed, {told} would be taken for it"
    edges = np.flatnonzero(np.diff(np.concatenate([[0], resting.astype(np.int8), [0]])))
    stretches = np.array([[begin[a] + 0.5 * WINDOW, end[b - 1] - 0.5 * WINDOW] for a, b in edges.reshape(-1, 2)])
    stretches = stretches[stretches[:, 1] - stretches[:, 0] >= WINDOW]
    if not stretches.size:
        return none, no_sd, "rest: none"
    few = max(2, round(INTERVAL / step))
    quiet = blocks[0][still & resting]
    means = quiet[:, : size // few * few].reshape(quiet.shape[0], -1, few, 3).mean(axis=2)
    scatter = (means - means.mean(axis=1, keepdims=True)).std(axis=(0, 1)) * np.sqrt(2.0)
    rate_sd = 2.0 * np.hypot(scatter, spec.gyro.random_walk / np.sqrt(INTERVAL))
    total = float(np.sum(stretches[:, 1] - stretches[:, 0]))
    return stretches, rate_sd, f"rest: {total:.0f} s in {stretches.shape[0]} stretches; {told} is taken for it"
