"""Detection of units, signs and axes of an IMU from gravity, and from the rotation of gravity in the body."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from insnav import spill
from insnav.attitude import dcm_from_rph, wrap_pi
from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, Finding
from insnav.input.interpret.schema import ALL_UNITS
from insnav.types import FloatArray
from insnav.units import DEG

_DIRECTIONS = {
    "F": (1.0, 0.0, 0.0),
    "B": (-1.0, 0.0, 0.0),
    "R": (0.0, 1.0, 0.0),
    "L": (0.0, -1.0, 0.0),
    "D": (0.0, 0.0, 1.0),
    "U": (0.0, 0.0, -1.0),
}


def axes_matrix(axes: str) -> FloatArray:
    """Build the rotation from sensor axes to Forward, Right, Down.

    `axes`: directions of the sensor's x, y and z: three letters of F/B, R/L, D/U, such as ``FLU``. Or roll, pitch and
    yaw of the sensor in the vehicle [deg], such as ``0,0,30``.
    Returns: (3, 3): ``v_frd = axes_matrix(axes) @ v_sensor``; a rotation.
    Raises: ConfigError: neither letters nor angles, one direction twice, or left-handed axes.
    """
    letters = axes.strip().upper()
    angles = _angles(letters)
    if angles is not None:
        return dcm_from_rph(np.deg2rad(angles))
    if len(letters) != 3 or any(letter not in _DIRECTIONS for letter in letters):
        raise ConfigError("columns.axes_unknown", where="imu-axes", axes=axes)
    matrix = np.array([_DIRECTIONS[letter] for letter in letters]).T + 0.0
    determinant = round(float(np.linalg.det(matrix)))
    if determinant == 0:
        raise ConfigError("columns.axes_twice", where="imu-axes", axes=axes)
    if determinant < 0:
        other = "".join((letters[1], letters[0], letters[2]))
        raise ConfigError("columns.axes_left_handed", where="imu-axes", axes=axes, other=other)
    return matrix


def _angles(text: str) -> FloatArray | None:
    """Parse three comma-separated angles [deg]."""
    try:
        angles = np.array([float(word) for word in text.split(",")])
    except ValueError:
        return None
    return angles if angles.shape == (3,) and bool(np.all(np.abs(angles) <= 360.0)) else None


_GRAVITY = 9.8  # typical gravity on Earth, where it varies from 9.76 to 9.83 [m/s^2]
_GRAVITY_TOLERANCE = 0.05
_MIN_SHARE = 0.02  # share of quiet blocks that must show gravity
_FAR_OFF = 0.5  # accelerometers of vehicles have a smaller relative error of the median
_AIMLESS = 0.5  # least norm of the mean force over the mean norm, if gravity is included
UNCALIBRATED = 0.2  # largest relative error of an uncalibrated sensor
_MAX_RATE = 12.0  # no vehicle turns faster persistently [rad/s]
_MAX_SENSOR_RATE = 70.0  # largest rate of usual sensors [rad/s]
MAX_TURN_RATIO = 4.0  # factor by which a lever arm or a swaying vehicle may disturb the comparison with gravity
_MAX_BLOCKS = 1000  # most blocks of `quiet_part` that are examined
_MIN_STEPS = 10  # least number of rows that determine a time unit
_REPEATED = 0.5  # a larger share of rows with the previous row's time shows a clock with too few digits
_MAX_SAMPLES = 50_000  # most samples that are examined
_MAX_GROUPS = 2000  # limits of the number of groups in `turn_ratio`
_MIN_GROUPS = 10
_TURN_BLOCK = 0.2  # interval for comparing rotation and gravity [s]
_MIN_CORRELATION = 0.15
# Least correlation of gyro turns with course turns to determine their sign, and its significance (Fisher's z in
# standard deviations): 1 in 2000 by chance
_SAME_TURNS, _SURE_TURNS = 0.5, 3.5
_ALONG, _SLIP = 0.9, 20.0 * DEG  # least mean resultant length of equal directions; course error by slip and wind [rad]
_COURSE_LAGS = np.arange(0.0, 2.1, 0.25)  # examined delays of the course, which phones filter [s]
_COURSE_SPEED, _LONGEST_TURN = 3.0, 2.5  # least speed for a course [m/s], and longest step [s]
# largest ratio of sample-to-sample changes of two gyros with equal units; least ratio if one gyro is in deg/s
_LIKE, _OTHER = 8.0, 20.0
# The zero-rate output of the MPU-6050 is within 20 deg/s (InvenSense, PS-MPU-6000A, rev. 3.4, section 6.1).
LARGEST_BIAS = 20.0 * DEG  # largest plausible gyro bias [rad/s]
_LEVEL = 0.8  # least cosine of the angle between a vertical axis and gravity

_ACCEL_UNITS = ("m/s^2", "g", "mg", "ug", "mm/s^2", "ft/s^2")
_DVEL_UNITS = ("m/s", "g*s")
_TIME_UNITS = ("s", "ms", "us", "ns")


@dataclass(frozen=True, slots=True)
class Quiet:
    """Statistics of specific force in the quieter half of a record, in blocks of a second."""

    mean: FloatArray  # (m, 3) mean of each block, in units of the file
    rate: FloatArray  # (3,) 99.9 % quantile of turn rates, in units of the file
    # medians over the blocks: turn rate about horizontal axes, in units of the file; rotation of the force [rad/s]
    level_rate: float = 0.0
    force_rate: float = 0.0


def quiet_part(gyro: FloatArray, accel: FloatArray, *, interval: float, scale: float) -> Quiet:
    """Compute statistics of the quieter half of a record ``(n, 3)``, in units of the file and in order of time.

    `interval`: median sample interval [s]. `scale`: factor to rates: one, or for increments the inverse interval.
    """
    width = min(max(3, round(1.0 / interval)), len(accel))
    n = len(accel) // width
    step = -(-n // _MAX_BLOCKS)
    turns = np.einsum("ijk->ik", spill.every(gyro[: n * width].reshape(n, width, 3), step)) / width
    blocks = spill.every(accel[: n * width].reshape(n, width, 3), step)
    mean = np.einsum("ijk->ik", blocks) / width  # `mean` over a middle axis is five times slower
    deviation = blocks - mean[:, None]
    shake = np.sqrt(np.einsum("ijk,ijk->ik", deviation, deviation) / width).sum(axis=1)
    sample = np.abs(spill.every(gyro, -(-len(gyro) // _MAX_SAMPLES)))
    quiet = shake <= np.median(shake)
    direction = mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-300)
    level_rate = np.linalg.norm(np.cross(turns, direction), axis=1)[quiet] * scale
    rotation = np.linalg.norm(np.diff(direction, axis=0), axis=1) / (step * width * interval)
    both_quiet = quiet[1:] & quiet[:-1]
    medians = (float(np.median(level_rate)), float(np.median(rotation[both_quiet]))) if both_quiet.any() else (0.0, 0.0)
    return Quiet(mean[quiet] * scale, np.quantile(sample, 0.999, axis=0) * scale, *medians)


def find_accel_unit(
    quiet: Quiet, stated: str | None, *, interval: float, increments: bool, where: str
) -> tuple[str, Finding]:
    """Find the unit of the accelerometers by gravity.

    `quiet`: statistics in units of the file; increments over the interval [s]. `stated`: unit from header or user.
    Raises: InputError: the stated unit contradicts gravity, or no unit fits.
    """
    norms = np.linalg.norm(quiet.mean, axis=1)
    candidates = _DVEL_UNITS if increments else _ACCEL_UNITS
    median_norm = float(np.median(norms))
    values: dict[str, Any]
    for tolerance, share in ((_GRAVITY_TOLERANCE, _MIN_SHARE), (UNCALIBRATED, 0.5)):
        for unit in (stated, *candidates) if stated else candidates:
            force = norms * ALL_UNITS[unit][1]
            fits = np.abs(force / _GRAVITY - 1.0) < tolerance
            if fits.mean() < share:
                continue
            if stated is not None and unit != stated and abs(np.median(force) / _GRAVITY - 1.0) <= _FAR_OFF:
                values = {"stated": stated, "shown": median_norm, "unit": unit}
                raise InputError("columns.accel_unit", where=where, gives={"units": {"accel": unit}}, **values)
            gravity = float(np.median(force))
            if abs(gravity / _GRAVITY - 1.0) > _FAR_OFF:  # only a few blocks fit, by chance
                continue
            error = gravity / _GRAVITY - 1.0
            if abs(error) <= _GRAVITY_TOLERANCE:
                return unit, Finding.of(Code.UNITS_ACCEL, gravity_m_s2=gravity, unit=unit)
            values = {"error": error, "limit": _GRAVITY_TOLERANCE, "gravity_m_s2": gravity}
            return unit, Finding.of(Code.UNITS_ACCEL_UNCALIBRATED, **values, unit=unit)
    # No unit fits. With the other sample type (increments or rates), gravity may appear.
    other_type = norms * interval if increments else norms / interval
    sizes = (ALL_UNITS[unit][1] for unit in (_ACCEL_UNITS if increments else _DVEL_UNITS))
    if any(np.mean(np.abs(other_type * size / _GRAVITY - 1.0) < _GRAVITY_TOLERANCE) > _MIN_SHARE for size in sizes):
        gives = {"sampling": "mean" if increments else "increment"}
        raise InputError(
            "columns.accel_rates" if increments else "columns.accel_increments",
            where=where,
            interval_s=interval,
            gives=gives,
        )
    median_norm = float(np.median(other_type)) if increments else median_norm  # again in units of the file
    exchanged = abs(float(np.linalg.norm(quiet.rate)) / _GRAVITY - 1.0) < 0.5  # the gyro columns show gravity
    if not exchanged and float(np.linalg.norm(quiet.mean.mean(axis=0))) < _AIMLESS * float(norms.mean()):
        raise InputError("columns.gravity_removed", where=where, shown=median_norm)
    values = {"shown": median_norm, "unit": stated or "", "option": "--columns"}
    raise InputError("columns.gyros_as_accel" if exchanged else "columns.no_gravity", where=where, **values)


def turn_ratio(time: FloatArray, gyro: FloatArray, accel: FloatArray) -> tuple[float, float]:
    """Compare changes of specific force in the body with the changes that the gyros predict: ratio and correlation.

    A vector fixed in space changes in the body by ``df/dt = -w x f = f x w`` (Goldstein 2002, eq. 4.86, with zero on
    the left). The ratio is 1 if the gyros are in rad/s, for any unit of the force. Both are zero without enough motion.
    """
    width = max(1, round(_TURN_BLOCK / float(np.median(np.diff(time[:_MAX_SAMPLES])))))
    n = len(time) // (3 * width)  # groups of three blocks, for the slope at the middle block
    if n < _MIN_GROUPS:
        return 0.0, 0.0
    step = -(-n // _MAX_GROUPS)
    grouped = (array[: 3 * n * width].reshape(n, 3, width, -1) for array in (time, gyro, accel))
    t, w, f = (np.einsum("ijkl->ijl", spill.every(array, step)) / width for array in grouped)
    change = (f[:, 2] - f[:, 0]) / (t[:, 2] - t[:, 0])
    expected = np.cross(f[:, 1], w[:, 1])
    product, change2, expected2 = float(np.sum(change * expected)), float(np.sum(change**2)), float(np.sum(expected**2))
    if expected2 == 0.0 or change2 == 0.0:
        return 0.0, 0.0
    correlation = product / math.sqrt(change2 * expected2)
    if abs(correlation) < max(_MIN_CORRELATION, 4.0 / math.sqrt(change.size)):  # the chance level is 1 / sqrt(size)
        return 0.0, 0.0
    return product / expected2, correlation


def course_of(v_n: FloatArray) -> FloatArray:
    """Return the course ``(m,)`` [rad] from velocities North, East, Down ``(m, 3)``; NaN at low speed."""
    fast = np.linalg.norm(v_n[:, :2], axis=1) > _COURSE_SPEED
    return np.where(fast, np.arctan2(v_n[:, 1], v_n[:, 0]), np.nan)


def turns_with_course(
    time: FloatArray, gyro: FloatArray, accel: FloatArray, fixes: FloatArray, course: FloatArray
) -> float:
    """Correlate turn rates about the vertical, from gyros and specific force, with turn rates of the course.

    `fixes` ``(m,)``: times of `course` ``(m,)``, courses or headings [rad], NaN if unknown. Specific force points up,
    so clockwise turns have the rate ``-w . f / |f|``. A negative correlation means that gyros or accelerometers have
    the wrong sign. Zero if not significant. The course may be late by two seconds.
    """
    known = np.flatnonzero(np.isfinite(course) & (fixes >= time[0] + _COURSE_LAGS[-1]) & (fixes <= time[-1]))
    step = np.diff(fixes[known])
    near = step < _LONGEST_TURN
    if np.count_nonzero(near) < _MIN_GROUPS:
        return 0.0
    course_rate = wrap_pi(np.diff(course[known]))[near] / step[near]

    integrals = [np.cumsum(values * np.diff(time, prepend=time[0])[:, None], axis=0) for values in (gyro, accel)]

    def between(total: FloatArray, lag: float) -> FloatArray:
        at = np.column_stack([np.interp(fixes[known] - lag, time, column) for column in total.T])
        return np.asarray(np.diff(at, axis=0)[near] / step[near, None])

    correlations = [0.0]
    for lag in _COURSE_LAGS:
        turned, force = (between(total, lag) for total in integrals)
        gyro_rate = -np.einsum("ij,ij->i", turned, force) / np.maximum(np.linalg.norm(force, axis=1), 1e-9)
        if gyro_rate.std() > 0.0 and course_rate.std() > 0.0:
            correlations.append(float(np.corrcoef(gyro_rate, course_rate)[0, 1]))
    best = max(correlations, key=abs)
    significant = abs(best) > _SAME_TURNS and np.arctanh(abs(best)) * math.sqrt(len(course_rate) - 3) > _SURE_TURNS
    return best if significant else 0.0


def heading_convention(turns: float, heading: FloatArray, v_n: FloatArray) -> tuple[float, float]:
    """Find the sense of headings ``(m,)``, 1 or -1, and their offset from the vehicle heading [rad].

    `turns`: correlation of headings with vehicle turns, from `turns_with_course`. `v_n` (m, 3): velocities; the course
    equals the heading except for slip. Headings that count from east, or point across the vehicle, have offsets of
    quarter turns. Without a known course, counter-clockwise headings are assumed to count from east.
    """
    sense = -1.0 if turns < 0.0 else 1.0
    offset = sense * heading - course_of(v_n)
    known = offset[np.isfinite(offset)]
    resultant = np.mean(np.exp(1j * known)) if known.size >= _MIN_GROUPS else 0.0
    if abs(resultant) < _ALONG:
        return sense, -0.5 * np.pi if sense < 0.0 else 0.0
    mean_offset = float(np.angle(resultant))
    quarters = 0.5 * np.pi * round(mean_offset / (0.5 * np.pi))
    return sense, quarters if abs(mean_offset - quarters) < _SLIP else mean_offset


def odd_one(gyros: Sequence[FloatArray]) -> int | None:
    """Find the index of a gyro whose sample changes indicate another unit than the other two ``(n,)``; else None."""
    changes = [float(np.median(np.abs(np.diff(gyro[:_MAX_SAMPLES])))) for gyro in gyros]
    low, middle, high = sorted(changes)
    for odd, second, third in ((high, middle, low), (low, middle, high)):
        if low > 0.0 and max(second / third, third / second) < _LIKE and max(odd / second, second / odd) > _OTHER:
            return changes.index(odd)
    return None


def find_gyro_unit(
    quiet: Quiet, ratio: float, correlation: float, stated: str | None, *, increments: bool, where: str, odd: str = ""
) -> tuple[str, Finding]:
    """Find the unit of the gyros, by vehicle rates and by the rotation of gravity.

    `ratio`, `correlation`: from `turn_ratio`, in units of the file. `odd`: header of the gyro found by `odd_one`.
    Raises: InputError: the stated unit contradicts the evidence.
    """
    usual = ("rad", "deg") if increments else ("rad/s", "deg/s", "mrad/s", "mdeg/s")  # units differ by 17 times or more
    fastest = float(quiet.rate.max())
    shown, reason = None, dict[str, Any]()
    finding = Finding.of(Code.UNITS_GYRO_ASSUMED, largest=fastest, unit=usual[0], other=usual[1], factor=1.0 / DEG)
    if stated is not None:
        finding = stated_unit("gyros", stated)
    if correlation:
        for unit in (stated, *usual) if stated else usual:
            factor = abs(ratio) / ALL_UNITS[unit][1]
            if 1.0 / MAX_TURN_RATIO < factor < MAX_TURN_RATIO:
                reason = {"ratio": factor, "correlation": correlation}
                code = Code.UNITS_GYRO if correlation > 0.0 else Code.UNITS_GYRO_WRONG_WAY
                shown, finding = unit, Finding.of(code, correlation=correlation, ratio=factor, unit=unit)
                break
    tried = stated or usual[0]
    limit = _MAX_SENSOR_RATE if stated else _MAX_RATE
    if shown is None and fastest * ALL_UNITS[tried][1] > limit:
        shown, reason = usual[1], {"largest": fastest}
        if correlation < 0.0:
            finding = Finding.of(Code.UNITS_GYRO_WRONG_WAY, correlation=correlation, unit=shown)
        elif stated is None:
            finding = Finding.of(Code.UNITS_GYRO_BY_RATE, largest=fastest, tried=tried, unit=shown)
    if stated is None and shown is None:
        # a turn rate about a horizontal axis rotates the specific force; a rate without such rotation is bias
        biases = {unit: quiet.level_rate * ALL_UNITS[unit][1] - quiet.force_rate for unit in usual}
        likely = next((unit for unit in usual if biases[unit] < LARGEST_BIAS), usual[-1])
        if likely != usual[0]:
            rate, shown = quiet.level_rate * ALL_UNITS[usual[0]][1], likely
            finding = Finding.of(Code.UNITS_GYRO_STILL, rate_rad_s=rate, tried=usual[0], unit=likely)
    if stated is not None and shown not in (None, stated):
        if odd:
            raise InputError("columns.gyro_unit_odd", where=where, column=odd, stated=stated, **reason)
        reason |= {"stated": stated, "unit": shown}
        raise InputError("columns.gyro_unit", where=where, gives={"units": {"gyro": shown}}, **reason)
    return stated or shown or usual[0], finding


def stated_unit(quantity: str, unit: str) -> Finding:
    """Build the finding for a unit that the file or the user states, and that nothing contradicts."""
    return Finding.of(Code.UNITS_STATED, quantity=quantity, unit=unit)


def check_axes(
    quiet: Quiet, axes: str | None, *, where: str, any_way: bool = False, by_format: bool = False
) -> Finding:
    """Report the vertical body axis after applying `axes` (None: unspecified), and its direction, up or down.

    `by_format`: `axes` come from the format, not the user.
    Raises: InputError: no axes were specified, and z points up without `any_way`.
    """
    norms = np.linalg.norm(quiet.mean, axis=1)[:, None]
    direction = np.mean(quiet.mean / np.where(norms > 0.0, norms, 1.0), axis=0)  # zeros of a sensor without power
    if direction[2] > _LEVEL and axes is None and not any_way:
        raise InputError("columns.axes_flu", where=where, direction=tuple(direction.tolist()), gives={"axes": "FLU"})
    code = Code.AXES_ASSUMED if axes is None else Code.AXES_BY_FORMAT if by_format else Code.AXES_GIVEN
    # no axis is vertical if the body is not level, or its attitude varies
    vertical = [
        (axis, "up" if cosine > 0.0 else "down")
        for axis, cosine in zip("xyz", direction, strict=True)
        if abs(cosine) > _LEVEL
    ]
    axis, way = vertical[0] if vertical else ("", "")
    return Finding.of(code, direction=direction, axes=axes or "FRD", axis=axis, way=way)


def clock_digits(time: FloatArray) -> FloatArray | None:
    """Convert times ``(n,)`` written as hhmmss.s to seconds since midnight; None for other times.

    In such times, minutes and seconds stay below 60, and jumps by 41 or more, as from :59 to :00, become usual steps
    after conversion. Plain seconds with gaps may also stay below 60.
    """
    known = np.isfinite(time)
    known = time if known.all() else time[known]
    if len(known) < _MIN_STEPS or known.min() < 0.0 or known.max() >= 240_000.0:
        return None
    for block in spill.blocks(len(known)):
        if (known[block] % 100.0 >= 60.0).any() or (known[block] // 100.0 % 100.0 >= 60.0).any():
            return None
    jumps = np.diff(known) > 40.0
    time = np.where(np.isfinite(time), time, np.nan)
    seconds = 3600.0 * (time // 10_000.0) + 60.0 * (time // 100.0 % 100.0) + time % 100.0
    steps = np.diff(seconds[np.isfinite(time)])
    step, after_one = float(np.median(steps)), float(known.min()) >= 10_000.0  # the first time is at or after 01:00:00
    usual = np.abs(steps[jumps] - step) < 0.5 * step
    if not jumps.any() or (np.count_nonzero(usual) < 2 and not after_one):
        return None
    return seconds if usual.mean() > 0.5 or (after_one and steps.max() < 40.0) else None


def find_time_unit(time: FloatArray, stated: str | None, *, slowest: float, where: str) -> tuple[str, Finding]:
    """Find the unit of the time column by its steps.

    `time` ``(n,)``: in units of the file. `slowest`: longest plausible step [s].
    Raises: InputError: the steps contradict the stated unit, or fit no unit.
    """
    steps = np.diff(time[:_MAX_SAMPLES])
    if not (steps > 0.0).all():  # times are out of order, or NaN
        steps = np.diff(np.sort(time[np.isfinite(time)]))
    steps = steps[steps > 0.0]
    step = float(np.median(steps)) if len(steps) else 0.0
    if step == 0.0:
        raise InputError("columns.constant_time", where=where)
    fitting = [unit for unit in _TIME_UNITS if slowest * 1e-4 <= step * ALL_UNITS[unit][1] < slowest]
    # with few rows or digits, long steps do not exclude a unit; the cleaning of rows reports them
    few = len(time) < _MIN_STEPS or float(np.mean(np.diff(time[:_MAX_SAMPLES]) == 0.0)) > _REPEATED
    since = float(np.nanmedian(time[:_MAX_SAMPLES]))
    dated = [unit for unit in fitting if 1e9 <= since * ALL_UNITS[unit][1] < 1e10]  # Unix time since 2001
    guess = dated[0] if dated else "s" if step < slowest or few else (fitting[0] if fitting else None)
    if stated is not None:
        if step * ALL_UNITS[stated][1] >= slowest and not few:
            values: dict[str, Any] = {"stated": stated, "step": step, "unit": guess or "", "example": guess or "ms"}
            raise InputError("columns.time_unit", where=where, **values)
        return stated, stated_unit("time", stated)
    if guess is None:
        raise InputError("columns.time_unit_unclear", where=where, step=step)
    return guess, Finding.of(Code.TIME_UNIT, step_s=step * ALL_UNITS[guess][1], unit=guess)
