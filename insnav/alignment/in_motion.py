"""Heading from the course over ground, and level from the GPS velocity change, for a moving vehicle."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from insnav.attitude import dcm_from_quat, quat_from_rotvec, quat_from_rph, quat_multiply, rph_from_quat, wrap_pi
from insnav.earth import earth_rate_n, gravity_n, lla_offset, ned_offset
from insnav.exceptions import AlignmentError
from insnav.findings import Code
from insnav.kernels.alignment import gyro_history
from insnav.strapdown import Intervals, between
from insnav.types import Alignment, BoolArray, FloatArray, GpsData, IntArray
from insnav.units import G0

SLOWEST = 2.0  # below this speed, GPS velocity noise changes the course by degrees [m/s]
CRAWL = 0.7  # speed limit instead of `SLOWEST` for slow robots and boats, with a larger course sd [m/s]
SURELY = 3.0  # a spike of the positions resembles motion for less than this [s]
SPAN = 15.0  # length of motion for a heading; gyro drift dominates beyond it [s]
SLIP_SD = np.deg2rad(3.0)  # sd of the angle from travel to the body's forward axis, by slip and mounting
CREEP = SLIP_SD * SLOWEST / np.deg2rad(30.0)  # below this speed the course is dominated by slip [m/s]
SEEN = 0.1  # time before and after a fix in which a receiver may smooth the velocity [s]
DIFFERENCE = 2.0  # base of velocities from positions: 1 m of noise gives 0.7 m/s [s]
LONGER = 5.0, 10.0  # longer bases if no motion is significant, for positions as inaccurate as a phone's [s]
STEADY = 300.0  # longest motion for the gyro bias from the course; turns dominate beyond it [s]
CHANGING = 1.0 / 3.0  # share of the slip that changes with time, unlike crabbing and mounting [-]
FEWEST = 10  # least number of epochs in this motion
SUDDEN = 30.0  # no vehicle accelerates more [m/s^2]
CLEAR_SD = np.deg2rad(20.0)  # largest usable sd of the direction of acceleration
# angle of acceleration from course: beyond TURNED the IMU is rotated; within REVERSED of pi the vehicle reverses [rad]
TURNED, REVERSED = np.deg2rad(40.0), np.deg2rad(30.0)


@dataclass(frozen=True, slots=True)
class Velocity:
    """GPS velocity, measured or from successive positions."""

    time: FloatArray  # (n,) times [s]
    v_n: FloatArray  # (n, 3) velocity North, East, Down [m/s]
    sd: FloatArray  # (n,) standard deviation of each horizontal component [m/s]
    slowest: float = SLOWEST  # speed that counts as motion [m/s]

    @property
    def fast(self) -> BoolArray:
        """Epochs in motion, (n,)."""
        speed = np.hypot(self.v_n[:, 0], self.v_n[:, 1])
        return (speed > self.slowest) & is_clear(speed, self.sd)

    @property
    def span(self) -> float:
        """Length of motion for a heading, at least two epochs [s]."""
        return max(SPAN, 1.5 * interval_of(self.time))

    @property
    def slip_sd(self) -> float:
        """Standard deviation between direction of travel and the body's forward axis [rad]."""
        pace = np.median(np.hypot(*self.v_n[self.fast, :2].T)) if self.creeps else self.slowest
        return float(SLIP_SD * SLOWEST / pace)

    @property
    def creeps(self) -> bool:
        """True if the vehicle never reaches `CRAWL`."""
        return self.slowest < CRAWL


@dataclass(frozen=True)
class History:
    """Attitude by gyros alone and integrated specific force, at interval ends from the start."""

    time: FloatArray  # (n,) interval ends [s]
    q_nb: FloatArray  # (n, 4) attitude quaternion
    u_n: FloatArray  # (n, 3) integrated specific force in the axes of `q_nb` [m/s]

    def heading(self, time: FloatArray) -> FloatArray:
        """Return the heading at the first interval ends that are not before `time` [rad]."""
        return np.asarray(rph_from_quat(self.q_nb[self.nearest(time)])[..., 2])

    def integral(self, time: FloatArray) -> FloatArray:
        """Interpolate the integrated specific force at `time` [m/s], linear between interval ends."""
        return between(self.time, self.u_n, time)[1]

    @cached_property
    def way(self) -> FloatArray:
        """Integrate specific force twice, at interval ends (n, 3) [m]."""
        moved = np.cumsum(0.5 * (self.u_n[1:] + self.u_n[:-1]) * np.diff(self.time)[:, None], axis=0)
        return np.vstack([np.zeros(3), moved])

    def nearest(self, time: FloatArray) -> IntArray:
        """Return the rows of the first interval ends that are not before `time`."""
        return np.clip(np.searchsorted(self.time, time), 0, self.time.shape[0] - 1)


def is_clear(size: ArrayLike, sd: ArrayLike) -> BoolArray:
    """Test speeds or displacements for motion: noise of two components exceeds five sd once in 270 000, exp(-25/2)."""
    return np.asarray(size) > 5.0 * np.asarray(sd)


def gives_velocities(gps: GpsData) -> bool:
    """Return whether the receiver gives a velocity at most epochs."""
    return bool(np.isfinite(gps.v_n).all(axis=1).mean() > 0.5)


def positions_alone(gps: GpsData) -> GpsData:
    """Remove the velocities of fixes."""
    return replace(gps, v_n=np.full_like(gps.v_n, np.nan))


def velocity(gps: GpsData, difference: float = DIFFERENCE) -> Velocity:
    """Return receiver velocities if most epochs have them, else from positions `difference` seconds apart."""
    if gives_velocities(gps):
        known = np.isfinite(gps.v_n).all(axis=1)
        return Velocity(gps.time[known], gps.v_n[known], gps.velocity_sd[known, :2].max(axis=1))
    ahead = np.searchsorted(gps.time, gps.time + difference - 1e-3)
    i = np.flatnonzero(ahead < gps.time.shape[0])
    j = ahead[i]
    base = gps.time[j] - gps.time[i]
    near = base < 2.0 * max(difference, interval_of(gps.time))
    i, j, base = i[near], j[near], base[near]
    moved = ned_offset(gps.lla[j], gps.lla[i]) / base[:, None]
    sd = np.hypot(gps.position_sd[i, :2].max(axis=1), gps.position_sd[j, :2].max(axis=1)) / base
    return Velocity(0.5 * (gps.time[i] + gps.time[j]), moved, sd)


def too_sparse(interval: float) -> AlignmentError:
    """Build the error for fixes too sparse [s] to show velocity changes."""
    return AlignmentError("align.fixes_far_apart", interval_s=interval)


def interval_of(time: FloatArray) -> float:
    """Return the median interval of times, 0 for a single time [s]."""
    return float(np.median(np.diff(time))) if time.size > 1 else 0.0


def history(
    parts: Intervals, start: float, end: float, rph: FloatArray, bias: FloatArray, lat: float | None
) -> History:
    """Integrate gyros and specific force from `rph` at `start` to `end`. `lat`: None if `bias` includes Earth rate."""
    first, last = np.searchsorted(parts.end, [start + 1e-6, end], side="right")
    dt = parts.dt[first:last]
    scale = dt[:, None] if parts.instant else 1.0
    dtheta = parts.gyro[first:last] * scale - bias * dt[:, None]
    n = dt.shape[0]
    q, u = np.empty((n + 1, 4)), np.empty((n + 1, 3))
    earth = np.zeros(3) if lat is None else earth_rate_n(lat)
    gyro_history(quat_from_rph(rph), earth, dt, dtheta, parts.accel[first:last] * scale, q, u)
    return History(np.concatenate([[parts.end[first] - dt[0]], parts.end[first:last]]), q, u)


def at_imu(gps: GpsData, parts: Intervals, found: Alignment, lever_b: FloatArray) -> GpsData:
    """Move fixes from antenna to IMU: subtract lever arm and its velocity, with the attitude of an alignment.

    `parts`: samples as intervals, around the alignment `found`. `lever_b`: (3,) antenna seen from the IMU [m].
    """
    track = history(parts, parts.end[0] - parts.dt[0], parts.end[-1], found.rph, found.gyro_bias, gps.lla[0, 0])

    def arm(time: FloatArray) -> tuple[FloatArray, FloatArray]:
        rows = track.nearest(time)
        return track.time[rows], dcm_from_quat(track.q_nb[rows]) @ lever_b @ turn.T

    turn = (
        dcm_from_quat(quat_from_rph(found.rph)) @ dcm_from_quat(track.q_nb[track.nearest(np.array([found.time]))[0]]).T
    )
    (before, first), (after, last) = arm(gps.time - SEEN), arm(gps.time + SEEN)
    change = (last - first) / np.maximum(after - before, 1e-9)[:, None]
    return replace(gps, lla=lla_offset(gps.lla, -arm(gps.time)[1]), v_n=gps.v_n - change)


def start_velocity(parts: Intervals, found: Alignment, gps: GpsData, lever_sd: float) -> tuple[FloatArray, FloatArray]:
    """Estimate velocity at the alignment's first fix from positions and specific force; its sd, (3,) [m/s].

    The displacement to another fix is ``v t + 1/2 g t^2`` plus twice integrated specific force. With time t, the effect
    of position noise falls and the effect of the level error grows: the fix with the smallest sd is used. `lever_sd`:
    standard deviation of the lever arm, whose rotation moves the antenna relative to the IMU [m].
    Raises: AlignmentError: the samples contain no other fix.
    """
    later = gps.rows(np.flatnonzero((gps.time >= found.time - 1e-6) & (gps.time <= parts.end[-1])))
    if later.time.size < 2:
        raise too_sparse(interval_of(gps.time))
    track = history(parts, found.time, float(later.time[-1]), found.rph, found.gyro_bias, gps.lla[0, 0])
    time, rows, before = later.time[1:] - later.time[0], track.nearest(later.time[1:]), track.integral(later.time[:1])
    by_force = np.diff(between(track.time, track.way, later.time)[1], axis=0).cumsum(axis=0) - before * time[:, None]
    by_force += 0.5 * gravity_n(later.lla[0, 0], later.lla[0, 2]) * time[:, None] ** 2
    rotation = np.linalg.norm(dcm_from_quat(track.q_nb[rows]) - dcm_from_quat(track.q_nb[0]), axis=(1, 2))
    noise = np.hypot(later.position_sd[1:], later.position_sd[0]) + (rotation * lever_sd)[:, None]
    sd = np.hypot(noise / time[:, None], 0.5 * G0 * np.hypot(*found.sd[:2]) * time[:, None])
    best = int(np.argmin(np.linalg.norm(sd, axis=1)))
    return (ned_offset(later.lla[1 + best], later.lla[0]) - by_force[best]) / time[best], sd[best]


@dataclass(frozen=True, slots=True)
class Course:
    """Heading at the start of a history, estimated from motion."""

    heading: float  # heading at the start [rad]
    sd: float  # standard deviation of the heading [rad]
    method: Code  # code of the method


def first_motion(speed: Velocity, start: float) -> float | None:
    """Find the first time from which all epochs, at least two, show significant motion for `SURELY` seconds [s].

    A creeping vehicle must move for `SPAN`.
    """
    # if the sd is four times too small, 46 % of the speeds at rest are fast, and fifteen in a row once in 100 000
    surely = max(SPAN if speed.creeps else SURELY, 1.5 * interval_of(speed.time))
    fast = speed.fast & (speed.time >= start)
    slow = np.concatenate([[0], np.cumsum(~fast)])
    last = np.searchsorted(speed.time, speed.time + surely, side="right")
    first = np.arange(speed.time.shape[0])
    moving = np.flatnonzero((slow[last] == slow[first]) & (last - first >= 2))
    return float(speed.time[moving[0]]) if moving.size else None


def _leaves(gps: GpsData, start: float) -> bool:
    """Return whether positions leave the first one significantly, as persistent velocity errors resemble motion."""
    later = gps.rows(np.flatnonzero(gps.time >= start))
    distance = np.linalg.norm(ned_offset(later.lla, later.lla[:1])[:, :2], axis=1)
    sd = later.position_sd[:, :2].max(axis=1)
    return bool(is_clear(distance, np.hypot(sd, sd[:1])).any())


def sure_motion(gps: GpsData, start: float, hidden: float = np.inf) -> tuple[Velocity, float | None]:
    """Compute velocity, from positions on the shortest usable base, and the first time of significant motion.

    If velocities scatter too much to show motion, as of a pedestrian at 5 Hz, positions replace them. Longer bases show
    the motion of slow ships, but a stationary vehicle may seem to move. They are used if shorter bases mask the motion
    for more than `hidden` [s].
    """
    by_receiver = [[velocity(gps)]] if gives_velocities(gps) else []
    by_position = [velocity(positions_alone(gps), difference) for difference in (DIFFERENCE, *LONGER)]
    paces = SLOWEST, CRAWL, *([CREEP] if _leaves(gps, start) else [])
    for candidates, slowest in itertools.product((*by_receiver, by_position), paces):
        speeds = [replace(speed, slowest=slowest) for speed in candidates]
        found = [(speed, moving) for speed in speeds if (moving := first_motion(speed, start)) is not None]
        if found:
            soon = min(moving for _, moving in found) + hidden
            return next((speed, moving) for speed, moving in found if moving <= soon)
    return velocity(gps), None


def course_heading(
    track: History, speed: Velocity, moving: float, drift_sd: float, tilt: float, yaw: float = 0.0
) -> Course | None:
    """Compute the heading offset of a history from the directions of travel and acceleration.

    The course assumes travel along the vehicle's forward axis, and a yaw of the IMU in the vehicle of `yaw` [rad]. The
    velocity change by accelerometers, compared with GPS, needs no such assumption but is less precise. It decides
    between forward and reverse, and replaces the course if the IMU is rotated in the vehicle.

    `track` starts with heading zero and covers `Velocity.span` after `moving`, the time from `first_motion` [s].
    `drift_sd`: standard deviation of the gyro bias [rad/s]. `tilt`: sd of the level [rad]. None with too few epochs in
    motion.
    """
    use = speed.fast & (speed.time >= moving) & (speed.time <= min(moving + speed.span, track.time[-1]))
    if use.sum() < 2:
        return None
    time, v, sd = speed.time[use], speed.v_n[use], speed.sd[use]
    gyro_heading = track.heading(time)
    weight = (v[:, 0] ** 2 + v[:, 1] ** 2) / sd**2
    angle = np.arctan2(v[:, 1], v[:, 0]) + yaw - gyro_heading
    mean = np.arctan2(np.sum(weight * np.sin(angle)), np.sum(weight * np.cos(angle)))
    scatter = np.sqrt(np.sum(weight * wrap_pi(angle - mean) ** 2) / np.sum(weight))
    drift = drift_sd * (time.mean() - track.time[0])
    course_sd = float(np.sqrt(speed.slip_sd**2 + 1.0 / weight.sum() + scatter**2 / min(use.sum(), 5) + drift**2))

    # rotation from velocity changes by the accelerometers to the same changes by GPS
    window = (speed.time >= max(track.time[0], moving - SPAN)) & (speed.time <= time[-1])
    t, gps_v = speed.time[window], speed.v_n[window, :2]
    step = max(1, round(1.0 / max(float(np.median(np.diff(t))), 1e-3))) if t.size > 2 else 1
    gps = np.diff(gps_v[::step], axis=0)
    imu = np.diff(track.integral(t[::step])[:, :2], axis=0)
    strength = float(np.sum(imu**2))
    rotation = np.arctan2(
        np.sum(imu[:, 0] * gps[:, 1] - imu[:, 1] * gps[:, 0]), np.sum(imu[:, 0] * gps[:, 0] + imu[:, 1] * gps[:, 1])
    )
    level_error = 9.8 * tilt * (t[-1] - t[0]) / np.sqrt(max(gps.shape[0], 1))
    felt_sd = float(np.sqrt((2.0 * np.median(sd) ** 2 + level_error**2) / max(strength, 1e-12)))
    angle_between = abs(float(wrap_pi(rotation - mean)))
    if felt_sd < CLEAR_SD and angle_between > max(TURNED, 4.0 * felt_sd):
        if angle_between > np.pi - max(REVERSED, 3.0 * felt_sd):
            return Course(float(wrap_pi(mean + np.pi)), course_sd, Code.ALIGN_HEADING_REVERSING)
        sd_turned = float(np.hypot(2.0 * felt_sd, drift))
        return Course(float(rotation), sd_turned, Code.ALIGN_HEADING_ACCELERATION)
    return Course(float(mean), course_sd, Code.ALIGN_HEADING_COURSE)


def bias_by_course(parts: Intervals, found: Alignment, speed: Velocity, lat: float) -> tuple[float, float]:
    """Estimate the vertical gyro bias and its sd [rad/s] by the course of a vehicle that moves forward.

    The gyro heading drifts from the course at the rate of the bias. Changes of slip resemble it. Residuals ``rms`` of a
    straight line give the sd ``sqrt(12) rms / span`` of a slope with errors at its ends. The span ends with the first
    epoch that is not fast. Returns: zero and infinity with too few epochs.
    """
    time, fast = speed.time, speed.fast
    inside = np.flatnonzero((time >= found.time) & (time <= min(found.time + STEADY, parts.end[-1])))
    slow = inside[~fast[inside]]
    use = inside[inside < slow[0]] if slow.size else inside
    if use.size < FEWEST:
        return 0.0, np.inf
    time, v_n = time[use], speed.v_n[use]
    track = history(parts, found.time, float(time[-1]), found.rph, found.gyro_bias, lat)
    drift = np.unwrap(track.heading(time) - np.arctan2(v_n[:, 1], v_n[:, 0]))
    slope, offset = np.polyfit(time - time[0], drift, 1)
    rms = float(np.std(drift - slope * (time - time[0]) - offset))
    return float(slope), float(np.sqrt(12.0) * np.hypot(rms, CHANGING * speed.slip_sd) / (time[-1] - time[0]))


def level_in_motion(
    parts: Intervals, start: float, end: float, speed: Velocity, lla: FloatArray, yaw: float = 0.0
) -> tuple[FloatArray, float, float] | None:
    """Estimate attitude at `start` [s] in motion: heading from the course, level from GPS velocity until `end`.

    The mean specific force between the ends, rotated into n by the gyros, must equal mean GPS acceleration minus
    gravity (compare Wu and Pan, "Velocity/position integration formula part I: application to in-flight coarse
    alignment", IEEE Trans. AES 49 (2013) 1006-1023, eq. 12).

    Returns: `rph` (3,): roll, pitch, heading [rad]. `tilt_sd`: standard deviation of the level [rad] from velocity
    noise and the difference to the first half of the span. It omits sensor and heading errors. `acceleration`: mean
    acceleration in the span, which a heading error converts to a level error [m/s^2].
    """
    whole = _level(parts, start, end, speed, lla, yaw)
    half = _level(parts, start, 0.5 * (start + end), speed, lla, yaw)
    if whole is None:
        return None
    rph, acceleration_sd, acceleration = whole
    difference = 0.0 if half is None else float(np.hypot(*(half[0] - rph)[:2]))
    return rph, float(np.hypot(acceleration_sd / G0, difference)), acceleration


def _level(
    parts: Intervals, start: float, end: float, speed: Velocity, lla: FloatArray, yaw: float
) -> tuple[FloatArray, float, float] | None:
    """Estimate the attitude from one span, and standard deviation and size of the mean acceleration [m/s^2]."""
    close = max(1.5, 1.5 * interval_of(speed.time))
    first = np.abs(speed.time - start) <= close
    last = np.abs(speed.time - end) <= close
    if not first.any() or not last.any():
        return None
    t0, v0 = speed.time[first].mean(), speed.v_n[first].mean(axis=0)
    t1, v1 = speed.time[last].mean(), speed.v_n[last].mean(axis=0)
    if t1 <= t0:  # fixes are so sparse that both ends use the same velocities
        return None
    slope = (v1 - v0) / (t1 - t0)
    heading = course = float(np.arctan2(v0[1], v0[0])) + yaw
    g = gravity_n(lla[0], lla[2])
    expected = slope - g
    rph = np.array([0.0, 0.0, heading])
    for _ in range(8):
        track = history(parts, start, end, rph, np.zeros(3), lla[0])
        # the course at t0; the gyros measure the rotation since the start
        turned = track.heading(np.array([t0])) - track.heading(np.array([start]))
        heading = course - float(wrap_pi(turned)[0])
        ends = track.integral(np.array([max(t0, track.time[0]), min(t1, track.time[-1])]))
        mean = (ends[1] - ends[0]) / (t1 - t0)
        turn = np.cross(mean, expected)
        length = float(np.linalg.norm(turn))
        angle = np.arctan2(length, mean @ expected)
        if length == 0.0 or (angle < 1e-7 and abs(float(wrap_pi(rph[2] - heading))) < 1e-7):
            break
        axis = turn / length * angle
        rph = rph_from_quat(quat_multiply(quat_from_rotvec(axis), quat_from_rph(rph)))
        rph[2] = heading  # the level correction must not change the heading
    noise = np.sqrt(np.median(speed.sd[first]) ** 2 / first.sum() + np.median(speed.sd[last]) ** 2 / last.sum())
    return rph, float(noise / (t1 - t0)), float(np.hypot(slope[0], slope[1]))
