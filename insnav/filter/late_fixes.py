"""Likelihood of fixes as a function of their delay, with all other states estimated for each delay.

The filter runs once, with every fix at its timestamp. The innovation of the same fix at another time is linear in the
error states. Its terms are velocity error times time difference, tilt times specific force, and the rotated lever arm.
One pass of covariance algebra gives these innovations (`insnav.kernels.noise_likelihood`) for any delay, without the
delay state of the filter. Lever arm, attitude and biases, which depend on the delay, are estimated again.
"""

from __future__ import annotations

from copy import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from insnav import strapdown
from insnav.alignment import in_motion
from insnav.alignment.in_motion import SEEN
from insnav.attitude import dcm_from_quat, rph_from_quat, skew
from insnav.earth import gravity_n, ned_offset
from insnav.filter.error_model import first_state, layout
from insnav.filter.filter_input import FilterInput
from insnav.filter.gates import impossible, pass_quality
from insnav.filter.innovation_likelihood import HUBER, bridged, costs_of, weights_of
from insnav.filter.navigator import rates_at, turned
from insnav.kernels import noise_likelihood
from insnav.kernels.dynamics import NAV
from insnav.kernels.measurements import STILL
from insnav.kernels.smoother import ARM, COAST, CORRECTION, KIND, POSITION, STATE, TIME, VELOCITY
from insnav.strapdown import TIME_TOLERANCE
from insnav.types import FloatArray
from insnav.units import DEG

REACH = 2.0  # largest delay of the search, positive or negative [s]
EDGE = REACH + 1.0  # fixes nearer to the ends of the record may be valid outside it, and are not used [s]
# drop a candidate delay that, after this share of the fixes, costs this much more than the best one [-]
SOON, UNLIKELY = 0.3, 50.0
GAP = 100.0  # largest ratio of velocity variance to its median; it is larger after gaps of fixes [-]
BLOCK, BLOCKS = (10.0, 20.0), 3  # parts with independent errors: limits of their length [s], their least number
OPEN_START = 20.0, 2.0, 5.0 * DEG  # sd of position [m], velocity [m/s], attitude [rad] at a start by a late fix


_Since = tuple[FloatArray, FloatArray, FloatArray]  # changes of velocity and position by specific force; ``C_nb``


class _Seen(NamedTuple):
    """Fixes with the state before the measurement at their epochs: k rows."""

    time: FloatArray  # time of the epoch [s]
    away: FloatArray  # time of the epoch after the middle of the record [s]
    v_n: FloatArray  # measured velocity [m/s]
    off: FloatArray  # position of the IMU minus measured position [m]
    v: FloatArray  # velocity of the state [m/s]
    lever: FloatArray  # lever arm estimated so far [m]
    shaken: FloatArray  # lever arm of the vibration estimated so far [m]
    lasting: FloatArray  # time-correlated error that was fed back, (k, 6) [m], [m/s]
    bias: FloatArray  # estimated sensor errors (k, 12)
    here: FloatArray  # track integrated from gyros and accelerometers alone (k, 15)
    turn: FloatArray  # rotation from the attitude of this track to the attitude of the state (k, 3, 3)


class LateFixes:
    """Likelihood of the delay of fixes. `ready`, `epochs`: input of a filter run, and the rows of its history."""

    def __init__(self, ready: FilterInput, epochs: FloatArray) -> None:
        receiver, gates = ready.receiver, ready.gates
        at, time, gps = layout(receiver), epochs[:, TIME], ready.gps
        after_gap = bridged(ready.imu.time, time)
        self._tape = noise_likelihood.tape(epochs, at.states, ready.model.noise, after_gap, ready.rounding)
        row_of_fix = np.minimum(np.searchsorted(ready.fix_time, time - TIME_TOLERANCE), gps.time.size - 1)
        usable = np.abs(ready.fix_time[row_of_fix] - time) <= TIME_TOLERANCE
        # leave out impossible positions: a position wrong by 100 km would dominate
        usable &= (pass_quality(gates, gps) & ~impossible(gates, gps))[row_of_fix]
        usable &= (time > time[0] + EDGE) & (time < time[-1] - EDGE)
        fixes, fix_epochs, self._rows = gps.rows(row_of_fix[usable]), time[usable], np.flatnonzero(usable)
        velocity = usable & np.isfinite(gps.v_n[row_of_fix]).all(axis=1)
        self._kind = np.where(velocity, POSITION + VELOCITY, np.where(usable, POSITION, COAST))
        length = np.clip((time[-1] - time[0]) / BLOCKS, *BLOCK)
        self._block = np.repeat(((time - time[0]) / length).astype(int), np.bitwise_count(self._kind))
        self.accepted = float(np.mean(epochs[usable, KIND] == self._kind[usable])) if usable.any() else 0.0
        self.velocities = bool(velocity.any())
        self.blocks, self.half = np.unique(self._block).size, 0.5 * float(time[-1] - time[0])
        self.moments = receiver.lag.moments
        self._at, self._model, self.lag, self._correlated = at, ready.model, receiver.lag.value, receiver.correlated
        self._variance = np.ones((time.size, 6))
        share = 0.0 if receiver.correlated is None else receiver.correlated.share
        self._variance[usable, :3] = (1.0 - share) * fixes.position_sd**2
        self._variance[usable, 3:] = np.nan_to_num(fixes.velocity_sd**2, nan=1.0)
        # the state before the measurement is the state after it plus the feedback
        x, fed = epochs[usable, STATE : STATE + 10], self._tape[8]
        v = x[:, 3:6] + fed[usable, 3:6]
        covariance = epochs.shape[1] - at.states * (at.states + 1) // 2  # first column of its lower triangle
        variance = np.sum(epochs[usable][:, covariance + np.array([9, 14, 20])], axis=1)
        limit = GAP * np.median(variance) if variance.size else 0.0  # variances are far larger after a gap of fixes
        normal = variance <= limit
        self.moves = bool(np.sum(v[normal] ** 2) > STILL * np.sum(variance[normal]))
        # lever arms before each measurement: the initial ones minus all corrections so far
        taken = np.cumsum(np.vstack([np.zeros(at.states), fed[:-1]]), axis=0)[usable]
        taken = np.hstack([taken, np.zeros((self._rows.size, 3))])  # zeros for index -1: the arm is no state
        lever, shaken = (receiver.lever_arm.value - taken[:, k:][:, :3] for k in (at.lever, max(at.shaken, at.lever)))
        lasting = np.zeros((self._rows.size, 6))
        if receiver.correlated is not None:  # a correction decays from its epoch on
            size = receiver.correlated.times.size
            decayed = np.zeros((time.size, size))
            for k, fade in enumerate(np.exp(-np.diff(time)[:, None] / receiver.correlated.times)):
                decayed[k + 1] = (decayed[k] + fed[k, at.correlated : at.correlated + size]) * fade
            lasting[:, :size] = -decayed[usable]
        # track by gyros and accelerometers alone, which moves a fix to another time
        parts = strapdown.intervals(ready.imu, ready.nominal)
        self._samples = parts.end, turned(parts)
        self._nominal, self._gravity = ready.nominal, gravity_n(gps.lla[0, 0], gps.lla[0, 2])
        begin, rph = float(time[0]), rph_from_quat(epochs[0, STATE + 6 : STATE + 10])
        bias = np.median(epochs[time.size // 2 :, CORRECTION : CORRECTION + 3], axis=0)
        track = in_motion.history(parts, begin, float(parts.end[-1]), rph, bias, gps.lla[0, 0])
        u, attitudes = track.u_n, dcm_from_quat(track.q_nb).reshape(-1, 9)
        self._track = track.time, np.hstack([u, track.way, attitudes])
        local = strapdown.between(*self._track, fix_epochs)[1]
        back = np.swapaxes(local[:, 6:].reshape(-1, 3, 3), 1, 2)
        turn = (np.eye(3) - skew(fed[usable, 6:9])) @ dcm_from_quat(x[:, 6:]) @ back
        error, away = ned_offset(x[:, :3], fixes.lla) + fed[usable, :3], fix_epochs - time[0] - self.half
        self._seen = _Seen(
            fix_epochs, away, fixes.v_n, error, v, lever, shaken, lasting, epochs[usable, CORRECTION:ARM], local, turn
        )
        self._start = first_state(ready.initial, receiver).covariance
        self._start[:NAV, :NAV] += np.diag(np.repeat(OPEN_START, 3) ** 2)
        # allocate the arrays once: all delays fill the same ones
        self._out, self._z, self._h = (
            np.zeros(each) for each in ((2, 6 * time.size), (time.size, 6), (time.size, 6, at.states))
        )
        measured = 6 if self.velocities else 3
        self._h[self._rows, :measured, :measured] = np.eye(measured)
        if receiver.correlated is not None:
            count = receiver.correlated.sds.size
            self._h[self._rows, :, at.correlated : at.correlated + count] = np.eye(6)[:, :count]
        noise = ready.model.noise
        self._density = np.array([np.mean(noise[:3]), np.mean(noise[3:6]), *noise[18:]])

    def _beginning(self) -> LateFixes:
        """Copy with the first fixes only, a share `SOON` of all."""
        part, fixes = copy(self), max(1, int(self._rows.size * SOON))
        epochs = int(self._rows[fixes - 1]) + 1
        part._seen, part._rows = _Seen(*(each[:fixes] for each in self._seen)), self._rows[:fixes]
        part._tape, part._kind = tuple(each[:epochs] for each in self._tape), self._kind[:epochs]
        part._block = self._block[: np.bitwise_count(part._kind).sum()]
        return part

    def _since(self, span: FloatArray) -> _Since:
        """Integrate specific force over `span` (k,) [s] from the epochs: velocity, position, and final ``C_nb``."""
        fixes, s = self._seen, span[:, None]
        end = strapdown.between(*self._track, fixes.time + span)[1]
        v, p = end[:, :3] - fixes.here[:, :3], end[:, 3:6] - fixes.here[:, 3:6] - fixes.here[:, :3] * s
        c = fixes.turn @ end[:, 6:].reshape(-1, 3, 3)
        push = _times(c, fixes.bias[:, 3:6])
        return _times(fixes.turn, v) - push * s, _times(fixes.turn, p) - 0.5 * push * s**2, c

    def costs(self, delays: FloatArray, drift: FloatArray | float = 0.0, lag: FloatArray | None = None) -> FloatArray:
        """Compute the negative log-likelihood of each part of the record for k cases, (k, blocks).

        `delays`: in the middle of the record [s]. `drift`: rate of the delay [s/s]. `lag`: of velocities behind
        positions [s], by default the lag of the receiver. Each is (k,) or a single value.
        """
        cases = np.broadcast(delays, drift, self.lag if lag is None else lag)
        cost_of_cases = [costs_of(*self.innovations(*each)) for each in cases]
        return np.array([np.bincount(self._block, each) for each in cost_of_cases])

    def mean_costs(self, delays: FloatArray, drifts: FloatArray, lags: FloatArray) -> FloatArray:
        """Compute the mean cost per measured value, (k,); see `costs`."""
        return np.asarray(self.costs(delays, drifts, lags).sum(axis=1) / self._block.size)

    def cost_of_step(self, delays: FloatArray, wider: float) -> float:
        """Compute the least cost with a step of the delay: one delay up to the end of a part, and another after it.

        `delays`: tested delays, evenly spaced [s]. `wider`: extension of their range on both sides [s].
        """
        step = delays[1] - delays[0]
        delays = np.arange(delays[0] - wider, delays[-1] + wider + 0.5 * step, step)
        cost_until = np.cumsum(self.costs(delays), axis=1)
        cost_since = cost_until[:, -1:] - cost_until
        last = int(np.argmin(cost_until.min(axis=0) + cost_since.min(axis=0)))
        of_fix = self._block[np.cumsum(np.bitwise_count(self._kind))[self._rows] - 1]
        # repeat with both delays: a wrong delay in one part distorts the state in the other
        both = np.where(of_fix <= last, delays[np.argmin(cost_until[:, last])], delays[np.argmin(cost_since[:, last])])
        return float(costs_of(*self.innovations(both, 0.0, self.lag)).sum()) + float(np.log(self.blocks))

    def likeliest(self, delays: FloatArray, lags: ArrayLike, off: ArrayLike = 0.0, drift: float = 0.0) -> int:
        """Find the case of least cost, see `costs`, plus its prior cost `off`. Unlikely cases are dropped early."""
        _, lags, off = np.broadcast_arrays(delays, lags, off)
        early_costs = self._beginning().costs(delays, drift, lags).sum(axis=1) + off
        kept = np.flatnonzero(early_costs <= early_costs.min() + UNLIKELY)
        return int(kept[np.argmin(self.costs(delays[kept], drift, lags[kept]).sum(axis=1) + off[kept])])

    def off(self, delays: FloatArray) -> float:
        """Compute the mean normalised squared innovation at the most likely of `delays` [-]."""
        innovation, variance = self.innovations(delays[self.likeliest(delays, self.lag)], 0.0, self.lag)
        return float(np.mean(innovation**2 / variance))

    def slopes(self, delay: float, drift: float, lag: float, step: float) -> tuple[FloatArray, FloatArray]:
        """Compute slopes of each part's cost by delay and lag, (2, blocks), and the Gauss-Newton curvature (2, 2)."""
        e, s = self.innovations(delay, drift, lag)
        by = np.array([self.innovations(delay + d, drift, lag + q)[0] - e for d, q in step * np.eye(2)]) / step
        weight = weights_of(e, s)
        return np.array([np.bincount(self._block, each * weight * e) for each in by]), (by * weight) @ by.T

    def measured(self, delay: FloatArray | float, drift: float, lag: float) -> tuple[FloatArray, FloatArray]:
        """Compute predicted minus measured (m, 6) and derivatives (m, 6, n) of all rows, valid until the next call."""
        index, fixes, rows = self._at, self._seen, self._rows
        span = -(delay + drift * fixes.away)
        since = v, p, c = self._since(span)
        arm, s = _times(c, fixes.lever), span[:, None]
        # `s`: time from epoch to fix [s]. `v`, `p`: motion in it by specific force. See `insnav.kernels.measurements`
        z, h = self._z, self._h
        z[rows, :3] = fixes.off + fixes.v * s + p + 0.5 * self._gravity * s**2 + arm + fixes.lasting[:, :3]
        h[rows, :3, 3:6] = s[..., None] * np.eye(3)
        h[rows, :3, 6:9], h[rows, :3, 12:15] = skew(p + arm), -0.5 * s[..., None] ** 2 * c
        if index.lever >= 0:
            h[rows, :3, index.lever : index.lever + 3] = c
        if self.velocities:
            late = span - lag
            instants = [self._measured_at(span - by * lag, lag, since if lag == 0.0 else None) for by in self.moments]
            v, q_c, by_lever, by_shaken = (np.mean(of, axis=0) for of in zip(*instants, strict=True))
            swing = _times(by_lever, fixes.lever) + _times(by_shaken, fixes.shaken)
            gained = self._gravity * late[:, None]
            z[rows, 3:] = np.nan_to_num(fixes.v + v + gained + swing - fixes.v_n) + fixes.lasting[:, 3:]
            h[rows, 3:, 6:9], h[rows, 3:, 12:15] = skew(v + swing), -q_c
            if index.lever >= 0:
                h[rows, 3:, index.lever : index.lever + 3] = by_lever
            if index.shaken >= 0:
                h[rows, 3:, index.shaken : index.shaken + 3] = by_shaken
        return z, h

    def _measured_at(self, late: FloatArray, lag: float, since: _Since | None) -> tuple[FloatArray, ...]:
        """Compute velocity change over `late` [s] after the epochs, ``C_nb`` times `late`, and lever-arm derivatives.

        `since`: motion by specific force in this time, if known.
        """
        v, _, c = since or self._since(late)
        reach = max(0.5 * self._nominal, abs(lag) * (len(self.moments) - 1) / len(self.moments) ** 2)
        slow = max(abs(lag) if len(self.moments) > 1 else reach, SEEN)
        time, bias = self._seen.time + late, self._seen.bias[:, :3]
        total, rate = (rates_at(time, *self._samples, r) - bias for r in (reach, slow))
        rate = rate if self._at.shaken >= 0 or len(self.moments) > 1 else total
        by_lever = c @ skew(rate)
        return v, late[:, None, None] * c, by_lever, c @ skew(total - rate)

    def innovations(self, delay: FloatArray | float, drift: float, lag: float) -> FloatArray:
        """Compute innovations and variances, (2, n), for delay at mid-record [s], its drift [s/s] and velocity lag [s].

        `delay`: one value, or one per fix.
        """
        index, (z, h) = self._at, self.measured(delay, drift, lag)
        (time, _, *before), decay = self._tape, self._model.decay
        correlated = self._correlated
        count = noise_likelihood.innovations(
            (time, self._kind, *before[:4], z, h, *before[6:]),
            self._density,
            self._model.noise[6:18],
            decay,
            index.correlated,
            np.ones(3) if correlated is None else correlated.sds,
            np.ones(3) if correlated is None else correlated.times,
            self._variance,
            (np.zeros(index.states), self._start),
            np.zeros((1, self._kind.size, NAV)),
            HUBER,
            self._out,
        )
        return self._out[:, :count].copy()


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    return np.asarray((matrix @ vector[..., None])[..., 0])
