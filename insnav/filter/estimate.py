"""State, covariance and smoother history of the filter: `Estimate` changes all three together.

filterpy checks nothing: one NaN, one wrong shape or one negative variance silently corrupts all later results. `Engine`
checks its input and output.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from insnav.alignment.static import LONG_REST
from insnav.attitude import dcm_from_quat, dcm_from_rph, quat_from_rph
from insnav.deferred import deferred
from insnav.earth import near_pole
from insnav.exceptions import DivergenceError, InputError
from insnav.filter.error_model import FilterState, InitialState, cross_covariance, layout, reset_correlated, set_to_fix
from insnav.filter.filter_input import FilterInput
from insnav.filter.smoother import History
from insnav.findings import Code, Finding
from insnav.kernels import epoch, errorstate, measurements
from insnav.kernels.dynamics import NAV
from insnav.kernels.errorstate import STATES
from insnav.kernels.measurements import NOT_FINITE, fault_of, inverse, measurement_fault, swing
from insnav.strapdown import TIME_TOLERANCE
from insnav.types import FloatArray, RoundingChange, StateChange

MAX_REPAIRS = 10  # rounding errors need one or two in hours; more indicate a defect of model or data
# filterpy imports all its modules, scipy.stats and scipy.linalg in half a second: defer modules that no run needs
with deferred("filterpy.discrete_bayes", "filterpy.stats", "scipy.linalg"):
    KalmanFilter: Any = import_module("filterpy.kalman").KalmanFilter


class Engine:
    """Closed-loop error-state filter with checks. The state is zero before each update. `covariance`: initial."""

    def __init__(self, covariance: FloatArray) -> None:
        n = covariance.shape[0]
        self._filter = KalmanFilter(dim_x=n, dim_z=6)
        self._filter.P = covariance.copy()
        # for three numbers, numpy's inverse would take most of the time of an update
        self._filter.inv = inverse
        self._zero = np.zeros((n, 1))
        self.repairs = 0

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the error state, (n, n); do not change it."""
        p: FloatArray = self._filter.P
        return p

    def predict(self, transition: FloatArray, noise: FloatArray, time: float) -> bool:
        """Propagate the covariance to `time` [s] by transition and noise, (n, n) each, accumulated since the last call.

        Returns whether a negative variance was repaired.

        Raises: DivergenceError: a number that is not finite, or too many repairs.
        """
        self._filter.predict(F=transition, Q=noise)
        return self._check(time, self._zero[:, 0])

    def update(self, z: FloatArray, h: FloatArray, r: FloatArray, time: float) -> tuple[FloatArray, bool]:
        """Apply a measurement: predicted minus measured `z` (m,), its derivative `h` (m, n), its covariance `r` (m, m).

        Returns: `error` (n,): estimated error, to subtract from the state.
        Raises: DivergenceError: as in `predict`; also if the measurement is not finite or its covariance not positive.
        """
        r = np.ascontiguousarray(r)  # with one memory layout, numba compiles once
        if measurement_fault(z, h, r):
            raise DivergenceError(
                "filter.bad_measurement", where=f"t = {time:.3f} s", innovation=str(z), variance=str(np.diagonal(r))
            )
        self._filter.update(z.reshape(-1, 1), R=r, H=h)
        error: FloatArray = self._filter.x[:, 0]
        self._filter.x = self._zero
        return error, self._check(time, error)

    def replace_covariance(self, covariance: FloatArray) -> None:
        """Set the covariance, at an explicit reset."""
        self._filter.P = covariance.copy()

    def _check(self, time: float, error: FloatArray) -> bool:
        fault = fault_of(self._filter.P, error)
        if fault == 0:
            return False
        if fault == NOT_FINITE:
            raise DivergenceError("filter.not_finite", where=f"t = {time:.3f} s")
        self.repairs += 1
        if self.repairs > MAX_REPAIRS:
            raise DivergenceError("filter.no_variance", where=f"t = {time:.3f} s", count=self.repairs)
        # scale states by their standard deviations: a common limit would suit only the largest ones
        scale = np.sqrt(np.abs(np.diagonal(self._filter.P)))
        live = scale > 0.0
        unit = np.where(live, scale, 1.0)
        values, vectors = np.linalg.eigh(self._filter.P / np.outer(unit, unit))
        repaired = (vectors * np.maximum(values, 1e-12 * values[-1])) @ vectors.T * np.outer(unit, unit)
        repaired[~live, :] = repaired[:, ~live] = 0.0
        self._filter.P = repaired
        return True


SUBSTEP = 0.1  # longest sub-step of transition and noise: a car turns by less than 6 deg in it [s]
# motion in a data gap: change of rate [rad/s^2], of specific force [m/s^3]; limits of the errors by it [rad], [m/s]
GAP_NOISE = np.array([0.1, 0.5, 0.3, 20.0])
# attitude sd added at a reset: the cause of the reset, perhaps a bias step, also rotated the attitude [rad]
ATTITUDE_RESET_SD = np.deg2rad([6.0, 6.0, 10.0])
BIAS_RESET_SD = np.array([*np.deg2rad([0.5, 0.5, 0.5]), 0.2, 0.2, 0.2])  # bias sd added at a reset [rad/s], [m/s^2]
VELOCITY_RESET_SD = 5.0  # velocity sd added at a reset by fixes without velocity [m/s]
NONE = np.empty(0)  # empty row, if the run keeps no history for the smoother
RESET_FACTOR = 3.0  # factor on the sd of the fix at a reset: many fixes before it were rejected


@dataclass(frozen=True, slots=True)
class Across:
    """Relation of a new alignment after a gap to the sensor errors.

    The motion in the gap is unknown, so position, velocity and attitude are independent of the part before it. The
    sensor errors continue: they relate both parts, and the smoother carries information on them across the gap.
    """

    slope: FloatArray  # (9, 12) derivative of position, velocity and attitude errors by sensor errors
    own: FloatArray  # (9, 9) covariance of these errors from other causes

    @classmethod
    def of(cls, initial: InitialState) -> Across:
        """Derive the relation from the covariance of an initial state. Its sensor errors are uncorrelated."""
        p = initial.covariance
        variance = np.diag(p)[NAV:]
        slope = np.where(variance > 0.0, p[:NAV, NAV:] / np.where(variance > 0.0, variance, 1.0), 0.0)
        return cls(slope, p[:NAV, :NAV] - (slope * variance) @ slope.T)


class Estimate:
    """State and covariance of the filter.

    `all` is the array of all estimates, see `insnav.kernels.measurements`. Views of it: `x`, `correction`, `motion`,
    `shaken`, `lever` (3,) [m] and `delay` [s]. `doubt`: lower limit of the delay sd, see `insnav.kernels.epoch`. `at`:
    indices of the states. `places`: table of the further blocks. `span` (1,): time since the last epoch [s]. `history`:
    epochs for the smoother. `note`: function that records an event. `coast`: longest time between filter epochs [s].
    """

    def __init__(self, ready: FilterInput, start: FilterState, note: Callable[[Finding], None], coast: float) -> None:
        receiver, alignment, explained = ready.receiver, ready.alignment, ready.explained
        self.at, self._coast = layout(receiver), coast
        n = self.at.states
        self.all = np.zeros(measurements.FURTHER + start.further.size)
        parts = measurements.STATE, measurements.CORRECTION, measurements.MOTION, measurements.SHAKEN
        self.x, self.correction, self.motion, self.shaken = (self.all[part] for part in parts)
        self.arm, self._swung = self.all[measurements.ARM], self.all[measurements.SWUNG]
        self.x[:], self.correction[:], self.motion[:] = start.x, start.correction, start.motion
        self.all[measurements.BEGAN] = self.x[3:5]
        self.arm[:3], self.all[measurements.FURTHER :] = start.lever_b, start.further
        self.lever, self.span, self.places = self.arm[:3], np.zeros(1), self.at.places
        self._seen = self.x, self.correction, self.arm
        self.history = History(n) if ready.output.smooth else None
        self._engine = Engine(start.covariance)
        self._note, self._lever_given, self._gps_noise = note, receiver.lever_arm.value, receiver.correlated
        self._settled, self.doubt = receiver.delay.settled, np.array([receiver.delay.least_sd, receiver.delay.shown])
        fading = [
            (first + i, place + i, block.sd[i], time)
            for block, (first, place, _) in zip(self.at.blocks, self.places, strict=True)
            for i, time in enumerate(block.time)
        ]
        places, values = np.split(np.array(fading, dtype=np.float64).reshape(-1, 4), 2, axis=1)
        self._fading, (self._fading_sd, self._fading_time) = places.astype(np.int64), values.T.copy()
        self._carried = errorstate.Carried(self.x, self.correction, self.motion, np.zeros(errorstate.SUMS), self.span)
        self._phi, self._q, self._unity = np.eye(n), np.zeros((n, n)), np.eye(n)
        self._work = errorstate.scratch()
        self.before = np.zeros(12)  # predicted variances at the last epoch
        self._changing = self.all, self.span, self._carried.sums, self._phi, self._q, self.before
        self._rough = explained.rough
        self._changes = [change for change in explained.changes if change.time > start.time]
        self._rounding = [change for change in ready.rounding if change.time > start.time]
        # of each gyro at its last change of rounding error: bias without this error, variance (unknown at first), time
        self._bias = np.tile([0.0, 1.0, start.time], (3, 1))
        begin, rest = alignment.static or (-np.inf, -np.inf)
        rest = max(rest, alignment.left)
        part = (rest - begin) / (len(alignment.sway) + 1)  # length of a part; `sway` is the change from part to part
        sway = alignment.sway**2 / part
        limit = np.array([SUBSTEP, coast, begin, rest if rest - begin >= LONG_REST else -np.inf])
        self._noise = errorstate.Model(limit, ready.model.noise, GAP_NOISE, ready.model.decay, sway)
        if self.history is not None:
            self.history.epoch(start.time, *self._seen, self._phi, self.covariance)

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the error states, (n, n); do not change it."""
        return self._engine.covariance

    @property
    def delay(self) -> float:
        """Delay of the fixes in addition to the specified delay [s]."""
        return float(self.all[measurements.DELAY])

    @property
    def covariance_now(self) -> FloatArray:
        """Covariance of the error states, propagated to the last complete sub-step, (n, n)."""
        if self.span[0] == 0.0:
            return self.covariance.copy()
        phi = self._phi.copy()
        epoch.turn(phi, self.all.copy())
        return phi @ self.covariance @ phi.T + self._q

    def saved(self) -> tuple[Any, ...]:
        """Copy everything that changes. The engine never modifies its covariance in place: a reference is enough."""
        arrays = [each.copy() for each in self._changing]
        expected = tuple(self._changes), tuple(self._rounding), self._bias.copy()
        return arrays, self._engine.covariance, self._engine.repairs, *expected, self._noise

    def go_back(self, saved: tuple[Any, ...]) -> None:
        """Restore a state that `saved` returned."""
        arrays, covariance, self._engine.repairs, changes, rounding, bias, self._noise = saved
        for array, values in zip(self._changing, arrays, strict=True):
            array[:] = values
        self._changes, self._rounding, self._bias = list(changes), list(rounding), bias.copy()
        self._engine.replace_covariance(covariance)

    def kept(self, time: float) -> FilterState:
        """Copy the complete state at `time` [s], from which another filter can continue."""
        phi = self._unity.copy()
        epoch.turn(phi, self.all.copy())
        if self.at.lever >= 0:
            phi[:3, self.at.lever : self.at.lever + 3] = -self.arm[3:].reshape(3, 3)
            swing(phi, self._swung.copy())
        p = phi @ self.covariance @ phi.T
        state = self.x, self.correction, self.lever, self.all[measurements.FURTHER :], self.motion, p
        return FilterState(time, *(each.copy() for each in state))

    def propagate(
        self, samples: errorstate.Samples, first: int, last: int, close: bool, out: errorstate.Outputs
    ) -> int:
        """Propagate the state over samples `first` to at most `last`, and return the next index; see `errorstate`."""
        k: int = errorstate.propagate(
            *(first, last, close, *samples, *self._carried, *self._noise, self._phi, self._q, *out, *self._work)
        )
        return k

    @property
    def least_delay_sd(self) -> float:
        """Least plausible standard deviation of the delay [s], as search and filter may disagree."""
        return float(epoch.least_delay_sd(self.all, self.doubt))

    def stated(self) -> FloatArray:
        """Return the reported covariance, with a plausible sd of the delay. Gains use the unchanged covariance."""
        covariance: FloatArray = errorstate.less_sure(self.covariance, self.least_delay_sd)
        return covariance

    def predict(self, time: float) -> None:
        """Begin a filter epoch: propagate the covariance to `time` [s], with known changes and rounding errors."""
        if near_pole(self.x[0]):  # a local-level frame is singular there
            raise InputError("filter.at_pole", where=f"t = {time:.3f} s")
        times, sds = self._fading_time, self._fading_sd
        for rough in self._rough if self._gps_noise is not None else ():
            times, sds = rough.drive(time, times, sds)
        epoch.turn(self._phi, self.all)
        epoch.not_linear(self._q, self.all, self.covariance)
        epoch.fade(self.all, self._fading, times, sds, self._phi, self._q, self.span)
        while self._rounding and self._rounding[0].time <= time + TIME_TOLERANCE:
            self._round(self._rounding.pop(0))
        while self._changes and self._changes[0].time <= time + TIME_TOLERANCE:
            self._change(self._changes.pop(0))
        self._note_repair(time, self._engine.predict(self._phi, self._q, time))
        row = NONE if self.history is None else self.history.new_row()
        epoch.predicted(row, time, self.all, self.doubt, self.covariance, self._phi, self._q, self.span, self.before)

    def _round(self, found: RoundingChange) -> None:
        """Replace the rounding errors of coarse gyros by new ones.

        The correction of a gyro is the sum of its bias b and its rounding error r, with variances V and v. The bias is
        the part V / (V + v) of the change of this sum, with the variance V v / (V + v). Then a new error r begins.
        """
        for axis in np.flatnonzero(~np.isnan(found.before)).tolist():
            state, before = NAV + axis, float(found.before[axis])
            bias, variance, since = self._bias[axis]
            variance += self._noise.noise[6 + axis] * (found.time - since)
            part = variance / (variance + before)
            self.correction[axis] = bias + part * (self.correction[axis] - bias)
            for row in (self._phi[state], self._q[state], self._q[:, state]):
                row *= part
            self._q[state, state] += part * before
            variance_now = float(self._phi[state] @ self.covariance @ self._phi[state] + self._q[state, state])
            self._bias[axis] = self.correction[axis], variance_now, found.time
            self._q[state, state] += found.after[axis]

    def _change(self, found: StateChange) -> None:
        """Apply a known change to the state, and increase the covariance by its uncertainty."""
        error, part = np.zeros(self.at.states), slice(found.first, found.first + 3)
        error[part] = found.change
        errorstate.feed_back(self.x, self.correction, error)
        self._bias[:, 0] -= error[NAV : NAV + 3]
        self._q[part, part] += np.diag(np.maximum(found.variance - np.diag(self.covariance)[part], 0.0))
        if found.first == NAV:  # a gyro fault rotated the IMU for up to one epoch before
            self._q[6:9, 6:9] += self._coast**2 * (found.change @ found.change + found.variance.max()) * np.eye(3)
        if found.first >= NAV and found.change.any():  # a bias that has stepped does not decay
            decay = self._noise.decay.copy()
            decay[found.first - NAV : found.first - NAV + 3] = 0.0
            self._noise = self._noise._replace(decay=decay)

    def epoch(self, time: float) -> None:
        """Start another epoch at the time of the last one, for a further measurement."""
        if self.history is not None:
            self.history.epoch(time, *self._seen, self._unity, self.covariance)

    def correct(self, time: float, z: FloatArray, h: FloatArray, r: FloatArray) -> None:
        """Apply a measurement: predicted minus measured `z`, its derivative `h` by the states, its covariance `r`."""
        error, repaired = self._engine.update(z, h, r, time)
        row = NONE if self.history is None else self.history.last
        epoch.take(row, self.all, error, self.places, self._settled)
        self._note_repair(time, repaired)

    def restart(self, time: float, z: FloatArray, position_sd: FloatArray, velocity_sd: FloatArray | None) -> None:
        """Reset position, and velocity if its standard deviation is given, to a fix, with a matching covariance.

        `z` (6,): predicted minus measured position [m] and velocity [m/s]. The standard deviations belong to the fix.
        """
        p = self.covariance.copy()
        error = np.zeros(p.shape[0])
        error[:3] = z[:3]
        p[:6, :] = p[:, :6] = 0.0
        p[:3, :3] = np.diag((RESET_FACTOR * position_sd) ** 2)
        if velocity_sd is not None:
            error[3:6] = z[3:]
            p[3:6, 3:6] = np.diag((RESET_FACTOR * velocity_sd) ** 2)
        else:
            p[3:6, 3:6] += VELOCITY_RESET_SD**2 * np.eye(3)
        p[6:15, 6:15] += np.diag(np.concatenate([ATTITUDE_RESET_SD, BIAS_RESET_SD]) ** 2)
        errorstate.feed_back(self.x, self.correction, error)
        mapping = set_to_fix(self.at, self.x[3:6], dcm_from_quat(self.x[6:]))
        p = mapping @ p @ mapping.T
        self._begin_at_fix(p)
        if self.history is not None:
            self.history.restart(time, *self._seen, p)

    def go_on(self, start: InitialState, span: float) -> None:
        """Continue after a gap of `span` seconds: position, velocity and attitude from a new alignment.

        Sensor errors, delay and lever arm are kept, apart from their decay; see `Across`.
        """
        n, sensors, across = self.at.states, slice(NAV, STATES), Across.of(start)
        phi, q = np.eye(n), np.zeros((n, n))
        phi[:NAV] = 0.0
        decay, driving = self._noise.decay, self._noise.noise[6:18]
        fade = np.exp(-decay * span)
        phi[sensors, sensors] = np.diag(fade)
        growth = np.where(decay > 0.0, (1.0 - fade**2) / np.where(decay > 0.0, 2.0 * decay, 1.0), span)
        q[sensors, sensors] = np.diag(driving * growth)
        phi[self._fading[:, 0]] = 0.0
        p = phi @ self.covariance @ phi.T + q
        phi[:NAV, sensors] = across.slope * fade
        p[:NAV, NAV:] = across.slope @ p[sensors, NAV:]
        p[NAV:, :NAV] = p[:NAV, NAV:].T
        p[:NAV, :NAV] = across.own + across.slope @ p[sensors, sensors] @ across.slope.T
        x, c = np.concatenate([start.lla, start.v_n, quat_from_rph(start.rph)]), dcm_from_rph(start.rph)
        # correct the alignment, made with specified sensor errors, delay and lever arm, by the estimates of the filter
        error = np.zeros(STATES)
        error[:NAV] = -across.slope @ (self.correction - np.concatenate([start.gyro_bias, np.zeros(9)]))
        error[:3] -= start.v_n * self.delay - c @ (self.lever - self._lever_given)
        errorstate.feed_back(x, self.correction, error)
        self.x[:] = x
        self.motion[:] = 0.0
        # add the uncertainty of delay and lever arm, uncorrelated: the smoother has no transition from them to position
        mapping = set_to_fix(self.at, start.v_n, c)[:3, STATES:]
        p[:3, :3] += mapping @ p[STATES:, STATES:] @ mapping.T
        self._begin_at_fix(p)
        errorstate.reset_transition(self._phi, self._q, self.span)
        if self.history is not None:
            self.history.epoch(start.time, *self._seen, phi, p)

    def _begin_at_fix(self, p: FloatArray) -> None:
        """Set the covariance of a position set to a fix with time-correlated errors. Clear sums of corrections."""
        self.arm[3:] = self._swung[:] = 0.0
        self.all[measurements.CORRECTED] = self.all[measurements.TURNED] = self.all[measurements.SQUARES] = 0.0
        self.all[measurements.BEGAN] = self.x[3:5]
        if self._gps_noise is not None:
            reset_correlated(p, self.at.correlated, self._gps_noise.sds)
            cross_covariance(p, self.at.correlated, self._gps_noise.sds)
            self.all[measurements.LASTING] = 0.0
        self._engine.replace_covariance(p)

    def _note_repair(self, time: float, repaired: bool) -> None:
        if repaired:
            self._note(Finding.of(Code.FILTER_REPAIR, time))
