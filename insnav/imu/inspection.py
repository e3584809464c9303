"""Sensor statistics from IMU samples: resolution, noise at rest and in motion, vibration, clock."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded on first use

from insnav.exceptions import InputError
from insnav.imu.model import per_sample
from insnav.imu.noise_density import resolution, white_noise
from insnav.tabular import runs_of
from insnav.types import BoolArray, FloatArray, ImuData

AXES = tuple(f"{sensor} {axis}" for sensor in ("gyro", "accel") for axis in "xyz")
SEGMENT = 4.0  # of the vibration spectrum [s]
LOWEST = 5.0  # below this, vehicle motion dominates [Hz]
PROMINENT = 20.0  # power of a line relative to its neighbourhood
NEIGHBOURS = 41  # frequencies in the neighbourhood
PEAKS = 3
JOLT = 5.0  # multiple of the usual change from second to second
JITTER_GAP = 1.5  # longer intervals, relative to the median, are missing samples


@dataclass(frozen=True, slots=True)
class AxisFigures:
    """Statistics of one sensor, SI."""

    name: str
    at_rest: float  # mean at rest [rad/s] or [m/s^2]; NaN without a rest
    noise: float  # white noise density at rest [rad/sqrt(s)] or [m/s/sqrt(s)]; NaN without a rest
    in_motion: float  # standard deviation of the change between samples, over sqrt(2), when not at rest
    largest: float  # largest magnitude
    resolution: float  # distance between neighbouring values of a coarse sensor; 0 for a fine sensor
    repeated: float  # share of samples equal to the previous one


@dataclass(frozen=True, slots=True)
class VibrationPeak:
    """Line in the spectrum of the specific force in motion."""

    axis: str
    frequency: float  # [Hz]
    rms: float  # [m/s^2]


@dataclass(frozen=True, slots=True)
class ImuFigures:
    """Statistics of IMU samples."""

    axes: tuple[AxisFigures, ...]
    peaks: tuple[VibrationPeak, ...]
    jitter: float  # standard deviation of the intervals, without missing samples [s]
    missing: int  # number of intervals with missing samples
    gravity_steps: tuple[float, float]  # largest step of the specific force between stops [m/s^2], and its time [s]
    jolt: tuple[float, float]  # largest step between seconds of the first stop, if significant


def inspect_samples(imu: ImuData, rest: tuple[float, float] | None, still: BoolArray | None = None) -> ImuFigures:
    """Compute sensor statistics of a record.

    `rest`: start and end of a stationary interval [s]. `still` (n,): samples of the stationary vehicle, in the whole
    record.
    """
    scale = per_sample(imu)
    values = np.hstack([imu.gyro / scale, imu.accel / scale])
    at_rest, noise, inside = np.full(6, np.nan), np.full(6, np.nan), np.zeros(len(values), dtype=np.bool_)
    moving = np.ones(len(values), dtype=np.bool_)
    if rest is not None:
        inside = (imu.time >= rest[0]) & (imu.time <= rest[1])
        moving = ~inside if still is None else ~still
        at_rest = values[inside].mean(axis=0) if inside.any() else at_rest
        with suppress(InputError):
            noise = np.concatenate(white_noise(imu, *rest))
    change = np.diff(values, axis=0)
    both = moving[1:] & moving[:-1]
    step = np.diff(imu.time)
    usual = float(np.median(step))
    raw, interval = np.hstack([imu.gyro, imu.accel]), usual if imu.sampling == "increment" else 1.0
    axes = tuple(
        AxisFigures(
            name,
            float(at_rest[i]),
            float(noise[i]),
            float(np.std(change[both, i]) / np.sqrt(2.0)) if both.any() else float("nan"),
            float(np.abs(values[:, i]).max()),
            resolution(raw[:, i]) / interval,
            float(np.mean(change[:, i] == 0.0)),
        )
        for i, name in enumerate(AXES)
    )
    whole = step < JITTER_GAP * usual
    return ImuFigures(
        axes,
        _peaks(values[moving, 3:], 1.0 / usual),
        float(np.std(step[whole])),
        int(np.count_nonzero(~whole)),
        (0.0, float("nan")) if still is None else _gravity_step(imu.time, values[:, 3:], still),
        (0.0, float("nan")) if rest is None else _jolt(imu.time[inside], values[inside, 3:], usual),
    )


def _peaks(force: FloatArray, rate: float) -> tuple[VibrationPeak, ...]:
    """Find the strongest spectral lines above their neighbourhood."""
    length = round(SEGMENT * rate)
    if len(force) < 4 * length or rate < 4.0 * LOWEST:
        return ()
    found = []
    frequency, power = scipy.signal.welch(force, rate, nperseg=length, axis=0)
    for i, axis in enumerate("xyz"):
        ratio = power[:, i] / np.maximum(scipy.ndimage.median_filter(power[:, i], NEIGHBOURS, mode="constant"), 1e-300)
        top = np.flatnonzero((ratio > PROMINENT) & (frequency > LOWEST))
        for row in top[np.argsort(power[top, i])[::-1]][:PEAKS]:
            near = slice(max(row - 2, 0), row + 3)
            if power[row, i] < power[near, i].max():
                continue
            rms = float(np.sqrt(np.sum(power[near, i]) * (frequency[1] - frequency[0])))
            found.append(VibrationPeak(axis, float(frequency[row]), rms))
    return tuple(sorted(found, key=lambda each: -each.rms)[:PEAKS])


def _jolt(time: FloatArray, force: FloatArray, interval: float) -> tuple[float, float]:
    """Find the largest change of specific force between seconds [m/s^2], and its time [s]; zero if usual."""
    n = max(1, round(1.0 / interval))
    seconds = force[: len(force) // n * n].reshape(-1, n, 3).mean(axis=1)
    change = np.linalg.norm(np.diff(seconds, axis=0), axis=1)
    if len(change) < 3 or not change.max() > JOLT * np.median(change):
        return 0.0, float("nan")
    row = int(np.argmax(change))
    return float(change[row]), float(time[(row + 1) * n])


def _gravity_step(time: FloatArray, force: FloatArray, still: BoolArray) -> tuple[float, float]:
    """Find the largest change of the specific force's magnitude between stops [m/s^2], and its time [s]."""
    rests = [(a, b) for a, b in runs_of(still) if time[b - 1] - time[a] > 2.0]
    sizes = np.array([float(np.linalg.norm(force[a:b].mean(axis=0))) for a, b in rests])
    if sizes.size < 2:
        return 0.0, float("nan")
    steps = np.diff(sizes)
    row = int(np.argmax(np.abs(steps)))
    return float(steps[row]), float(time[rests[row + 1][0]])
