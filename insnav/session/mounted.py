"""How the IMU is mounted, estimated from the drive: samples in the axes of the vehicle, and findings."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from insnav import spill
from insnav.alignment import Mounting, find_mounting
from insnav.alignment.in_motion import sure_motion
from insnav.alignment.mounting import ALL_ALIKE, IN_ORDER, letters_of
from insnav.attitude import rph_from_quat, wrap_pi
from insnav.exceptions import AlignmentError, InputError
from insnav.filter.gps_delay import Filtered, filtered
from insnav.filter.prepare import Prepared
from insnav.findings import OF_THE_IMU, Code, Finding, of_code
from insnav.input import Reading
from insnav.input.interpret.axes import axes_matrix
from insnav.input.interpret.physics import check_axes, one_gyro, quiet_part
from insnav.kernels.smoother import STATE
from insnav.session.inputs import Inputs
from insnav.strapdown import intervals
from insnav.types import FloatArray, GpsData, ImuData
from insnav.units import DEG

LOOK = 1800.0  # a drive of that length tells the mounting [s]
TURNED = 10.0 * DEG  # a smaller yaw is within what slip and wind make of the course [rad]
WORDS = {"F": "forward", "B": "back", "R": "right", "L": "left", "D": "down", "U": "up"}
UPRIGHT, INVERTED = "FRD", "FLU"
QUARTERS, QUARTER = (UPRIGHT, "RBD", "BLD", "LFD"), 0.5 * np.pi  # x forward, then turned to the right
SLANTED = 20.0 * DEG  # an IMU turned so far from a quarter is not meant to point along an axis of the vehicle
# cosines of how far an IMU may lean from axes of the vehicle that it is said to point along, and from upright else
LEANING, ON_ITS_SIDE = 0.9, 0.5
CLEAR = 4.0 * DEG  # standard deviation of the yaw below which such an IMU has angles to give: flights had 5 and 8
POINTED = 0.9  # length of the mean direction of travel in the vehicle of what goes where it points [-]
LIKELY = 2.0  # mean square of innovations by their variance up to which axes may be right: where they are it is 1 [-]
LIKELIER = 30.0  # twice the logarithm of how much likelier fixes must be with other axes than with x forward
X_FORWARD = Finding.of(Code.MOUNTING_ASSUMED, subject="imu")


def doubt_mounting(notes: Iterable[Finding], events: Iterable[Finding]) -> tuple[Finding, ...]:
    """Doubt an assumed mounting if the IMU contradicts the fixes, as it does in wrong axes."""
    contradictions = list(of_code(events, *OF_THE_IMU))
    if not contradictions or not any(of_code(notes, Code.MOUNTING_ASSUMED)):
        return ()
    begin = contradictions[0].begin
    return (Finding.of(Code.MOUNTING_DOUBTED, begin, subject="imu", count=len(contradictions)),)


def as_mounted(
    imu: Reading[ImuData], fixes: GpsData | None, inputs: Inputs
) -> tuple[Reading[ImuData], float, tuple[Finding, ...]]:
    """Samples in the axes of the vehicle if none were given, the yaw of the IMU that is left [rad], and findings.

    Raises: InputError: the axes are left-handed, the gyros turn against the accelerometers or are in another order, or
    z points up and the vehicle does not move.
    """
    if fixes is None:
        return imu, 0.0, ()
    data, found = imu.data, _found(imu, fixes)
    given = inputs.get("axes")
    if found is None:
        from_file = bool(imu.facts.columns)  # whose axes are anybody's guess
        moves = given is None and sure_motion(fixes, float(data.time[0]))[1] is not None
        if given is None and from_file and imu.facts.axes == UPRIGHT:
            scale = 1.0 / float(np.median(np.diff(data.time))) if data.sampling == "increment" else 1.0
            quiet = quiet_part(data.gyro, data.accel, interval=1.0 / imu.facts.rate_hz, scale=scale)
            try:
                check_axes(quiet, None, where=imu.facts.path)
            except InputError:
                if not moves:
                    raise
                imu, note = _turned(imu, axes_matrix(INVERTED), INVERTED, Code.MOUNTING_UPSIDE_DOWN)
                return imu, 0.0, (note, X_FORWARD)
        return imu, 0.0, (X_FORWARD,) * moves
    if not found.right_handed:
        raise _refused(found, imu.facts.path)
    matrix, notes, windows = found.to_vehicle, [], found.windows
    as_read = axes_matrix(given or imu.facts.axes or UPRIGHT)
    letters, turn = letters_of(matrix @ as_read), axes_matrix(found.letters)
    # far from all axes of the vehicle, which wind and banks move further: as it was read, if that is not on its side
    elsewhere = found.letters != UPRIGHT and given is None
    slanted = elsewhere and (matrix @ turn.T)[2, 2] < LEANING and matrix[2, 2] > ON_ITS_SIDE
    if elsewhere and not slanted:
        matrix, as_read = matrix @ turn.T, turn @ as_read
        imu, note = _turned(imu, turn, letters, Code.MOUNTING_ALONG_AXES, windows=windows)
        notes.append(note)
    left = replace(found, to_vehicle=matrix)
    yaw = float(left.angles[2])
    if given is not None and left.letters != UPRIGHT:
        values = {"yaw_rad": yaw, "windows": windows, "given": given, **_named(letters)}
        wrong = Finding.of(Code.MOUNTING_CONTRADICTS_GIVEN, float(data.time[0]), subject="imu", **values)
        imu = replace(imu, events=(*imu.events, wrong))
    elif slanted or abs(yaw) > max(TURNED, 4.0 * found.sd):
        whole = replace(found, to_vehicle=matrix @ as_read).angles / DEG
        axes = ",".join(f"{angle + 0.0:.1f}" for angle in whole) * (not slanted or found.sd < CLEAR)
        code = Code.MOUNTING_TILTED if slanted else Code.MOUNTING_YAW
        notes.append(Finding.of(code, subject="imu", yaw_rad=yaw, sd_rad=found.sd, windows=windows, axes=axes))
    else:
        yaw = 0.0
    return imu, yaw, tuple(notes)


def in_likely_axes(
    imu: Reading[ImuData], prepared: Callable[[ImuData], Prepared]
) -> tuple[Reading[ImuData], float, Finding]:
    """As `as_mounted` where accelerations tell nothing: by the fixes, with x forward, backward, to the right or left.

    Slow vehicles hardly accelerate, but turn: with x of the IMU taken for that of the vehicle the heading begins wrong
    by quarters of a turn. `X_FORWARD` if fixes are no likelier with other axes than with x forward, unless all that
    are as likely end with the same heading, which is not where the vehicle goes. What does not go where it points, as
    drones do, keeps its axes, and begins with the likeliest heading. `prepared`: prepares the drive with samples.
    """
    seen, begin = dict[str, Filtered](), imu.data.beginning(LOOK)
    for letters in QUARTERS:
        with suppress(AlignmentError, InputError):  # which the drive as it is will tell
            seen[letters] = filtered(prepared(_in_axes(begin, axes_matrix(letters))))
    best = min(seen, key=lambda each: seen[each].misfit, default=UPRIGHT)
    # none if all of them diverge, or are unlikely
    if UPRIGHT not in seen or seen[best].epochs is None or seen[best].squares >= LIKELY:
        return imu, 0.0, X_FORWARD
    fixes = seen[UPRIGHT].ready.gps.time.size
    most = seen[best].misfit + LIKELIER / fixes
    travels = {each: _travel(seen[each], QUARTERS.index(each)) for each in seen if seen[each].misfit <= most}
    yaw, share = travels[best]
    # all the same if the heading has come round to where x points; x forward is as likely as the others else
    alike = max(abs(wrap_pi(other - yaw)) for other, _ in travels.values()) < SLANTED
    if UPRIGHT in travels and not (alike and min(share for _, share in travels.values()) > POINTED):
        return imu, 0.0, X_FORWARD
    if share < POINTED:
        note = Finding.of(Code.MOUNTING_TRAVEL_VARIES, subject="imu", share=share, limit_share=POINTED)
        return imu, QUARTERS.index(best) * QUARTER, note
    nearest, by_course = round(yaw / QUARTER), UPRIGHT in travels
    gain = dict[str, Any]()
    if not by_course:
        gain = {"gain": fixes * (seen[UPRIGHT].misfit - seen[best].misfit), "limit_gain": LIKELIER}
    if abs(yaw - nearest * QUARTER) > SLANTED:
        code = Code.MOUNTING_YAW_COURSE if by_course else Code.MOUNTING_YAW_FIXES
        return imu, yaw, Finding.of(code, subject="imu", yaw_rad=yaw, **gain)
    if nearest == 0:
        return imu, 0.0, X_FORWARD
    turn = axes_matrix(QUARTERS[nearest % 4])
    letters = letters_of(turn @ axes_matrix(imu.facts.axes or UPRIGHT))
    code = Code.MOUNTING_ALONG_AXES_COURSE if by_course else Code.MOUNTING_ALONG_AXES_FIXES
    imu, note = _turned(imu, turn, letters, code, **gain)
    return imu, 0.0, note


def _travel(found: Filtered, quarter: int) -> tuple[float, float]:
    """By how much the IMU is turned against the direction of travel [rad], and how much of the way is along that [-].

    An axis, as a forklift goes backward as well: the mean of doubled angles (Mardia and Jupp, "Directional statistics",
    2000, section 1.1); forward on it is where it goes more.
    """
    if found.epochs is None:
        return 0.0, 0.0
    settled = found.epochs[found.epochs.shape[0] // 2 :, STATE : STATE + 10]  # a heading that began wrong is right then
    along = settled[:, 3] - 1j * settled[:, 4]
    ahead = np.exp(1j * rph_from_quat(settled[:, 6:])[:, 2]) * along * np.abs(along)
    size = np.maximum(np.abs(ahead), 1e-12)
    axis = np.sum(ahead**2 / size)
    forward = np.exp(0.5j * np.angle(axis))
    forward *= np.sign(np.sum((ahead / forward).real)) or 1.0
    return float(wrap_pi(quarter * QUARTER + np.angle(forward))), float(abs(axis) / np.sum(size))


def _turned(
    imu: Reading[ImuData], turn: FloatArray, letters: str, code: Code, **values: Any
) -> tuple[Reading[ImuData], Finding]:
    """Samples turned into the axes of the vehicle, and the finding of `code` about their axes."""
    evidence = tuple(each for each in imu.facts.evidence if getattr(each, "code", None) is not Code.AXES_ASSUMED)
    facts = replace(imu.facts, axes=letters, evidence=evidence)
    note = Finding.of(code, subject="imu", **values, **_named(letters))
    return replace(imu, data=_in_axes(imu.data, turn), facts=facts), note


def _named(letters: str) -> dict[str, Any]:
    """Axes as --imu-axes takes them, and where each of x, y, z points."""
    return {"axes": letters, **{axis: WORDS[letter] for axis, letter in zip("xyz", letters, strict=True)}}


def _in_axes(data: ImuData, turn: FloatArray) -> ImuData:
    gyro, accel = (spill.by_blocks(lambda values: values @ turn.T, each) for each in (data.gyro, data.accel))
    return replace(data, gyro=gyro, accel=accel)


def refuse_unlike_gyros(imu: Reading[ImuData], fixes: GpsData) -> None:
    """Refuse gyros in another order than the accelerometers, or one of them in another unit."""
    found = _found(imu, fixes)
    if found is not None and (found.gyro_order != IN_ORDER or found.gyro_units != ALL_ALIKE):
        raise _refused(found, imu.facts.path)


def explained(imu: Reading[ImuData], fixes: GpsData) -> bool:
    """Whether some axes explain the fixes, those that no IMU has too."""
    return _found(imu, fixes) is not None


def _found(imu: Reading[ImuData], fixes: GpsData) -> Mounting | None:
    """Mounting by the first half an hour."""
    return find_mounting(intervals(imu.data.beginning(LOOK)), fixes)


def _words(letters: str) -> str:
    return ", ".join(WORDS[letter] for letter in letters)


def _refused(found: Mounting, where: str) -> InputError:
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
