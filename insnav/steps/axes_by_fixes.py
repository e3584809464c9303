"""IMU axes that explain the fixes, and axes that no rotation explains."""

from __future__ import annotations

from insnav.alignment import Mounting, find_mounting
from insnav.alignment.mounting import ALL_ALIKE, IN_ORDER
from insnav.exceptions import InputError
from insnav.filter.innovation_likelihood import LONGEST
from insnav.findings import Code, Finding
from insnav.input import Reading
from insnav.input.interpret.physics import course_of, turn_ratio, turns_with_course
from insnav.strapdown import intervals
from insnav.types import GpsData, ImuData

WORDS = {"F": "forward", "B": "back", "R": "right", "L": "left", "D": "down", "U": "up"}


def refuse_unlike_gyros(imu: Reading[ImuData], fixes: GpsData) -> None:
    """Refuse gyros in another order than the accelerometers, or one gyro in another unit."""
    found = mounting_of(imu, fixes)
    if found is not None and (found.gyro_order != IN_ORDER or found.gyro_units != ALL_ALIKE):
        raise refusal(found, imu.facts.path)


def accel_reversed(imu: Reading[ImuData], fixes: GpsData, mounting: Mounting | None) -> Finding | None:
    """Report accelerometers that all have the opposite sign of the specific force; None otherwise.

    `mounting`: mounting that explains the fixes. If None, the course decides, unless gravity shows inverted gyros.
    """
    if mounting is not None:
        in_order = mounting.gyro_order == IN_ORDER and mounting.gyro_units == ALL_ALIKE
        reverse = in_order and mounting.mirrored and len(mounting.inverted) == 3
        return Finding.of(Code.AXES_ACCEL_REVERSED, windows=mounting.windows) if reverse else None
    data = imu.data.beginning(LONGEST)
    correlation = turns_with_course(data.time, data.gyro, data.accel, fixes.time, course_of(fixes.v_n))
    if correlation >= 0.0 or turn_ratio(data.time, data.gyro, data.accel)[1] < 0.0:
        return None
    return Finding.of(Code.AXES_ACCEL_REVERSED, correlation=correlation)


def explained(imu: Reading[ImuData], fixes: GpsData) -> bool:
    """Return whether some axes, possibly impossible ones, explain the fixes."""
    return mounting_of(imu, fixes) is not None


def mounting_of(imu: Reading[ImuData], fixes: GpsData) -> Mounting | None:
    """Estimate the mounting from the first half an hour."""
    return find_mounting(intervals(imu.data.beginning(LONGEST)), fixes)


def refusal(mounting: Mounting, where: str) -> InputError:
    """Build the error for axes that no rotation maps to the vehicle, or for gyros of other columns."""
    inverted = mounting.inverted
    if mounting.gyro_units != ALL_ALIKE:
        units = ("deg/s", "rad/s") if min(mounting.gyro_units) < 1.0 else ("rad/s", "deg/s")
        odd = next(axis for axis in range(3) if mounting.gyro_units.count(mounting.gyro_units[axis]) == 1)
        if mounting.gyro_units[odd] == 1.0:
            units = units[::-1]
        axis, windows = "xyz"[odd], mounting.windows
        return InputError(
            "mounting.gyro_unit_odd", where=where, axis=axis, unit=units[0], others=units[1], windows=windows
        )
    windows, axes = mounting.windows, tuple(inverted)
    if mounting.gyro_order != IN_ORDER:
        about = tuple("xyz"[mounting.gyro_order.index(gyro)] for gyro in range(3))
        return InputError("mounting.gyro_order", where=where, about=about, windows=windows)
    if mounting.mirrored and len(inverted) == 3:
        gives = {"accel_sign": "minus-force"}
        return InputError("mounting.accelerometers_inverted", where=where, gives=gives, windows=windows)
    if mounting.mirrored and mounting.changes == 1:
        points = tuple(WORDS[letter] for letter in mounting.letters)
        return InputError("mounting.accelerometer_inverted", where=where, axis=axes[0], points=points, windows=windows)
    if mounting.mirrored:
        points = tuple(WORDS[letter] for letter in mounting.letters)
        return InputError("mounting.left_handed", where=where, points=points, axes=axes, windows=windows)
    return InputError("mounting.gyros_wrong_way", where=where, axes=axes, windows=windows)
