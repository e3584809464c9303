"""Axes of an IMU that explain the fixes, and what no rotation explains."""

from __future__ import annotations

from insnav.alignment import Mounting, find_mounting
from insnav.alignment.mounting import ALL_ALIKE, IN_ORDER
from insnav.exceptions import InputError
from insnav.input import Reading
from insnav.input.interpret.physics import one_gyro
from insnav.strapdown import intervals
from insnav.types import GpsData, ImuData

LOOK = 1800.0  # a drive of that length tells the mounting [s]
WORDS = {"F": "forward", "B": "back", "R": "right", "L": "left", "D": "down", "U": "up"}


def refuse_unlike_gyros(imu: Reading[ImuData], fixes: GpsData) -> None:
    """Refuse gyros in another order than the accelerometers, or one of them in another unit."""
    found = mounting_of(imu, fixes)
    if found is not None and (found.gyro_order != IN_ORDER or found.gyro_units != ALL_ALIKE):
        raise refusal(found, imu.facts.path)


def explained(imu: Reading[ImuData], fixes: GpsData) -> bool:
    """Whether some axes explain the fixes, those that no IMU has too."""
    return mounting_of(imu, fixes) is not None


def mounting_of(imu: Reading[ImuData], fixes: GpsData) -> Mounting | None:
    """Estimate the mounting from the first half an hour."""
    return find_mounting(intervals(imu.data.beginning(LOOK)), fixes)


def _words(letters: str) -> str:
    return ", ".join(WORDS[letter] for letter in letters)


def refusal(found: Mounting, where: str) -> InputError:
    """What is wrong with axes that no rotation brings to those of the vehicle, or with gyros of other columns."""
    inverted, told = found.inverted, f"({found.windows} windows of the drive)"
    if found.gyro_units != ALL_ALIKE:
        units = ("deg/s", "rad/s") if min(found.gyro_units) < 1.0 else ("rad/s", "deg/s")
        odd = next(axis for axis in range(3) if found.gyro_units.count(found.gyro_units[axis]) == 1)
        if found.gyro_units[odd] == 1.0:
            units = units[::-1]
        why = f"accelerations by GPS fit only if it is in {units[0]} and the others are in {units[1]} {told}"
        return one_gyro(f"gyro {'xyz'[odd]}", why, where)
    why = "accelerations by GPS fit only with all signs of the accelerometers changed"
    if found.gyro_order != IN_ORDER:
        what = "the gyros are in another order than the accelerometers"
        about = ", ".join("xyz"[found.gyro_order.index(gyro)] for gyro in range(3))
        why = f"accelerations by GPS fit only if gyros x, y, z turn about {about} of the accelerometers"
        fix = "put the columns of the gyros, or those of the accelerometers, in the file in the order of the others"
    elif found.mirrored and len(inverted) == 3:
        what, fix = "the accelerometers are inverted", "change the signs of the accelerometers in the file"
    elif found.mirrored:
        what = "the axes of the IMU are left-handed"
        why = f"accelerations by GPS fit only if x, y, z point {_words(found.letters)}"
        fix = "change the sign of one axis of the accelerometers, and of the same axis of the gyros, in the file"
        if found.changes == 1:
            what, fix = f"accelerometer {inverted[0]} is inverted", "change its sign in the file"
        elif inverted:
            fix += f"; of the gyros as they are, {', '.join(inverted)} contradict{'s' * (len(inverted) == 1)} the rest"
    else:
        one = len(inverted) == 1
        what = f"gyro {inverted[0]} turns the wrong way" if one else "the gyros turn the wrong way"
        why = "with them the accelerations do not fit those of GPS; with other signs they do"
        fix = f"change the sign{'s' * (not one)} of gyro{'s' * (not one)} {', '.join(inverted)} in the file"
    return InputError(what, where=where, why=f"{why} {told}", fix=fix)
