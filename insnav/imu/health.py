"""Faulty samples: spikes, sensors at the end of their range, stuck sensors.

A spike is replaced. The true signal of a clipped or stuck sensor is unknown: such samples are removed. The resulting
data gap is bridged by the mechanization, with the filter's uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from insnav import spill
from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.imu.model import per_sample
from insnav.kernels.increments import glance
from insnav.tabular import runs_of
from insnav.types import BoolArray, FloatArray, ImuData, IntArray

SPIKE_GYRO, SPIKE_ACCEL = 1.5, 9.5  # a smaller jump is a spike only if all other axes are quiet [rad/s], [m/s^2]
SPIKE_FACTOR = 12.0  # least size of a spike, as a multiple of the median change between samples
# Spike: largest difference of jump and return, relative to the jump. Largest change of other axes, relative to the
# median change. Number of quiet samples on either side.
RETURN, QUIET, BESIDE = 0.25, 4.0, 4
CLIPPED = 3  # least number of successive samples at the largest value of a clipped sensor
STUCK = 20  # least number of successive equal samples of a stuck sensor ...
STUCK_TIME = 0.5  # ... and least duration [s]
BRIDGED = 1.0  # longer runs at a limit within the range are kept: a data gap costs more than their error [s]
UNLIKE = 0.9  # least share of distinct values around runs at a limit: else coarse steps or a dead band explain the runs
COMPARABLE = 2.0  # blocks are comparable if the activities of the other axes differ by at most this factor
ENOUGH = 10  # least number of comparable blocks for statistics
UNUSUAL = 0.01  # share of comparable blocks that may be as constant as a stuck sensor
STEPS = 4.0  # least usual range of values, in resolution steps: else resolution or a dead band explains repeats
IN_MOTION = 0.25  # other axes are in motion above this activity, relative to the median of the record
LONGEST = 3  # number of longest runs of repeats that may be faults ...
OFTEN, FAR_LONGER = 200, 4.0  # ... or up to this number, if all are longer than the next run by this factor
CONSTANT = 1e-9  # a smaller change, relative to the largest value, counts as zero
BY_CHANCE = 1e-6  # a run is a fault if the number of runs of its length expected by chance is smaller
_AXES = tuple(f"{sensor} {axis}" for sensor in ("gyro", "accelerometer") for axis in "xyz")


def inspect(imu: ImuData) -> tuple[ImuData, list[Finding]]:
    """Replace spikes and remove clipped and stuck samples.

    Returns imu: samples without faults, the same object if there is no fault; events: one finding per faulty interval.
    """
    if imu.time.shape[0] < 2 * STUCK:
        return imu, []
    scale = per_sample(imu)
    if _plain(imu, scale):
        return imu, []
    each = np.broadcast_to(scale, (imu.time.shape[0], 1))
    values = spill.by_blocks(lambda *some: np.hstack([some[0] / some[2], some[1] / some[2]]), imu.gyro, imu.accel, each)
    events: list[Finding] = []
    change = _changes(values)
    spikes = _spikes(values, change)
    if spikes[0].size:
        for row, axis, limit in zip(*spikes, strict=True):
            mean = 0.5 * (values[row - 1, axis] + values[row + 1, axis])
            events.append(_spike(float(imu.time[row]), axis, float(values[row, axis] - mean), float(limit)))
            values[row, axis] = mean
        change = _changes(values)
    # compare the original samples: after division by the intervals, equal increments would differ
    equal = spill.by_blocks(
        lambda *some: np.hstack([some[0] == some[1], some[2] == some[3]]),
        *(imu.gyro[1:], imu.gyro[:-1], imu.accel[1:], imu.accel[:-1]),
    )
    repeats, high = np.zeros(6, dtype=np.bool_), np.zeros(6)
    for block in spill.blocks(equal.shape[0], before=1):
        # most axes never have three equal samples in a row, and need no further test
        repeats |= (equal[block][1:] & equal[block][:-1]).any(axis=0)
    for block in spill.blocks(values.shape[0]):
        high = np.maximum(high, np.abs(values[block]).max(axis=0))
    quiet = spill.by_blocks(lambda some: some <= CONSTANT * high, change)
    _refuse_constant(values, quiet)
    activity = _Activity.of(change, max(STUCK, int(np.ceil(STUCK_TIME / np.median(np.diff(imu.time))))))
    removed = np.zeros(imu.time.shape[0], dtype=np.bool_)
    faults = []
    for axis in np.flatnonzero(repeats).tolist():
        column = spill.by_blocks(np.copy, values[:, axis])
        first, count = _runs(equal[:, axis])
        largest = float(np.abs(column).max())
        extreme = largest > 4.0 * float(np.abs(column - np.median(column)).mean()) > 0.0
        clipped = (np.abs(column[first]) >= largest * (1.0 - 1e-9)) & extreme
        # a short run at a limit within the range counts as clipped; a long one is only reported
        bounded = _bounded(column, first, count)
        long = bounded & ~clipped & (_length(imu.time, first, count) > BRIDGED)
        clipped |= bounded & ~long
        clipped &= _others_vary(quiet, axis, first, count)
        # some sample always has the largest value, and coarse steps may repeat it by chance
        clipped &= _chance(equal[:, axis], first, count, np.flatnonzero(clipped)) < BY_CHANCE
        stuck = ~clipped & ~long & (count >= STUCK) & (_length(imu.time, first, count) >= STUCK_TIME)
        suspects = _longest(count)
        chance = equal.shape[0] * _chance(equal[:, axis], first, count, suspects[count[suspects] >= STUCK])
        stuck &= _others_vary(quiet, axis, first, count) & (chance < BY_CHANCE)
        stuck[stuck] = activity.unusual(column, axis, first[stuck], count[stuck])
        faults += [
            (Code.IMU_SATURATED, _AXES[axis], first[clipped], count[clipped]),
            (Code.IMU_LIMITED, _AXES[axis], first[long], count[long]),
            (Code.IMU_STUCK, _AXES[axis], first[stuck], count[stuck]),
        ]
    if repeats.all():
        faults.append((Code.IMU_FROZEN, "imu", *_frozen(imu.time, equal, values, activity)))
    for code, subject, first, count in faults:
        for start, number in zip(first, count, strict=True):
            removed[start : start + number] |= code is not Code.IMU_LIMITED
            begin, end = float(imu.time[start]), float(imu.time[start + number - 1])
            events.append(Finding.of(code, begin, end, subject=subject, duration_s=end - begin))
    if not events:
        return imu, []
    events.sort(key=lambda event: event.begin)
    gyro, accel = (spill.by_blocks(np.multiply, half, each) for half in (values[:, :3], values[:, 3:]))
    return replace(imu, gyro=gyro, accel=accel).rows(~removed), events


def _spike(time: float, axis: int, size: float, limit: float) -> Finding:
    """Report a spike: one sample of an axis differs by `size` [rad/s], [m/s^2]."""
    if axis < 3:
        return Finding.of(Code.IMU_SPIKE, time, subject=_AXES[axis], rate_rad_s=size, limit_rad_s=limit)
    return Finding.of(Code.IMU_SPIKE, time, subject=_AXES[axis], acceleration_m_s2=size, limit_m_s2=limit)


def _plain(imu: ImuData, scale: FloatArray | float) -> bool:
    """Return whether the samples need no inspection: no spike, no value three times in a row, no constant axis."""
    head = slice(1 << 16)
    values_head = np.hstack([imu.gyro[head], imu.accel[head]]) / (scale if isinstance(scale, float) else scale[head])
    scales, limit = np.broadcast_to(scale, (imu.time.shape[0], 1)), SPIKE_FACTOR * _usual(_changes(values_head))
    largest = change = np.zeros(6)
    for block in spill.blocks(imu.time.shape[0], before=2):
        # `flatten` copies, because a read-only broadcast array would compile another kernel
        high, step, odd = glance(imu.gyro[block], imu.accel[block], scales[block].flatten(), limit, RETURN)
        if odd:
            return False
        largest, change = np.maximum(largest, high), np.maximum(change, step)
    return not (change <= CONSTANT * largest).any()


def _usual(change: FloatArray) -> FloatArray:
    """Compute the median change between samples of each axis, at least the smallest positive change, (6,)."""
    head = change[: (1 << 16) - 1]
    return np.asarray(np.maximum(np.median(head, axis=0), np.min(head, axis=0, where=head > 0.0, initial=SPIKE_ACCEL)))


def _changes(values: FloatArray) -> FloatArray:
    """Compute the absolute changes between samples, (n - 1, 6)."""
    return spill.by_blocks(lambda after, before: np.abs(after - before), values[1:], values[:-1])


def _spikes(values: FloatArray, change: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Find spikes: single samples far from both neighbours, which agree. Returns rows, axes and limits, (k,) each.

    A smaller jump counts only if its axis is quiet around the sample and the other axes are quiet at the sample.
    """
    usual = _usual(change)
    limit = SPIKE_FACTOR * usual
    row, axis = np.nonzero(
        spill.by_blocks(lambda one, next_one: (one > limit) & (next_one > limit), change[:-1], change[1:])
    )
    before, after = values[row + 1, axis] - values[row, axis], values[row + 2, axis] - values[row + 1, axis]
    # the jump to a spike and the return from it are of similar size
    height = np.minimum(np.abs(before), np.abs(after))
    spike = (before * after < 0.0) & (np.abs(before + after) < RETURN * height)
    row, axis, height = row[spike], axis[spike], height[spike]
    neighbours = row[:, None] + np.array([*range(-BESIDE, 0), *range(2, 2 + BESIDE)])
    calm = change[np.clip(neighbours, 0, len(change) - 1), axis[:, None]].max(axis=1, initial=0.0) < RETURN * height
    others = change[row[:, None] + np.arange(2)] < QUIET * usual
    others[np.arange(len(row)), :, axis] = True
    large = height > np.array([SPIKE_GYRO] * 3 + [SPIKE_ACCEL] * 3)[axis]
    spike = large | (calm & others.all(axis=(1, 2)))
    return row[spike] + 1, axis[spike], limit[axis[spike]]


@dataclass(frozen=True, slots=True)
class _Activity:
    """Activity of every axis in blocks of a record, to detect unusual repeats of values.

    Repeats are normal for a sensor with a dead band or coarse steps. They cluster: always at rest, seldom in
    motion. A run of them is therefore compared with blocks in which the *other* axes are equally active.
    """

    length: int  # number of samples per block
    square: FloatArray  # (blocks, 6) mean squared change between samples, relative to the mean of the record

    @classmethod
    def of(cls, change: FloatArray, length: int) -> _Activity:
        """Compute the activity from changes between samples."""
        blocks = change[: change.shape[0] // length * length].reshape(-1, length, 6)
        parts = spill.blocks(blocks.shape[0], size=-(-spill.ROWS // length))
        square = np.concatenate([np.empty((0, 6)), *(np.mean(blocks[part] ** 2, axis=1) for part in parts)])
        remainder = change[blocks.shape[0] * length :] ** 2
        mean = (length * square.sum(axis=0) + remainder.sum(axis=0)) / change.shape[0]
        return cls(length, square / np.maximum(mean, 1e-300))

    def unusual(self, column: FloatArray, axis: int, first: IntArray, count: IntArray) -> BoolArray:
        """Find runs of repeats that are unusual for the sensor during similar vehicle motion."""
        unusual = np.zeros(first.size, dtype=np.bool_)
        if not first.size or not self.square.shape[0]:
            return unusual
        others = np.delete(self.square, axis, axis=1).mean(axis=1)
        normal = np.ones(others.size, dtype=np.bool_)
        for row in _longest(count):  # possible faults are not normal
            normal[self._blocks(first[row], count[row])] = False
        spread, resolution = self._range(column), _resolution(column, column[first])
        moving = IN_MOTION * float(np.median(others))
        for row in range(first.size):
            activity = float(np.median(others[self._blocks(first[row], count[row])]))
            comparable = normal & (others <= COMPARABLE * activity) & (others >= activity / COMPARABLE)
            if comparable.sum() < ENOUGH:
                if activity <= moving or normal.sum() < ENOUGH:
                    continue
                comparable = normal  # in motion: all normal blocks
            unusual[row] = float(np.quantile(spread[comparable], UNUSUAL)) > STEPS * resolution[row]
        return unusual

    def _range(self, column: FloatArray) -> FloatArray:
        """Compute the range of values in each block."""
        blocks = column[: self.square.shape[0] * self.length].reshape(-1, self.length)
        return np.asarray(np.ptp(blocks, axis=1))

    def _blocks(self, first: int, count: int) -> slice:
        """Return the blocks that a run of samples fills, at least one."""
        start = min(-(-int(first) // self.length), self.square.shape[0] - 1)
        return slice(start, max((int(first) + int(count)) // self.length, start + 1))


def _bounded(column: FloatArray, first: IntArray, count: IntArray) -> BoolArray:
    """Find runs of repeats at a limit: samples between runs at the same value are all smaller, and hardly repeat."""
    bounded = np.zeros(first.size, dtype=np.bool_)
    for level in np.unique(column[first]):
        rows = np.flatnonzero(column[first] == level)
        samples = column[first[rows[0]] : first[rows[-1]] + count[rows[-1]]]
        others = samples[np.abs(samples) != np.abs(level)]
        if rows.size >= CLIPPED and others.size >= STUCK and np.unique(others).size > UNLIKE * others.size:
            bounded[rows] = (np.sign(level) * others < np.abs(level)).all()
    return bounded


def _resolution(column: FloatArray, held: FloatArray) -> FloatArray:
    """Compute the distance from each held value to the nearest other value: a step, or the edge of a dead band.

    The result is at least the smallest usual change, as a sensor that reports only larger changes may hold any value.
    """
    change = np.abs(np.diff(column[: 1 << 16]))
    smallest = float(np.quantile(change[change > 0.0], UNUSUAL)) if change.any() else 0.0
    levels = np.unique(column)
    index = np.searchsorted(levels, held)
    padded = np.concatenate([[-np.inf], levels, [np.inf]])
    return np.asarray(np.maximum(np.minimum(held - padded[index], padded[index + 2] - held), smallest))


def _longest(count: IntArray) -> IntArray:
    """Find runs that may be faults: the longest few, or all before a sharp drop in length; coarse steps cause many."""
    order = np.argsort(count)[::-1]
    lengths = np.append(count[order], CLIPPED - 1)[: OFTEN + 1]
    drops = np.flatnonzero(lengths[:-1] >= FAR_LONGER * lengths[1:])
    return order[: max(LONGEST, int(drops[0]) + 1 if drops.size else 0)]


def _chance(same: BoolArray, first: IntArray, count: IntArray, suspects: IntArray) -> FloatArray:
    """Compute the probability of each run by chance, from the share of repeats outside the runs `suspects`."""
    elsewhere = np.array(same)
    for row in suspects:
        elsewhere[first[row] : first[row] + count[row] - 1] = False
    repeat = float(elsewhere.mean())
    if elsewhere[:-1].any():  # repeats cluster: share of repeats after a repeat
        repeat = max(repeat, float(np.sum(elsewhere[1:] & elsewhere[:-1]) / np.sum(elsewhere[:-1])))
    return np.asarray(max(repeat, 1e-9) ** (count - 1.0))


def _frozen(time: FloatArray, same: BoolArray, values: FloatArray, activity: _Activity) -> tuple[IntArray, IntArray]:
    """Find runs in which all axes repeat values although most axes have noise: the logger stopped."""
    first, count = _runs(np.asarray(same.all(axis=1)))
    long = (count >= STUCK) & (_length(time, first, count) >= STUCK_TIME)
    first, count = first[long], count[long]
    if not first.size:
        return first, count
    normal = np.ones(activity.square.shape[0], dtype=np.bool_)
    for start, number in zip(first, count, strict=True):
        normal[activity._blocks(start, number)] = False
    if normal.sum() < ENOUGH:
        return first[:0], count[:0]
    spread = np.column_stack([activity._range(values[:, axis])[normal] for axis in range(6)])
    if int(np.sum(np.quantile(spread, UNUSUAL, axis=0) > 0.0)) < 4:  # all sensors without noise are constant at rest
        return first[:0], count[:0]
    return first, count


def _refuse_constant(values: FloatArray, quiet: BoolArray) -> None:
    """Refuse a record in which one axis is constant while other axes of the same sensor vary."""
    dead = np.asarray(quiet.all(axis=0))
    for axis in np.flatnonzero(dead):
        kind = values[:, :3] if axis < 3 else values[:, 3:]
        levels = [np.unique(column[: 1 << 16]).size for column in kind.T]
        if max(levels) > STEPS:
            value = float(values[0, axis])
            rate, force = (value, None) if axis < 3 else (None, value)
            raise InputError("imu.axis_constant", axis=_AXES[axis], rate_rad_s=rate, force_m_s2=force)


def _length(time: FloatArray, first: IntArray, count: IntArray) -> FloatArray:
    """Compute the duration of runs of samples [s]."""
    return np.asarray(time[np.minimum(first + count, time.shape[0]) - 1] - time[first])


def _others_vary(quiet: BoolArray, axis: int, first: IntArray, count: IntArray) -> BoolArray:
    """Return whether another axis varies in most of each run; if none does, noise-free sensors are at rest."""
    count_still = np.concatenate([[0], np.cumsum(quiet.sum(axis=1) - quiet[:, axis] == 5)])
    return np.asarray(count_still[first + count - 1] - count_still[first] < 0.5 * (count - 1))


def _runs(same: BoolArray) -> tuple[IntArray, IntArray]:
    """Find first sample and length of each run of equal samples, at least `CLIPPED`."""
    first, end = runs_of(same).T
    count = end - first + 1
    long = count >= CLIPPED
    return first[long], count[long]
