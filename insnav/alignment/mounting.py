"""Mounting of the IMU in the vehicle, relative to the direction of travel, from gravity and accelerations.

In windows of a few seconds the gyros carry the specific force into the axes at the window's start. Its integrals there
must equal the changes of GPS velocity minus gravity (compare Wu and Pan, "Velocity/position integration formula part I:
application to in-flight coarse alignment", IEEE Trans. AES 49 (2013) 1006-1023). Twice integrated, they must equal
position changes from a free place and velocity. The rotation between the two sets of vectors (Wahba, "A least squares
estimate of satellite attitude", SIAM Review 7 (1965) 409; Markley, J. Astronautical Sciences 36 (1988) 245-258: by
singular values) is the IMU attitude, from the data alone. Relative to the course over ground it is the mounting. If a
reflection, or gyros of other signs, fit far better, the axes are left-handed. If other gyro orders or units fit, the
columns are mixed up.
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

WINDOW = 8.0  # longer, gyro drift dominates; shorter, there are too few velocity changes [s]
STEP = 1.0  # of GPS velocity: shorter steps are noise [s]
NOISY, LONGEST = 3.0, 3.0  # factor on both per m/s of noise, and its maximum
PLACED, LONGEST_PLACED = 2.0, 5.0  # windows of positions, factor per root of a metre: change grows as time squared
BASE = 4.0  # for the course by positions [s]
OVERLAP = 2  # windows that contain each second
MOST = 200  # windows with the largest accelerations
FEWEST = 5  # windows for an estimate
LIVELY = 0.3  # RMS acceleration of a useful window [m/s^2]
TURN = np.deg2rad(25.0)  # course change of a turning window
TELLING = 30  # turning and straight windows used for the signs of the gyros
SUDDEN = 15.0  # no vehicle accelerates more: the velocities are false [m/s^2]
SCATTER = np.deg2rad(8.0)  # standard deviation of the yaw beyond which there is no result
# other signs must leave less than this share of the residuals, at first, and with bias and delay
TRIED, HANDED = 0.75, 0.6
ALIKE = 1.1  # similar residuals, relative to the least: among such signs the fewest changes are chosen
FITS = 0.4  # share of unexplained accelerations that permits other signs; in level aircraft turns both fit [-]
SURE_SD = np.deg2rad(1.0)  # lower limit of the yaw sd, by slip and scale factors [rad]
MISFIT = 0.6  # largest unexplained share of the accelerations
Signs = tuple[int, int, int]
SIGNS: list[Signs] = [(x, y, z) for x in (1, -1) for y in (1, -1) for z in (1, -1)]
AS_GIVEN = SIGNS[0]
Order = tuple[int, int, int]
IN_ORDER: Order = (0, 1, 2)
# Gyro orders, and accelerometers with two axes exchanged, a reflection. On level roads x and y hardly turn: their
# exchange may go undetected.
_ORDERS: list[Order] = [(0, 2, 1), (1, 2, 0), (2, 0, 1), (2, 1, 0)]
EXCHANGED: list[tuple[Signs, bool, Order]] = [(AS_GIVEN, False, order) for order in _ORDERS]
EXCHANGED += [((-1, -1, -1), True, order) for order in (_ORDERS[0], _ORDERS[-1])]
# factors that convert gyros to one unit, if one of three or all have another unit
Units = tuple[float, ...]
ALL_ALIKE: Units = (1.0, 1.0, 1.0)
OTHER_UNITS: list[Units] = [
    (x, y, z)
    for factor in (DEG, 1.0 / DEG)
    for x, y, z in itertools.product((1.0, factor), repeat=3)
    if (x, y, z) != ALL_ALIKE
]
# No vehicle exceeds the first rate in a thousandth of its samples. Roll and pitch rates below the second may be radians
# that were read as degrees [rad/s].
FASTEST, HARDLY = 12.0, np.deg2rad(1.0)
MISSED = 1.2  # factor on the residuals without one gyro: below it, that gyro may have a temporary fault
# share of the noise difference that gyros in correct units keep; residual ratio if they hardly turn
NOISE_TELLS, CLOSER = 0.5, 0.99
AS_IS: tuple[Signs, bool, Order] = (AS_GIVEN, False, IN_ORDER)
ROUNDS, SETTLED = 10, 0.999  # of Gauss-Newton at most; ratio of successive misfits that ends the iteration
NUDGE = np.diag([1e-3, 1e-3, 1e-3, 0.02, 0.02, 0.02, 0.02])  # steps of its derivatives [rad/s], [m/s^2], [s]
LARGEST_BIAS = 0.1  # of gyros that can be used [rad/s]
# prior sd of gyro bias [rad/s], accelerometer bias [m/s^2] and delay [s]. A bias rotates the accelerations of every
# window, as the mounting does. At rest, gyro bias is observed, but may change by warm-up: by 0.07 deg/s on a recorded
# flight
AT_REST, AT_ALL, FORCE_SD, DELAY_SD = np.deg2rad(0.1), np.deg2rad(0.5), 0.2, 1.0
_DIRECTIONS = dict(zip("FBRLDU", np.repeat(np.eye(3), 2, axis=0) * np.tile([1.0, -1.0], 3)[:, None], strict=True))
_OPPOSITE = dict(zip("FBRLDU", "BFLRUD", strict=True))
_USUAL = ("FRD", "FLU")  # usual axes of IMUs
# right-handed and left-handed sets of axes by their letters
_SETS: tuple[list[tuple[str, FloatArray]], list[tuple[str, FloatArray]]] = ([], [])
for _letters in itertools.permutations(_DIRECTIONS, 3):
    _matrix = np.array([_DIRECTIONS[each] for each in _letters]).T
    if (_size := float(np.linalg.det(_matrix))) != 0.0:
        _SETS[_size < 0.0].append(("".join(_letters), _matrix))


def letters_of(to_vehicle: FloatArray, *, mirrored: bool = False) -> str:
    """Return the nearest vehicle axes to x, y and z, such as ``FLU``, of a matrix (3, 3) to forward, right, down."""
    return max(_SETS[mirrored], key=lambda each: float(np.sum(each[1] * to_vehicle)))[0]


@dataclass(frozen=True, slots=True)
class Mounting:
    """IMU axes in a vehicle that travels along its forward axis."""

    to_vehicle: FloatArray  # (3, 3) from IMU axes to forward, right, down
    sd: float  # of the yaw of the IMU in the vehicle [rad]
    windows: int  # number of windows used
    misfit: float  # unexplained share of the accelerations [-]
    gyro_signs: Signs  # gyro signs that fit; other than 1, 1, 1: no rotation
    mirrored: bool  # the accelerometers fit only in left-handed axes
    gyro_order: Order = IN_ORDER  # gyro column for each accelerometer axis
    gyro_units: Units = ALL_ALIKE  # factors that convert the gyros to one unit

    @property
    def letters(self) -> str:
        """Nearest vehicle axes to x, y and z, such as ``FLU``."""
        return letters_of(self.to_vehicle, mirrored=self.mirrored)

    @property
    def angles(self) -> FloatArray:
        """Roll, pitch, yaw of the IMU in the vehicle, (3,) [rad]; of right-handed axes."""
        angles = np.asarray(rph_from_quat(quat_from_dcm(self.to_vehicle)))
        return np.asarray(wrap_pi(angles))

    @property
    def inverted(self) -> list[str]:
        """List the axes whose gyros turn the wrong way relative to the accelerometers.

        If one accelerometer is inverted, and its gyro is not, that axis is listed.
        """
        return [axis for axis, sign in zip("xyz", self.gyro_signs, strict=True) if (sign < 0) != self.mirrored]

    @property
    def changes(self) -> int:
        """Least number of signs that must change; that of all accelerometers is one convention, as of iOS."""
        if self.mirrored and len(self.inverted) == 1:
            at = "xyz".index(self.inverted[0])
            return 1 if self.letters[:at] + _OPPOSITE[self.letters[at]] + self.letters[at + 1 :] in _USUAL else 4
        return {0: 2, 3: 1}.get(len(self.inverted), 4) if self.mirrored else len(self.inverted)

    @property
    def right_handed(self) -> bool:
        """True if a rotation maps the axes to the vehicle axes, with correct gyro signs."""
        as_given = self.gyro_signs == AS_GIVEN and self.gyro_order == IN_ORDER and self.gyro_units == ALL_ALIKE
        return as_given and not self.mirrored


def find_mounting(parts: Intervals, gps: GpsData) -> Mounting | None:
    """Estimate the mounting of an IMU from a drive, by velocities or else positions; None if unobservable.

    `parts`: samples as intervals, in their original axes. `gps`: fixes with standard deviations.
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
        if given > FITS and best < TRIED * given:  # a hardly turning axis, as x on level roads, fits with any sign
            alike = [each for each in tried if each.misfit < ALIKE * best]
            chosen = min(alike, key=lambda each: (each.changes, each.misfit))
            signs, mirrored = chosen.gyro_signs, chosen.mirrored

    def refined(
        signs: Signs, mirrored: bool, order: Order = IN_ORDER, units: Units = ALL_ALIKE
    ) -> tuple[Mounting, float]:
        """Estimate the mounting by all windows; return also the residuals of the selected windows."""
        before, changed = still.copy(), parts
        if order != IN_ORDER or units != ALL_ALIKE:
            before[:3] = (still[:3] * units)[list(order)]
            changed = replace(parts, gyro=np.ascontiguousarray((parts.gyro * units)[:, order]))
        at, sd, left = _refined(telling, changed, (before, still_sd), signs, mirrored=mirrored)
        found = _fit(windows, _felt(windows, changed, at, signs), signs, mirrored=mirrored)[0]
        found = replace(found, sd=float(np.hypot(found.sd, sd)), gyro_order=order, gyro_units=units)
        return found, left

    found, left = refined(signs, mirrored)
    if not found.right_handed:  # bias and delay do not explain the drive in these axes, either
        plain, as_given = refined(AS_GIVEN, mirrored=False)
        found, left = (plain, as_given) if as_given <= FITS or left >= HANDED * as_given else (found, left)
    if telling.bends >= FEWEST:
        found = _mixed_up(found, left, parts.gyro / parts.dt[:, None], refined)
    least = MISFIT if found.windows >= OVERLAP * FEWEST else FITS  # few windows fit by chance more easily
    return found if found.misfit < least and found.sd < SCATTER else None


def _mixed_up(
    found: Mounting, left: float, rates: FloatArray, refined: Callable[..., tuple[Mounting, float]]
) -> Mounting:
    """Test other gyro orders and units; return the mounting that fits, or `found`.

    `left`: residual of `found`. `rates` (n, 3): of the gyros [rad/s]. `refined`: fits other axes; also residuals.
    """
    fits = left <= FITS
    if fits and not found.right_handed:
        return found
    fastest, up = np.quantile(np.abs(rates), 0.999, axis=0), int(np.argmax(np.abs(found.to_vehicle[2])))

    def small(units: Units) -> bool:
        """Return whether only hardly turning gyros have a smaller unit: the original unit fits them, too."""
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
    # prefer one common unit by the course: a hardly turning gyro fits any unit
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
    """Return the ratio between sample-to-sample noise of three gyros (n, 3), as a logarithm."""
    noise = np.median(np.abs(np.diff(rates, axis=0)), axis=0)
    return float(np.std(np.log(np.maximum(noise, 1e-12))))


def _refined(
    windows: _Windows, parts: Intervals, before: tuple[FloatArray, FloatArray], signs: Signs, *, mirrored: bool
) -> tuple[FloatArray, float, float]:
    """Estimate biases [rad/s], [m/s^2] and the delay of the samples behind the velocities [s], by Gauss-Newton.

    `before`: prior mean (7,) and standard deviation (7,). Returns the estimates, (7,), the yaw sd by their uncertainty
    [rad], and the misfit.
    """

    def fitted(at: FloatArray) -> tuple[Mounting, FloatArray]:
        return _fit(windows, _felt(windows, parts, at, signs), signs, mirrored=mirrored)

    start, sd = before
    at = start.copy()
    found, left = fitted(at)
    for _ in range(ROUNDS):
        pushed = [fitted(at + step) for step in NUDGE]
        slope = np.column_stack([(each[1] - left) / step.sum() for each, step in zip(pushed, NUDGE, strict=True)])
        # a window counts once, as unmodelled errors persist, and half as its halves are shared
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
    """Spans of a drive with GPS accelerations."""

    times: FloatArray  # (w, k) of fixes [s]
    compared: FloatArray  # (w, m, k) sums over fixes: velocity changes, or position changes without steady motion
    change: FloatArray  # (w, m, 3) changes of GPS minus gravity, forward, right, down [m/s] or [m]
    strength: FloatArray  # sum of squared horizontal changes
    turned: FloatArray  # course change from start to end [rad]
    lla: FloatArray  # of the first fix
    placed: bool  # positions are compared, not velocities

    @property
    def telling(self) -> _Windows:
        """Select equal numbers of turning and straight windows: turns reveal gyro signs, travel the axis."""
        bend = np.abs(self.turned) > TURN
        rows = np.concatenate([np.flatnonzero(bend)[-TELLING:], np.flatnonzero(~bend)[-TELLING:]])
        return self._rows(rows)

    @property
    def bends(self) -> int:
        """Number of turning windows."""
        return int((np.abs(self.turned) > TURN).sum())

    def _rows(self, rows: IntArray) -> _Windows:
        times, compared, change = self.times[rows], self.compared[rows], self.change[rows]
        return _Windows(times, compared, change, self.strength[rows], self.turned[rows], self.lla, self.placed)

    @classmethod
    def of(cls, parts: Intervals, gps: GpsData, *, placed: bool) -> _Windows | None:
        """Select the windows of largest acceleration, if there are enough."""
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
        unit = unit[..., None]  # effect of a unit acceleration
        power = np.sum((compared @ value[some, :2]) ** 2, axis=(1, 2))
        power -= 2.0 * np.sum(compared**2, axis=(1, 2)) * np.mean(noise[some] ** 2, axis=1)
        course, end = np.arctan2(v[:, 0, 1], v[:, 0, 0]), v[:, -1]
        change = compared @ (value[some] - gravity_n(lla[0], lla[2]) * unit) @ _about_down(course)
        turned = np.asarray(wrap_pi(np.arctan2(end[:, 1], end[:, 0]) - course))
        turned[np.hypot(end[:, 0], end[:, 1]) <= least] = 0.0  # the course of a stopped vehicle is noise
        windows = cls(time[some], compared, change, power, turned, lla, placed)
        windows = windows._rows(np.flatnonzero(power >= LIVELY**2 * np.sum((compared @ unit) ** 2, axis=(1, 2))))
        if windows.strength.size < FEWEST * (1 if windows.bends >= OVERLAP else OVERLAP):
            return None  # without turns, a drone may fly in any direction
        return windows._rows(np.argsort(windows.strength)[-MOST:])


def _felt(windows: _Windows, parts: Intervals, given: FloatArray, signs: Signs) -> FloatArray:
    """Integrate specific force to the times of each window for comparison, (w, m, 3) in the axes of its start.

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
    """Fit the mean rotation (or reflection) over the windows; return the residual of each change.

    `felt`: from `_felt`, with gyros of these `signs`.
    """
    weight, matrices, mean = np.sqrt(windows.strength), np.empty((len(felt), 3, 3)), np.empty((3, 3))
    away = np.empty(len(felt))
    # windows in reverse or with wheel slip are de-weighted
    mean_rotation(windows.change, felt, weight, -1.0 if mirrored else 1.0, matrices, mean, away)
    axis = int(np.argmin(np.abs(mean[2])))  # the least vertical axis: its direction is the yaw
    yaw = np.arctan2(matrices[:, 1, axis], matrices[:, 0, axis])
    off = np.asarray(wrap_pi(yaw - np.arctan2(mean[1, axis], mean[0, axis])))
    apart = 2.0 * np.arcsin(np.minimum(away / np.sqrt(8.0), 1.0))
    scatter = 1.4826 * float(np.median(apart))  # of an aircraft: includes banks
    turned = _about_down(-off) @ matrices
    left = (windows.change - felt @ np.swapaxes(turned, 1, 2)) / weight[:, None, None]
    squares = np.minimum(np.sum(left**2, axis=(1, 2)), 1.0)
    sd = max(SURE_SD, 1.25 * scatter * np.sqrt(OVERLAP / len(left)))
    mounting = Mounting(mean, sd, len(left), float(np.sqrt(np.mean(squares))), signs, mirrored)
    return mounting, np.clip(left, -1.0, 1.0).ravel()


def _about_down(angle: ArrayLike) -> FloatArray:
    """Return rotations of vectors about the down axis by each angle [rad], (..., 3, 3)."""
    turn = np.zeros((*np.shape(angle), 3, 3))
    turn[..., 0, 0] = turn[..., 1, 1] = np.cos(angle)
    turn[..., 1, 0] = np.sin(angle)
    turn[..., 0, 1] = -turn[..., 1, 0]
    turn[..., 2, 2] = 1.0
    return turn
