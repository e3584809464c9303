"""Navigation loop: takes IMU samples in blocks and runs the filter. Results do not depend on the block size.

Between filter epochs, a compiled kernel propagates the state and accumulates transition and noise. A filter epoch
follows at each fix, and once a second without fixes. A fix between two samples splits the interval at its time.
Post-processing feeds a recording in large blocks. `insnav.session.online` feeds samples as they arrive. The state then
lags by `MARGIN` samples and by `SEEN`.
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
MARGIN = LOOKAHEAD + strapdown.LOST_WINDOW + 2  # number of newest samples that wait for later neighbours
QUANTUM = 2.0**-40  # resolution of summed angles, far finer than gyros [rad]
COAST = 1.0  # longest time between filter epochs: the transition is of second order [s]
BROKEN = 3.0  # a longer time without a rejection ends a series of rejections, if fixes are more frequent [s]
NOISY, FAR_BEYOND = 3.0, 10.0  # multiples of RMS gyro noise below which a mean rate, or added vibration, may be noise
FEWEST_REJECTIONS = 5  # rejections needed for a reset, so that one or two of them do not suffice at low rates


class Navigator:
    """Loosely coupled INS/GPS filter over a stream of IMU samples.

    `ready`: the recording; `feed` takes its samples. `start`: state to continue from, by default the initial one; data
    before its time are skipped. `marks`: rows of fixes after which `kept` stores the complete state, from which another
    navigator can continue. `record`: collects the results, by default all of them.

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
        interval = output.interval
        self._grid = np.array([np.inf, interval if interval > 0.0 or not output.with_poses else -1.0, 0.0])
        self._begin_grid(start.time)
        none = np.empty((0, 3))
        self._sensed, self._motion = (none, none, none, none), np.zeros(25)  # inputs of `felt`
        noise = float(model.noise[:3].sum()) / nominal
        mean = 0.5 * nominal / SEEN  # ratio of the noise variance of a mean to one sample's
        self._motion[9:11] = mean * NOISY**2 * noise, FAR_BEYOND**2 * noise
        if len(lag.moments) > 1:  # averaged velocities: the response to fast turns is unknown, so the arm ignores them
            self._motion[10] = np.inf
        if not self._late.any():  # noise of the mean acceleration; other noise for lagging velocities
            self._motion[17] = NOISY**2 * float(model.noise[3:6].sum()) / (2.0 * SEEN)
        # The newest samples wait for later ones. Twice as many processed samples are kept, for means around fixes
        self._margin = MARGIN + int((SEEN + max(lag.moments) * abs(lag.value)) / nominal)
        self._last_good = start.time  # time of the last accepted position
        often = float(np.median(np.diff(ready.gps.time))) if ready.gps.time.shape[0] > 1 else 1.0
        self._broken = max(BROKEN, 2.5 * often)
        self._rejections: list[float] = []  # times of an uninterrupted series of rejected positions
        self._tail: ImuData | None = None
        self._parts = [part for part in ready.starts[1:] if part.initial.time > start.time]

    def take_fixes(self, gps: GpsData) -> None:
        """Replace all fixes. Fixes before the time of the state are not used again."""
        delay, lag = self._receiver.delay.value, self._receiver.lag.value
        later = gps.time - delay > self._first + strapdown.TIME_TOLERANCE
        self._gps, self._fix, self._fix_time = gps, np.flatnonzero(later), gps.time[later] - delay
        receiver_fix = np.full(gps.time.shape[0], True) if gps.fix is None else gps.fix != gate.OF_REFERENCE
        # age of the velocities [s]; a small lag is zero here, as linear states suffice for it
        self._late = receiver_fix[later] * (lag if abs(lag) > LAG_WORTH else 0.0)
        # index of the first fix that is not yet processed
        done = max(self._done, self._start) + strapdown.TIME_TOLERANCE
        self._next = int(np.searchsorted(self._fix_time, done, side="right"))

    def feed(self, imu: ImuData) -> None:
        """Process the next block of samples. The last ones wait for later neighbours in the next call."""
        while self._parts and imu.time[-1] > self._parts[0].after:
            before = int(np.searchsorted(imu.time, self._parts[0].after, side="right"))
            if before:
                self._advance(imu.rows(slice(0, before)), last=False)
            self._go_on(self._parts.pop(0))
            imu = imu.rows(slice(before, None))
        self._advance(imu, last=False)

    def _go_on(self, part: Part) -> None:
        """Finish a part of the record before a long gap, and start the next part."""
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
        """Return the times, in order, that split the samples from `begin` to `end` [s]: start, fixes, wanted poses.

        A pose of another point also has a split a tenth of a millisecond before: its velocity needs the rate there.
        """
        output, span = self._ready.output, [begin, end + strapdown.TIME_TOLERANCE]
        cuts = [some[slice(*some.searchsorted(span))] for some in (self._fix_time[self._next :], output.epochs)]
        if output.point_b is not None:
            interval, poses = self._grid[1], cuts[1]
            if interval > 0.0 and not output.epochs.size:
                poses = interval * np.arange(np.floor(begin / interval), np.ceil(end / interval) + 1.0)
            cuts += poses, poses - 100.0 * strapdown.TIME_TOLERANCE
        return np.sort(np.concatenate([*cuts, [self._start]]))

    def _begin_grid(self, time: float) -> None:
        """Set the next output times: whole multiples of the output interval, and the additional output times."""
        begin, interval = time - strapdown.TIME_TOLERANCE, self._grid[1]
        self._grid[0] = interval * np.ceil(begin / interval) if interval > 0.0 else np.inf
        self._grid[2] = np.searchsorted(self._ready.output.epochs, begin)

    def _close(self) -> None:
        """Add a final filter epoch, so that every row of the solution lies between two epochs."""
        if self._estimate.span[0] > 0.0:
            self._estimate.predict(self._done)
            self._record.epoch(self._done, self._estimate)

    @property
    def done(self) -> float:
        """Time of the state [s], before the newest samples, which wait for later ones."""
        return max(self._done, self._start)

    @property
    def estimate(self) -> Estimate:
        """State and covariance at the time `done`."""
        return self._estimate

    def saved(self) -> tuple[Any, ...]:
        """Copy all variables that processing changes, except aiding and results, for `go_back`."""
        plain = self._done, self._last_good, self._tail, tuple(self._rejections)
        return *plain, self._estimate.saved()

    def go_back(self, saved: tuple[Any, ...], gps: GpsData) -> None:
        """Go back to an earlier state from `saved`, with other fixes. Feed the samples since then again."""
        self._done, self._last_good, self._tail, rejections, estimate = saved
        self._rejections = list(rejections)
        self._estimate.go_back(estimate)
        self.take_fixes(gps)

    def restart_at(self, part: Part) -> None:
        """Register a new alignment, from which to continue after a gap in the samples to come."""
        self._parts.append(part)

    @property
    def delay(self) -> tuple[float, float]:
        """Current estimate of the delay of the fixes beyond the specified delay, and its sd [s]."""
        estimate = self._estimate
        index = max(estimate.at.delay, 0)
        return estimate.delay, float(np.sqrt(estimate.covariance[index, index])) if estimate.at.delay >= 0 else np.inf

    def levers(self) -> tuple[FloatArray, FloatArray]:
        """Return lever arm minus specified arm, vibration arm minus lever arm: (2, 3) [m], covariances (2, 3, 3)."""
        estimate, index = self._estimate, self._estimate.at
        mapping = np.zeros((2, 3, index.states))
        for row, first, sign in ((0, index.lever, 1.0), (1, index.shaken, 1.0), (1, index.lever, -1.0)):
            if first >= 0:
                mapping[row, :, first : first + 3] = sign * np.eye(3)
        arms = np.array([estimate.lever - self._receiver.lever_arm.value, estimate.shaken - estimate.lever])
        return arms, mapping @ estimate.covariance @ np.swapaxes(mapping, 1, 2)

    def finish(self) -> Run:
        """Process the waiting samples, run the smoother if wanted, and return the result."""
        if self._tail is not None:
            self._advance(None, last=True)
        estimate = self._estimate
        self._close()
        smoothed = estimate.history.smooth(estimate.least_delay_sd) if estimate.history is not None else None
        reported, alone = estimate.stated(), estimate.covariance  # the first with a lower limit of the delay sd
        return self._record.finish(self._ready, estimate.lever, estimate.delay, reported, alone, smoothed)

    def misfit(self) -> tuple[float, float]:
        """Return mean cost and mean normalised square of the innovations so far; see `Record.misfit`."""
        return self._record.misfit()

    def history(self) -> History:
        """Process the waiting samples and return the history of all epochs."""
        if self._tail is not None:
            self._advance(None, last=True)
        if self._estimate.history is None:
            raise ConfigError("filter.no_epochs", where="output.smooth")
        return self._estimate.history

    def _advance(self, imu: ImuData | None, *, last: bool) -> None:
        # process the waiting and the new samples, except the newest ones if more samples follow
        buffer = self._tail if imu is None else imu if self._tail is None else self._tail.joined(imu)
        assert buffer is not None
        n = buffer.time.shape[0]
        ready = n if last else n - self._margin
        if ready < 2:
            self._tail = buffer
            return
        parts = strapdown.intervals(buffer, self._nominal)
        # process intervals up to the last sample that has all its later neighbours, and gaps before it
        end_row = parts.end.shape[0] - (parts.gap[::-1] == 0.0).cumsum().searchsorted(n - ready, side="left") - 1
        end_row = parts.end.shape[0] if last else end_row
        first = int(parts.end.searchsorted(max(self._done, self._start + strapdown.TIME_TOLERANCE), side="right"))
        if end_row > first:
            cuts = self._cuts(parts.end[first] - parts.dt[first], parts.end[end_row - 1])
            pieces = strapdown.split(parts, cuts, first, end_row)
            inc = strapdown.increments(parts, pieces)
            last_fix = int(self._fix_time.searchsorted(parts.end[end_row - 1] + strapdown.TIME_TOLERANCE, side="right"))
            times = self._fix_time[self._next : last_fix]
            if times.size:
                self._sense(times, self._late[self._next : last_fix], parts)
            self._process(inc, parts.gap[pieces[0]])
            self._done = parts.end[end_row - 1]
        self._tail = buffer.rows(slice(max(0, ready - 2 * self._margin), None))

    def _sense(self, times: FloatArray, late: FloatArray, parts: strapdown.Intervals) -> None:
        """Compute mean rates and forces around the next fixes (k,) [s], for `felt`. `late` (k,): age of velocity."""
        half, n_samples = 0.5 * self._nominal, int(SEEN / self._nominal)
        angles, instants, reach = turned(parts), [times], SEEN  # a velocity is the mean of these instants
        swings = motion_since = self._sensed[3]
        if late.any():
            oldest, instants = np.abs(late).max(), [times - share * late for share in self._receiver.lag.moments]
            reach = SEEN if len(instants) == 1 else max(SEEN, oldest)
            swing_reach = max(half, oldest * (len(instants) - 1) / len(instants) ** 2)
            swings = np.mean([rates_at(instant - half, parts.end, angles, swing_reach) for instant in instants], axis=0)
            motion_since = np.mean([since(times, times - instant, parts) for instant in instants], axis=0)
        # average force like velocity: another average would bias the delay towards zero
        forces = [forces_about(instant, parts, max(1, n_samples)) for instant in instants]
        rates = [rates_at(instant, parts.end, angles, reach) for instant in instants]
        means = [each[0] if len(each) == 1 else np.mean(each, axis=0) for each in (rates, forces)]
        self._sensed = means[0], means[1], swings, motion_since

    def _process(self, inc: Increments, gap: FloatArray) -> None:
        # run the filter over increments that end at samples, fixes and wanted times
        k = int(inc.time.searchsorted(self._start + strapdown.TIME_TOLERANCE))
        # index of the sample interval, split at fixes, that ends at each fix
        fixes, before = self._fix_time[self._next :], self._next
        pieces_at_fix = inc.time.searchsorted(fixes - strapdown.TIME_TOLERANCE)
        pieces_at_fix = pieces_at_fix[pieces_at_fix < inc.time.shape[0]]
        rows = 3 + int((inc.time[-1] - inc.time[0]) / self._grid[1]) if self._grid[1] > 0.0 else inc.time.shape[0]
        wanted = self._ready.output.epochs
        rows += int(wanted.searchsorted(inc.time[-1] + 1.0)) - int(self._grid[2])
        out = self._record.reserve(rows, self._grid, wanted)
        samples = Samples(inc.time, inc.dt, inc.dtheta, inc.dvel, inc.coning, inc.sculling, gap)
        for i in pieces_at_fix:  # propagate to the fix, apply it, then apply aiding
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
        """Propagate over samples `first` to `last`. Add filter epochs in long spans, and with `close` at the end."""
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
        """Process the fix at `time` [s]. `number`: its row in the rates of `_sense`."""
        estimate = self._estimate
        estimate.predict(time)
        late, index = self._late[self._next], estimate.at
        still = stays(self._ready.alignment, time)  # then all measured rotation is noise
        felt(estimate.all, *self._sensed, number, late, index.has_arm, still, self._motion)
        row = self._fix[self._next]
        z, h, r = self._z, self._h, self._r
        nis_position, nis_velocity, distance, change = self._assess(row)
        nis = nis_position, nis_velocity
        use = [True, nis_velocity == nis_velocity]
        fix = int(self._gps.fix[row]) if self._gps.fix is not None else None
        quality = gate.quality(self._ready.gates, time, fix, self._gps.position_sd[row])
        if quality is not None and fix in (0, gate.OF_REFERENCE):  # invalid fix: do not use its velocity, either
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
                # add noise that reduces the NIS to its limit
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
        """Store the state after the measurements of an epoch in the solution, if the solution has rows at `time`."""
        self._record.epoch(time, self._estimate)
        row = int(out.used[0]) - 1
        while row >= 0 and out.time[row] >= time - strapdown.TIME_TOLERANCE:
            out.state[row] = self._estimate.x
            row -= 1

    def _assess(self, row: int) -> tuple[float, float, float, float]:
        """Compute the innovation of a fix and its covariance. Returns NIS (position, velocity) and lengths."""
        gps, receiver, estimate = self._gps, self._receiver, self._estimate
        results: tuple[float, float, float, float] = assess(
            *(estimate.all, estimate.covariance, self._motion),
            *(gps.lla, gps.v_n, gps.position_sd, gps.velocity_sd, row),
            *(gps.fix is None or gps.fix[row] != gate.OF_REFERENCE, self._late[self._next], receiver.jitter),
            *(receiver.correlated.share if receiver.correlated is not None else 0.0, estimate.places),
            *(self._z, self._h, self._r, self._s, self._sd),
        )
        return results

    def _gate(
        self, time: float, row: int, nis: tuple[float, float], distance: float, change: float, quality: Finding | None
    ) -> tuple[Finding | None, Finding | None]:
        """Return the finding that rejects or de-weights the position, or None; and the same for the velocity."""
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
        """Reset the filter to the fix if all positions were rejected for a long time, and record an event."""
        gates, gps = self._ready.gates, self._gps
        if self._rejections and time - self._rejections[-1] > self._broken:
            self._rejections.clear()
        self._rejections.append(time)
        if time - self._rejections[0] < gates.reset_after or len(self._rejections) < FEWEST_REJECTIONS:
            return
        self._assess(row)  # repeat: the velocity of this fix may have been used since
        z = self._z
        with_velocity = np.isfinite(z[3:]).all() and gate.physical_velocity(gates, time, gps.v_n[row]) is None
        self._estimate.restart(time, z, gps.position_sd[row], gps.velocity_sd[row] if with_velocity else None)
        distance = float(np.linalg.norm(z[:3]))
        self._record.event(Finding.of(Code.FILTER_RESET, time, distance_m=distance, limit_s=gates.reset_after))
        self._last_good = time
        self._rejections.clear()


def turned(parts: strapdown.Intervals) -> FloatArray:
    """Compute the cumulative angle about each axis at the end of each sample interval, (n, 3) [rad].

    Sums of multiples of `QUANTUM` are exact, so that differences do not depend on the first sample.
    """
    angles = parts.gyro * parts.dt[:, None] if parts.instant else parts.gyro
    return QUANTUM * np.cumsum(np.round(angles / QUANTUM), axis=0)


def rates_at(times: FloatArray, end: FloatArray, angles: FloatArray, reach: float = SEEN) -> FloatArray:
    """Compute the mean body rate within `reach` [s] of each time (k,) [s], without vibration: (k, 3) [rad/s].

    `end` (n,): ends of the sample intervals [s]. `angles` (n, 3): from `turned`.
    """
    window = np.minimum(np.maximum(times + np.array([[-reach], [reach]]), end[0]), end[-1])
    row = np.minimum(np.maximum(end.searchsorted(window), 1), end.size - 1)
    overhang = ((end[row] - window) / (end[row] - end[row - 1]))[..., None] * (angles[row] - angles[row - 1])
    turn = angles[row[1]] - angles[row[0]] - overhang[1] + overhang[0]
    return np.asarray(turn / np.maximum(window[1] - window[0], reach)[:, None])


def forces_about(times: FloatArray, parts: strapdown.Intervals, number: int) -> FloatArray:
    """Compute the mean specific force of `number` samples before and after each time (k,) [s]: (k, 3) [m/s^2]."""
    first = (parts.end - parts.dt).searchsorted(times - strapdown.TIME_TOLERANCE)
    rows = np.minimum(np.maximum(first[:, None] + np.arange(-number, number), 0), parts.end.size - 1)
    dt = parts.dt[rows]
    changes = parts.accel[rows] * dt[..., None] if parts.instant else parts.accel[rows]
    return np.asarray(changes.sum(axis=1) / dt.sum(axis=1)[:, None])


def since(times: FloatArray, late: FloatArray, parts: strapdown.Intervals) -> FloatArray:
    """Compute rotation [rad] and velocity change [m/s] over `late` (k,) [s] before each of `times` (k,): (k, 6).

    The velocity change is by specific force alone, in the body axes at `times`. Rotations are small. If `late` is
    negative, the span is after `times`.
    """
    begin, end = np.sort([times, times - late], axis=0)[..., None]
    first, last = np.searchsorted(parts.end, begin), np.searchsorted(parts.end, end)
    rows = first + np.arange(np.max(last - first) + 1)
    inside, rows = rows < parts.end.size, np.minimum(rows, parts.end.size - 1)
    until = parts.end[rows].clip(begin, end)
    signed_dt = np.sign(late)[:, None] * inside * (until - (parts.end - parts.dt)[rows].clip(begin, until))
    signed_dt = (signed_dt if parts.instant else signed_dt / parts.dt[rows])[..., None]
    turn, gain = signed_dt * parts.gyro[rows], signed_dt * parts.accel[rows]
    rotation, angle = turn.sum(axis=1), np.cumsum(turn, axis=1) - 0.5 * turn
    angle = np.where(signed_dt.sum(axis=1, keepdims=True) > 0.0, rotation[:, None] - angle, angle)  # angle to `times`
    first_order = np.cross(gain, angle)
    return np.hstack([rotation, (gain + first_order + 0.5 * np.cross(first_order, angle)).sum(axis=1)])


class AidingUpdates:
    """Aiding updates of one estimate from the time `start` [s] on, including headings measured with the fixes."""

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
        """Restart the mean of the body rate at `time` [s]."""
        self._turned[:] = 0.0
        self._last = time

    def turned(self, samples: Samples, first: int, last: int) -> None:
        """Add samples `first` to `last` to the mean of the body rate."""
        if self._every is not None:
            self._turned[:3] += samples.dtheta[first:last].sum(axis=0)
            self._turned[3] += samples.dt[first:last].sum()

    def at_fix(self, time: float) -> None:
        """Apply the measurements that come with a fix, such as its heading."""
        for measurement in self._with_fixes:
            self._use(measurement, self._view(time, time, np.zeros(3)))

    def at_epoch(self, time: float) -> None:
        """Apply all other aiding measurements, at most once per `INTERVAL`."""
        if self._every is None or time - self._last < 0.9 * INTERVAL:
            return
        view = self._view(self._last, time, self._turned[:3] / self._turned[3])
        self._turned[:] = 0.0
        self._last = time
        applied: set[str] = set()
        for measurement in self._every:
            if not measurement.excluded_by & applied and self._use(measurement, view):
                applied.add(measurement.name)

    def _view(self, begin: float, time: float, mean_gyro: FloatArray) -> FilterView:
        at = self._estimate
        return FilterView(begin, time, at.x, at.correction, at.motion[:3], mean_gyro, float(np.hypot(at.x[3], at.x[4])))

    def _use(self, measurement: Measurement, at: FilterView) -> bool:
        """Apply a measurement, unless its NIS exceeds the gate. Return whether it had data, also if rejected."""
        z, h, r, estimate = self._z, self._h, self._r, self._estimate
        rows = measurement.observe(at, z, h)
        size = rows.stop - rows.start
        if size == 0:
            return False
        variance = np.ones(6)
        variance[rows] = measurement.sd[:size] ** 2
        nis = innovation(estimate.covariance, z, h, variance, rows.start, rows.stop, np.empty((size, size)))
        limit = self._gates.limit(size)
        self._record.aiding(measurement, z[rows], nis, nis <= limit)
        if nis > limit:
            code, name = Code.GATE_AIDING, measurement.name
            self._record.event(Finding.of(code, at.time, subject=name, nis=nis, limit_nis=limit, dof=size))
            return True
        np.fill_diagonal(r, variance)
        estimate.epoch(at.time)
        if estimate.history is not None:
            estimate.history.aiding(rows, z, h, r)
        estimate.correct(at.time, z[rows], h[rows], r[rows, rows])
        return True
