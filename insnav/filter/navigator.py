"""The resumable loop: blocks of IMU samples in, state and covariance out, whatever the size of the blocks.

Between filter epochs the compiled kernel carries the state and accumulates transition and noise; at each fix, and once
a second where there is none, they are handed to the filter. A fix between two samples splits the interval at its time.
Post-processing feeds one recording in blocks; a live system could feed samples as they come, and is answered `MARGIN`
samples later.
"""

from __future__ import annotations

from collections.abc import Container

import numpy as np

from insnav import strapdown
from insnav.exceptions import ConfigError, DivergenceError
from insnav.filter import gates as gate
from insnav.filter.aiding import INTERVAL, Aiding
from insnav.filter.begin import first_state, layout, set_lasting, tie
from insnav.filter.engine import Engine
from insnav.filter.model import ErrorModel, FilterState, InitialState
from insnav.filter.record import Record
from insnav.filter.settings import FilterSettings
from insnav.filter.smoother import History, SmoothedErrors
from insnav.kernels import errorstate
from insnav.kernels.aiding import course, innovation, still
from insnav.kernels.aiding import wheels as kernel_wheels
from insnav.kernels.increments import LOOKAHEAD
from insnav.kernels.measurement import assess
from insnav.types import (
    Alignment,
    Event,
    EventKind,
    FloatArray,
    GpsData,
    ImuData,
    Increments,
    Run,
)

POSITION = (EventKind.GATE_POSITION, EventKind.SOFT_POSITION)
VELOCITY = (EventKind.GATE_VELOCITY, EventKind.SOFT_VELOCITY)
SOFT = (EventKind.SOFT_POSITION, EventKind.SOFT_VELOCITY)
MARGIN = LOOKAHEAD + strapdown.LOST_WINDOW + 2  # samples behind the newest that can be processed
CONTEXT = 2 * MARGIN  # samples kept before the first unprocessed one
SUBSTEP = 0.1  # longest sub-step of transition and noise [s]
COAST = 1.0  # longest time between filter epochs [s]
# unseen change of rate [rad/s^2] and specific force [m/s^3] in a hole, and the most assumed of it [rad], [m/s]
HOLE_NOISE = np.array([0.1, 0.5, 0.3, 20.0])
BROKEN = 3.0  # a longer time without a rejected fix ends a row of rejections, if fixes come more often [s]
FEWEST_REJECTIONS = 5  # fixes that must have been rejected before a reset
NEXT_TO_POLE = np.pi / 2 - 1.6e-4  # latitude beyond which a local-level frame is no use [rad]
ATTITUDE_RESET_SD = np.deg2rad([1.0, 1.0, 5.0])  # added at a reset [rad]
VELOCITY_RESET_SD = 5.0  # velocity of a reset by fixes without velocity [m/s]


class Navigator:
    """Loosely coupled INS/GPS filter over a stream of IMU samples.

    Parameters
    ----------
    start : InitialState or FilterState
        Where to begin, or to go on from; samples and fixes before its time are passed over.
    model : ErrorModel
        Noise of the sensors.
    gps : GpsData
        Fixes, with a standard deviation for every value that is given.
    alignment : Alignment
        Kept for the result.
    nominal : float
        Sampling interval [s].
    settings : FilterSettings
        Lever arm, delay, gates, output.
    marks : container of int
        Rows of `gps` after which the whole state is kept, in `kept`, to go on from it another time.

    Examples
    --------
    ``nav = Navigator(start, model, gps, alignment, 0.005)``, then ``nav.feed(block)`` for every block of samples, then
    ``run = nav.finish()``.
    """

    def __init__(
        self,
        start: InitialState | FilterState,
        model: ErrorModel,
        gps: GpsData,
        alignment: Alignment,
        nominal: float,
        settings: FilterSettings | None = None,
        marks: Container[int] = (),
    ) -> None:
        settings = settings or FilterSettings()
        if isinstance(start, InitialState):
            start = first_state(start, settings)
        self._at = layout(settings)
        n = self._at.states
        later = gps.time - settings.delay > start.time + strapdown.TIME_TOLERANCE
        self._gps = gps
        self._fix = np.flatnonzero(later)
        self._fix_time = gps.time[later] - settings.delay
        self._settings, self._model, self._nominal, self._alignment = settings, model, nominal, alignment
        self._marks, self.kept = marks, dict[int, FilterState]()
        self._engine = Engine(start.covariance)
        self._x, self._correction = start.x.copy(), start.correction.copy()
        self._delay, self._lasting, self._lever = start.delay, start.lasting.copy(), start.lever_b.copy()
        self._motion, self._sums, self._span = start.motion.copy(), np.zeros(errorstate.SUMS), np.zeros(1)
        self._phi, self._q, self._unity = np.eye(n), np.zeros((n, n)), np.eye(n)
        self._work = errorstate.scratch(n)
        self._aiding = settings.aiding
        self._coast = COAST if self._aiding is None else INTERVAL
        self._limit = np.array([SUBSTEP, self._coast])
        self._turned, self._aided = np.zeros(4), start.time
        self._z, self._h, self._sd = np.zeros(6), np.zeros((6, n)), np.zeros(6)
        self._r, self._s = np.zeros((6, 6)), np.zeros((6, 6))
        every = settings.output_interval
        self._grid = np.array([start.time if every > 0 else np.inf, every, start.time])
        self._start, self._done = start.time, -np.inf
        self._next = 0  # first fix not yet used
        self._last_good = start.time  # time of the last accepted position
        often = float(np.median(np.diff(gps.time))) if gps.time.shape[0] > 1 else 1.0
        self._broken = max(BROKEN, 2.5 * often)
        self._rejections: list[float] = []  # times of an unbroken row of rejected positions
        self._tail: ImuData | None = None
        self._record = Record(self._fix.shape[0])
        self._history = History(n) if settings.smooth else None
        if self._history is not None:
            self._history.epoch(start.time, self._x, self._correction, self._phi, self._engine.covariance)

    def feed(self, imu: ImuData) -> None:
        """Take the next block of samples; what needs later neighbours waits for the next call.

        Parameters
        ----------
        imu : ImuData
            Samples that follow those of the call before.
        """
        self._advance(imu, last=False)

    def finish(self) -> Run:
        """Process the samples still waiting and return the result."""
        if self._tail is not None:
            self._advance(None, last=True)
        return self._record.finish(
            self._alignment,
            self._settings,
            self._lever,
            self._model.axes_sd,
            self._delay,
            self._engine.covariance,
            self._history.smooth() if self._history is not None else None,
        )

    def offered(self) -> SmoothedErrors:
        """Process the samples still waiting and tell what filter and smoother make of every fix, used or not."""
        if self._tail is not None:
            self._advance(None, last=True)
        if self._history is None:
            raise ConfigError("only a filter that smooths compares fixes", where="settings.smooth")
        return self._history.smooth()

    def _state(self, time: float) -> FilterState:
        return FilterState(
            time,
            self._x.copy(),
            self._correction.copy(),
            self._delay,
            self._lasting.copy(),
            self._lever.copy(),
            self._motion.copy(),
            self._engine.covariance.copy(),
        )

    def _advance(self, imu: ImuData | None, *, last: bool) -> None:
        buffer = _join(self._tail, imu)
        n = buffer.time.shape[0]
        ready = n if last else n - MARGIN
        if ready < 2:
            self._tail = buffer
            return
        parts = strapdown.intervals(buffer, self._nominal)
        # everything up to the last sample that has all its neighbours, holes before it included
        stop = parts.end.shape[0] - (parts.hole[::-1] == 0.0).cumsum().searchsorted(n - ready, side="left") - 1
        stop = parts.end.shape[0] if last else stop
        first = int(np.searchsorted(parts.end, max(self._done, self._start + strapdown.TIME_TOLERANCE), side="right"))
        if stop > first:
            cuts = np.concatenate([[self._start], self._fix_time[self._next :]])
            pieces = strapdown.split(parts, cuts, first, stop)
            inc = strapdown.increments(parts, pieces)
            self._process(inc, parts.hole[pieces[0]])
            self._done = parts.end[stop - 1]
        self._tail = _slice(buffer, max(0, ready - CONTEXT))

    def _process(self, inc: Increments, hole: FloatArray) -> None:
        begin = int(np.searchsorted(inc.time, self._start + strapdown.TIME_TOLERANCE))
        # index of the piece that ends at each fix
        fixes = self._fix_time[self._next :]
        at = np.searchsorted(inc.time, fixes - strapdown.TIME_TOLERANCE)
        at = at[at < inc.time.shape[0]]
        out = self._record.reserve(inc.time.shape[0] if self._grid[1] == 0.0 else _rows(inc, self._grid[1]))
        k = begin
        for i in at:
            if i < begin:
                self._next += 1
                continue
            k = self._run(inc, hole, k, int(i) + 1, True, out)
            self._update(inc.time[i], out)
            self._steer(inc.time[i], int(self._fix[self._next]))
            if self._aiding is not None:
                self._aid(inc.time[i], self._aiding)
            row = int(self._fix[self._next])
            if row in self._marks:
                self.kept[row] = self._state(inc.time[i])
            self._next += 1
        self._run(inc, hole, k, inc.time.shape[0], False, out)
        self._record.keep(out)

    def _run(self, inc: Increments, hole: FloatArray, first: int, last: int, close: bool, out: Record.Rows) -> int:
        """Carry on to `last`; a filter epoch there if `close`, and in between wherever the next fix is far."""
        k, begin, done = first, out.used, first
        while k < last:
            k, out.used = errorstate.propagate(
                k,
                last,
                close,
                inc.time,
                inc.dt,
                inc.dtheta,
                inc.dvel,
                inc.coning,
                inc.sculling,
                hole,
                self._x,
                self._correction,
                self._motion,
                self._sums,
                self._span,
                self._limit,
                self._model.noise,
                HOLE_NOISE,
                self._model.decay,
                self._phi,
                self._q,
                self._engine.covariance,
                self._grid,
                out.time,
                out.state,
                out.variance,
                out.used,
                self._work,
            )
            if self._aiding is not None:
                self._turned[:3] += inc.dtheta[done:k].sum(axis=0)
                self._turned[3] += inc.dt[done:k].sum()
                done = k
            if self._span[0] >= self._coast - 1e-9 and not (close and k == last):
                self._predict(inc.time[k - 1])
                if self._aiding is not None:
                    self._aid(inc.time[k - 1], self._aiding)
        out.delay[begin : out.used] = self._delay
        return k

    def _predict(self, time: float) -> None:
        if abs(self._x[0]) > NEXT_TO_POLE:
            raise DivergenceError(
                "the track comes within a kilometre of a pole",
                where=f"time {time:.3f} s",
                why="heading and longitude have no meaning there",
                fix="cut the recording before it",
            )
        lasting = self._settings.correlated
        if lasting is not None:
            fade = float(np.exp(-self._span[0] / lasting.time))
            self._lasting *= fade
            for i in range(3):
                at = self._at.lasting + i
                self._phi[at, at] = fade
                self._q[at, at] = (1.0 - fade**2) * lasting.sd[i] ** 2
        self._note_repair(time, self._engine.predict(self._phi, self._q, time))
        if self._history is not None:
            self._history.epoch(time, self._x, self._correction, self._phi, self._engine.covariance)
        errorstate.reset_transition(self._phi, self._q, self._span)

    def _aid(self, time: float, aiding: Aiding) -> None:
        """Use what is known besides fixes, at most once in `INTERVAL`."""
        begin, span = self._aided, self._turned[3]
        if time - begin < 0.9 * INTERVAL:
            return
        rate = self._turned[:3] / span
        self._turned[:] = 0.0
        self._aided = time
        z, h = self._z, self._h
        if aiding.height is not None:
            h[0] = 0.0
            h[0, 2] = -1.0  # the error of position is down
            z[0] = self._x[2] - float(np.interp(time, aiding.height.time, aiding.height.height))
            self._use_aid(time, 0, 1, np.array([aiding.height.sd]), (EventKind.GATE_HEIGHT, "m"))
        if aiding.resting(begin, time):
            still(self._x, self._correction[:3], rate, z, h)
            sd = np.concatenate([np.full(3, aiding.rest_velocity_sd), aiding.rest_rate_sd])
            self._use_aid(time, 0, 6 if np.isfinite(sd).all() else 3, sd, (EventKind.GATE_REST, "m/s, rad/s"))
            return
        wheels = aiding.wheels
        if wheels is None or float(np.hypot(self._x[3], self._x[4])) < wheels.slowest:
            return
        odometer = aiding.odometer
        speed = np.nan if odometer is None else float(np.interp(time, odometer.time, odometer.speed))
        kernel_wheels(self._x, self._motion[:3], wheels.to_vehicle, wheels.lever_b, speed, z, h)
        sd = np.array([odometer.sd if odometer is not None else np.inf, *wheels.sd])
        if np.isfinite(speed):
            self._use_aid(time, 0, 1, sd, (EventKind.GATE_ODOMETER, "m/s"))
            kernel_wheels(self._x, self._motion[:3], wheels.to_vehicle, wheels.lever_b, speed, z, h)
        self._use_aid(time, 1, 3, sd, (EventKind.GATE_WHEELS, "m/s"))

    def _steer(self, time: float, row: int) -> None:
        """Use the heading of a fix, if it has one and it is wanted."""
        heading, sd = self._gps.heading, self._settings.heading_sd
        if heading is not None and sd > 0.0 and np.isfinite(heading[row]):
            course(self._x, heading[row], self._z, self._h)
            self._use_aid(time, 0, 1, np.array([sd]), (EventKind.GATE_HEADING, "rad"))

    def _use_aid(self, time: float, first: int, last: int, sd: FloatArray, what: tuple[EventKind, str]) -> None:
        z, h, r = self._z, self._h, self._r
        variance = np.zeros(6)
        variance[: sd.shape[0]] = sd**2
        m = last - first
        nis = innovation(self._engine.covariance, z, h, variance, first, last, np.empty((m, m)))
        limit = self._settings.gates.limit(m)
        self._record.aid(what[0], z[first:last], nis, nis <= limit)
        if nis > limit:
            self._record.event(Event(time, what[0], nis, limit, f"NIS ({m} dof)", gate.REJECTED, "wheels or rest"))
            return
        r[:] = 0.0
        np.fill_diagonal(r, np.where(variance > 0.0, variance, 1.0))
        part = slice(first, last)
        if self._history is not None:
            self._history.epoch(time, self._x, self._correction, self._unity, self._engine.covariance)
            self._history.aid(first, last, z, h, r)
        error, repaired = self._engine.update(z[part], h[part], r[part, part], time)
        self._take(error)
        self._note_repair(time, repaired)
        if self._history is not None:
            self._history.updated(self._x, self._correction)

    def _take(self, error: FloatArray) -> None:
        """Take an estimated error off the state."""
        errorstate.feed_back(self._x, self._correction, error)
        at = self._at
        if at.delay >= 0:
            self._delay -= error[at.delay]
        if at.lasting >= 0:
            self._lasting -= error[at.lasting : at.lasting + 3]
        if at.lever >= 0:
            self._lever -= error[at.lever : at.lever + 3]

    def _note_repair(self, time: float, repaired: bool) -> None:
        if repaired:
            self._record.event(Event(time, EventKind.REPAIR, 1.0, 0.0, "count", "negative variance set to zero"))

    def _update(self, time: float, out: Record.Rows) -> None:
        self._predict(time)
        row = self._fix[self._next]
        z, h, r = self._z, self._h, self._r
        nis_position, nis_velocity, distance, change = self._assess(row)
        nis = nis_position, nis_velocity
        use = [True, nis_velocity == nis_velocity]
        fix = int(self._gps.fix[row]) if self._gps.fix is not None else None
        quality = gate.quality(self._settings.gates, time, fix, self._gps.position_sd[row])
        if quality is not None and fix == 0:  # no fix at all, and no velocity either
            if self._history is not None:
                self._history.measurement(False, False, z, h, r)
            self._record.event(quality)
            self._record.fix(
                time, z, self._sd, nis, [False, False], self._x, self._correction, self._engine.covariance, self._delay
            )
            return
        for half, event in enumerate(self._judge(time, row, nis, distance, change, quality)):
            if event is None:
                continue
            self._record.event(event)
            if event.kind in SOFT:
                # exactly the noise that brings the NIS down to its limit
                part = slice(3 * half, 3 * half + 3)
                r[part, part] += (event.value / event.limit - 1.0) * self._s[part, part]
            else:
                use[half] = False
        if use[0] or use[1]:
            part = slice(0 if use[0] else 3, 6 if use[1] else 3)
            if self._history is not None:
                self._history.measurement(use[0], use[1], z, h, r)
            error, repaired = self._engine.update(z[part], h[part], r[part, part], time)
            self._take(error)
            self._note_repair(time, repaired)
            if self._history is not None:
                self._history.updated(self._x, self._correction)
        if use[0]:
            self._last_good = time
            self._rejections.clear()
        elif quality is None:
            self._consider_reset(time, row)
        p = self._engine.covariance
        self._record.fix(time, z, self._sd, nis, use, self._x, self._correction, p, self._delay)
        if out.used and out.time[out.used - 1] >= time - strapdown.TIME_TOLERANCE:
            out.state[out.used - 1] = self._x
            out.delay[out.used - 1] = self._delay
            variance = out.variance[out.used - 1]
            variance[:9] = p.diagonal()[:9]
            variance[9], variance[10], variance[11] = p[6, 7], p[6, 8], p[7, 8]

    def _assess(self, row: int) -> tuple[float, float, float, float]:
        """Innovation of a fix, its covariance, NIS of position and velocity, and their lengths."""
        gps, settings = self._gps, self._settings
        found: tuple[float, float, float, float] = assess(
            self._x,
            self._motion,
            self._lever,
            self._delay,
            settings.velocity_lag,
            settings.jitter,
            self._at.lasting,
            self._at.lever,
            self._lasting,
            settings.correlated.share if settings.correlated is not None else 0.0,
            gps.lla[row],
            gps.v_n[row],
            gps.position_sd[row],
            gps.velocity_sd[row],
            self._engine.covariance,
            self._z,
            self._h,
            self._r,
            self._s,
            self._sd,
        )
        return found

    def _judge(
        self,
        time: float,
        row: int,
        nis: tuple[float, float],
        distance: float,
        change: float,
        quality: Event | None,
    ) -> tuple[Event | None, Event | None]:
        """Why position and velocity are rejected or weighted down, or None."""
        gates, gps = self._settings.gates, self._gps
        position = (
            quality
            or gate.physical_position(gates, time, distance, gps.position_sd[row], time - self._last_good)
            or gate.statistical(gates, time, POSITION, nis[0], distance, gates.small_position)
        )
        velocity = None
        if nis[1] == nis[1]:
            velocity = gate.physical_velocity(gates, time, gps.v_n[row]) or gate.statistical(
                gates, time, VELOCITY, nis[1], change, gates.small_velocity
            )
        return position, velocity

    def _consider_reset(self, time: float, row: int) -> None:
        """After a long unbroken row of rejected positions, start again from the fix, once, and say so."""
        gates, gps = self._settings.gates, self._gps
        if self._rejections and time - self._rejections[-1] > self._broken:
            self._rejections.clear()
        self._rejections.append(time)
        if time - self._rejections[0] < gates.reset_after or len(self._rejections) < FEWEST_REJECTIONS:
            return
        self._assess(row)  # anew: the velocity of this fix may have been used already
        z = self._z
        p = self._engine.covariance.copy()
        error = np.zeros(p.shape[0])
        error[:3] = z[:3]
        p[:6, :] = p[:, :6] = 0.0
        p[:3, :3] = np.diag((3.0 * gps.position_sd[row]) ** 2)
        if np.isfinite(z[3:]).all() and gate.physical_velocity(gates, time, gps.v_n[row]) is None:
            error[3:6] = z[3:]
            p[3:6, 3:6] = np.diag((3.0 * gps.velocity_sd[row]) ** 2)
        else:
            p[3:6, 3:6] += VELOCITY_RESET_SD**2 * np.eye(3)
        # whatever led here has probably spoilt the attitude as well
        p[6:9, 6:9] += np.diag(ATTITUDE_RESET_SD**2)
        lasting = self._settings.correlated
        if lasting is not None:
            set_lasting(p, self._at.lasting, lasting.sd)
            tie(p, self._at.lasting, lasting.sd)
            self._lasting[:] = 0.0
        errorstate.feed_back(self._x, self._correction, error)
        self._engine.replace_covariance(p)
        if self._history is not None:
            self._history.restart(time, self._x, self._correction, p)
        self._record.event(
            Event(
                time,
                EventKind.RESET,
                float(np.linalg.norm(z[:3])),
                gates.reset_after,
                "m (limit: s of rejections)",
                "position and velocity set to the fix",
                "every position had been rejected",
            )
        )
        self._last_good = time
        self._rejections.clear()


def _rows(inc: Increments, every: float) -> int:
    return int((inc.time[-1] - inc.time[0]) / every) + 3


def _join(tail: ImuData | None, block: ImuData | None) -> ImuData:
    if tail is None or block is None:
        both = tail if block is None else block
        assert both is not None
        return both
    return ImuData(
        np.concatenate([tail.time, block.time]),
        np.concatenate([tail.gyro, block.gyro]),
        np.concatenate([tail.accel, block.accel]),
        block.sampling,
        block.stamp,
    )


def _slice(imu: ImuData, first: int) -> ImuData:
    return ImuData(imu.time[first:], imu.gyro[first:], imu.accel[first:], imu.sampling, imu.stamp)
