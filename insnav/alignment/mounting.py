"""How the IMU sits in the vehicle: its axes against the direction of travel, from gravity and from accelerations.

In windows of a few seconds the gyros carry the specific force into the axes of the window's start, where its integrals
must be the changes of GPS velocity less gravity (compare Wu and Pan, "Velocity/position integration formula part I:
application to in-flight coarse alignment", IEEE Trans. AES 49 (2013) 1006-1023), or, integrated twice, those of
positions from a place and a velocity that are left open. The rotation between the two sets of vectors (Wahba, "A least
squares estimate of satellite attitude", SIAM Review 7 (1965) 409; Markley, J. Astronautical Sciences 36 (1988) 245-258:
by singular values) is the attitude of the IMU, and nothing but the data tells it; against the course over ground it is
the mounting. Where a reflection fits far better than any rotation, or gyros of other signs than those given, the axes
are no right-handed set; where gyros fit in another order, or one in another unit, the columns are mixed up.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from insnav.alignment.align import stationary_of
from insnav.alignment.in_motion import SLOWEST, gives_velocities, positions_alone, velocity
from insnav.alignment.static import summarize
from insnav.attitude import quat_from_dcm, rph_from_quat, wrap_pi
from insnav.earth import earth_rate_n, gravity_n, ned_offset
from insnav.kernels.alignment import felt_windows, mean_rotation
from insnav.strapdown import Intervals, joined
from insnav.types import FloatArray, GpsData, IntArray
from insnav.units import DEG

WINDOW = 8.0  # longer, gyro drift counts; shorter, there are too few changes of velocity [s]
STEP = 1.0  # of GPS velocity: shorter ones drown in noise [s]
NOISY, LONGEST = 3.0, 3.0  # both are so many times longer per m/s of noise, but not more
PLACED, LONGEST_PLACED = 2.0, 5.0  # windows of positions, per root of a metre: their change grows with time squared
BASE = 4.0  # of the course by positions [s]
OVERLAP = 2  # windows in which each second is
MOST = 200  # windows, those with the largest accelerations
FEWEST = 5  # windows that can tell
LIVELY = 0.3  # RMS acceleration of a window that tells a direction [m/s^2]
TURN = np.deg2rad(25.0)  # of the course, from which a window shows a bend
TELLING = 30  # bends, and straight windows, that the signs of the gyros are looked for in
SUDDEN = 15.0  # no vehicle accelerates more: the velocities are false [m/s^2]
SCATTER = np.deg2rad(8.0)  # standard deviation of the yaw beyond which nothing is said
# signs are wrong if others leave less than so much of the residuals, at first and with bias and delay
TRIED, HANDED = 0.75, 0.6
ALIKE = 1.1  # times the least residuals; of such signs those are taken that change the fewest
FITS = 0.4  # and they leave more of the accelerations; in level turns of an aircraft both kinds of axes fit [-]
SURE_SD = np.deg2rad(1.0)  # slip and scale factors leave no yaw better known [rad]
MISFIT = 0.6  # part of the accelerations that may be left unexplained
Signs = tuple[int, int, int]
SIGNS: list[Signs] = [(x, y, z) for x in (1, -1) for y in (1, -1) for z in (1, -1)]
AS_GIVEN = SIGNS[0]
Order = tuple[int, int, int]
IN_ORDER: Order = (0, 1, 2)
# Orders of gyros, and of accelerometers with two axes exchanged, a reflection. x and y, which hardly turn on a plain,
# may be exchanged unseen.
_ORDERS: list[Order] = [(0, 2, 1), (1, 2, 0), (2, 0, 1), (2, 1, 0)]
EXCHANGED: list[tuple[Signs, bool, Order]] = [(AS_GIVEN, False, order) for order in _ORDERS]
EXCHANGED += [((-1, -1, -1), True, order) for order in (_ORDERS[0], _ORDERS[-1])]
# what brings gyros, one of which is in another unit than two, or all in another than given, to one
Units = tuple[float, ...]
ALL_ALIKE: Units = (1.0, 1.0, 1.0)
OTHER_UNITS: list[Units] = [
    (x, y, z)
    for factor in (DEG, 1.0 / DEG)
    for x, y, z in itertools.product((1.0, factor), repeat=3)
    if (x, y, z) != ALL_ALIKE
]
# no vehicle turns faster in one of a thousand samples, and none rolls and pitches so little that these rates may be
# radians for degrees [rad/s]
FASTEST, HARDLY = 12.0, np.deg2rad(1.0)
MISSED = 1.2  # times what is left that a gyro leaves which is not used: less, and it may as well be off for a while
# part of the difference in noise that gyros keep in their true units, and of what is left where they hardly turn
NOISE_TELLS, CLOSER = 0.5, 0.99
AS_IS: tuple[Signs, bool, Order] = (AS_GIVEN, False, IN_ORDER)
ROUNDS, SETTLED = 10, 0.999  # of Gauss-Newton, at most; as large a part of the misfit of the round before ends them
NUDGE = np.diag([1e-3, 1e-3, 1e-3, 0.02, 0.02, 0.02, 0.02])  # steps of its derivatives [rad/s], [m/s^2], [s]
LARGEST_BIAS = 0.1  # of gyros that can be used [rad/s]
# what is known of gyro bias [rad/s], accelerometer bias [m/s^2] and delay [s] before: a bias turns the accelerations of
# every window alike, much as the mounting does; at rest that of gyros is seen, but may warm up, as on a recorded flight
# by 0.07 deg/s
AT_REST, AT_ALL, FORCE_SD, DELAY_SD = np.deg2rad(0.1), np.deg2rad(0.5), 0.2, 1.0
_DIRECTIONS = dict(zip("FBRLDU", np.repeat(np.eye(3), 2, axis=0) * np.tile([1.0, -1.0], 3)[:, None], strict=True))
_OPPOSITE = dict(zip("FBRLDU", "BFLRUD", strict=True))
_USUAL = ("FRD", "FLU")  # axes in which IMUs are mounted if nothing else is known
# right-handed and left-handed sets of axes by their letters
_SETS: tuple[list[tuple[str, FloatArray]], list[tuple[str, FloatArray]]] = ([], [])
for _letters in itertools.permutations(_DIRECTIONS, 3):
    _matrix = np.array([_DIRECTIONS[each] for each in _letters]).T
    if (_size := float(np.linalg.det(_matrix))) != 0.0:
        _SETS[_size < 0.0].append(("".join(_letters), _matrix))


def letters_of(to_vehicle: FloatArray, *, mirrored: bool = False) -> str:
    """Nearest axes of the vehicle to x, y and z, such as ``FLU``, of a matrix (3, 3) to forward, right, down."""
    return max(_SETS[mirrored], key=lambda each: float(np.sum(each[1] * to_vehicle)))[0]


@dataclass(frozen=True, slots=True)
class Mounting:
    """The axes of the IMU in the vehicle, which travels along its forward axis."""

    to_vehicle: FloatArray  # (3, 3) from IMU axes to forward, right, down
    sd: float  # of the yaw of the IMU in the vehicle [rad]
    windows: int  # that told it
    misfit: float  # part of the accelerations that the IMU does not show [-]
    gyro_signs: Signs  # of the gyros with which the windows fit; other than 1, 1, 1: no rotation
    mirrored: bool  # whether the accelerometers fit only in a left-handed set of axes
    gyro_order: Order = IN_ORDER  # which gyro, as given, turns about each axis of the accelerometers
    gyro_units: Units = ALL_ALIKE  # what brings gyros of different units to one

    @property
    def letters(self) -> str:
        """Nearest axes of the vehicle to x, y and z, such as ``FLU``."""
        return letters_of(self.to_vehicle, mirrored=self.mirrored)

    @property
    def angles(self) -> FloatArray:
        """Roll, pitch, yaw of the IMU in the vehicle, (3,) [rad]; of a right-handed set."""
        angles = np.asarray(rph_from_quat(quat_from_dcm(self.to_vehicle)))
        return np.asarray(wrap_pi(angles))

    @property
    def inverted(self) -> list[str]:
        """Axes whose gyros turn the wrong way in the set of axes that the accelerometers fit in.

        If that is left-handed because one accelerometer is inverted, and its gyro is not, it is that axis.
        """
        return [axis for axis, sign in zip("xyz", self.gyro_signs, strict=True) if (sign < 0) != self.mirrored]

    @property
    def changes(self) -> int:
        """How many columns, at least, are to change their signs."""
        if self.mirrored and len(self.inverted) == 1:
            at = "xyz".index(self.inverted[0])
            return 1 if self.letters[:at] + _OPPOSITE[self.letters[at]] + self.letters[at + 1 :] in _USUAL else 4
        return {0: 2, 3: 3}.get(len(self.inverted), 4) if self.mirrored else len(self.inverted)

    @property
    def right_handed(self) -> bool:
        """Whether a rotation brings the axes to those of the vehicle, and the gyros turn as they should."""
        as_given = self.gyro_signs == AS_GIVEN and self.gyro_order == IN_ORDER and self.gyro_units == ALL_ALIKE
        return as_given and not self.mirrored


def find_mounting(parts: Intervals, gps: GpsData) -> Mounting | None:
    """Mounting of an IMU from a drive, by velocities or else by positions; None if the drive does not tell it.

    `parts`: samples as intervals, in the axes they were given in. `gps`: fixes, with standard deviations.
    """
    found = _find(parts, gps, placed=False) if gives_velocities(gps) else None
    return found or _find(parts, positions_alone(gps), placed=True)


def _find(parts: Intervals, gps: GpsData, *, placed: bool) -> Mounting | None:
    windows = _Windows.of(parts, gps, placed=placed)
    if windows is None:
        return None
    rest = stationary_of(parts, gps)
    still = np.append(summarize(parts, *rest).rate if rest is not None else np.zeros(3), np.zeros(4))
    still_sd = np.repeat([AT_ALL if rest is None else AT_REST, FORCE_SD, DELAY_SD], [3, 3, 1])
    parts, telling = joined([parts]), windows.telling
    signs, mirrored = AS_GIVEN, False
    if telling.bends >= FEWEST:
        felt = [_felt(telling, parts, still, other) for other in SIGNS]
        tried = [
            _fit(telling, *each, mirrored=way)[0] for each in zip(felt, SIGNS, strict=True) for way in (False, True)
        ]
        given, best = tried[0].misfit, min(each.misfit for each in tried)
        if given > FITS and best < TRIED * given:  # what hardly turns, as about x on a plain, has any sign
            alike = [each for each in tried if each.misfit < ALIKE * best]
            chosen = min(alike, key=lambda each: (each.changes, each.misfit))
            signs, mirrored = chosen.gyro_signs, chosen.mirrored

    def refined(
        signs: Signs, mirrored: bool, order: Order = IN_ORDER, units: Units = ALL_ALIKE
    ) -> tuple[Mounting, float]:
        """Mounting by all windows, and what the telling ones leave."""
        before, changed = still.copy(), parts
        if order != IN_ORDER or units != ALL_ALIKE:
            before[:3] = (still[:3] * units)[list(order)]
            changed = replace(parts, gyro=np.ascontiguousarray((parts.gyro * units)[:, order]))
        at, sd, left = _refined(telling, changed, (before, still_sd), signs, mirrored=mirrored)
        found = _fit(windows, _felt(windows, changed, at, signs), signs, mirrored=mirrored)[0]
        found = replace(found, sd=float(np.hypot(found.sd, sd)), gyro_order=order, gyro_units=units)
        return found, left

    found, left = refined(signs, mirrored)
    if not found.right_handed:  # nor do bias and delay make a drive fit as it was given
        plain, as_given = refined(AS_GIVEN, mirrored=False)
        found, left = (plain, as_given) if as_given <= FITS or left >= HANDED * as_given else (found, left)
    if telling.bends >= FEWEST:
        found = _mixed_up(found, left, parts.gyro / parts.dt[:, None], refined)
    least = MISFIT if found.windows >= OVERLAP * FEWEST else FITS  # few windows fit by chance more easily
    return found if found.misfit < least and found.sd < SCATTER else None


def _mixed_up(
    found: Mounting, left: float, rates: FloatArray, refined: Callable[..., tuple[Mounting, float]]
) -> Mounting:
    """Mounting if gyros are in another order than accelerometers, or one in another unit; else that `found`.

    `left`: what it leaves. `rates` (n, 3): of the gyros [rad/s]. `refined`: others, and what they leave.
    """
    fits = left <= FITS
    if fits and not found.right_handed:
        return found
    fastest, up = np.quantile(np.abs(rates), 0.999, axis=0), int(np.argmax(np.abs(found.to_vehicle[2])))

    def small(units: Units) -> bool:
        """Whether only gyros that hardly turn are in a smaller one: these fit as they are, too."""
        larger = np.array(units) > 1.0
        return min(units) == 1.0 and not larger[up] and bool((fastest[larger] < HARDLY).all())

    others = [
        (*AS_IS, units)
        for units in OTHER_UNITS
        if float(np.max(fastest * units)) < FASTEST and (not fits or small(units))
    ]
    if not fits:
        others += [(*each, ALL_ALIKE) for each in EXCHANGED]
    if not others:
        return found
    ones = [refined(*each) for each in others]
    least = min(each[1] for each in ones)
    # of units that fit, one for all if that may be, as the course tells: what hardly turns has any
    other = min(ones, key=lambda each: (each[1] > ALIKE * least, len({*each[0].gyro_units}), each[1]))[0]
    better, factor = least < min(FITS, HANDED * left), np.array(other.gyro_units)
    alike = _unlike(rates * factor) < NOISE_TELLS * _unlike(rates)
    if fits:
        return other if better or (alike and least < CLOSER * left) else found
    if np.ptp(factor) == 0.0:
        better = better and other.gyro_units == ALL_ALIKE
    elif better and not alike:
        better = refined(*AS_IS, tuple(np.where(factor == factor.min(), 0.0, factor)))[1] > MISSED * least
    return other if better else found


def _unlike(rates: FloatArray) -> float:
    """How much the noise of three gyros (n, 3) differs, by the logarithm of that from sample to sample."""
    noise = np.median(np.abs(np.diff(rates, axis=0)), axis=0)
    return float(np.std(np.log(np.maximum(noise, 1e-12))))


def _refined(
    windows: _Windows, parts: Intervals, before: tuple[FloatArray, FloatArray], signs: Signs, *, mirrored: bool
) -> tuple[FloatArray, float, float]:
    """Biases [rad/s], [m/s^2], and how much later the samples are stamped than the velocities [s], by Gauss-Newton.

    `before`: mean (7,) and standard deviation (7,) of them before. Returns them, (7,), the standard deviation of the
    yaw by what is not known of them [rad], and the misfit that they leave.
    """

    def fitted(at: FloatArray) -> tuple[Mounting, FloatArray]:
        return _fit(windows, _felt(windows, parts, at, signs), signs, mirrored=mirrored)

    start, sd = before
    at = start.copy()
    found, left = fitted(at)
    for _ in range(ROUNDS):
        pushed = [fitted(at + step) for step in NUDGE]
        slope = np.column_stack([(each[1] - left) / step.sum() for each, step in zip(pushed, NUDGE, strict=True)])
        # a window counts once, as what is not modelled lasts, and half as its halves are those of others
        noise = OVERLAP * float(np.sum(left**2)) / len(windows.turned)
        covariance = np.linalg.inv(slope.T @ slope / noise + np.diag(sd**-2))
        turns = [each[0].to_vehicle @ found.to_vehicle.T for each in pushed]
        yaw = np.array([np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1]) for turn in turns])
        yaw /= NUDGE.sum(axis=0)
        change = covariance @ ((start - at) / sd**2 - slope.T @ left / noise)
        other, other_left = fitted(at + change)
        if np.abs(change[:3]).max() > LARGEST_BIAS or other.misfit >= found.misfit:
            break
        settled = other.misfit > SETTLED * found.misfit
        at, found, left = at + change, other, other_left
        if settled:
            break
    return at, float(np.sqrt(yaw @ covariance @ yaw)), found.misfit


@dataclass(frozen=True, slots=True)
class _Windows:
    """Spans of a drive with accelerations, by GPS."""

    times: FloatArray  # (w, k) of fixes [s]
    compared: FloatArray  # (w, m, k) sums over them: changes of velocity, or of positions what no steady way makes
    change: FloatArray  # (w, m, 3) those of GPS less gravity, forward, right, down [m/s] or [m]
    strength: FloatArray  # sum of squared horizontal changes
    turned: FloatArray  # change of the course from its start to its end [rad]
    lla: FloatArray  # of the first fix
    placed: bool  # whether positions are compared, not velocities

    @property
    def telling(self) -> _Windows:
        """As many with a bend in them as straight ones: signs of gyros show in bends, against the axis of travel."""
        bend = np.abs(self.turned) > TURN
        rows = np.concatenate([np.flatnonzero(bend)[-TELLING:], np.flatnonzero(~bend)[-TELLING:]])
        return self._rows(rows)

    @property
    def bends(self) -> int:
        """Number of windows with a bend in them."""
        return int((np.abs(self.turned) > TURN).sum())

    def _rows(self, rows: IntArray) -> _Windows:
        times, compared, change = self.times[rows], self.compared[rows], self.change[rows]
        return _Windows(times, compared, change, self.strength[rows], self.turned[rows], self.lla, self.placed)

    @classmethod
    def of(cls, parts: Intervals, gps: GpsData, *, placed: bool) -> _Windows | None:
        """The liveliest windows, if there are enough."""
        speed, lla = velocity(gps, BASE), gps.lla[0]
        time = gps.time if placed else speed.time
        inside = (time > parts.end[0]) & (time < parts.end[-1])
        if inside.sum() < FEWEST * 3 or speed.time.size < 2:
            return None
        time, sd = time[inside], np.interp(time[inside], speed.time, speed.sd)
        v_n = np.column_stack([np.interp(time, speed.time, each) for each in speed.v_n.T])
        value = ned_offset(gps.lla[inside], lla) if placed else v_n
        noise = gps.position_sd[inside, :2].max(axis=1) if placed else sd
        longer = float(np.clip(NOISY * np.median(sd), 1.0, LONGEST))
        seconds = STEP * longer
        if placed:
            longer, seconds = float(np.clip(PLACED * np.sqrt(np.median(noise)), 1.0, LONGEST_PLACED)), STEP
        step = max(1, round(seconds / max(float(np.median(np.diff(time))), 1e-3)))
        time, v_n, sd, value, noise = (each[::step] for each in (time, v_n, sd, value, noise))
        rows = max(3 + placed, round(longer * WINDOW / max(float(np.median(np.diff(time))), 1e-3)))
        first = np.arange(0, time.size - rows, rows // OVERLAP)
        some = first[:, None] + np.arange(rows + 1)
        since, v, least = time[some] - time[first, None], v_n[some], np.maximum(SLOWEST, 5.0 * sd[first])
        sudden = np.max(np.abs(np.diff(v, axis=1)) / np.diff(since)[..., None], axis=(1, 2)) > SUDDEN
        fast = np.hypot(v[:, 0, 0], v[:, 0, 1]) >= least
        use = np.flatnonzero(fast & ~sudden & (since[:, -1] <= 2.0 * longer * WINDOW))
        some, since, v, least = some[use], since[use], v[use], least[use]
        compared, unit = np.broadcast_to(np.diff(np.eye(rows + 1), axis=0), (use.size, rows, rows + 1)), since
        if placed:
            steady = np.stack([np.ones_like(since), since], axis=-1)
            compared, unit = np.swapaxes(np.linalg.qr(steady, mode="complete")[0][..., 2:], 1, 2), 0.5 * since**2
        unit = unit[..., None]  # what an acceleration of one makes
        power = np.sum((compared @ value[some, :2]) ** 2, axis=(1, 2))
        power -= 2.0 * np.sum(compared**2, axis=(1, 2)) * np.mean(noise[some] ** 2, axis=1)
        course, end = np.arctan2(v[:, 0, 1], v[:, 0, 0]), v[:, -1]
        change = compared @ (value[some] - gravity_n(lla[0], lla[2]) * unit) @ _about_down(course)
        turned = np.asarray(wrap_pi(np.arctan2(end[:, 1], end[:, 0]) - course))
        turned[np.hypot(end[:, 0], end[:, 1]) <= least] = 0.0  # the course of one that has stopped is noise
        windows = cls(time[some], compared, change, power, turned, lla, placed)
        windows = windows._rows(np.flatnonzero(power >= LIVELY**2 * np.sum((compared @ unit) ** 2, axis=(1, 2))))
        if windows.strength.size < FEWEST * (1 if windows.bends >= OVERLAP else OVERLAP):
            return None  # straight on, a drone may fly any side ahead
        return windows._rows(np.argsort(windows.strength)[-MOST:])


def _felt(windows: _Windows, parts: Intervals, given: FloatArray, signs: Signs) -> FloatArray:
    """Specific force, integrated to the times of each window and compared, (w, m, 3) in the axes of its start.

    `given` (7,): bias of gyros [rad/s] and accelerometers [m/s^2], and delay of the samples [s].
    """
    sign, lat = np.array(signs, dtype=float), float(windows.lla[0])
    shifted = np.clip(windows.times + given[6], parts.end[0] - parts.dt[0], parts.end[-1])
    felt = np.empty((*shifted.shape, 3))
    after = np.minimum(np.searchsorted(parts.end, shifted[:, -1] - 1e-6) + 1, parts.end.size)
    ends = np.column_stack([np.searchsorted(parts.end, shifted[:, 0] + 1e-6, side="right"), after])
    bias, w_ie_n = given[:6] * np.append(sign, np.ones(3)), earth_rate_n(lat)
    samples = parts.end, parts.dt, parts.gyro, parts.accel
    felt_windows(*samples, sign, bias, w_ie_n, shifted, ends, windows.placed, felt)
    return np.asarray(windows.compared @ felt)


def _fit(windows: _Windows, felt: FloatArray, signs: Signs, *, mirrored: bool) -> tuple[Mounting, FloatArray]:
    """Mean rotation (or reflection) over the windows, and what it leaves of each change.

    `felt`: by `_felt`, with gyros of these `signs`.
    """
    weight, matrices, mean = np.sqrt(windows.strength), np.empty((len(felt), 3, 3)), np.empty((3, 3))
    away = np.empty(len(felt))
    # windows in reverse, or with wheels that slip, do not count
    mean_rotation(windows.change, felt, weight, -1.0 if mirrored else 1.0, matrices, mean, away)
    axis = int(np.argmin(np.abs(mean[2])))  # the least vertical: its direction is the yaw
    yaw = np.arctan2(matrices[:, 1, axis], matrices[:, 0, axis])
    off = np.asarray(wrap_pi(yaw - np.arctan2(mean[1, axis], mean[0, axis])))
    apart = 2.0 * np.arcsin(np.minimum(away / np.sqrt(8.0), 1.0))
    scatter = 1.4826 * float(np.median(apart))  # of an aircraft: banks, too
    turned = _about_down(-off) @ matrices
    left = (windows.change - felt @ np.swapaxes(turned, 1, 2)) / weight[:, None, None]
    squares = np.minimum(np.sum(left**2, axis=(1, 2)), 1.0)
    sd = max(SURE_SD, 1.25 * scatter * np.sqrt(OVERLAP / len(left)))
    mounting = Mounting(mean, sd, len(left), float(np.sqrt(np.mean(squares))), signs, mirrored)
    return mounting, np.clip(left, -1.0, 1.0).ravel()


def _about_down(angle: ArrayLike) -> FloatArray:
    """Rotation of vectors about the down axis by each angle [rad], (..., 3, 3)."""
    turn = np.zeros((*np.shape(angle), 3, 3))
    turn[..., 0, 0] = turn[..., 1, 1] = np.cos(angle)
    turn[..., 1, 0] = np.sin(angle)
    turn[..., 0, 1] = -turn[..., 1, 0]
    turn[..., 2, 2] = 1.0
    return turn
