"""Resumable loop: IMU samples in, state and covariance out, independent of the block size.

Between filter epochs the compiled kernel propagates the state and accumulates transition and noise. The filter gets
them at each fix, and once a second without fixes. A fix between two samples splits the interval at its time.
Post-processing feeds a recording in blocks. `insnav.session.online` feeds samples as they arrive, and lags by `MARGIN`
samples and `SEEN`.
"""

from __future__ import annotations

from collections.abc import Container
from typing import Any

import numpy as np

from insnav import strapdown
from insnav.alignment.in_motion import SEEN
from insnav.alignment.static import stays
from insnav.exceptions import ConfigError
from insnav.filter import gates as gate
from insnav.filter.error_model import FilterState, Part, first_state
from insnav.filter.estimate import Estimate
from insnav.filter.filter_input import FilterInput
from insnav.filter.gps_noise import LAG_WORTH
from insnav.filter.measurements.measurement import INTERVAL, FilterView, Measurement
from insnav.filter.measurements.sensors import Heading
from insnav.filter.run_recorder import Record
from insnav.filter.smoother import History
from insnav.findings import Code, Finding
from insnav.kernels.epoch import felt
from insnav.kernels.errorstate import Outputs, Samples
from insnav.kernels.increments import LOOKAHEAD
from insnav.kernels.measurements import assess, innovation
from insnav.types import FloatArray, GpsData, ImuData, Increments, Run

POSITION = (Code.GATE_POSITION, Code.DEWEIGHTED_POSITION)
VELOCITY = (Code.GATE_VELOCITY, Code.DEWEIGHTED_VELOCITY)
DEWEIGHTED = (Code.DEWEIGHTED_POSITION, Code.DEWEIGHTED_VELOCITY)
MARGIN = LOOKAHEAD + strapdown.LOST_WINDOW + 2  # newest samples, which wait for their neighbours
QUANTUM = 2.0**-40  # of angles, far below gyro resolution [rad]
COAST = 1.0  # longest time between filter epochs: the transition is of second order [s]
BROKEN = 3.0  # a longer time without a rejected fix ends a run of rejections, if fixes come more often [s]
NOISY, FAR_BEYOND = 3.0, 10.0  # factors on the RMS of the gyros' white noise: smaller rates, or parts, may be noise
FEWEST_REJECTIONS = 5  # before a reset: at low rates a second or two of multipath must not cause a reset


class Navigator:
    """Loosely coupled INS/GPS filter over a stream of IMU samples.

    `ready`: the recording; `feed` takes its samples. `start`: state to continue from, by default the first; data
    before its time are skipped. `marks`: rows of the fixes after which `kept` stores the whole state, to continue from.
    `record`: collects the results; by default all of them.

    Examples
    --------
    ``nav = Navigator(ready)``, then ``nav.feed(block)`` for every block of samples, then ``run = nav.finish()``.
    """

    def __init__(
        self,
        ready: FilterInput,
        start: FilterState | None = None,
        marks: Container[int] = (),
        record: Record | None = None,
    ) -> None:
        start = start or first_state(ready.initial, ready.receiver)
        self._ready, self._receiver, self._nominal = ready, ready.receiver, ready.nominal
        model, nominal, output, lag = ready.model, ready.nominal, ready.output, ready.receiver.lag
        self._start, self._done, self._first = start.time, -np.inf, start.time
        self.take_fixes(ready.gps)
        self._marks, self.kept = marks, dict[int, FilterState]()
        self._coast = COAST if ready.aiding.measurements is None else INTERVAL
        rates_sd = np.sqrt(model.noise[:3] / nominal) if output.with_poses else None
        self._record = record or Record(self._fix.shape[0], rates_sd)
        self._estimate = Estimate(ready, start, self._record.event, self._coast)
        self._record.epoch(start.time, self._estimate)
        self._aiding = AidingUpdates(self._estimate, ready, self._record, start.time)
        n = self._estimate.at.states
        self._z, self._h, self._sd = np.zeros(6), np.zeros((6, n)), np.zeros(6)
        self._r, self._s = np.zeros((6, 6)), np.zeros((6, 6))
        every = output.interval
        self._grid = np.array([np.inf, every if every > 0.0 or not output.with_poses else -1.0, 0.0])
        self._begin_grid(start.time)
        none = np.empty((0, 3))
        self._sensed, self._motion = (none, none, none, none), np.zeros(25)  # see `felt`
        noise = float(model.noise[:3].sum()) / nominal
        mean = 0.5 * nominal / SEEN  # noise reduction by the mean
        self._motion[9:11] = mean * NOISY**2 * noise, FAR_BEYOND**2 * noise
        if len(lag.moments) > 1:  # the receiver's response to fast turns is unknown: do not use them for the arm
            self._motion[10] = np.inf
        if not self._late.any():  # older velocities have other noise than the mean
            self._motion[17] = NOISY**2 * float(model.noise[3:6].sum()) / (2.0 * SEEN)
        # The newest samples wait for later ones. Twice as many processed samples are kept, for means about fixes
        self._margin = MARGIN + int((SEEN + max(lag.moments) * abs(lag.value)) / nominal)
        self._last_good = start.time  # time of the last accepted position
        often = float(np.median(np.diff(ready.gps.time))) if ready.gps.time.shape[0] > 1 else 1.0
        self._broken = max(BROKEN, 2.5 * often)
        self._rejections: list[float] = []  # times of an unbroken run of rejected positions
        self._tail: ImuData | None = None
        self._parts = [part for part in ready.starts[1:] if part.initial.time > start.time]

    def take_fixes(self, gps: GpsData) -> None:
        """Replace all fixes; processed ones have no further effect."""
        delay, lag = self._receiver.delay.value, self._receiver.lag.value
        later = gps.time - delay > self._first + strapdown.TIME_TOLERANCE
        self._gps, self._fix, self._fix_time = gps, np.flatnonzero(later), gps.time[later] - delay
        own = np.full(gps.time.shape[0], True) if gps.fix is None else gps.fix != gate.OF_REFERENCE
        # age of the velocities [s]; a smaller lag is linear enough
        self._late = own[later] * (lag if abs(lag) > LAG_WORTH else 0.0)
        # first unprocessed fix
        done = max(self._done, self._start) + strapdown.TIME_TOLERANCE
        self._next = int(np.searchsorted(self._fix_time, done, side="right"))

    def feed(self, imu: ImuData) -> None:
        """Process the next block of samples; samples without later neighbours wait for the next call.

        `imu`: samples that follow the previous call.
        """
        while self._parts and imu.time[-1] > self._parts[0].after:
            before = int(np.searchsorted(imu.time, self._parts[0].after, side="right"))
            if before:
                self._advance(imu.rows(slice(0, before)), last=False)
            self._go_on(self._parts.pop(0))
            imu = imu.rows(slice(before, None))
        self._advance(imu, last=False)

    def _go_on(self, part: Part) -> None:
        """End a part of the record and begin the next part."""
        if self._tail is not None:
            self._advance(None, last=True)
        estimate, start = self._estimate, part.initial
        self._close()
        span = start.time - max(self._done, self._start)
        self._tail, self._start, self._done = None, start.time, -np.inf
        self.take_fixes(self._gps)
        self._last_good = start.time
        self._rejections.clear()
        self._begin_grid(start.time)
        estimate.go_on(start, span)
        self._record.epoch(start.time, estimate)
        self._aiding.restart(start.time)

    def _cuts(self, begin: float, end: float) -> FloatArray:
        """Return times in order at which intervals from `begin` to `end` are cut: start, fixes and wanted poses.

        A tenth of a millisecond before a pose of another point, too: its velocity needs the rate at the epoch.
        """
        output, span = self._ready.output, [begin, end + strapdown.TIME_TOLERANCE]
        cuts = [some[slice(*some.searchsorted(span))] for some in (self._fix_time[self._next :], output.epochs)]
        if output.point_b is not None:
            every, poses = self._grid[1], cuts[1]
            if every > 0.0 and not output.epochs.size:
                poses = every * np.arange(np.floor(begin / every), np.ceil(end / every) + 1.0)
            cuts += poses, poses - 100.0 * strapdown.TIME_TOLERANCE
        return np.sort(np.concatenate([*cuts, [self._start]]))

    def _begin_grid(self, time: float) -> None:
        """Set the next epochs of the solution: whole multiples of the interval, and those wanted."""
        begin, every = time - strapdown.TIME_TOLERANCE, self._grid[1]
        self._grid[0] = every * np.ceil(begin / every) if every > 0.0 else np.inf
        self._grid[2] = np.searchsorted(self._ready.output.epochs, begin)

    def _close(self) -> None:
        """End with an epoch, so that every row lies between two epochs."""
        if self._estimate.span[0] > 0.0:
            self._estimate.predict(self._done)
            self._record.epoch(self._done, self._estimate)

    @property
    def done(self) -> float:
        """Time of the state [s]: the newest samples wait for their neighbours."""
        return max(self._done, self._start)

    @property
    def estimate(self) -> Estimate:
        """State and covariance at that time."""
        return self._estimate

    def saved(self) -> tuple[Any, ...]:
        """Copy everything that processing changes, without aiding and results, for `go_back`."""
        plain = self._done, self._last_good, self._tail, tuple(self._rejections)
        return *plain, self._estimate.saved()

    def go_back(self, saved: tuple[Any, ...], gps: GpsData) -> None:
        """Go back to an earlier state, with other fixes; the samples since must follow again."""
        self._done, self._last_good, self._tail, rejections, estimate = saved
        self._rejections = list(rejections)
        self._estimate.go_back(estimate)
        self.take_fixes(gps)

    def restart_at(self, part: Part) -> None:
        """Continue with a new alignment after a gap of the samples that follow."""
        self._parts.append(part)

    @property
    def delay(self) -> tuple[float, float]:
        """Estimate of the delay of the fixes so far, in addition to the specified delay, and its sd [s]."""
        estimate = self._estimate
        at = max(estimate.at.delay, 0)
        return estimate.delay, float(np.sqrt(estimate.covariance[at, at])) if estimate.at.delay >= 0 else np.inf

    def levers(self) -> tuple[FloatArray, FloatArray]:
        """Lever arm minus the specified arm, and vibration arm minus lever arm: (2, 3) [m], covariances (2, 3, 3)."""
        estimate, at = self._estimate, self._estimate.at
        by = np.zeros((2, 3, at.states))
        for row, first, sign in ((0, at.lever, 1.0), (1, at.shaken, 1.0), (1, at.lever, -1.0)):
            if first >= 0:
                by[row, :, first : first + 3] = sign * np.eye(3)
        off = np.array([estimate.lever - self._receiver.lever_arm.value, estimate.shaken - estimate.lever])
        return off, by @ estimate.covariance @ np.swapaxes(by, 1, 2)

    def finish(self) -> Run:
        """Process the waiting samples and return the result."""
        if self._tail is not None:
            self._advance(None, last=True)
        estimate = self._estimate
        self._close()
        found = estimate.history.smooth(estimate.least_delay_sd) if estimate.history is not None else None
        stated = estimate.stated(), estimate.covariance
        return self._record.finish(self._ready, estimate.lever, estimate.delay, *stated, found)

    def misfit(self) -> tuple[float, float]:
        """Misfit of the fixes so far, and their mean square; see `Record.misfit`."""
        return self._record.misfit()

    def history(self) -> History:
        """Process the waiting samples and return all epochs."""
        if self._tail is not None:
            self._advance(None, last=True)
        if self._estimate.history is None:
            raise ConfigError("filter.no_epochs", where="output.smooth")
        return self._estimate.history

    def _advance(self, imu: ImuData | None, *, last: bool) -> None:
        buffer = self._tail if imu is None else imu if self._tail is None else self._tail.joined(imu)
        assert buffer is not None
        n = buffer.time.shape[0]
        ready = n if last else n - self._margin
        if ready < 2:
            self._tail = buffer
            return
        parts = strapdown.intervals(buffer, self._nominal)
        # everything up to the last sample with all its neighbours, including gaps before it
        stop = parts.end.shape[0] - (parts.gap[::-1] == 0.0).cumsum().searchsorted(n - ready, side="left") - 1
        stop = parts.end.shape[0] if last else stop
        first = int(parts.end.searchsorted(max(self._done, self._start + strapdown.TIME_TOLERANCE), side="right"))
        if stop > first:
            cuts = self._cuts(parts.end[first] - parts.dt[first], parts.end[stop - 1])
            pieces = strapdown.split(parts, cuts, first, stop)
            inc = strapdown.increments(parts, pieces)
            last_fix = int(self._fix_time.searchsorted(parts.end[stop - 1] + strapdown.TIME_TOLERANCE, side="right"))
            times = self._fix_time[self._next : last_fix]
            if times.size:
                self._sense(times, self._late[self._next : last_fix], parts)
            self._process(inc, parts.gap[pieces[0]])
            self._done = parts.end[stop - 1]
        self._tail = buffer.rows(slice(max(0, ready - 2 * self._margin), None))

    def _sense(self, times: FloatArray, late: FloatArray, parts: strapdown.Intervals) -> None:
        """Compute rates and forces about the next fixes (k,) [s], with velocities `late` (k,) [s] old, for `felt`."""
        half, number = 0.5 * self._nominal, int(SEEN / self._nominal)
        angles, instants, reach = turned(parts), [times], SEEN  # instants: whose mean a velocity is; reach of rates [s]
        swings = older = self._sensed[3]
        if late.any():
            oldest, instants = np.abs(late).max(), [times - share * late for share in self._receiver.lag.moments]
            reach = SEEN if len(instants) == 1 else max(SEEN, oldest)
            swing_reach = max(half, oldest * (len(instants) - 1) / len(instants) ** 2)
            swings = np.mean([rates_at(instant - half, parts.end, angles, swing_reach) for instant in instants], axis=0)
            older = np.mean([since(times, times - instant, parts) for instant in instants], axis=0)
        # an acceleration of another shape than the velocity would bias the delay towards zero
        forces = [forces_about(instant, parts, max(1, number)) for instant in instants]
        rates = [rates_at(instant, parts.end, angles, reach) for instant in instants]
        mean = [each[0] if len(each) == 1 else np.mean(each, axis=0) for each in (rates, forces)]
        self._sensed = mean[0], mean[1], swings, older

    def _process(self, inc: Increments, gap: FloatArray) -> None:
        k = int(inc.time.searchsorted(self._start + strapdown.TIME_TOLERANCE))
        # index of the piece that ends at each fix
        fixes, before = self._fix_time[self._next :], self._next
        at = inc.time.searchsorted(fixes - strapdown.TIME_TOLERANCE)
        at = at[at < inc.time.shape[0]]
        rows = 3 + int((inc.time[-1] - inc.time[0]) / self._grid[1]) if self._grid[1] > 0.0 else inc.time.shape[0]
        wanted = self._ready.output.epochs
        rows += int(wanted.searchsorted(inc.time[-1] + 1.0)) - int(self._grid[2])
        out = self._record.reserve(rows, self._grid, wanted)
        samples = Samples(inc.time, inc.dt, inc.dtheta, inc.dvel, inc.coning, inc.sculling, gap)
        for i in at:
            k = self._run(samples, k, int(i) + 1, True, out)
            self._update(inc.time[i], self._next - before)
            row = int(self._fix[self._next])
            self._aiding.at_fix(inc.time[i])
            self._aiding.at_epoch(inc.time[i])
            self._show(inc.time[i], out)
            if row in self._marks:
                self.kept[row] = self._estimate.kept(inc.time[i])
            self._next += 1
        self._run(samples, k, inc.time.shape[0], False, out)

    def _run(self, samples: Samples, first: int, last: int, close: bool, out: Outputs) -> int:
        """Propagate to `last`; `close` adds a filter epoch there. Further epochs where the next fix is far."""
        estimate, k = self._estimate, first
        while k < last:
            done = k
            k = estimate.propagate(samples, k, last, close, out)
            self._aiding.turned(samples, done, k)
            if estimate.span[0] >= self._coast - 1e-9 and not (close and k == last):
                estimate.predict(samples.time[k - 1])
                self._aiding.at_epoch(samples.time[k - 1])
                self._show(samples.time[k - 1], out)
        return k

    def _update(self, time: float, number: int) -> None:
        """Process a fix. `number`: its row of the rates."""
        estimate = self._estimate
        estimate.predict(time)
        late, at = self._late[self._next], estimate.at
        still = stays(self._ready.alignment, time)  # all rotation is noise
        felt(estimate.all, *self._sensed, number, late, at.has_arm, still, self._motion)
        row = self._fix[self._next]
        z, h, r = self._z, self._h, self._r
        nis_position, nis_velocity, distance, change = self._assess(row)
        nis = nis_position, nis_velocity
        use = [True, nis_velocity == nis_velocity]
        fix = int(self._gps.fix[row]) if self._gps.fix is not None else None
        quality = gate.quality(self._ready.gates, time, fix, self._gps.position_sd[row])
        if quality is not None and fix in (0, gate.OF_REFERENCE):  # invalid fix, without velocity
            if estimate.history is not None:
                estimate.history.measurement(False, False, z, h, r)
            self._record.event(quality)
            self._record.fix(time, z, self._sd, nis, [False, False], estimate)
            return
        for half, event in enumerate(self._gate(time, row, nis, distance, change, quality)):
            if event is None:
                continue
            self._record.event(event)
            if event.code in DEWEIGHTED:
                # the noise that reduces the NIS to its limit
                part = slice(3 * half, 3 * half + 3)
                r[part, part] += (event["nis"] / event["limit_nis"] - 1.0) * self._s[part, part]
            else:
                use[half] = False
        if use[0] or use[1]:
            part = slice(0 if use[0] else 3, 6 if use[1] else 3)
            if estimate.history is not None:
                estimate.history.measurement(use[0], use[1], z, h, r)
            estimate.correct(time, z[part], h[part], r[part, part])
        if use[0]:
            self._last_good = time
            self._rejections.clear()
        elif quality is None and (self._ready.explained.false is None or not self._ready.explained.false[0, row]):
            self._consider_reset(time, row)
        self._record.fix(time, z, self._sd, nis, use, estimate)

    def _show(self, time: float, out: Outputs) -> None:
        """Store the state after an epoch in the rows of the solution at its time, if any."""
        self._record.epoch(time, self._estimate)
        row = int(out.used[0]) - 1
        while row >= 0 and out.time[row] >= time - strapdown.TIME_TOLERANCE:
            out.state[row] = self._estimate.x
            row -= 1

    def _assess(self, row: int) -> tuple[float, float, float, float]:
        """Compute the innovation of a fix, its covariance, NIS of position and velocity, and their lengths."""
        gps, receiver, estimate = self._gps, self._receiver, self._estimate
        found: tuple[float, float, float, float] = assess(
            *(estimate.all, estimate.covariance, self._motion),
            *(gps.lla, gps.v_n, gps.position_sd, gps.velocity_sd, row),
            *(gps.fix is None or gps.fix[row] != gate.OF_REFERENCE, self._late[self._next], receiver.jitter),
            *(receiver.correlated.share if receiver.correlated is not None else 0.0, estimate.places),
            *(self._z, self._h, self._r, self._s, self._sd),
        )
        return found

    def _gate(
        self, time: float, row: int, nis: tuple[float, float], distance: float, change: float, quality: Finding | None
    ) -> tuple[Finding | None, Finding | None]:
        """Return the findings that reject or de-weight position and velocity, or None."""
        gates, gps = self._ready.gates, self._gps
        position, velocity = None, None
        if self._ready.explained.false is not None:
            position, velocity = gate.whole_record(time, row, self._ready.explained.false, distance, change)
        position = (
            position
            or quality
            or gate.physical_position(gates, time, distance, gps.position_sd[row], time - self._last_good)
            or gate.statistical(gates, time, POSITION, nis[0], distance, gates.small_of(gps.position_sd[row]))
        )
        if velocity is None and nis[1] == nis[1]:
            velocity = gate.physical_velocity(gates, time, gps.v_n[row]) or gate.statistical(
                gates, time, VELOCITY, nis[1], change, gates.small_velocity
            )
        return position, velocity

    def _consider_reset(self, time: float, row: int) -> None:
        """Reset to the fix after a long unbroken run of rejected positions, with an event."""
        gates, gps = self._ready.gates, self._gps
        if self._rejections and time - self._rejections[-1] > self._broken:
            self._rejections.clear()
        self._rejections.append(time)
        if time - self._rejections[0] < gates.reset_after or len(self._rejections) < FEWEST_REJECTIONS:
            return
        self._assess(row)  # again: the velocity of this fix may have been used
        z = self._z
        with_velocity = np.isfinite(z[3:]).all() and gate.physical_velocity(gates, time, gps.v_n[row]) is None
        self._estimate.restart(time, z, gps.position_sd[row], gps.velocity_sd[row] if with_velocity else None)
        distance = float(np.linalg.norm(z[:3]))
        self._record.event(Finding.of(Code.FILTER_RESET, time, distance_m=distance, limit_s=gates.reset_after))
        self._last_good = time
        self._rejections.clear()


def turned(parts: strapdown.Intervals) -> FloatArray:
    """Compute the angle about each axis from the first sample to the end of each, (n, 3) [rad].

    Differences do not depend on the first sample: sums of integer multiples of `QUANTUM` are exact.
    """
    angles = parts.gyro * parts.dt[:, None] if parts.instant else parts.gyro
    return QUANTUM * np.cumsum(np.round(angles / QUANTUM), axis=0)


def rates_at(times: FloatArray, end: FloatArray, angles: FloatArray, reach: float = SEEN) -> FloatArray:
    """Compute the mean body rate about each of the fixes (k,) [s], without vibration: (k, 3) [rad/s].

    `end` (n,): of the samples [s]. `angles` (n, 3): from `turned`.
    """
    window = np.minimum(np.maximum(times + np.array([[-reach], [reach]]), end[0]), end[-1])
    row = np.minimum(np.maximum(end.searchsorted(window), 1), end.size - 1)
    left = ((end[row] - window) / (end[row] - end[row - 1]))[..., None] * (angles[row] - angles[row - 1])
    turn = angles[row[1]] - angles[row[0]] - left[1] + left[0]
    return np.asarray(turn / np.maximum(window[1] - window[0], reach)[:, None])


def forces_about(times: FloatArray, parts: strapdown.Intervals, number: int) -> FloatArray:
    """Compute mean specific force of `number` samples before and after each time (k,) [s]: (k, 3) [m/s^2]."""
    first = (parts.end - parts.dt).searchsorted(times - strapdown.TIME_TOLERANCE)
    rows = np.minimum(np.maximum(first[:, None] + np.arange(-number, number), 0), parts.end.size - 1)
    dt = parts.dt[rows]
    changes = parts.accel[rows] * dt[..., None] if parts.instant else parts.accel[rows]
    return np.asarray(changes.sum(axis=1) / dt.sum(axis=1)[:, None])


def since(times: FloatArray, late: FloatArray, parts: strapdown.Intervals) -> FloatArray:
    """Compute rotation and velocity by specific force in the time before each of `times` (k,): (k, 6) [rad], [m/s].

    `late` (k,): length of that time [s], negative for times after. In body axes at `times`; rotations are small.
    """
    begin, end = np.sort([times, times - late], axis=0)[..., None]
    first, last = np.searchsorted(parts.end, begin), np.searchsorted(parts.end, end)
    rows = first + np.arange(np.max(last - first) + 1)
    inside, rows = rows < parts.end.size, np.minimum(rows, parts.end.size - 1)
    until = parts.end[rows].clip(begin, end)
    part = np.sign(late)[:, None] * inside * (until - (parts.end - parts.dt)[rows].clip(begin, until))
    part = (part if parts.instant else part / parts.dt[rows])[..., None]
    turn, gain = part * parts.gyro[rows], part * parts.accel[rows]
    whole, angle = turn.sum(axis=1), np.cumsum(turn, axis=1) - 0.5 * turn
    angle = np.where(part.sum(axis=1, keepdims=True) > 0.0, whole[:, None] - angle, angle)  # forward in time
    once = np.cross(gain, angle)
    return np.hstack([whole, (gain + once + 0.5 * np.cross(once, angle)).sum(axis=1)])


class AidingUpdates:
    """Aiding updates of one estimate, from the time `start` [s] on; fixes may come with a heading."""

    def __init__(self, estimate: Estimate, ready: FilterInput, record: Record, start: float) -> None:
        self._estimate, self._gates, self._record = estimate, ready.gates, record
        self._every = ready.aiding.measurements
        self._with_fixes: list[Measurement] = []
        if ready.receiver.heading_sd > 0.0 and ready.gps.heading is not None:
            sd = np.array([ready.receiver.heading_sd])
            self._with_fixes.append(Heading(ready.fix_time, ready.gps.heading, sd))
        self._turned, self._last = np.zeros(4), start
        self._z, self._h, self._r = np.zeros(6), np.zeros((6, estimate.at.states)), np.zeros((6, 6))

    def restart(self, time: float) -> None:
        """Reset the sums of the body rate."""
        self._turned[:] = 0.0
        self._last = time

    def turned(self, samples: Samples, first: int, last: int) -> None:
        """Sum the body rate over samples."""
        if self._every is not None:
            self._turned[:3] += samples.dtheta[first:last].sum(axis=0)
            self._turned[3] += samples.dt[first:last].sum()

    def at_fix(self, time: float) -> None:
        """Use the measurements that come with the fixes."""
        for each in self._with_fixes:
            self._use(each, self._view(time, time, np.zeros(3)))

    def at_epoch(self, time: float) -> None:
        """Use all other measurements, at most once per `INTERVAL`."""
        if self._every is None or time - self._last < 0.9 * INTERVAL:
            return
        view = self._view(self._last, time, self._turned[:3] / self._turned[3])
        self._turned[:] = 0.0
        self._last = time
        seen: set[str] = set()
        for each in self._every:
            if not each.excluded_by & seen and self._use(each, view):
                seen.add(each.name)

    def _view(self, begin: float, time: float, mean_gyro: FloatArray) -> FilterView:
        at = self._estimate
        return FilterView(begin, time, at.x, at.correction, at.motion[:3], mean_gyro, float(np.hypot(at.x[3], at.x[4])))

    def _use(self, measurement: Measurement, at: FilterView) -> bool:
        """Apply a measurement, unless gated; return whether there was a measurement."""
        z, h, r, estimate = self._z, self._h, self._r, self._estimate
        part = measurement.observe(at, z, h)
        m = part.stop - part.start
        if m == 0:
            return False
        variance = np.ones(6)
        variance[part] = measurement.sd[:m] ** 2
        nis = innovation(estimate.covariance, z, h, variance, part.start, part.stop, np.empty((m, m)))
        limit = self._gates.limit(m)
        self._record.aiding(measurement, z[part], nis, nis <= limit)
        if nis > limit:
            code, name = Code.GATE_AIDING, measurement.name
            self._record.event(Finding.of(code, at.time, subject=name, nis=nis, limit_nis=limit, dof=m))
            return True
        np.fill_diagonal(r, variance)
        estimate.epoch(at.time)
        if estimate.history is not None:
            estimate.history.aiding(part, z, h, r)
        estimate.correct(at.time, z[part], h[part], r[part, part])
        return True
