"""Plausibility of a reference: its clock, velocities copied from the fixes, its headings, a constant difference.

Each check compares the reference with the solution from IMU and fixes, and reports a finding. A constant difference
means that the reference has another point on the vehicle, another datum, or another kind of height.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from insnav import spill
from insnav.attitude import dcm_from_rph, wrap_pi
from insnav.errors.metrics import EPOCHS, TrajectoryErrors, apart, no_time_in_common, other_drive, position_errors
from insnav.filter.gps_noise import velocity_lag
from insnav.findings import Code, Finding
from insnav.input.interpret.velocities import Fit, fit_velocities
from insnav.sample_statistics import rms
from insnav.tabular import runs_of
from insnav.types import BoolArray, FloatArray, GpsData, IntArray, Run, Trajectory
from insnav.units import DEG

FEWEST = 100  # least number of epochs
BLOCKS = 10  # parts of a drive for the jackknife, as errors of neighbouring epochs are correlated
TURNED = 0.3  # least spread of headings: RMS distance of forward unit vectors from their mean [-]
_CLEAR = 5.0  # least significance of another reference point, in standard deviations
LEAST = 0.05  # least distance of another reference point [m]
WORTH = 0.8  # another point must reduce the RMS below this share: an inaccurate run has offsets, too [-]
HORIZONTAL, VERTICAL = slice(2), slice(2, 3)  # columns of a position North, East, Down
GEOID = 10.0  # mean height difference, too large for navigation errors [m]
LARGEST_UNDULATION = 110.0  # limit of geoid undulations, which are -107 to 86 m in EGM2008 [m]
FARTHEST, STEP = 30.0, 0.25  # range and step of the search for a clock error [s]
LEAST_CLOCK, CLEAR = 0.03, 5.0  # least reported clock error [s], and its significance in standard deviations
STANDS, FOLLOWS = 0.2, 0.9  # wheeled vehicle: largest speed at rest [m/s], least resultant of heading minus course
IN_PLACE, TIGHTEST = 5.0 * DEG, 4.0  # least reported turn at rest [rad], smallest turn radius of a vehicle [m]
DENSE, GAP = 0.1, 2.0  # row interval that resolves turns; gap that may hide motion [s]
LATE = 0.1  # least reported delay of fixes, larger than with normal receivers and loggers [s]
SURE_LATE = 2.0  # significance of a delay in standard deviations
STEADY = 1.0  # scatter of the speed below which a clock error resembles a position error [m/s]
FAST = 2.0  # speed above which the course is used as heading [m/s]
LEAST_TILT = 0.3 * DEG  # least scatter of roll and pitch differences that is examined [rad]
# least reported heading difference: constant [rad], temporary [rad]; significance in sd
LEAST_HEADING, LEAST_TURN, SURE = 1.0 * DEG, 5.0 * DEG, 5.0
_MOST = 0.9  # a larger share of the epochs counts as all of them
_SAME = 0.5  # a fix delay explains a clock error that it reduces below this share [-]


@dataclass(frozen=True, slots=True)
class ReferenceOffset:
    """Constant parts of the difference between a run and its reference."""

    body: FloatArray  # (2,) point of the reference seen from the compared point, forward and right [m]
    body_sd: FloatArray  # (2,) standard deviation of `body` [m]
    horizontal_rms: float  # RMS of the uncorrected difference [m]
    horizontal_rms_without: float  # RMS after moving the compared point by `body` [m]
    down: float  # mean height difference, positive if the reference is higher [m]
    surest_down: float  # `down` weighted by inverse stated variances, as heights drift without fixes [m]

    @property
    def clear(self) -> bool:
        """True if the reference has significantly another point."""
        explained = self.horizontal_rms_without < WORTH * self.horizontal_rms
        return explained and bool((np.abs(self.body) > np.maximum(LEAST, _CLEAR * self.body_sd)).any())

    @property
    def geoid(self) -> bool:
        """True if the mean height difference is as large as between ellipsoid and mean sea level."""
        return abs(self.surest_down) > GEOID


def reference_offset(
    errors: TrajectoryErrors, track: Trajectory, lever_sd: FloatArray | None = None
) -> ReferenceOffset | None:
    """Fit a body-fixed and a ground-fixed offset to the horizontal errors.

    Another reference point b on the vehicle adds ``-C b`` to estimate minus reference. Another datum adds a constant in
    North and East. A lever-arm error also rotates with the vehicle, so `lever_sd` (3,) [m] adds to the sd of b.

    Returns: None with few epochs, or without turns.
    """
    known: BoolArray = np.asarray(np.isfinite(errors.position).all(axis=1))
    position = errors.position[known]
    if position.shape[0] < FEWEST:
        return None
    c = dcm_from_rph(track.rph[rows_at(track, errors.time[known])])[:, :2, :2]
    if np.sqrt(np.sum(np.var(c[:, :, 0], axis=0))) < TURNED:
        return None
    terms = np.concatenate([-c, np.broadcast_to(np.eye(2), c.shape)], axis=2)  # unknowns: forward, right, north, east
    weight = stated_weights(errors, HORIZONTAL)[known, None]
    value, value_sd = jackknifed(terms * weight[..., None], position[:, :2] * weight)
    body, sd = value[:2], value_sd[:2] if lever_sd is None else np.hypot(value_sd[:2], lever_sd[:2])
    moved = position[:, :2] + c @ body
    return ReferenceOffset(
        body,
        sd,
        rms(np.hypot(position[:, 0], position[:, 1])),
        rms(np.hypot(moved[:, 0], moved[:, 1])),
        float(position[:, 2].mean()),
        float(np.average(position[:, 2], weights=stated_weights(errors, VERTICAL)[known] ** 2)),
    )


def stated_weights(errors: TrajectoryErrors, axes: slice) -> FloatArray:
    """Compute weights of epochs by inverse stated position sd, 1 for the smallest sd, (m,).

    Epochs after minutes without fixes get small weight. Without standard deviations all weights are 1.
    """
    sd = np.zeros(1) if errors.sd is None else np.linalg.norm(errors.sd[:, axes], axis=1)
    return np.asarray(sd.min() / sd) if (sd > 0.0).all() else np.ones(len(errors.time))


def rows_at(track: Trajectory, time: FloatArray) -> IntArray:
    """Return the first row of a track at or after each time, or the last row."""
    return np.searchsorted(track.time, time).clip(max=len(track.time) - 1)


def jackknifed(terms: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Fit k unknowns to values ``(n, 2)`` with coefficients `terms` ``(n, 2, k)`` by least squares, with their sds.

    The jackknife leaves out each tenth of the drive in turn, as errors of neighbouring epochs are correlated (Efron and
    Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 11).
    """
    normal, right = np.swapaxes(terms, 1, 2) @ terms, np.einsum("nij,ni->nj", terms, values)
    parts = np.array_split(np.arange(len(values)), BLOCKS)
    sums = [(normal[part].sum(axis=0), right[part].sum(axis=0)) for part in parts]
    total = sum(each[0] for each in sums), sum(each[1] for each in sums)
    estimate = np.linalg.lstsq(*total, rcond=None)[0]
    left_out = np.array([np.linalg.lstsq(total[0] - a, total[1] - b, rcond=None)[0] for a, b in sums])
    return estimate, np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((left_out - left_out.mean(axis=0)) ** 2, axis=0))


def offset_findings(found: ReferenceOffset, taken: FloatArray) -> list[Finding]:
    """Report offsets and advice. `taken` (3,): compared point, seen from the IMU [m]."""
    findings = []
    if found.clear:
        names = ("forward_m", "right_m", "forward_sd_m", "right_sd_m", "rms_m", "corrected_m", "x_m", "y_m", "z_m")
        sizes = *found.body, *found.body_sd, found.horizontal_rms, found.horizontal_rms_without
        point = *(taken[:2] + found.body), taken[2]
        values: dict[str, Any] = dict(zip(names, (*sizes, *point), strict=True))
        findings.append(Finding.of(Code.REF_POINT, subject="ref", **values))
    if found.geoid:
        code, limit = Code.REF_GEOID, GEOID
        if abs(found.surest_down) > LARGEST_UNDULATION:
            code, limit = Code.REF_HEIGHT, LARGEST_UNDULATION
        findings.append(Finding.of(code, subject="ref", height_m=found.surest_down, limit_m=limit))
    return findings


def check_reference(
    reference: Trajectory,
    track: Trajectory,
    gps: GpsData | None,
    lever_b: FloatArray,
    delay: float = 0.0,
    lever_sd: FloatArray | None = None,
) -> tuple[Trajectory, list[Finding]]:
    """Remove impossible parts of a reference and report them; report its clock error, but do not correct it.

    `lever_b` (3,): point of the reference seen from the IMU, body axes [m]. `delay`: of the fixes, from `delay_shown`.
    `lever_sd` (3,): of the track's lever arm, if unknown [m].
    Raises: InputError: no common time.
    """
    findings: list[Finding] = []

    def add(code: Code, begin: float = np.nan, end: float | None = None, **values: Any) -> None:
        findings.append(Finding.of(code, begin, end, subject="ref", **values))

    if not (len(reference.time) and len(track.time)):
        raise no_time_in_common(reference, track)
    if distance := other_drive(reference, track, gps):
        add(Code.REF_OTHER_DRIVE, distance_m=distance)
        return reference, findings
    fit = fit_velocities(reference.time, reference.lla, reference.v_n)
    if fit is not None and fit.confusion:
        reference = replace(reference, v_n=np.full_like(reference.v_n, np.nan))
        findings.append(_confusion(fit))
    elif gps is not None and _copied(reference.v_n, gps.v_n):
        reference = replace(reference, v_n=np.full_like(reference.v_n, np.nan))
        add(Code.REF_VELOCITY_OF_GPS)
    lag, lag_sd = velocity_lag(
        GpsData(reference.time, reference.lla, reference.v_n, *np.full((2, *reference.lla.shape), np.nan))
    )
    if abs(lag) > max(LEAST_CLOCK, CLEAR * lag_sd):
        at = reference.time + lag
        moved = [np.interp(at, reference.time, each, left=np.nan, right=np.nan) for each in reference.v_n.T]
        reference = replace(reference, v_n=np.transpose(moved))
        add(Code.REF_VELOCITY_LAG, lag_s=lag, limit_s=LEAST_CLOCK)
    errors = position_errors(track, reference, lever_b=lever_b)
    late, before, after = clock_error(errors, reference, track, lever_b)
    time = reference.time
    if late:
        code = Code.REF_CLOCK_OF_IMU if fixes_are_late(late, delay) else Code.REF_CLOCK
        if not np.isnan(delay):
            add(code, late_s=late, limit_s=LEAST_CLOCK, rms_m=before, corrected_m=after)
        reference = replace(reference, time=time - late)
        errors = position_errors(track, reference, lever_b=lever_b)
    headings = misread_headings(errors, track)
    if reading := headings or misread_tilts(reference, track):
        reference = replace(reference, rph=np.full_like(reference.rph, np.nan))
        errors = position_errors(track, reference, lever_b=lever_b)
        add(Code.REF_HEADING_MISREAD if headings else Code.REF_TILT_MISREAD, reading=reading)
    until, constant, by_course = heading_error(errors, track)
    is_heading = np.arange(3) == 2
    if constant:
        if by_course:
            reference = replace(reference, rph=np.where(is_heading, np.nan, reference.rph))
        code = Code.REF_HEADING_AXES if by_course else Code.REF_HEADING_OFFSET
        add(code, angle_rad=constant, limit_rad=LEAST_HEADING)
    turn = None if until is None else turned_in_place(track)
    # if the contradiction ends during a turn of the solution at rest, the solution is wrong, not the reference
    by_turn = until is not None and turn is not None and turn[0] < until < turn[1]
    if until is not None and not by_course and not by_turn:
        largest = float(np.nanmax(np.abs(errors.attitude[errors.time < until, 2])))
        rows = (reference.time < until)[:, None]
        reference = replace(reference, rph=np.where(rows & is_heading, np.nan, reference.rph))
        add(Code.REF_HEADING_BEGIN, float(track.time[0]), until, angle_rad=largest, limit_rad=LEAST_TURN)
    offset = reference_offset(errors, track, lever_sd)
    findings += [] if offset is None else offset_findings(offset, lever_b)
    return replace(reference, time=time), findings


def _confusion(fit: Fit) -> Finding:
    """Report the kind of confusion in positions and velocities of a reference."""
    if fit.radians:
        return Finding.of(Code.REF_RADIANS, subject="ref", what=fit.radians)
    if fit.exchanged:
        return Finding.of(Code.REF_EXCHANGED, subject="ref")
    if not fit.as_named:
        north, east = fit.columns
        return Finding.of(Code.REF_VELOCITY_NAMES, subject="ref", north=north, east=east)
    if fit.unit != "m/s":
        return Finding.of(Code.REF_VELOCITY_UNIT, subject="ref", unit=fit.unit)
    return Finding.of(Code.REF_VELOCITY_UP if fit.upward else Code.REF_FEET, subject="ref")


def turned_in_place(track: Trajectory) -> tuple[float, float, float] | None:
    """Find the largest turn of a stationary wheeled vehicle: begin, end [s], angle [rad]; None without such a turn.

    A vehicle is wheeled if its heading follows the course in motion, unlike a drone or a pedestrian.
    """
    if len(track.time) < FEWEST:
        return None
    # fewer rows limit the memory for a day at full rate
    every = max(1, round(DENSE / float(np.median(np.diff(track.time[:1000])))))
    track = track.rows(np.arange(0, len(track.time), every))
    spill.release()
    speed, time = np.hypot(track.v_n[:, 0], track.v_n[:, 1]), track.time
    fast = speed > FAST
    from_course = track.rph[fast, 2] - np.arctan2(track.v_n[fast, 1], track.v_n[fast, 0])
    if from_course.size < FEWEST or abs(np.mean(np.exp(1j * from_course))) < FOLLOWS:
        return None
    step = np.diff(time, prepend=time[:1])
    at_rest = (speed < STANDS) & (step < GAP)  # a vehicle may move in a gap
    if not at_rest.any():
        return None
    # turn in each stationary period, beyond the turn that its small travelled distance allows
    first, last = (runs_of(at_rest) - [0, 1]).T
    heading, distance = np.unwrap(track.rph[:, 2]), np.cumsum(speed * step)
    turns = heading[last] - heading[first]
    excess = np.abs(turns) - (distance[last] - distance[first]) / TIGHTEST
    worst = int(np.argmax(excess))
    if excess[worst] < IN_PLACE:
        return None
    rate = np.abs(np.diff(heading[first[worst] : last[worst] + 1], prepend=heading[first[worst]]))
    turning = first[worst] + np.flatnonzero(rate > 0.1 * rate.max())
    return float(time[turning[0]]), float(time[turning[-1]]), float(turns[worst])


def delay_shown(run: Run) -> float:
    """Return the estimated delay of the fixes if it is significant and larger than `LATE`, else zero [s]."""
    delay, sd = run.gps_delay, run.gps_delay_sd
    return delay if sd and abs(delay) >= max(LATE, SURE_LATE * sd) else 0.0


def fixes_are_late(late: float, delay: float) -> bool:
    """Return whether the delay of the fixes explains a reference clock ahead by `late`."""
    return abs(late + delay) < _SAME * abs(late)


def _copied(values: FloatArray, others: FloatArray) -> bool:
    """Return whether nearly all horizontal velocities in motion occur in the other velocities, to 1 mm/s."""
    moving, known = (np.round(each[:, 0], 3) + 1j * np.round(each[:, 1], 3) for each in (values, others))
    moving = moving[np.abs(moving) > FAST]
    return len(moving) >= FEWEST and bool(np.mean(np.isin(moving, known)) > _MOST)


def clock_error(
    errors: TrajectoryErrors, reference: Trajectory, track: Trajectory, lever_b: FloatArray
) -> tuple[float, float, float]:
    """Estimate by how much the reference clock leads [s]; horizontal RMS before and after correction [m].

    A search first finds the lag of the closest tracks. Least squares then estimate lag, constant offset and reference
    point together. Inverse stated sds weight the epochs, as an epoch after minutes of drift determines no clock.
    `errors`: track against uncorrected reference. Returns: zeros if the clock error is small or not significant.
    """
    uncorrected = rms(errors.horizontal)
    before = rms(errors.horizontal * stated_weights(errors, HORIZONTAL))
    late, sd, after = _coarse(reference, track), np.inf, uncorrected
    difference = before
    for _ in range(3):
        moved = replace(reference, time=reference.time - late)
        if moved.time[-1] < track.time[0] or moved.time[0] > track.time[-1]:
            return 0.0, 0.0, 0.0
        if late:
            errors = position_errors(track, moved, lever_b=lever_b)
        weight = stated_weights(errors, HORIZONTAL)
        after, difference = rms(errors.horizontal), rms(errors.horizontal * weight)
        row = rows_at(track, errors.time)
        v = track.v_n[row, :2]
        if len(v) < FEWEST or float(np.std(np.hypot(v[:, 0], v[:, 1]))) < STEADY:
            return 0.0, 0.0, 0.0
        c = dcm_from_rph(track.rph[row])[:, :2, :2]
        terms = np.concatenate([v[:, :, None], -c, np.broadcast_to(np.eye(2), c.shape)], axis=2)
        value, value_sd = jackknifed(terms * weight[:, None, None], errors.position[:, :2] * weight[:, None])
        late, sd = late + float(value[0]), float(value_sd[0])
        if not 0.5 * LEAST_CLOCK <= abs(late) <= FARTHEST:  # too small or too large to be reported
            return 0.0, 0.0, 0.0
    clear = abs(late) > max(LEAST_CLOCK, CLEAR * sd) and difference < WORTH * before
    return (round(late, 3), uncorrected, after) if clear else (0.0, 0.0, 0.0)


def _coarse(reference: Trajectory, track: Trajectory) -> float:
    """Find the clock lag at which the difference of the tracks scatters least [s]; zero if it hardly improves."""
    difference_at = apart(reference, track)

    def scatter(lag: float) -> float:
        difference = difference_at(lag)
        return float(np.hypot(*(np.std(each) for each in difference.T))) if len(difference) >= FEWEST else np.inf

    best = min(np.arange(-FARTHEST, FARTHEST + STEP, STEP), key=scatter)
    return float(best) if scatter(float(best)) < WORTH * scatter(0.0) else 0.0


def misread_headings(errors: TrajectoryErrors, track: Trajectory) -> str:
    """Return the interpretation under which reference headings match (for example reversed), or ""."""
    known = np.isfinite(errors.attitude[:, 2])
    if np.count_nonzero(known) < FEWEST:
        return ""
    solved = track.rph[rows_at(track, errors.time[known]), 2]
    given = solved - errors.attitude[known, 2]
    if _middle(given - solved)[1] < LEAST_TURN:  # headings are correct, or differ by a constant
        return ""
    readings = {
        "counter_clockwise_from_east": 0.5 * np.pi - given,
        "counter_clockwise": -given,
        "radians": wrap_pi(given) / DEG,
    }
    difference = {name: float(np.median(np.abs(wrap_pi(each - solved)))) for name, each in readings.items()}
    best = min(difference, key=lambda name: difference[name])
    return best if difference[best] < LEAST_TURN else ""


def misread_tilts(reference: Trajectory, track: Trajectory) -> str:
    """Return the interpretation under which reference roll and pitch match, or ""."""
    inside = (reference.time >= track.time[0]) & (reference.time <= track.time[-1])
    rows = np.flatnonzero(inside & np.isfinite(reference.rph[:, :2]).all(axis=1))
    rows = rows[:: max(1, len(rows) // EPOCHS)]
    if len(rows) < FEWEST:
        return ""
    solved = track.rph[rows_at(track, reference.time[rows]), :2]
    roll, pitch = reference.rph[rows, :2].T
    readings = {
        "": (roll, pitch),
        "opposite_pitch": (roll, -pitch),
        "opposite_roll": (-roll, pitch),
        "opposite_both": (-roll, -pitch),
        "exchanged": (pitch, roll),
        "exchanged_opposite": (-pitch, -roll),
        "as_radians": (roll / DEG, pitch / DEG),
    }
    # scatter of the difference, as a constant difference may be another mounting
    sd = {name: float(np.linalg.norm(np.std(np.transpose(each) - solved, axis=0))) for name, each in readings.items()}
    best = min(sd, key=lambda name: sd[name])
    return best if sd[""] > LEAST_TILT and sd[best] < 0.5 * sd[""] else ""


def heading_error(errors: TrajectoryErrors, track: Trajectory) -> tuple[float | None, float, bool]:
    """Compare the headings of a reference with the headings of a solution, overall and at the start.

    Returns: end of an initial contradiction [s] or None. Constant difference, reference minus solution [rad], or zero.
    True if the course over ground agrees with the solution and contradicts the reference.
    """
    error = -errors.attitude[:, 2]
    known = np.isfinite(error)
    if errors.sd is None or np.count_nonzero(known) < FEWEST:
        return None, 0.0, False
    time, error, sd = errors.time[known], error[known], errors.sd[known, 8]
    row = rows_at(track, time)
    v = track.v_n[row, :2]
    fast = np.hypot(v[:, 0], v[:, 1]) > FAST
    moved = np.count_nonzero(fast) >= FEWEST
    middle, scatter = _middle(error[fast] if moved else error)
    clear = abs(middle) > LEAST_HEADING + SURE * np.median(sd[fast] if moved else sd) and scatter < 0.5 * abs(middle)
    constant = middle if clear else 0.0
    # heading minus course of the solution, which should be small
    from_course = _middle(track.rph[row[fast], 2] - np.arctan2(v[fast, 1], v[fast, 0]))[0] if moved else np.inf
    by_course = clear and abs(from_course) < 0.5 * abs(constant) < abs(wrap_pi(from_course + constant))
    wrong = np.abs(wrap_pi(error - constant)) > LEAST_TURN + SURE * sd
    # row that best separates contradicting epochs from later ones that agree
    last = int(np.argmax(np.cumsum(np.where(wrong, 1, -1)))) + 1
    at_first = FEWEST <= last < len(time) - FEWEST and np.mean(wrong[:last]) > _MOST and np.mean(~wrong[last:]) > _MOST
    return float(time[last]) if at_first else None, constant, bool(by_course)


def _middle(angle: FloatArray) -> tuple[float, float]:
    """Compute the median of angles about their mean direction, and the median distance from it [rad]."""
    mean = float(np.angle(np.mean(np.exp(1j * angle))))
    value = float(wrap_pi(mean + float(np.median(wrap_pi(angle - mean)))))
    return value, float(np.median(np.abs(wrap_pi(angle - value))))
