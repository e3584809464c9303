"""Collection of outputs, innovations and events during a run, and their conversion to the result at its end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from insnav import spill
from insnav.attitude import dcm_from_rph, skew
from insnav.earth import earth_rate_n, lla_offset
from insnav.exceptions import InputError
from insnav.filter.error_model import Layout, layout
from insnav.filter.estimate import Estimate
from insnav.filter.filter_input import FilterInput, Output
from insnav.filter.measurements.measurement import Measurement
from insnav.filter.smoother import SmoothedErrors
from insnav.findings import Code, Finding, by_time
from insnav.kernels import epoch
from insnav.kernels.dynamics import NAV
from insnav.kernels.errorstate import SENSOR, STATES, Outputs, feed_back, move_along, move_by_motion
from insnav.kernels.output import add_moved, deviations, moved, sides
from insnav.kernels.smoother import correct
from insnav.strapdown import TIME_TOLERANCE, between
from insnav.types import (
    AidingUse,
    BoolArray,
    Epochs,
    FloatArray,
    Innovations,
    IntArray,
    Run,
    SensorErrors,
    Smoothed,
    Trajectory,
)

CONSISTENCY_WINDOW = 60.0  # NIS is averaged over this time, to average out time-correlated errors of fixes [s]
# Mean NIS per degree of freedom beyond which the filter has diverged. A mean far below one is normal at rest. It
# is also normal for receivers that report large standard deviations (30 minutes of a good recorded drive).
TOO_LARGE = 5.0
FALSE_FROM = 30.0  # NIS of a position beyond which its cost is limited, chi-square with three degrees of freedom [-]
ROOM = 1 << 12  # least number of outputs allocated at a time
ROWS = 1 << 13  # number of outputs converted at a time: they fit in the processor's cache


class Record:
    """Growing record of outputs, epochs, fixes and events."""

    def __init__(self, fixes: int, rate_sd: FloatArray | None = None) -> None:
        self._rate_sd = rate_sd  # (3,) sd of gyro rates, if poses are wanted [rad/s]
        self._rooms: list[Outputs] = []  # allocated tables of outputs
        self._epochs, self._epoch = np.empty((fixes + 2, 26)), 0  # time, variances before and after updates, delay
        self._events: list[Finding] = []
        self._aiding: dict[tuple[str, str], list[tuple[float, float, float]]] = {}
        self._count = 0
        self._fixes = spill.empty((fixes, epoch.FIX_WIDTH))

    def reserve(self, rows: int, grid: FloatArray, wanted: FloatArray) -> Outputs:
        """Provide space for `rows` more outputs, at the times of a `grid` and at `wanted` times; see `Outputs`."""
        if not self._rooms or self._rooms[-1].time.shape[0] < self._rooms[-1].used[0] + rows:
            size = max(ROOM, rows)
            time, aim, state, motion = np.split(spill.empty((18 * size,)), [size, 2 * size, 12 * size])
            used, known = np.zeros(2, np.int64), np.empty(size, np.int64)
            table = time, aim, state.reshape(size, 10), known, motion.reshape(size, 6)
            self._rooms.append(Outputs(grid, wanted, used, *table))
        return self._rooms[-1]

    def epoch(self, time: float, estimate: Estimate) -> None:
        """Store the variances before and after the measurements of a filter epoch at `time` [s]."""
        if self._epoch == len(self._epochs):
            self._epochs = np.concatenate([self._epochs, np.empty_like(self._epochs)])
        row = self._epochs[self._epoch]
        epoch.note_epoch(row, time, estimate.before, estimate.all, estimate.doubt, estimate.covariance)
        self._epoch += 1

    def event(self, event: Finding) -> None:
        """Store an event."""
        self._events.append(event)

    def aiding(self, measurement: Measurement, innovation: FloatArray, nis: float, used: bool) -> None:
        """Store the innovation of an aiding measurement. Only its first three numbers share a unit."""
        rows = self._aiding.setdefault((measurement.name, measurement.unit.split(",")[0]), [])
        first = innovation[:3]
        rows.append((nis / innovation.shape[0], float(first @ first) / first.size, float(used)))

    def fix(
        self,
        time: float,
        predicted: FloatArray,
        sd: FloatArray,
        nis: tuple[float, float],
        use: list[bool],
        estimate: Estimate,
    ) -> None:
        """Store the innovation of a fix, as predicted minus measured, and the state after it."""
        row, state = self._fixes[self._count], estimate
        epoch.note_fix(row, time, predicted, sd, *nis, *use, state.all, state.doubt, state.covariance)
        self._count += 1

    def misfit(self) -> tuple[float, float]:
        """Compute mean cost (twice the negative log-likelihood) and mean normalised square of the fixes' innovations.

        The cost of a false fix is limited, see `FALSE_FROM`.
        """
        rows = self._fixes[: self._count]
        nis, sd = rows[:, epoch.FIX_NIS], rows[:, epoch.FIX_SD].reshape(-1, 2, 3)
        square = np.minimum(nis, FALSE_FROM)
        total = np.nansum(square + 2.0 * np.log(sd).sum(axis=2)) / max(self._count, 1)
        return float(total), float(np.nansum(square) / max(3 * np.isfinite(nis).sum(), 1))

    def _trajectory(
        self,
        epochs: FloatArray,
        variance: tuple[FloatArray, FloatArray],
        change: Callable[[FloatArray, FloatArray], None],
        common: tuple[float, float, FloatArray],
        last: bool,
    ) -> tuple[Trajectory, FloatArray]:
        """Convert the outputs to a trajectory with roll, pitch, heading and standard deviations, and rates (n, 3).

        `epochs` (m,) [s]. `variance`: variances before and after the measurements of each epoch, see `variances`.
        `change`: function that corrects states (n, 10) at times (n,) in place. `common`: clock shift of the times and
        its sd [s], and attitude sds by misalignment (3,) [rad]. Misalignment is the same in all rows: the filter treats
        it as noise, but it does not average out. `last`: the outputs are not needed again.

        A row wanted at a fixed time is moved to it, after the clock shift, at constant rate and acceleration.
        """
        clock, delay_sd, axes_sd = common
        (rows, known_count), begin, first = np.sum([room.used for room in self._rooms], axis=0).tolist(), 0, 0
        time, known_index = spill.empty((rows,)), spill.empty((known_count,), np.int64)
        lla, v_n, rph = (spill.empty((rows, 3)) for _ in range(3))
        rates = spill.empty((0 if self._rate_sd is None else rows, 3))
        sd, variances = spill.empty((rows, NAV)), spill.empty((known_count, NAV + 3))
        opposite, adjacent = np.empty((2, ROWS, 3))
        for number in range(len(self._rooms)):  # correct states, move them to output times, interpolate variances
            room = self._rooms.pop(0) if last else self._rooms[number]
            for block in spill.blocks(int(room.used[0]), size=ROWS):
                now, state, count = room.time[block], room.state[block].copy(), block.stop - block.start
                change(now, state)
                known_rows = slice(*np.searchsorted(room.known[: room.used[1]], [block.start, block.stop]))
                moved_rows = room.known[known_rows] - block.start
                to = np.where(np.isnan(room.aim[block]), now + clock, room.aim[block])
                move_by_motion(state, moved_rows, room.motion[known_rows], (to - now - clock)[moved_rows])
                part, begin = slice(begin, begin + count), begin + count
                sides(state, opposite, adjacent)
                np.arctan2(opposite[:count], adjacent[:count], out=rph[part])
                time[part], lla[part], v_n[part] = to, state[:, :3], state[:, 3:6]
                if rates.size:
                    rates[part][moved_rows] = room.motion[known_rows, :3]
                between = _between(now[moved_rows], epochs, *variance)
                add_moved(state, moved_rows, room.motion[known_rows], delay_sd, between)
                part, first = slice(first, first + len(moved_rows)), first + len(moved_rows)
                known_index[part], variances[part] = moved_rows + begin - count, between
        for block in spill.blocks(known_count, size=max(ROWS * known_count // max(rows, 1), 1)):
            # interpolation needs the known rows on both sides
            before = slice(max(block.start - 1, 0), block.stop)
            first = int(known_index[before.start]) if before.start else 0
            part = slice(first, int(known_index[block.stop - 1]) + 1 if block.stop < known_count else None)
            deviations(time[part], known_index[before] - first, variances[before], axes_sd, rph[part], sd[part])
        return Trajectory(time, lla, v_n, rph, sd), rates

    def finish(
        self,
        ready: FilterInput,
        lever_b: FloatArray,
        delay: float,
        covariance: FloatArray,
        alone: FloatArray,
        found: SmoothedErrors | None,
    ) -> Run:
        """Convert the record to a `Run`. `covariance`: as reported. `alone`: of the filter."""
        index, output, fixes = layout(ready.receiver), ready.output, self._fixes[: self._count]
        time, state = fixes[:, epoch.FIX_TIME].copy(), fixes[:, epoch.FIX_STATE].copy()
        fix_covariance = fixes[:, epoch.FIX_COVARIANCE].reshape(-1, NAV, NAV)
        if np.ptp(self._epochs[: self._epoch, 0]) == 0.0:
            raise InputError("align.no_sample_after_start")
        innovations = Innovations(
            *(time, -fixes[:, epoch.FIX_INNOVATION], fixes[:, epoch.FIX_SD].copy()),
            *(*fixes[:, epoch.FIX_NIS].T.copy(), *fixes[:, epoch.FIX_USE].T.astype(bool)),
        )
        self._events += _divergence(innovations, ready.gates.nis_limit)
        # an estimated delay shifts the samples: GPS time is more accurate
        clock = delay if ready.receiver.delay.sd > 0 else 0.0
        delay_sd = float(np.sqrt(covariance[STATES, STATES])) if index.delay >= 0 else 0.0
        if clock != 0.0:  # at each fix, the state was shifted by the delay estimated at that time
            move_along(state, clock - fixes[:, epoch.FIX_DELAY])
        epochs, self._epochs = np.asfortranarray(self._epochs[: self._epoch]), self._epochs[:0]
        filtered, rates = self._trajectory(
            epochs[:, 0],
            (epochs[:, 1:13], epochs[:, 13:25]),
            lambda time, state: move_along(state, clock - epochs[_before(time, epochs[:, 0]), 25]),
            (clock, delay_sd, ready.model.axes_sd),
            found is None,
        )
        for block in spill.blocks(self._count):
            fix_covariance[block] += _squared(_moved(state[block], delay_sd))
        smoothed = None
        if found is not None:
            rows = np.searchsorted(time, found.time[found.used] - 1e-6)
            moved = _moved(state[rows], delay_sd)
            covariances = np.ascontiguousarray(found.covariance[:, [*range(NAV), 6, 6, 7], [*range(NAV), 7, 8, 8]])
            track, rates = self._trajectory(
                found.time,
                (covariances, covariances),
                lambda time, state: correct(time, state, found.time, found.after, found.before),
                (clock, delay_sd, ready.model.axes_sd),
                True,
            )
            smoothed = _smoothed(track, found, clock, moved)
        sensor, variance = fixes[:, epoch.FIX_SENSOR], fixes[:, epoch.FIX_VARIANCE]
        spill.release()
        states = Epochs(time + clock, state[:, :3], state[:, 3:6], state[:, 6:10], fix_covariance)
        poses = None
        if self._rate_sd is not None:
            best, known = (filtered, states) if smoothed is None else (smoothed.solution, smoothed.epochs)
            poses = poses_of(best, rates, known, output, self._rate_sd)
            grid = on_grid(filtered.time, output.interval)
            filtered = filtered.rows(grid)
            smoothed = smoothed and replace(smoothed, solution=smoothed.solution.rows(grid))
        return Run(
            solution=filtered,
            poses=poses,
            innovations=innovations,
            sensor_errors=SensorErrors(time + clock, sensor.copy(), np.sqrt(variance)),
            events=by_time(self._events),
            alignment=ready.alignment,
            epochs=states,
            gps_delay=ready.receiver.delay.value + delay,
            gps_delay_sd=delay_sd,
            smoothed=smoothed,
            lever_b=lever_b.copy(),
            lever_sd=_of_lever(index, covariance),
            lever_sd_alone=_of_lever(index, alone),
            aiding=tuple(_aiding_use(*what, np.array(rows)) for what, rows in sorted(self._aiding.items())),
        )


def _of_lever(at: Layout, covariance: FloatArray) -> FloatArray:
    return np.sqrt(covariance.diagonal()[at.lever : at.lever + 3]) if at.lever >= 0 else np.zeros(3)


def _aiding_use(name: str, unit: str, rows: FloatArray) -> AidingUse:
    used = rows[:, 2] > 0.0
    nis, square = (float(np.mean(rows[used, i])) if used.any() else 0.0 for i in (0, 1))
    return AidingUse(name, rows.shape[0], int((~used).sum()), float(np.sqrt(square)), nis, unit)


def _moved(state: FloatArray, delay_sd: float) -> FloatArray:
    """Compute the effect of a clock error `delay_sd` [s] on states (n, 16), (n, 9); see `moved`."""
    out = np.empty((state.shape[0], NAV))
    for row, effect in zip(state, out, strict=True):
        moved(row[:10], row[10:], delay_sd, effect)
    return out


def _squared(error: FloatArray) -> FloatArray:
    return error[:, :, None] * error[:, None]


def _before(time: FloatArray, epochs: FloatArray) -> IntArray:
    """Find the last epoch not after each of the times, which are in ascending order."""
    begun = np.bincount(np.searchsorted(time + TIME_TOLERANCE, epochs), minlength=time.size + 1)
    return np.asarray(np.maximum(begun[: time.size].cumsum() - 1, 0))


def _between(time: FloatArray, epochs: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
    """Interpolate values at times (n,), between the value after an epoch and the value before the next epoch."""
    epoch_before = _before(time, epochs)
    following = np.minimum(epoch_before + 1, epochs.shape[0] - 1)
    span = epochs[following] - epochs[epoch_before]
    share = np.clip((time - epochs[epoch_before]) / np.where(span > 0.0, span, 1.0), 0.0, 1.0)[:, None]
    share[time - epochs[epoch_before] <= TIME_TOLERANCE] = 0.0
    return np.asarray((1.0 - share) * after[epoch_before] + share * before[following])


def _smoothed(track: Trajectory, found: SmoothedErrors, clock: float, moved: FloatArray) -> Smoothed:
    """Build the smoothed solution, and its states and sensor errors at the epochs with an accepted fix.

    `moved` (m, 9): effect of a clock error at these epochs, see `_moved`.
    """
    used = np.flatnonzero(found.used)
    time, state, error = found.time[used] + clock, found.state[used], found.after[used]
    for row, state_error in zip(state, error, strict=True):
        feed_back(row, np.zeros(SENSOR), state_error)
    covariance = spill.by_blocks(lambda row, some: found.covariance[row] + _squared(some), used, moved)
    states = Epochs(time, state[:, :3], state[:, 3:6], state[:, 6:], covariance)
    sd = np.sqrt(np.maximum(found.variance[used], 0.0))
    return Smoothed(track, states, SensorErrors(time, found.correction[used] - error[:, NAV:], sd))


def _divergence(innovations: Innovations, limit: float) -> list[Finding]:
    """Report minutes in which accepted measurements are, on average, too far from their predictions.

    `limit`: upper limit of the NIS of one fix, so that only many large innovations in a minute count as divergence.
    """
    findings: list[Finding] = []
    if innovations.time.size == 0:
        return findings
    window = np.floor((innovations.time - innovations.time[0]) / CONSISTENCY_WINDOW).astype(int)
    for name, nis, used in (
        ("position", innovations.nis_position, innovations.used_position),
        ("velocity", innovations.nis_velocity, innovations.used_velocity),
    ):
        count = np.bincount(window, weights=used)
        mean = np.bincount(window, weights=np.where(used, np.minimum(nis, limit), 0.0)) / np.maximum(count, 1)
        for w in np.flatnonzero((count >= 20) & (mean / 3.0 > TOO_LARGE)):
            begin, size = float(innovations.time[0] + w * CONSISTENCY_WINDOW), float(mean[w] / 3.0)
            end = begin + CONSISTENCY_WINDOW
            findings.append(Finding.of(Code.FILTER_DIVERGED, begin, end, subject=name, nis=size, limit_nis=TOO_LARGE))
    return findings


def on_grid(time: FloatArray, every: float) -> BoolArray:
    """Find the rows whose times (n,) [s] are whole multiples of `every` [s], or all rows if `every` is zero."""
    if every <= 0.0:
        return np.ones(time.shape, dtype=np.bool_)
    return np.asarray(np.abs(time - np.round(time / every) * every) < TIME_TOLERANCE)


def rows_of(time: FloatArray, epochs: FloatArray) -> IntArray:
    """Return the rows of `time` (n,) [s] that equal `epochs` (m,) [s]. Epochs without a row are left out."""
    row = np.searchsorted(time, epochs - 2.0 * TIME_TOLERANCE)
    row = row[row < time.size]
    return np.asarray(row[np.abs(time[row] - epochs[: row.size]) < 4.0 * TIME_TOLERANCE], dtype=np.int64)


def covariance_at(time: FloatArray, epochs: Epochs) -> FloatArray:
    """Interpolate the covariance of position, velocity, attitude linearly in time, (n, 9, 9). Zero without epochs."""
    covariance = epochs.covariance if epochs.time.size else np.zeros((1, 9, 9))
    if len(covariance) == 1:
        return np.repeat(covariance, time.size, axis=0)
    return between(epochs.time, covariance.reshape(-1, 81), time)[1].reshape(-1, 9, 9)


def move_to_point(
    track: Trajectory, w_eb_b: FloatArray, point_b: FloatArray, covariance: FloatArray, rate_sd: FloatArray
) -> Trajectory:
    """Move a trajectory to another point of the rigid vehicle, with its standard deviations.

    Parameters
    ----------
    track : Trajectory
        At the IMU, ``(n,)`` rows.
    w_eb_b : (n, 3) array
        Angular rate relative to the Earth [rad/s].
    point_b : (3,) array
        The point seen from the IMU, body axes [m].
    covariance : (n, 9, 9) array
        Of position [m], velocity [m/s], attitude [rad]: only correlations and attitude are used. `track` provides the
        standard deviations of position and velocity, and lower limits of roll, pitch and heading.
    rate_sd : (3,) array
        Standard deviation of the rates [rad/s].

    Notes
    -----
    Groves (2013), section 14.3.1: position ``p + C r``, velocity ``v + C (w_eb x r)``. With ``C_hat = (I - [phi x]) C``
    the error of ``C r`` is ``(C r) x phi``.
    """
    c = dcm_from_rph(track.rph)
    lever_n, slip_n = c @ point_b, np.einsum("nij,nj->ni", c, np.cross(w_eb_b, point_b))
    sd = track.sd
    if sd is not None:
        sd = sd.copy()
        # attitude variance of `track` beyond the covariance: misalignment of the sensors, and widening by ambiguities
        heading, level = track.rph[:, 2], np.zeros(len(track.time))
        pitch_axis = np.column_stack([-np.sin(heading), np.cos(heading), level])
        axes = np.stack([c[:, :, 0], pitch_axis, np.tile([0.0, 0.0, 1.0], (len(level), 1))], axis=2)
        to_rph = np.linalg.pinv(axes)
        attitude = covariance[:, 6:, 6:]
        excess = np.maximum(sd[:, 6:] ** 2 - np.einsum("nij,njk,nik->ni", to_rph, attitude, to_rph), 0.0)
        attitude = attitude + np.einsum("nij,nj,nkj->nik", axes, excess, axes)
        by_rate = c @ skew(point_b)
        noise = [0.0, np.einsum("nij,j->ni", by_rate**2, rate_sd**2)]
        for vector, rows, noise_variance in zip((lever_n, slip_n), (slice(0, 3), slice(3, 6)), noise, strict=True):
            s, size = skew(vector), np.sqrt(np.maximum(np.einsum("nii->ni", covariance[:, rows, rows]), 1e-30))
            cross = covariance[:, rows, 6:] * (np.minimum(sd[:, rows] / size, 1e6) * (size > 1e-12))[:, :, None]
            variance = sd[:, rows] ** 2 + np.einsum("nij,njk,nik->ni", s, attitude, s) + noise_variance
            sd[:, rows] = np.sqrt(np.maximum(variance + 2.0 * np.einsum("nij,nij->ni", cross, s), 0.0))
    return replace(track, lla=lla_offset(track.lla, lever_n), v_n=track.v_n + slip_n, sd=sd)


def poses_of(track: Trajectory, w_ib_b: FloatArray, known: Epochs, wanted: Output, rate_sd: FloatArray) -> Trajectory:
    """Select the rows of a solution at the wanted times, by default all, and move them; see `move_to_point`."""
    rows: IntArray | slice = rows_of(track.time, wanted.epochs) if wanted.epochs.size else slice(None)
    poses = track.rows(rows)
    if wanted.point_b is None:
        return poses
    earth = np.einsum("nij,ni->nj", dcm_from_rph(poses.rph), earth_rate_n(poses.lla[:, 0]))
    return move_to_point(poses, w_ib_b[rows] - earth, wanted.point_b, covariance_at(poses.time, known), rate_sd)
