"""Mounting of the IMU in the vehicle, relative to the direction of travel, from gravity and accelerations.

In windows of a few seconds the gyros carry the specific force into the axes at the window's start. Its integrals there
must equal the changes of GPS velocity minus gravity (compare Wu and Pan, "Velocity/position integration formula part I:
application to in-flight coarse alignment", IEEE Trans. AES 49 (2013) 1006-1023). Twice integrated, they must equal
position changes from a free place and velocity. The rotation between the two sets of vectors (Wahba, "A least squares
estimate of satellite attitude", SIAM Review 7 (1965) 409; Markley, J. Astronautical Sciences 36 (1988) 245-258: by
singular values) is the IMU attitude, from the data alone. Relative to the course over ground it is the mounting.

Over half a minute, gravity shows tilts of a degree: it must turn in the body as the gyros measure. Of all orders and
signs of the gyros, and of a reflection, some may fit every part of the drive better. Then the columns are mixed up.
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
PLACED, LONGEST_PLACED = 2.0, 4.0  # windows of positions, factor per root of a metre; the longest show tilts
BASE = 4.0  # for the course by positions [s]
OVERLAP = 2  # windows that contain each second
MOST = 200  # windows with the largest accelerations
FEWEST = 5  # windows for an estimate
SHARE = 0.1  # error of accelerations, by slip, scale factors and lever arm [-]
LIVELY = 0.3  # RMS acceleration of a useful window [m/s^2]
TURN = np.deg2rad(25.0)  # course change of a turning window
SUDDEN = 15.0  # no vehicle accelerates more: the velocities are false [m/s^2]
SCATTER = np.deg2rad(8.0)  # standard deviation of the yaw beyond which there is no result
# other axes, or units, must leave less than this share of the residuals; axes also by sd of the windows
HANDED, SURE = 0.75, 2.0
TRIED = 24  # other axes tested with bias and delay
ALIKE = 1.1  # similar residuals, relative to the least: among such signs the fewest changes are chosen
FITS = 0.4  # share of unexplained accelerations that permits other units [-]
SURE_SD = np.deg2rad(1.0)  # lower limit of the yaw sd, by slip and scale factors [rad]
MISFIT = 0.6  # largest unexplained share of the accelerations
Signs = tuple[int, int, int]
SIGNS: list[Signs] = [(x, y, z) for x in (1, -1) for y in (1, -1) for z in (1, -1)]
AS_GIVEN = SIGNS[0]
Order = tuple[int, int, int]
IN_ORDER: Order = (0, 1, 2)
Axes = tuple[Signs, bool, Order]  # of gyros, with left-handed accelerometers or not
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
# share of the noise difference that gyros in correct units keep; ratio of residuals from which there is no gain
NOISE_TELLS, CLOSER = 0.5, 0.99
_ORDERS: list[Order] = [(1, 0, 2), (0, 2, 1), (1, 2, 0), (2, 0, 1), (2, 1, 0)]
AS_IS: Axes = (AS_GIVEN, False, IN_ORDER)
ROUNDS = 10  # of Gauss-Newton at most
NUDGE = np.diag([1e-3, 1e-3, 1e-3, 0.02, 0.02, 0.02, 0.02])  # steps of its derivatives [rad/s], [m/s^2], [s]
LARGEST_BIAS = 0.1  # of gyros that can be used [rad/s]
# prior sd of gyro bias [rad/s], accelerometer bias [m/s^2] and delay [s]. A bias rotates the accelerations of every
# window, as the mounting does. At rest, gyro bias is observed, but may change by warm-up: by 0.07 deg/s on a recorded
# flight
AT_REST, AT_ALL, FORCE_SD, DELAY_SD = np.deg2rad(0.1), np.deg2rad(0.5), 0.2, 1.0
_DIRECTIONS = dict(zip("FBRLDU", np.repeat(np.eye(3), 2, axis=0) * np.tile([1.0, -1.0], 3)[:, None], strict=True))
# right-handed and left-handed sets of axes by their letters
_SETS: tuple[list[tuple[str, FloatArray]], list[tuple[str, FloatArray]]] = ([], [])
for _letters in itertools.permutations(_DIRECTIONS, 3):
    _matrix = np.array([_DIRECTIONS[each] for each in _letters]).T
    if (_size := float(np.linalg.det(_matrix))) != 0.0:
        _SETS[_size < 0.0].append(("".join(_letters), _matrix))


def _changes(matrix: FloatArray) -> int:
    """Count changed signs, all together as one, and exchanged columns."""
    signs, away = int(np.sum(matrix < 0.0)), int(np.sum(np.diag(matrix) == 0.0))
    return (0, 1, 2, 1)[signs] + max(0, away - 1)


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
    def corrections(self) -> tuple[FloatArray, FloatArray]:
        """Matrices (3, 3) with the fewest changes of columns, for accelerometers and gyros, to right-handed axes."""
        used = np.eye(3)[list(self.gyro_order)] * np.array(self.gyro_signs)[:, None]
        # a reflected vector turns the other way
        pairs = [(each.T, (-1.0 if self.mirrored else 1.0) * each.T @ used) for _, each in _SETS[self.mirrored]]
        return min(pairs, key=lambda pair: _changes(pair[0]) + _changes(pair[1]))

    def of_columns(self, axes: FloatArray) -> Mounting:
        """Return the mounting of the columns, before their rotation by `axes` (3, 3) of signs alone."""
        used = axes.T @ (np.eye(3)[list(self.gyro_order)] * np.array(self.gyro_signs)[:, None]) @ axes
        x, y, z = (int(at) for at in np.abs(used).argmax(axis=1))
        a, b, c = (1 if size > 0.0 else -1 for size in used.sum(axis=1))
        return replace(self, to_vehicle=self.to_vehicle @ axes, gyro_order=(x, y, z), gyro_signs=(a, b, c))

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
    parts = joined([parts])
    tilting = _Windows.of(parts, gps, placed=placed, tilts=True) or windows

    def changed(order: Order, units: Units) -> tuple[Intervals, FloatArray]:
        """Return the samples with other gyros, and their prior."""
        before = np.append((still[:3] * units)[list(order)], still[3:])
        return replace(parts, gyro=np.ascontiguousarray((parts.gyro * units)[:, order])), before

    def refined(axes: Axes, units: Units = ALL_ALIKE) -> tuple[Mounting, FloatArray, float]:
        """Estimate the mounting by all windows, biases and delay; return also the misfit with these."""
        signs, mirrored, order = axes
        other, before = changed(order, units)
        at, sd, squares = _refined(windows, other, (before, before, still_sd), signs, mirrored=mirrored)
        found = _fit(windows, _felt(windows, other, at, signs), signs, mirrored=mirrored)[0]
        found = replace(found, sd=float(np.hypot(found.sd, sd)), gyro_order=order, gyro_units=units)
        return found, at, _share(squares)

    def tilted(found: Mounting, at: FloatArray) -> FloatArray:
        """Return the squared residuals of long windows, (w,)."""
        other, before = changed(found.gyro_order, ALL_ALIKE)
        return _refined(tilting, other, (at, before, still_sd), found.gyro_signs, mirrored=found.mirrored)[2]

    def better(some: list[Axes]) -> list[tuple[Mounting, FloatArray]]:
        """Select the axes with a significantly better fit than the given ones."""
        ones = [(one, tilted(one, at)) for one, at, _ in map(refined, some)]
        return [each for each in ones if _fits_better(each[1], given)]

    found, at, left = refined(AS_IS)
    given, at_first = tilted(found, at), dict[Axes, float]()
    if windows.bends >= FEWEST:
        for order in [IN_ORDER, *_ORDERS]:
            other, before = changed(order, ALL_ALIKE)
            for signs in SIGNS:
                felt = _felt(tilting, other, before, signs)
                for mirrored in (False, True):
                    at_first[signs, mirrored, order] = _fit(tilting, felt, signs, mirrored=mirrored)[0].misfit
        likely = sorted((each for each in at_first if each != AS_IS), key=at_first.__getitem__)[:TRIED]
        nearer = [each for each in likely if at_first[each] < at_first[AS_IS]]
        tried = better(nearer)
        tried += better([each for each in likely if each not in nearer]) if tried else []
        least = min((_share(squares) for _, squares in tried), default=0.0)
        # an axis that hardly turns, as x on level roads, fits with any sign
        alike = [each for each in tried if _share(each[1]) <= ALIKE * least]
        if alike:
            found = min(alike, key=lambda each: (sum(map(_changes, each[0].corrections)), _share(each[1])))[0]
        else:
            found = _in_other_units(found, left, parts.gyro / parts.dt[:, None], lambda units: refined(AS_IS, units))
    least = MISFIT if found.windows >= OVERLAP * FEWEST else FITS  # few windows fit by chance more easily
    return found if found.misfit < least and found.sd < SCATTER else None


def _share(squares: FloatArray) -> float:
    """Return the unexplained share of the accelerations, of squared residuals of each window (w,)."""
    return float(np.sqrt(np.mean(squares)))


def _fits_better(other: FloatArray, given: FloatArray) -> bool:
    """Return whether other axes surely fit better, by squared residuals (w,): in sum, and in independent windows."""
    gain = np.log(given + 1e-12) - np.log(other + 1e-12)
    sd = float(np.std(gain, ddof=1)) * np.sqrt(OVERLAP / gain.size)
    return _share(other) < min(FITS, HANDED * _share(given)) and float(np.mean(gain)) > SURE * sd


def _in_other_units(
    found: Mounting, left: float, rates: FloatArray, refined: Callable[[Units], tuple[Mounting, FloatArray, float]]
) -> Mounting:
    """Test other units of the gyros; return the mounting that fits, or `found`.

    `left`: residual of `found`. `rates` (n, 3): of the gyros [rad/s]. `refined`: fits other units; also residuals.
    """
    fits = left <= FITS
    fastest, up = np.quantile(np.abs(rates), 0.999, axis=0), int(np.argmax(np.abs(found.to_vehicle[2])))

    def small(units: Units) -> bool:
        """Return whether only hardly turning gyros have a smaller unit: the original unit fits them, too."""
        larger = np.array(units) > 1.0
        return min(units) == 1.0 and not larger[up] and bool((fastest[larger] < HARDLY).all())

    others = [units for units in OTHER_UNITS if float(np.max(fastest * units)) < FASTEST and (not fits or small(units))]
    if not others:
        return found
    ones = [refined(units) for units in others]
    least = min(each[2] for each in ones)
    # prefer one common unit by the course: a hardly turning gyro fits any unit
    other = min(ones, key=lambda each: (each[2] > ALIKE * least, len({*each[0].gyro_units}), each[2]))[0]
    better, factor = least < min(FITS, HANDED * left), np.array(other.gyro_units)
    alike = _unlike(rates * factor) < NOISE_TELLS * _unlike(rates)
    if fits:
        return other if better or (alike and least < CLOSER * left) else found
    if np.ptp(factor) == 0.0:
        return found
    if better and not alike:
        better = refined(tuple(np.where(factor == factor.min(), 0.0, factor)))[2] > MISSED * least
    return other if better else found


def _unlike(rates: FloatArray) -> float:
    """Return the ratio between sample-to-sample noise of three gyros (n, 3), as a logarithm."""
    noise = np.median(np.abs(np.diff(rates, axis=0)), axis=0)
    return float(np.std(np.log(np.maximum(noise, 1e-12))))


def _refined(
    windows: _Windows,
    parts: Intervals,
    before: tuple[FloatArray, FloatArray, FloatArray],
    signs: Signs,
    *,
    mirrored: bool,
) -> tuple[FloatArray, float, FloatArray]:
    """Estimate biases [rad/s], [m/s^2] and the delay of the samples behind the velocities [s], by Gauss-Newton.

    `before`: first values, prior mean and standard deviation, each (7,). Returns the estimates, (7,), the yaw sd by
    their uncertainty [rad], and the squared residuals of each window, (w,).
    """

    def fitted(at: FloatArray) -> tuple[Mounting, FloatArray]:
        return _fit(windows, _felt(windows, parts, at, signs), signs, mirrored=mirrored)

    at, start, sd = before
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
        settled = other.misfit > CLOSER * found.misfit
        at, found, left = at + change, other, other_left
        if settled:
            break
    squares = np.sum(left.reshape(len(windows.turned), -1) ** 2, axis=1)
    return at, float(np.sqrt(yaw @ covariance @ yaw)), np.minimum(squares, 1.0)


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
    def bends(self) -> int:
        """Number of turning windows."""
        return int((np.abs(self.turned) > TURN).sum())

    def _rows(self, rows: IntArray) -> _Windows:
        times, compared, change = self.times[rows], self.compared[rows], self.change[rows]
        return _Windows(times, compared, change, self.strength[rows], self.turned[rows], self.lla, self.placed)

    @classmethod
    def of(cls, parts: Intervals, gps: GpsData, *, placed: bool, tilts: bool = False) -> _Windows | None:
        """Select the windows of largest acceleration, or all the longest ones for tilts, if there are enough."""
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
        if tilts:
            longer, seconds = LONGEST_PLACED, STEP
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
        if placed or tilts:
            steady = np.stack([np.ones_like(since), since], axis=-1)[..., : 1 + placed]
            compared = np.swapaxes(np.linalg.qr(steady, mode="complete")[0][..., 1 + placed :], 1, 2)
            unit = 0.5 * since**2 if placed else since
        unit = unit[..., None]  # effect of a unit acceleration
        power = np.sum((compared @ value[some, :2]) ** 2, axis=(1, 2))
        floor = np.sum(compared**2, axis=(1, 2)) * np.mean(noise[some] ** 2, axis=1)
        power -= 2.0 * floor
        course, end = np.arctan2(v[:, 0, 1], v[:, 0, 0]), v[:, -1]
        change = compared @ (value[some] - gravity_n(lla[0], lla[2]) * unit) @ _about_down(course)
        turned = np.asarray(wrap_pi(np.arctan2(end[:, 1], end[:, 0]) - course))
        turned[np.hypot(end[:, 0], end[:, 1]) <= least] = 0.0  # the course of a stopped vehicle is noise
        if tilts:  # noise counts as much as the errors
            power = np.maximum(power, 0.0) + floor / SHARE**2
        windows = cls(time[some], compared, change, power, turned, lla, placed)
        if tilts:
            return windows if len(turned) >= OVERLAP * FEWEST else None
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
