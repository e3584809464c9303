"""How likely fixes are whose timestamps are late by a given time, and all else that the filter estimates.

A filter has run once. In its error states a fix that is of another time than that of its epoch shows linearly: the
velocity error times the time between, the tilt of the specific force that acted in it, and the lever arm as it was
turned then. The innovations that the filter would have had with every fix in its own time then cost one pass of
covariance algebra (`insnav.kernels.noise_likelihood`), whatever the delay; the filter's own one is undone. Lever arm,
attitude and biases, of which a wrong delay makes others, are free in it, from a start that is hardly known.
"""

from __future__ import annotations

import numpy as np

from insnav import strapdown
from insnav.alignment import in_motion
from insnav.attitude import dcm_from_quat, rph_from_quat, skew
from insnav.earth import gravity_n, ned_offset
from insnav.filter.gates import impossible
from insnav.filter.navigator import SEEN, rates_at, turned
from insnav.filter.noise_identification import HUBER, bridged, costs_of, weights_of
from insnav.filter.prepare import Prepared
from insnav.filter.settings import FilterSettings
from insnav.filter.state_layout import first_state, layout
from insnav.kernels import noise_likelihood
from insnav.kernels.dynamics import NAV
from insnav.kernels.gps_measurement import STILL
from insnav.kernels.smoother import ARM, COAST, CORRECTION, KIND, POSITION, STATE, TIME, VELOCITY
from insnav.strapdown import TIME_TOLERANCE
from insnav.types import FloatArray
from insnav.units import DEG

REACH = 2.0  # delays looked for, early and late [s]
EDGE = REACH + 1.0  # fixes so near to the ends of the record may be of a time outside [s]
BLOCK, BLOCKS = (10.0, 20.0), 3  # parts whose errors are independent: how long, and so many of a short record [s]
OPEN_START = 20.0, 2.0, 5.0 * DEG  # sd of position [m], velocity [m/s], attitude at the start, which is late, too


class LateFixes:
    """Fixes of a record against a run; `epochs`: its rows, `settings`: of the filter that made them."""

    def __init__(self, ready: Prepared, settings: FilterSettings, epochs: FloatArray) -> None:
        at, time, gps = layout(settings), epochs[:, TIME], ready.gps
        self._tape = noise_likelihood.tape(epochs, at.states, ready.model.noise, bridged(ready.imu.time, time))
        own = np.minimum(np.searchsorted(gps.time - settings.delay, time - TIME_TOLERANCE), gps.time.size - 1)
        good = np.abs(gps.time[own] - settings.delay - time) <= TIME_TOLERANCE
        good &= (gps.position_sd[own].max(axis=1) <= settings.gates.max_sd) & (gps.fix is None or gps.fix[own] != 0)
        good &= ~impossible(settings.gates, gps)[own]  # one of 100 km would decide alone
        good &= (time > time[0] + EDGE) & (time < time[-1] - EDGE)
        self._fixes, self._time, self._rows = gps.rows(own[good]), time[good], np.flatnonzero(good)
        velocity = good & np.isfinite(gps.v_n[own]).all(axis=1)
        self._kind = np.where(velocity, POSITION + VELOCITY, np.where(good, POSITION, COAST))
        length = np.clip((time[-1] - time[0]) / BLOCKS, *BLOCK)
        self._block = np.repeat(((time - time[0]) / length).astype(int), np.bitwise_count(self._kind))
        self.accepted = float(np.mean(epochs[good, KIND] == self._kind[good])) if good.any() else 0.0
        self.velocities = bool(velocity.any())
        self.blocks, self.half = np.unique(self._block).size, 0.5 * float(time[-1] - time[0])
        self._away = self._time - time[0] - self.half
        self.moments = settings.moments
        self._at, self._model, self.lag, self._correlated = at, ready.model, settings.velocity_lag, settings.correlated
        self._variance = np.ones((time.size, 6))
        share = 0.0 if settings.correlated is None else settings.correlated.share
        self._variance[good, :3] = (1.0 - share) * self._fixes.position_sd**2
        self._variance[good, 3:] = np.nan_to_num(self._fixes.velocity_sd**2, nan=1.0)
        # the state before the measurement is the one after it and what was fed back
        x, fed = epochs[good, STATE : STATE + 10], self._tape[8]
        self._off = ned_offset(x[:, :3], self._fixes.lla) + fed[good, :3]
        self._v = x[:, 3:6] + fed[good, 3:6]
        covariance = epochs.shape[1] - at.states * (at.states + 1) // 2  # its lower triangle
        unsure = epochs[good][:, covariance + np.array([9, 14, 20])]
        self.moves = bool(np.sum(self._v**2) > STILL * np.sum(unsure))
        taken = np.cumsum(np.vstack([np.zeros(at.states), fed[:-1]]), axis=0)[good]
        taken = np.hstack([taken, np.zeros((self._rows.size, 3))])  # at -1, where an arm is no state
        arms = (at.lever, max(at.shaken, at.lever))
        self._lever, self._shaken = (settings.lever_b - taken[:, k:][:, :3] for k in arms)
        self._lasting = np.zeros((self._rows.size, 6))
        if settings.correlated is not None:  # what was fed back fades from its epoch on
            size = settings.correlated.times.size
            left = np.zeros((time.size, size))
            for k, fade in enumerate(np.exp(-np.diff(time)[:, None] / settings.correlated.times)):
                left[k + 1] = (left[k] + fed[k, at.correlated : at.correlated + size]) * fade
            self._lasting[:, :size] = -left[good]
        parts, self._bias = strapdown.intervals(ready.imu, ready.nominal), epochs[good, CORRECTION:ARM]
        self._samples = parts.end, turned(parts)
        self._nominal, self._gravity = ready.nominal, gravity_n(gps.lla[0, 0], gps.lla[0, 2])
        begin, rph = float(time[0]), rph_from_quat(epochs[0, STATE + 6 : STATE + 10])
        bias = np.median(epochs[time.size // 2 :, CORRECTION : CORRECTION + 3], axis=0)
        track = in_motion.history(parts, begin, float(parts.end[-1]), rph, bias, gps.lla[0, 0])
        u, c = track.u_n, dcm_from_quat(track.q_nb).reshape(-1, 9)
        self._track = track.time, np.hstack([u, track.way, c])
        self._here = strapdown.between(*self._track, self._time)[1]
        back = np.swapaxes(self._here[:, 6:].reshape(-1, 3, 3), 1, 2)
        self._turn = (np.eye(3) - skew(fed[good, 6:9])) @ dcm_from_quat(x[:, 6:]) @ back
        self._start = first_state(ready.initial, settings).covariance
        self._start[:NAV, :NAV] += np.diag(np.repeat(OPEN_START, 3) ** 2)
        # made once, as every delay fills the same places
        self._out, self._z, self._h = (
            np.zeros(each) for each in ((2, 6 * time.size), (time.size, 6), (time.size, 6, at.states))
        )
        noise = ready.model.noise
        self._density = np.array([np.mean(noise[:3]), np.mean(noise[3:6]), *noise[18:]])

    def _since(self, span: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What specific force adds to velocity and position in a time (k,) from the epoch on [s], and ``C_nb`` then."""
        there, s = strapdown.between(*self._track, self._time + span)[1], span[:, None]
        v, p = there[:, :3] - self._here[:, :3], there[:, 3:6] - self._here[:, 3:6] - self._here[:, :3] * s
        c = self._turn @ there[:, 6:].reshape(-1, 3, 3)
        push = _times(c, self._bias[:, 3:6])
        return _times(self._turn, v) - push * s, _times(self._turn, p) - 0.5 * push * s**2, c

    def costs(self, delays: FloatArray, drift: FloatArray | float = 0.0, lag: FloatArray | None = None) -> FloatArray:
        """Negative log-likelihood of each block of the record, (k, blocks), with delays in its middle [s].

        `delays`, `drift` of these [s/s], `lag` of the velocities behind the positions, of none the one assumed [s]:
        (k,), or one of each.
        """
        cases = np.broadcast(delays, drift, self.lag if lag is None else lag)
        every = [costs_of(*self.innovations(*each)) for each in cases]
        return np.array([np.bincount(self._block, each) for each in every])

    def slopes(self, delay: float, drift: float, lag: float, step: float) -> tuple[FloatArray, FloatArray]:
        """Slopes of the cost of each block by delay and lag, (2, blocks), and its curvature (2, 2), Gauss-Newton's."""
        e, s = self.innovations(delay, drift, lag)
        by = np.array([self.innovations(delay + d, drift, lag + q)[0] - e for d, q in step * np.eye(2)]) / step
        weight = weights_of(e, s)
        return np.array([np.bincount(self._block, each * weight * e) for each in by]), (by * weight) @ by.T

    def measured(self, delay: float, drift: float, lag: float) -> tuple[FloatArray, FloatArray]:
        """Predicted minus measured of each row (m, 6) and how errors show in that (m, 6, n), until the next call."""
        at, span = self._at, -(delay + drift * self._away)
        _, p, c = self._since(span)
        arm, s, own = _times(c, self._lever), span[:, None], np.zeros((self._rows.size, 6, at.states))
        # errors are estimate minus truth; see `insnav.kernels.gps_measurement`
        z, h = self._z, self._h
        z[self._rows, :3] = self._off + self._v * s + p + 0.5 * self._gravity * s**2 + arm
        own[:, :3, :3] = np.eye(3)
        own[:, :3, 3:6] = s[..., None] * np.eye(3)
        own[:, :3, 6:9], own[:, :3, 12:15] = skew(p + arm), -0.5 * s[..., None] ** 2 * c
        if at.lever >= 0:
            own[:, :3, at.lever : at.lever + 3] = c
        if self.velocities:
            late = span - lag
            q, seen = late[:, None], [self._measured_at(span - each * lag, lag) for each in self.moments]
            v, q_c, by_lever, by_shaken = (np.mean(each, axis=0) for each in zip(*seen, strict=True))
            swing = _times(by_lever, self._lever) + _times(by_shaken, self._shaken)
            z[self._rows, 3:] = np.nan_to_num(self._v + v + self._gravity * q + swing - self._fixes.v_n)
            own[:, 3:, 3:6] = np.eye(3)
            own[:, 3:, 6:9], own[:, 3:, 12:15] = skew(v + swing), -q_c
            if at.lever >= 0:
                own[:, 3:, at.lever : at.lever + 3] = by_lever
            if at.shaken >= 0:
                own[:, 3:, at.shaken : at.shaken + 3] = by_shaken
        if self._correlated is not None:
            size = self._correlated.sds.size
            own[:, :, at.correlated : at.correlated + size] = np.eye(6)[:, :size]
        z[self._rows] += self._lasting
        h[self._rows] = own
        return z, h

    def _measured_at(self, late: FloatArray, lag: float) -> tuple[FloatArray, ...]:
        """Velocity since the epoch, ``C_nb`` times the time, and what lever arms make of turns then, (k, 3, 3)."""
        v, _, c = self._since(late)
        reach = max(0.5 * self._nominal, abs(lag) * (len(self.moments) - 1) / len(self.moments) ** 2)
        slow = max(abs(lag) if len(self.moments) > 1 else reach, SEEN)
        whole, rate = (rates_at(self._time + late, *self._samples, r) - self._bias[:, :3] for r in (reach, slow))
        rate = rate if self._at.shaken >= 0 or len(self.moments) > 1 else whole
        by_lever = c @ skew(rate)
        return v, late[:, None, None] * c, by_lever, c @ skew(whole - rate)

    def innovations(self, delay: float, drift: float, lag: float) -> FloatArray:
        """Innovations and their variances, (2, n), with a delay in the middle of the record [s], drift and lag."""
        at, (z, h) = self._at, self.measured(delay, drift, lag)
        (time, _, *before), decay = self._tape, self._model.decay
        correlated = self._correlated
        count = noise_likelihood.innovations(
            (time, self._kind, *before[:4], z, h, *before[6:]),
            decay,
            self._density,
            self._model.noise[6:18],
            decay,
            at.correlated,
            np.ones(3) if correlated is None else correlated.sds,
            np.ones(3) if correlated is None else correlated.times,
            self._variance,
            (np.zeros(at.states), self._start),
            np.zeros((1, self._kind.size, NAV)),
            HUBER,
            self._out,
        )
        return self._out[:, :count].copy()


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    return np.asarray((matrix @ vector[..., None])[..., 0])
