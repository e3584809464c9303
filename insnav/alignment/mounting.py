"""Mounting of the IMU in the vehicle, relative to the direction of travel, from gravity and accelerations.

In windows of a few seconds the gyros carry the specific force into the axes at the window's start. Its integrals there
must equal the changes of GPS velocity minus gravity (compare Wu and Pan, "Velocity/position integration formula part I:
application to in-flight coarse alignment", IEEE Trans. AES 49 (2013) 1006-1023). Twice integrated, they must equal
positions, apart from the initial place and velocity. The rotation between the two sets of vectors (Wahba, SIAM Review 7
(1965) 409; by Davenport's q method: Markley and Mortari, J. Astronautical Sciences 48 (2000) 359-380) is the IMU
attitude, from the data alone. Relative to the course over ground it is the mounting.

Over half a minute, gravity shows tilts of a degree: it must turn in the body as the gyros measure. Each order and sign
of the gyro columns, with and without a reflection, has a likelihood, from the same sums of products of increments.
Columns are wrong if the likelihood ratio outweighs the prior odds: one to a hundred for each wrong column. All orders
with the same number of wrong columns share these odds.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from insnav.alignment.align import stationary_of
from insnav.alignment.in_motion import SLOWEST, SUDDEN, gives_velocities, interval_of, positions_alone, velocity
from insnav.alignment.static import summarize
from insnav.attitude import quat_from_dcm, rph_from_quat, skew, wrap_pi
from insnav.earth import gravity_n, ned_offset
from insnav.kernels.alignment import mean_rotation, window_histories
from insnav.strapdown import Intervals, joined
from insnav.types import FloatArray, GpsData, IntArray
from insnav.units import DEG

WINDOW = 8.0  # window length: gyro drift dominates longer windows, shorter ones have few velocity changes [s]
STEP = 1.0  # interval between compared fixes, in which a vehicle hardly turns [s]
NOISY, LONGEST = 3.0, 3.0  # factor on `WINDOW` per m/s of velocity noise, and its maximum
PLACED, LONGEST_PLACED = 2.0, 4.0  # factor per square root of a metre of position noise, and maximum, which shows tilts
BASE = 4.0  # interval between positions for the course [s]
OVERLAP = 2  # number of windows that contain each second
MOST = 200  # largest number of windows, selected by acceleration
FEWEST = 5  # least number of windows for an estimate
SHARE = 0.1  # relative error of accelerations, by slip, scale factors and lever arm [-]
LIVELY = 0.3  # RMS acceleration of a useful window [m/s^2]
TURN = np.deg2rad(25.0)  # least course change of a turning window
SCATTER = np.deg2rad(8.0)  # standard deviation of the yaw beyond which there is no result
# prior log odds against each wrong column; posterior log odds that prove wrong columns, 95 %
RARE, SURE = float(np.log(100.0)), float(np.log(19.0))
FITS = 0.4  # largest unexplained share of the accelerations [-]
SURE_SD = np.deg2rad(1.0)  # smallest reported yaw sd, for sideslip and scale factor errors [rad]
AS_IS = np.eye(3)
# factors that convert gyros to one unit, if some or all of the three have another unit
OTHER_UNITS = [
    np.array(units)
    for factor in (DEG, 1.0 / DEG)
    for units in itertools.product((1.0, factor), repeat=3)
    if units != (1.0, 1.0, 1.0)
]
# No vehicle exceeds the first rate in a thousandth of its samples. Roll and pitch rates below the second may be radians
# that were read as degrees [rad/s].
FASTEST, HARDLY = 12.0, np.deg2rad(1.0)
CLOSER = 0.99  # Gauss-Newton stops if the misfit does not fall below this share
NUDGE = np.diag([1e-3, 1e-3, 1e-3, 0.02, 0.02, 0.02, 0.02])  # steps of its numerical derivatives [rad/s], [m/s^2], [s]
# prior sd of gyro bias, with and without a stationary period [rad/s], accelerometer bias [m/s^2] and delay [s]. A bias
# rotates the accelerations of every window, as the mounting does. Warm-up may change a gyro bias observed at rest: by
# 0.07 deg/s on a recorded flight
AT_REST, AT_ALL, FORCE_SD, DELAY_SD = np.deg2rad(0.1), np.deg2rad(0.5), 0.2, 1.0
_DIRECTIONS = dict(zip("FBRLDU", np.repeat(np.eye(3), 2, axis=0) * np.tile([1.0, -1.0], 3)[:, None], strict=True))
# right-handed and left-handed sets of axes by their letters
_SETS: tuple[list[tuple[str, FloatArray]], list[tuple[str, FloatArray]]] = ([], [])
for _letters in itertools.permutations(_DIRECTIONS, 3):
    _matrix = np.array([_DIRECTIONS[each] for each in _letters]).T
    if (_size := float(np.linalg.det(_matrix))) != 0.0:
        _SETS[_size < 0.0].append(("".join(_letters), _matrix))


def _changes(matrices: FloatArray) -> IntArray:
    """Count the fewest exchanges of two columns, reversals of one and of all that compose matrices (n, 3, 3).

    Each change except the reversal of all is a reflection. The least number of reflections of a matrix M is the rank of
    M - I, in any axes (Carter, "Conjugacy classes in the Weyl group", Compositio Mathematica 25 (1972) 1-59, lemma 2).
    """
    ranks = np.linalg.matrix_rank(matrices - AS_IS), 1 + np.linalg.matrix_rank(matrices + AS_IS)
    return np.asarray(np.minimum(*ranks))


def _fewest(gyros: FloatArray, *, mirrored: bool) -> tuple[int, tuple[FloatArray, FloatArray]]:
    """Find the fewest column changes that give right-handed axes: number, and matrices (3, 3) of accel and gyro."""
    accel = np.array([each.T for _, each in _SETS[mirrored]])
    gyro = (-1.0 if mirrored else 1.0) * accel @ np.sign(gyros)  # a reflection reverses rotations
    count = _changes(accel) + _changes(gyro)
    fewest = int(np.argmin(count))
    return int(count[fewest]), (accel[fewest], gyro[fewest])


@cache
def _alternatives() -> IntArray:
    """Return the number of orders of the columns that need 0, 1, 2, ... changes."""
    orders = itertools.product((each for some in _SETS for _, each in some), (False, True))
    return np.bincount([_fewest(gyros, mirrored=mirrored)[0] for gyros, mirrored in orders])


def letters_of(to_vehicle: FloatArray, *, mirrored: bool = False) -> str:
    """Return the vehicle axes nearest to x, y and z, such as ``FLU``, for a matrix (3, 3) to forward, right, down."""
    return max(_SETS[mirrored], key=lambda each: float(np.sum(each[1] * to_vehicle)))[0]


@dataclass(frozen=True, slots=True)
class Mounting:
    """IMU axes in a vehicle that travels along its forward axis."""

    to_vehicle: FloatArray  # (3, 3) from IMU axes to forward, right, down
    sd: float  # standard deviation of the yaw of the IMU in the vehicle [rad]
    windows: int  # number of windows used
    misfit: float  # unexplained share of the accelerations [-]
    cost: float  # mean negative log-likelihood of a window
    gyros: FloatArray  # (3, 3) from gyro columns to rates about the accelerometer axes; the identity if correct
    mirrored: bool  # True if the accelerometers fit only in left-handed axes

    @property
    def letters(self) -> str:
        """Nearest vehicle axes to x, y and z, such as ``FLU``."""
        return letters_of(self.to_vehicle, mirrored=self.mirrored)

    @property
    def angles(self) -> FloatArray:
        """Roll, pitch, yaw of the IMU in the vehicle, (3,) [rad]; valid for right-handed axes."""
        return np.asarray(wrap_pi(np.asarray(rph_from_quat(quat_from_dcm(self.to_vehicle)))))

    @property
    def corrections(self) -> tuple[FloatArray, FloatArray]:
        """Matrices (3, 3) with the fewest changes of columns, for accelerometers and gyros, to right-handed axes."""
        return _fewest(self.gyros, mirrored=self.mirrored)[1]

    def of_columns(self, axes: FloatArray) -> Mounting:
        """Return the mounting of the columns before the rotation `axes` (3, 3), of elements 0, 1 and -1."""
        return replace(self, to_vehicle=self.to_vehicle @ axes, gyros=axes.T @ self.gyros @ axes)

    @property
    def right_handed(self) -> bool:
        """True if a rotation maps the axes to the vehicle axes, with correct gyros."""
        return bool((self.gyros == AS_IS).all()) and not self.mirrored

    def gain(self, other: Mounting) -> float:
        """Return the logarithm of the likelihood ratio to another mounting."""
        return (other.cost - self.cost) * self.windows / OVERLAP

    def odds(self, other: Mounting) -> float:
        """Return the log odds of this mounting, with wrong columns, against another one with correct columns."""
        count, _ = _fewest(self.gyros, mirrored=self.mirrored)
        return self.gain(other) - RARE * count - float(np.log(_alternatives()[count]))


def find_mounting(parts: Intervals, gps: GpsData) -> Mounting | None:
    """Estimate the mounting of an IMU from a drive, by velocities, else by positions; None if unobservable.

    `parts`: samples as intervals, in their original axes. `gps`: fixes with standard deviations.
    """
    rest = stationary_of(parts, gps)
    still = np.zeros(3) if rest is None else summarize(parts, *rest).rate
    sd = np.repeat([AT_ALL if rest is None else AT_REST, FORCE_SD, DELAY_SD], [3, 3, 1])
    sums = _Sums.of(parts := joined([parts]))

    def found_by(fixes: _Fixes | None) -> Mounting | None:
        """Estimate the mounting by velocities or positions, and test the columns."""
        if fixes is None or (windows := fixes.windows(sums, fixes.longer * WINDOW).lively()) is None:
            return None

        def refined(some: _Windows, gyros: FloatArray = AS_IS, *, mirrored: bool = False) -> Mounting:
            return _refined(some, gyros, np.append(gyros @ still, np.zeros(4)), sd, mirrored=mirrored)

        mounting = refined(windows)
        if windows.bends >= FEWEST:
            # test every signed order of the gyro columns, also mirrored, in windows long enough to show tilts
            tilting = fixes.windows(sums, LONGEST_PLACED * WINDOW).tilting() or windows
            fits = [
                _fit(tilting, force, gyros, mirrored=mirrored)[0]
                for gyros in (each for some in _SETS for _, each in some)
                for force in [_felt(tilting, np.append(gyros @ still, np.zeros(4)), gyros)]
                for mirrored in (False, True)
            ]
            original, likelier = refined(tilting), [each for each in fits if each.cost < fits[0].cost]
            candidates = [refined(tilting, each.gyros, mirrored=each.mirrored) for each in likelier]
            best = max(candidates, key=lambda each: each.odds(original), default=original)
            if best.odds(original) > SURE and best.misfit < FITS:
                mounting = refined(windows, best.gyros, mirrored=best.mirrored)
            else:
                rates = parts.gyro / parts.dt[:, None]
                mounting = _in_other_units(mounting, rates, lambda units: refined(windows, np.diag(units)))
        return mounting if mounting.misfit < FITS and mounting.sd < SCATTER else None

    found = found_by(_Fixes.of(sums, gps, placed=False)) if gives_velocities(gps) else None
    return found or found_by(_Fixes.of(sums, positions_alone(gps), placed=True))


def _in_other_units(found: Mounting, rates: FloatArray, refined: Callable[[FloatArray], Mounting]) -> Mounting:
    """Test other units of the gyros; return the mounting that fits better, or `found`.

    `rates` (n, 3): gyro rates [rad/s]. `refined`: function that fits the mounting with unit factors (3,).
    """
    fits = found.misfit <= FITS
    fastest, up = np.quantile(np.abs(rates), 0.999, axis=0), int(np.argmax(np.abs(found.to_vehicle[2])))

    def small(units: FloatArray) -> bool:
        """Return whether the factors change only gyros that hardly turn, which fit with either unit."""
        larger = units > 1.0
        return units.min() == 1.0 and not larger[up] and bool((fastest[larger] < HARDLY).all())

    trials = [units for units in OTHER_UNITS if float(np.max(fastest * units)) < FASTEST and (not fits or small(units))]
    if not trials:
        return found
    # one common unit is preferred, as a gyro that hardly turns fits with any unit
    fitted = [(refined(units), units) for units in trials]
    best, units = max(fitted, key=lambda each: each[0].gain(found) - RARE * np.unique(each[1]).size)
    accepted = best.misfit < FITS and best.gain(found) > RARE
    if accepted and not fits:
        # the fit must be worse without the gyro of another unit, which may only have a temporary fault
        accepted = bool(np.ptp(units)) and best.gain(refined(np.where(units == units.min(), 0.0, units))) > RARE
    return best if accepted else found


def _refined(windows: _Windows, gyros: FloatArray, start: FloatArray, sd: FloatArray, *, mirrored: bool) -> Mounting:
    """Estimate mounting, biases [rad/s], [m/s^2] and delay of the samples behind the fixes [s] by Gauss-Newton.

    `start`, `sd` (7,): prior mean and standard deviation.
    """

    def fitted(at: FloatArray) -> tuple[Mounting, FloatArray]:
        return _fit(windows, _felt(windows, at, gyros), gyros, mirrored=mirrored)

    at = start
    found, last = fitted(at)
    settled = False
    while not settled:
        perturbed = [fitted(at + step) for step in NUDGE]
        slope = np.column_stack([(each[1] - last) / step.sum() for each, step in zip(perturbed, NUDGE, strict=True)])
        # a window counts as one sample, as its errors are correlated, and as half a sample, as windows overlap
        noise = OVERLAP * float(np.sum(last**2)) / len(windows.turned)
        covariance = np.linalg.inv(slope.T @ slope / noise + np.diag(sd**-2))
        turns = [each[0].to_vehicle @ found.to_vehicle.T for each in perturbed]
        yaw = np.array([np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1]) for turn in turns])
        yaw /= NUDGE.sum(axis=0)
        change = covariance @ ((start - at) / sd**2 - slope.T @ last / noise)
        trial, trial_last = fitted(at + change)
        if not trial.misfit < found.misfit:  # also if the misfit is not a number
            break
        settled = trial.misfit > CLOSER * found.misfit
        at, found, last = at + change, trial, trial_last
    return replace(found, sd=float(np.hypot(found.sd, np.sqrt(yaw @ covariance @ yaw))))


@dataclass(frozen=True, slots=True)
class _Sums:
    """Integrals since the first sample: angles, velocities, positions, and products of angles with rates and forces."""

    time: FloatArray  # (n,) start of the first sample, and ends of all samples [s]
    table: FloatArray  # (n, 27) integrals up to each time

    @classmethod
    def of(cls, parts: Intervals) -> _Sums:
        change = np.hstack([parts.gyro, parts.accel])
        middle = np.cumsum(change, axis=0) - 0.5 * change
        time = np.append(parts.end[0] - parts.dt[0], parts.end)
        products = middle[:, :3, None] * change[:, None]
        rows = np.hstack([change, middle[:, 3:] * np.diff(time)[:, None], products.reshape(-1, 18)])
        return cls(time, np.vstack([np.zeros(27), np.cumsum(rows, axis=0)]))

    def between(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return lengths (m - 1,) and sums (m - 1, 36) of intervals: angles, velocities, positions, angle products."""
        times = np.clip(times, self.time[0], self.time[-1])
        row = np.minimum(np.searchsorted(self.time, times, side="right"), self.time.size - 1)
        share = (self.time[row] - times) / (self.time[row] - self.time[row - 1])
        table = self.table[row] + share[:, None] * (self.table[row - 1] - self.table[row])
        length, change, start = np.diff(times), np.diff(table, axis=0), table[:-1]
        turn_and_velocity, path = change[:, :6], change[:, 6:9] - start[:, 3:6] * length[:, None]
        middle = (start[:, :3] + 0.5 * change[:, :3])[:, :, None]  # angles are relative to the middle of the rotation
        products = change[:, 9:].reshape(-1, 3, 6) - middle * turn_and_velocity[:, None]
        # a constant force has its mean effect on the position after a third of the interval, not a half
        third = change[:, :3, None] * path[:, None] / -6.0
        by_sensor = [each.reshape(-1, 9) for each in (products[..., :3], products[..., 3:], third)]
        return length, np.hstack([turn_and_velocity, path, *by_sensor])


def _increments_of(turn: FloatArray) -> FloatArray:
    """Return the matrix (36, 9) from sums to rotation vector, velocity and position in the axes at mid-rotation.

    To second order in the angles (Bortz, IEEE Trans. AES 7 (1971) 61-66), with gyros multiplied by `turn` (3, 3).
    """
    matrix, across = np.zeros((36, 9)), np.swapaxes(skew(turn.T), 1, 2)
    matrix[:3, :3], matrix[3:9, 3:] = turn.T, np.eye(6)
    matrix[9:18, :3] = 0.5 * (turn.T @ across).reshape(9, 3)
    matrix[18:27, 3:6] = matrix[27:, 6:] = across.reshape(9, 3)
    return matrix


@dataclass(frozen=True, slots=True)
class _Windows:
    """Windows of a drive, with the changes of GPS velocity or position in each window."""

    sums: Callable[[float], tuple[FloatArray, FloatArray]]  # `_Sums.between` fix times, by delay of the samples [s]
    shares: int  # number of intervals of `sums` between two fixes
    first: IntArray  # (w,) row of the first fix
    compared: FloatArray  # (w, m, k) coefficients of m combinations of k fixes, unaffected by steady motion
    change: FloatArray  # (w, m, 3) changes of GPS minus gravity, forward, right, down [m/s] or [m]
    strength: FloatArray  # (w,) sum of squared horizontal changes
    noise: FloatArray  # (w,) sum of squared noise
    unit: FloatArray  # (w,) sum of squared changes by a unit acceleration
    turned: FloatArray  # (w,) course change from start to end [rad]
    placed: bool  # True if positions are compared, False for velocities

    @property
    def bends(self) -> int:
        """Number of turning windows."""
        return int((np.abs(self.turned) > TURN).sum())

    def rows(self, rows: IntArray) -> _Windows:
        """Select windows by row."""
        names = "first", "compared", "change", "strength", "noise", "unit", "turned"
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    def lively(self) -> _Windows | None:
        """Select the windows of largest acceleration, if there are enough."""
        windows = self.rows(np.flatnonzero(self.strength >= LIVELY**2 * self.unit))
        if windows.strength.size < FEWEST * (1 if windows.bends >= OVERLAP else OVERLAP):
            return None  # without turns, a drone may fly in any direction
        return windows.rows(np.argsort(windows.strength)[-MOST:])

    def tilting(self) -> _Windows | None:
        """Return all windows, or None if too few. Added strength limits the misfit by noise to about `SHARE`."""
        enough = self.strength.size >= OVERLAP * FEWEST
        return replace(self, strength=np.maximum(self.strength, 0.0) + self.noise / SHARE**2) if enough else None


@dataclass(frozen=True, slots=True)
class _Fixes:
    """Fixes within the samples."""

    time: FloatArray  # (n,) times of the fixes [s]
    v_n: FloatArray  # (n, 3) velocity North, East, Down [m/s]
    sd: FloatArray  # (n,) sd of `v_n` [m/s]
    value: FloatArray  # (n, 3) positions [m] or velocities [m/s]
    noise: FloatArray  # (n,) sd of `value`
    gravity: FloatArray  # (3,) gravity North, East, Down [m/s^2]
    placed: bool  # True if `value` has positions

    @classmethod
    def of(cls, sums: _Sums, gps: GpsData, *, placed: bool) -> _Fixes | None:
        """Return fixes about `STEP` apart, if there are enough."""
        speed, lla = velocity(gps, BASE), gps.lla[0]
        time = gps.time if placed else speed.time
        inside = (time > sums.time[1]) & (time < sums.time[-1])
        if inside.sum() < FEWEST * 3 or speed.time.size < 2:
            return None
        time, sd = time[inside], np.interp(time[inside], speed.time, speed.sd)
        v_n = np.column_stack([np.interp(time, speed.time, each) for each in speed.v_n.T])
        value = ned_offset(gps.lla[inside], lla) if placed else v_n
        noise = gps.position_sd[inside, :2].max(axis=1) if placed else sd
        step = max(1, round(STEP / max(interval_of(time), 1e-3)))
        time, v_n, sd, value, noise = (each[::step] for each in (time, v_n, sd, value, noise))
        return cls(time, v_n, sd, value, noise, gravity_n(lla[0], lla[2]), placed)

    @property
    def longer(self) -> float:
        """Factor by which noise lengthens the windows."""
        noise = float(np.median(self.noise))
        low, limit = (PLACED * np.sqrt(noise), LONGEST_PLACED) if self.placed else (NOISY * noise, LONGEST)
        return float(np.clip(low, 1.0, limit))

    def windows(self, sums: _Sums, length: float) -> _Windows:
        """Return the windows of a length [s] that begin in motion."""
        time, placed, interval = self.time, self.placed, max(interval_of(self.time), 1e-3)
        rows = max(3 + placed, round(length / interval))
        first = np.arange(0, time.size - rows, rows // OVERLAP)
        index = first[:, None] + np.arange(rows + 1)
        since, v, least = time[index] - time[first, None], self.v_n[index], np.maximum(SLOWEST, 5.0 * self.sd[first])
        sudden = np.max(np.abs(np.diff(v, axis=1)) / np.diff(since)[..., None], axis=(1, 2)) > SUDDEN
        fast = np.hypot(v[:, 0, 0], v[:, 0, 1]) >= least
        use = np.flatnonzero(fast & ~sudden & (since[:, -1] <= 2.0 * length))
        first, index, since, v, least = first[use], index[use], since[use], v[use], least[use]
        # orthonormal combinations of the fixes, which cancel a constant value, and for positions a constant velocity
        motion = np.stack([np.ones_like(since), since], axis=-1)[..., : 1 + placed]
        compared = np.swapaxes(np.linalg.qr(motion, mode="complete")[0][..., 1 + placed :], 1, 2)
        unit = (0.5 * since**2 if placed else since)[..., None]  # change by a unit acceleration
        noise = np.sum(compared**2, axis=(1, 2)) * np.mean(self.noise[index] ** 2, axis=1)
        power = np.sum((compared @ self.value[index, :2]) ** 2, axis=(1, 2)) - 2.0 * noise
        course, end = np.arctan2(v[:, 0, 1], v[:, 0, 0]), v[:, -1]
        change = compared @ (self.value[index] - self.gravity * unit) @ _about_down(course)
        turned = np.asarray(wrap_pi(np.arctan2(end[:, 1], end[:, 0]) - course))
        turned[np.hypot(end[:, 0], end[:, 1]) <= least] = 0.0  # the course of a stopped vehicle is noise
        shares = max(1, round(interval / STEP))
        fine = np.interp(np.arange((time.size - 1) * shares + 1) / shares, np.arange(time.size), time)
        by_unit = np.sum((compared @ unit) ** 2, axis=(1, 2))
        cached = cache(lambda delay: sums.between(fine + delay))
        return _Windows(cached, shares, first, compared, change, power, noise, by_unit, turned, placed)


def _felt(windows: _Windows, given: FloatArray, gyros: FloatArray) -> FloatArray:
    """Integrate specific force over each window and form its combinations, (w, m, 3), in the axes at its start.

    `given` (7,): assumed bias of gyros [rad/s] and accelerometers [m/s^2], and delay of the samples [s].
    """
    dt, sums = windows.sums(float(given[6]))
    angle, force = given[:3], given[3:6]
    steps = sums @ _increments_of(gyros) - dt[:, None] * np.concatenate([angle, force, np.zeros(3)])
    turns, pushes, moves = (np.ascontiguousarray(steps[:, column : column + 3]) for column in (0, 3, 6))
    first, count = windows.first * windows.shares, (windows.compared.shape[2] - 1) * windows.shares
    integral = np.empty((first.size, count + 1, 3))
    window_histories(dt, turns, pushes, first, integral)
    if windows.placed:
        position = np.empty_like(integral)
        window_histories(dt, turns, moves - 0.5 * dt[:, None] ** 2 * force, first, position)
        spans = dt[first[:, None] + np.arange(count)]
        integral[:, 1:] = np.cumsum(spans[..., None] * integral[:, :-1], axis=1) + position[:, 1:]
    return np.asarray(windows.compared @ integral[:, :: windows.shares])


def _fit(windows: _Windows, felt: FloatArray, gyros: FloatArray, *, mirrored: bool) -> tuple[Mounting, FloatArray]:
    """Fit the mean rotation (or reflection) over the windows to `felt` from `_felt`; also return the residuals."""
    weight, matrices, mean = np.sqrt(windows.strength), np.empty((len(felt), 3, 3)), np.empty((3, 3))
    away = np.empty(len(felt))
    # windows in reverse or with wheel slip are de-weighted
    mean_rotation(windows.change, felt, weight, -1.0 if mirrored else 1.0, matrices, mean, away)
    axis = int(np.argmin(np.abs(mean[2])))  # the most horizontal axis, whose direction gives the yaw
    yaw = np.arctan2(matrices[:, 1, axis], matrices[:, 0, axis])
    deviation = np.asarray(wrap_pi(yaw - np.arctan2(mean[1, axis], mean[0, axis])))
    scatter = 1.4826 * float(np.median(np.abs(deviation)))
    rotated = _about_down(-deviation) @ matrices
    residual = (windows.change - felt @ np.swapaxes(rotated, 1, 2)) / weight[:, None, None]
    squares = np.minimum(np.sum(residual**2, axis=(1, 2)), 1.0)
    sd = max(SURE_SD, 1.25 * scatter * np.sqrt(OVERLAP / len(residual)))
    # a window's error, a vector of unknown size about `SHARE`, has a Cauchy distribution of three dimensions
    cost, misfit = float(np.mean(2.0 * np.log1p(3.0 * squares / SHARE**2))), float(np.sqrt(np.mean(squares)))
    mounting = Mounting(mean, sd, len(residual), misfit, cost, gyros, mirrored)
    return mounting, np.clip(residual, -1.0, 1.0).ravel()


def _about_down(angle: ArrayLike) -> FloatArray:
    """Return rotations of vectors about the down axis by each angle [rad], (..., 3, 3)."""
    turn = np.zeros((*np.shape(angle), 3, 3))
    turn[..., 0, 0] = turn[..., 1, 1] = np.cos(angle)
    turn[..., 1, 0] = np.sin(angle)
    turn[..., 0, 1] = -turn[..., 1, 0]
    turn[..., 2, 2] = 1.0
    return turn
