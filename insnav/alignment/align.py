"""Choice of the alignment method (static, gyrocompass, course, specified heading), and rejection of false fixes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.alignment import in_motion as motion
from insnav.alignment import static
from insnav.attitude import wrap_two_pi
from insnav.earth import ned_offset
from insnav.exceptions import AlignmentError
from insnav.findings import Code
from insnav.imu.specification import ImuSpec, gyro_bias_sd, level_bias_sd
from insnav.strapdown import GAP, Intervals
from insnav.types import Alignment, BoolArray, FloatArray, GpsData
from insnav.units import G0

LONGER = 10.0  # a stop of the IMU contradicts fixes if it exceeds the stop of the fixes by this time [s]
AWAY, AWAY_SD = 50.0, 6.0  # a fix farther from a stop than this distance [m] plus this many sd is away from it
MOST = 0.1  # a larger share of fixes away from a stop is real motion [-]
SWUNG = 10.0  # displacement of a vehicle that has left its stop, beyond the noise of the fixes [m]
MOVED = 3.0  # a displacement between two positions of more standard deviations proves motion
CONSENSUS = 9  # largest number of first fixes that are compared with their median
# Limit of the distance from the median in robust standard deviations: Student's t, 3 degrees of freedom, two-sided
# 0.001. The median absolute deviation of nine numbers has 3 degrees of freedom (efficiency 0.37: Huber and Ronchetti,
# "Robust Statistics", 2nd ed., 2009, section 5.1). Dropping a good fix delays the start by one fix.
LIMIT = 12.9


def away(gps: GpsData, place: FloatArray) -> BoolArray:
    """Return whether each fix is too far from a place (3,), as in `gps.lla`, for a vehicle that is there, (n,)."""
    way = np.linalg.norm(ned_offset(gps.lla, place)[:, :2], axis=1)
    return np.asarray(way > AWAY + AWAY_SD * np.linalg.norm(gps.position_sd[:, :2], axis=1))


def without_false_motion(parts: Intervals, gps: GpsData, rest: tuple[float, float] | None) -> GpsData:
    """Remove apparent motion of the fixes while the IMU remains stationary, for an alignment.

    A vehicle that leaves accelerates. If neither mean nor scatter of gyros and accelerometers change after the stop,
    positions that leave by some tens of metres and return are false.

    `rest`: first stationary interval by IMU and fixes [s], or None.
    """
    if rest is None:
        return gps
    end = static.departure(parts, rest)
    rows = np.flatnonzero((gps.time >= rest[0]) & (gps.time < end))
    if end < rest[1] + LONGER or rows.size < 4:
        return gps
    place: FloatArray = np.median(gps.lla[rows], axis=0)
    first, last = (np.median(gps.lla[part], axis=0) for part in (rows[: rows.size // 4], rows[-(rows.size // 4) :]))
    drift = np.linalg.norm(ned_offset(last, first)[:2])
    if away(gps.rows(rows), place).mean() > MOST or drift > SWUNG:  # real motion, as in a current
        return gps
    lla = gps.lla.copy()
    lla[rows] = place
    return replace(gps, lla=lla)


def count_false_start(gps: GpsData) -> int:
    """Count the fixes at the start that contradict the median of the first fixes.

    The path since the first fix is subtracted from the positions. It comes from velocities, or from the median rate of
    positions (Theil and Sen: P. K. Sen, J. Am. Stat. Assoc. 63 (1968) 1379-1389).
    """
    interval = np.diff(gps.time[: CONSENSUS + 1])
    least = CONSENSUS // 2 + 1
    if interval.size < least:
        return 0
    gaps = np.flatnonzero(interval > GAP * np.median(interval))
    count = min(CONSENSUS, gps.time.size, int(gaps[0]) + 1 if gaps.size else CONSENSUS)
    if count < least:
        return 0
    early = gps.rows(slice(count))
    offset = ned_offset(early.lla, np.median(early.lla, axis=0)) - _path(early)
    deviation = np.abs(offset - np.median(offset, axis=0))
    scatter = 1.4826 * np.median(deviation, axis=0)
    stated = np.where(np.isfinite(early.position_sd), early.position_sd, 0.0)
    false = (deviation > LIMIT * np.maximum(scatter, np.median(stated, axis=0))).any(axis=1)
    return 0 if false.sum() > count - least else int(np.argmin(false))


def _path(gps: GpsData) -> FloatArray:
    """Return the path since the first fix, North, East, Down (n, 3) [m]."""
    time = gps.time - gps.time[0]
    if np.isfinite(gps.v_n).all():
        steps = 0.5 * (gps.v_n[1:] + gps.v_n[:-1]) * np.diff(time)[:, None]
        return np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    offset = ned_offset(gps.lla, gps.lla[0])
    first, second = np.triu_indices(time.size, 1)
    rate = np.median((offset[second] - offset[first]) / (time[second] - time[first])[:, None], axis=0)
    return np.asarray(np.outer(time, rate))


GYROCOMPASS_SD = np.deg2rad(15.0)  # largest heading sd for the filter's small-angle approximation
SURE_SD = np.deg2rad(3.0)  # a gyrocompass as accurate as the course of a car needs no course
GIVEN_HEADING_SD = np.deg2rad(2.0)  # sd of a heading that the user specifies, from a map or a compass
STATIC_SPEED = 0.5  # GPS speed of a stationary vehicle, including the noise of a poor receiver [m/s]
# Fixes may detect a departure this much too late [s]. Steady acceleration or speed then resembles a stop. A later stop
# is rejected if the velocity has changed by more than STATIC_SPEED plus LEVEL_DRIFT times the elapsed time [m/s^2]
UNSEEN, LEVEL_DRIFT = 30.0, 0.05
SOON = 10.0  # a stop that begins this soon after the first fix starts the drive [s]
HIDDEN = 60.0  # position noise may mask motion for this long [s]
COURSE_TIME = 0.5  # the course sd includes the turn in this time, or in the time to the nearest velocity if longer [s]
SPARSE = 5.0  # fixes with a longer interval show no change of velocity in a short record [s]
THEN_FILTER = {  # alignment methods, and the same methods after refinement by a run of the filter
    Code.ALIGN_LEVEL_MOTION: Code.ALIGN_LEVEL_MOTION_FILTER,
    Code.ALIGN_HEADING_COURSE: Code.ALIGN_HEADING_COURSE_FILTER,
    Code.ALIGN_HEADING_GYROCOMPASS: Code.ALIGN_HEADING_GYROCOMPASS_FILTER,
    Code.ALIGN_HEADING_GIVEN: Code.ALIGN_HEADING_GIVEN_FILTER,
}
LEVEL_SPAN = 20.0  # span for the level from GPS velocity changes: gyro drift limits it above, noise below [s]


def align_static(
    parts: Intervals, spec: ImuSpec, lat: float, height: float, rest: tuple[float, float], heading: float | None = None
) -> Alignment:
    """Align a stationary IMU.

    `lat`, `height`: latitude [rad], height [m]. `rest`: start and end of the stationary interval [s]. `heading`:
    specified heading [rad]; by default from a gyrocompass if the gyros allow it.
    Returns: alignment; an unobservable heading is zero with infinite standard deviation.
    """
    return _of_means(static.summarize(parts, *rest), spec, lat, height, heading)


def _of_means(at: static.StationaryMeans, spec: ImuSpec, lat: float, height: float, heading: float | None) -> Alignment:
    """Align a stationary IMU from its means over the stationary interval."""
    roll, pitch = static.level(at.force)
    tilt = static.tilt_sd(at, spec, lat, height)
    compass, compass_sd = static.gyrocompass(at, spec, lat, float(tilt[0]))
    if heading is not None:
        heading, heading_sd, method = float(wrap_two_pi(heading)), float(GIVEN_HEADING_SD), Code.ALIGN_HEADING_GIVEN
    elif compass_sd <= GYROCOMPASS_SD:
        heading, heading_sd, method = compass, compass_sd, Code.ALIGN_HEADING_GYROCOMPASS
    else:
        heading, heading_sd, method = 0.0, np.inf, Code.ALIGN_HEADING_UNKNOWN
    rph = np.array([roll, pitch, heading])
    bias, bias_sd = static.gyro_bias(at, spec, rph, heading_sd, lat)
    if method is Code.ALIGN_HEADING_GYROCOMPASS:  # the rates determine the heading and cannot give the bias as well
        bias, bias_sd = np.zeros(3), np.full(3, np.inf)
    sd = np.array([*tilt, heading_sd])
    return Alignment(at.start, rph, sd, bias, bias_sd, (at.start, at.end), Code.ALIGN_LEVEL_STATIC, method)


def align(
    parts: Intervals,
    spec: ImuSpec,
    gps: GpsData,
    *,
    static_span: tuple[float, float] | None = None,
    heading: float | None = None,
    yaw: float = 0.0,
    lever_sd: float = 0.0,
) -> Alignment:
    """Align at the first fix within the samples, by the best method for the data.

    `static_span`: stationary interval [s], by default detected. `heading`: specified heading at the start [rad]. `yaw`:
    yaw of the IMU in the vehicle [rad]. `lever_sd`: standard deviation of the lever arm [m].
    Raises: AlignmentError: the data do not determine the heading, or the level.
    """
    begin, stop = parts.end[0] - parts.dt[0], parts.end[-1]
    covered = (gps.time >= begin) & (gps.time <= stop)
    if not covered.any():
        raise AlignmentError("align.no_fix_inside")
    first_fix = float(gps.time[covered][0])
    rest = static_span or stationary_of(parts, gps)
    # a stop that ends before the first fix does not determine the attitude at that fix
    if rest is not None and (static_span is not None or (rest[0] <= first_fix + SOON and first_fix <= rest[1])):
        still = np.array([rest]) if static_span else still_of(parts, gps, rest)
        alignment = _from_rest(parts, spec, gps, still, heading, yaw)
        if alignment is not None:
            return alignment
    return _in_motion(parts, spec, gps, first_fix, heading, yaw, lever_sd)


def stationary_of(parts: Intervals, gps: GpsData) -> tuple[float, float] | None:
    """Find the first stationary interval of a recording [s]: `find_stationary` with GPS as second sensor."""
    slow = _slow(parts, motion.velocity(gps))
    interval = static.find_stationary(parts, slow)
    while interval is not None and slow is not None and _moved(gps, *interval):  # steady braking resembles a stop
        slow &= (parts.end < interval[0]) | (parts.end > interval[1])
        interval = static.find_stationary(parts, slow)
    return interval


def still_of(parts: Intervals, gps: GpsData, rest: tuple[float, float]) -> FloatArray:
    """Find the stationary intervals, interrupted by boarding, until GPS shows a departure, (m, 2) [s]."""
    here = gps.rows(np.flatnonzero(gps.time >= rest[0]))
    way = np.linalg.norm(ned_offset(here.lla, here.lla[:1])[:, :2], axis=1)
    left = here.time[way > SWUNG + MOVED * np.linalg.norm(here.position_sd[:, :2] + here.position_sd[:1, :2], axis=1)]
    until, least = min([*left[:1], parts.end[-1]]), max(rest[0] + static.LONG_REST, rest[1] + static.SHORTEST)
    slow = _slow(parts, motion.velocity(gps)) if until >= least else None
    if slow is not None:
        until = min([*parts.end[(parts.end > rest[1]) & ~slow][:1], until])
    still = [rest]
    if slow is None or until < least:
        return np.array(still)
    for interval in static.stationary(parts, slow, static.WINDOW):
        if interval[1] > until or (interval[0] > max(rest[1], until - UNSEEN) and _left(parts, still, interval[1])):
            break
        if interval[0] >= rest[1] and interval[1] > interval[0]:
            still.append(interval)
    return np.array(still)


def _left(parts: Intervals, still: list[tuple[float, float]], time: float) -> bool:
    """Return whether gyros and accelerometers show a departure between the last stop and a time [s]."""
    end = still[-1][1]
    rows = slice(*np.searchsorted(parts.end, [max(still[-1][0], end - LEVEL_SPAN), end], side="right"))
    if rows.start == rows.stop:  # a stop with a single fix has no samples
        return False
    rph = np.array([*static.level(static.rates(parts, rows)[1].mean(axis=0)), 0.0])
    # no latitude, as the mean rate, taken as bias, contains the Earth's rotation
    track = motion.history(parts, end, time, rph, static.summarize(parts, *still[0]).rate, None)
    return bool(np.hypot(*track.u_n[-1, :2]) > STATIC_SPEED + LEVEL_DRIFT * (time - end))


def _moved(gps: GpsData, begin: float, end: float) -> bool:
    """Return whether mean velocity, or positions without velocities, show significant motion in an interval."""
    rows = np.flatnonzero((gps.time >= begin) & (gps.time <= end))
    if rows.size < 2:
        return False
    if np.isfinite(gps.v_n[rows]).all():  # averaging does not reduce persistent velocity errors
        mean = float(np.hypot(*gps.v_n[rows, :2].mean(axis=0)))
        return mean > motion.CREEP and bool(motion.is_clear(mean, np.median(gps.velocity_sd[rows, :2])))
    first, last = rows[0], rows[-1]
    distance = float(np.linalg.norm(ned_offset(gps.lla[last], gps.lla[first])[:2]))
    sd = float(np.hypot(*gps.position_sd[[first, last], :2].max(axis=1)))
    return bool(distance > max(STATIC_SPEED * (gps.time[last] - gps.time[first]), MOVED * sd))


def _slow(parts: Intervals, speed: motion.Velocity) -> BoolArray | None:
    """Return whether GPS shows no motion in each sample interval, (n,); None without velocities."""
    if speed.time.size < 2:
        return None
    horizontal = np.hypot(speed.v_n[:, 0], speed.v_n[:, 1])
    still = (horizontal < np.maximum(STATIC_SPEED, 5.0 * speed.sd)).astype(float)
    return np.asarray(np.interp(parts.end, speed.time, still) > 0.5)


def _from_rest(
    parts: Intervals, spec: ImuSpec, gps: GpsData, still: FloatArray, heading: float | None, yaw: float
) -> Alignment | None:
    """Align from a stop; None for a rocking boat. `still` (m, 2): stationary intervals of the stop [s]."""
    rest = float(still[0, 0]), float(still[0, 1])
    fixes = gps.time[(gps.time >= rest[0]) & (gps.time <= rest[1])]
    if fixes.size == 0:
        raise AlignmentError("align.no_fix_at_rest", begin=rest[0], end=rest[1])
    start = float(fixes[0])
    lla = gps.lla[int(np.searchsorted(gps.time, start))]
    lat, height = float(lla[0]), float(lla[2])
    means = static.summarize(parts, *rest)
    alignment = replace(_of_means(means, spec, lat, height, heading), time=start)
    given = alignment.heading_method is Code.ALIGN_HEADING_GIVEN
    if alignment.sd[2] <= SURE_SD and not given:
        return alignment
    means, sway = static.sway(parts, still, means)
    long_stop = replace(alignment, sway=sway, left=means.end)
    if given:
        return long_stop
    speed, moving = motion.sure_motion(gps, start)
    if moving is not None and np.isnan(sway).sum() > 0.5 * sway.size:  # a rocking boat only seems stationary
        return None
    course = None
    if moving is not None:
        end = min(moving + speed.span + 1.0, float(parts.end[-1]))
        rph = np.array([alignment.rph[0], alignment.rph[1], 0.0])
        # gyros carry the heading after subtraction of their stationary mean; in a long stop the heading is constant
        bias, bias_sd = static.gyro_bias(means, spec, rph, np.inf, lat)
        track = motion.history(parts, means.end if sway.size else start, end, rph, bias, lat)
        # the horizontal Earth rate, unknown with the heading, is in the bias sd but does not rotate the heading
        drift = float(min(bias_sd[2], np.max(gyro_bias_sd(spec.gyro))))
        course = motion.course_heading(track, speed, moving, drift, float(alignment.sd[0]), yaw)
    if course is None or course.sd >= alignment.sd[2]:
        if np.isfinite(alignment.sd[2]):  # gyros that can gyrocompass drift little
            return alignment
        if moving is not None and motion.interval_of(gps.time) > SPARSE:
            raise motion.too_sparse(motion.interval_of(gps.time))
        raise AlignmentError("align.no_heading", limit_m_s=motion.CREEP, before_s=_ends_before(parts, gps))
    rph[2] = wrap_two_pi(course.heading)
    bias, bias_sd = static.gyro_bias(means, spec, rph, course.sd, lat)
    sd = np.array([alignment.sd[0], alignment.sd[1], course.sd])
    return replace(long_stop, rph=rph, sd=sd, gyro_bias=bias, gyro_bias_sd=bias_sd, heading_method=course.method)


def _ends_before(parts: Intervals, gps: GpsData) -> float:
    """Return the time from the last sample to the last fix [s]; NaN if it is not longer than `motion.SPAN`."""
    later = float(gps.time[-1] - parts.end[-1])
    return later if later > motion.SPAN else np.nan  # later fixes may show the motion that a heading needs


def _in_motion(
    parts: Intervals, spec: ImuSpec, gps: GpsData, start: float, heading: float | None, yaw: float, lever_sd: float
) -> Alignment:
    """Align in motion; `start`: first fix within the samples [s]."""
    speed, moving = motion.sure_motion(gps, start, HIDDEN)
    if moving is None:
        raise AlignmentError("align.no_motion", limit_m_s=motion.CREEP, before_s=_ends_before(parts, gps))
    later = gps.time[gps.time >= max(start, moving)]
    begin = float(later[0]) if later.size else max(start, moving)
    interval = motion.interval_of(gps.time)
    end = min(begin + max(LEVEL_SPAN, 2.0 * interval), float(parts.end[-1]) - 0.5, float(speed.time[-1]))
    lla = gps.lla[np.searchsorted(gps.time, start)]
    levelled = motion.level_in_motion(parts, begin, end, speed, lla, yaw) if end - begin > 5.0 else None
    if levelled is None:
        if interval > SPARSE:
            raise motion.too_sparse(interval)
        raise AlignmentError("align.short_motion", duration_s=max(end - begin, 0.0), before_s=_ends_before(parts, gps))
    rph, level_sd, acceleration = levelled
    bias = float(np.max(level_bias_sd(spec.accel)))
    gyro = float(np.max(gyro_bias_sd(spec.gyro)))
    time_apart = np.abs(speed.time - begin)
    nearest = float(time_apart.min())
    near = time_apart <= max(2.0, nearest)
    v = speed.v_n[near].mean(axis=0)
    rates, _ = static.rates(parts)
    around = np.abs(parts.end - begin) <= 1.0
    turning = float(np.max(np.abs(rates[around].mean(axis=0)))) if around.any() else 0.0
    # in a turn, the mean course differs from the course at one time, and the course of the antenna from the IMU's
    angle_sd = float(np.hypot(np.median(speed.sd[near]), turning * lever_sd)) / max(np.hypot(v[0], v[1]), 1e-9)
    course_sd = float(np.sqrt(speed.slip_sd**2 + angle_sd**2 + (turning * max(COURSE_TIME, nearest)) ** 2))
    method = Code.ALIGN_HEADING_CREEPING if speed.creeps else Code.ALIGN_HEADING_COURSE
    if heading is not None:
        rph[2], course_sd, method = heading, GIVEN_HEADING_SD, Code.ALIGN_HEADING_GIVEN
    # gyro bias tilts the frame of the averaged specific force; a heading error rotates the acceleration
    drift = 0.5 * gyro * (end - begin)
    tilt = float(np.linalg.norm([level_sd, bias / G0, drift, acceleration / G0 * course_sd]))
    rph[2] = wrap_two_pi(rph[2])
    sd, no_bias = np.array([tilt, tilt, course_sd]), np.zeros(3)
    return Alignment(begin, rph, sd, no_bias, np.full(3, np.inf), None, Code.ALIGN_LEVEL_MOTION, method)
