"""Samples that cannot be what the sensor felt: spikes, sensors at the end of their range, sensors that are stuck.

A spike is replaced. What a clipped or stuck sensor felt is not known at all: such samples are taken out, so that they
count as a hole, which the mechanization bridges and whose uncertainty the filter knows.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.imu.model import sample_intervals
from insnav.types import BoolArray, Event, EventKind, FloatArray, ImuData, IntArray

SPIKE_GYRO, SPIKE_ACCEL = 1.5, 9.5  # a smaller jump of one sample does no harm worth a search [rad/s], [m/s^2]
SPIKE_FACTOR = 12.0  # times the usual change from sample to sample
FINE = 0.01  # a sensor whose steps are larger, by its largest value, is coarse, not clipped
CLIPPED = 3  # samples in a row at the largest value of the record that are the end of a range
STUCK = 20  # samples in a row with the same value, at least, that are a stuck sensor ...
STUCK_TIME = 0.5  # and at least so long [s]
FEW = 3
BY_CHANCE = 1e-6  # ... if so long a row is expected less often than this in the record, as coarse its steps may be
_AXES = tuple(f"{sensor} {axis}" for sensor in ("gyro", "accelerometer") for axis in "xyz")


def inspect(imu: ImuData) -> tuple[ImuData, list[Event]]:
    """Replace spikes and take out clipped and stuck samples.

    Parameters
    ----------
    imu : ImuData
        Samples.

    Returns
    -------
    imu : ImuData
        The same object if there is nothing to object to.
    events : list of Event
        One for each stretch, with what was done.
    """
    if imu.time.shape[0] < 2 * STUCK:
        return imu, []
    scale = sample_intervals(imu)[:, None] if imu.sampling == "increment" else 1.0
    values = np.hstack([imu.gyro / scale, imu.accel / scale])
    events: list[Event] = []
    spikes = _spikes(values)
    if spikes.any():
        values = values.copy()
        for row, axis in zip(*np.nonzero(spikes), strict=True):
            mean = 0.5 * (values[row - 1, axis] + values[row + 1, axis])
            unit, limit = ("rad/s", SPIKE_GYRO) if axis < 3 else ("m/s^2", SPIKE_ACCEL)
            events.append(
                Event(
                    float(imu.time[row]),
                    EventKind.IMU_SPIKE,
                    float(values[row, axis] - mean),
                    limit,
                    unit,
                    f"{_AXES[axis]}: replaced by the mean of its neighbours",
                )
            )
            values[row, axis] = mean
    change = np.abs(np.diff(values, axis=0))
    # of the samples as they are: divided by intervals, equal increments would differ in their last digits
    same = np.hstack([np.diff(imu.gyro, axis=0), np.diff(imu.accel, axis=0)]) == 0.0
    quiet = change <= 1e-9 * np.abs(values).max(axis=0)
    lost = np.zeros(imu.time.shape[0], dtype=np.bool_)
    for axis in range(6):
        column = values[:, axis]
        first, count = _runs(same[:, axis])
        if not first.size:
            continue
        largest = float(np.abs(column).max())
        step = np.abs(np.diff(column[: 1 << 16]))
        fine = float(np.min(step[step > 0.0], initial=np.inf)) < FINE * largest
        far = largest > 4.0 * float(np.abs(column - np.median(column)).mean())
        clipped = (np.abs(column[first]) >= largest * (1.0 - 1e-9)) & (count >= CLIPPED) & fine & far
        clipped &= _others_vary(quiet, axis, first, count)
        lasts = imu.time[np.minimum(first + count, imu.time.shape[0]) - 1] - imu.time[first] >= STUCK_TIME
        stuck = ~clipped & lasts & _no_chance(same[:, axis], first, count)
        stuck &= _others_vary(quiet, axis, first, count)
        for kind, chosen, what in (
            (EventKind.IMU_SATURATED, clipped, "at the end of its range"),
            (EventKind.IMU_STUCK, stuck, "does not change"),
        ):
            for start, number in zip(first[chosen], count[chosen], strict=True):
                lost[start : start + number] = True
                events.append(
                    Event(
                        float(imu.time[start]),
                        kind,
                        float(imu.time[start + number - 1] - imu.time[start]),
                        float("nan"),
                        "s",
                        f"{_AXES[axis]} {what}: taken out, bridged like a gap",
                    )
                )
    if not events:
        return imu, []
    events.sort(key=lambda event: event.time)
    gyro, accel = values[:, :3] * scale, values[:, 3:] * scale
    return replace(imu, gyro=gyro, accel=accel).rows(~lost), events


def _spikes(values: FloatArray) -> BoolArray:
    """Single samples far from both neighbours, which agree with each other."""
    found = np.zeros(values.shape, dtype=np.bool_)
    before, after = np.diff(values[:-1], axis=0), np.diff(values[1:], axis=0)
    # out by about as much as back
    out = np.minimum(np.abs(before), np.abs(after))
    back = np.abs(before + after) < 0.25 * out
    usual = np.median(np.abs(np.diff(values[: 1 << 16], axis=0)), axis=0)
    limit = np.maximum(np.array([SPIKE_GYRO] * 3 + [SPIKE_ACCEL] * 3), SPIKE_FACTOR * usual)
    found[1:-1] = (before * after < 0.0) & back & (out > limit)
    return found


def _no_chance(same: BoolArray, first: IntArray, count: IntArray) -> BoolArray:
    """Rows of equal samples longer than the steps of the sensor explain, by how often a row goes on elsewhere."""
    rest = np.array(same)
    for row in np.argsort(count)[-FEW:]:  # a fault is a few long rows; coarse steps make many
        if count[row] >= STUCK:
            rest[first[row] : first[row] + count[row] - 1] = False
    alike = float(rest.mean())
    if rest[:-1].any():
        alike = max(alike, float(np.sum(rest[1:] & rest[:-1]) / np.sum(rest[:-1])))
    expected = same.shape[0] * max(alike, 1e-9) ** (count - 1.0)
    return np.asarray((count >= STUCK) & (expected < BY_CHANCE))


def _others_vary(quiet: BoolArray, axis: int, first: IntArray, count: IntArray) -> BoolArray:
    """Whether some other axis changes in most of each row: else it is a rest of sensors without noise, not a fault."""
    others = np.asarray(np.delete(quiet, axis, axis=1).sum(axis=1) == 5)
    return np.array([others[a : a + n - 1].mean() < 0.5 for a, n in zip(first, count, strict=True)], dtype=np.bool_)


def _runs(same: BoolArray) -> tuple[IntArray, IntArray]:
    """First sample and number of samples of each row of equal ones, at least `CLIPPED`."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]])))
    first, count = edges[::2], edges[1::2] - edges[::2] + 1
    long = count >= CLIPPED
    return first[long], count[long]
