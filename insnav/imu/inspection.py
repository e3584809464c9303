"""What samples of an IMU show of their sensors: resolution, noise at rest and in motion, vibration, clock."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import scipy  # its parts load themselves when they are used

from insnav.exceptions import InputError
from insnav.imu.model import per_sample
from insnav.imu.noise_density import resolution, white_noise
from insnav.tabular import runs_of
from insnav.types import BoolArray, FloatArray, ImuData

AXES = tuple(f"{sensor} {axis}" for sensor in ("gyro", "accel") for axis in "xyz")
SEGMENT = 4.0  # of the vibration spectrum [s]
LOWEST = 5.0  # below are the vehicle's own motions [Hz]
PROMINENT = 20.0  # power of a line against its neighbourhood
NEIGHBOURS = 41  # frequencies that are its neighbourhood
PEAKS = 3
JOLT = 5.0  # times the usual change from second to second
JITTER_GAP = 1.5  # longer intervals, by the median, are missing samples


@dataclass(frozen=True, slots=True)
class AxisFigures:
    """One sensor, SI."""

    name: str
    at_rest: float  # mean at rest [rad/s] or [m/s^2]; NaN without a rest
    noise: float  # white noise density at rest [rad/sqrt(s)] or [m/s/sqrt(s)]; NaN without a rest
    in_motion: float  # standard deviation of the change between samples, over sqrt(2), when not at rest
    largest: float  # largest magnitude
    resolution: float  # distance between neighbouring values of a coarse sensor; 0 if it is fine
    repeated: float  # share of samples equal to the one before


@dataclass(frozen=True, slots=True)
class VibrationPeak:
    """A line in the spectrum of the specific force in motion."""

    axis: str
    frequency: float  # [Hz]
    rms: float  # [m/s^2]


@dataclass(frozen=True, slots=True)
class ImuFigures:
    """What the samples show."""

    axes: tuple[AxisFigures, ...]
    peaks: tuple[VibrationPeak, ...]
    jitter: float  # standard deviation of the intervals, missing samples apart [s]
    missing: int  # intervals with samples missing
    gravity_steps: tuple[float, float]  # largest step of the specific force between rests [m/s^2], and its time [s]
    jolt: tuple[float, float]  # the same from one second of the first rest to the next, if it stands out


def inspect_samples(imu: ImuData, rest: tuple[float, float] | None, still: BoolArray | None = None) -> ImuFigures:
    """Look at the sensors of a record.

    `rest`: start and end of a stationary part [s]. `still` (n,): samples at which the vehicle stands, all over.
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
    """Strongest lines of the spectrum that stand out of their neighbourhood."""
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
    """Largest change of the specific force from one second to the next [m/s^2], and when [s]; zero if it is usual."""
    n = max(1, round(1.0 / interval))
    seconds = force[: len(force) // n * n].reshape(-1, n, 3).mean(axis=1)
    change = np.linalg.norm(np.diff(seconds, axis=0), axis=1)
    if len(change) < 3 or not change.max() > JOLT * np.median(change):
        return 0.0, float("nan")
    row = int(np.argmax(change))
    return float(change[row]), float(time[(row + 1) * n])


def _gravity_step(time: FloatArray, force: FloatArray, still: BoolArray) -> tuple[float, float]:
    """Largest change of the size of the specific force from one rest to the next [m/s^2], and when [s]."""
    rests = [(a, b) for a, b in runs_of(still) if time[b - 1] - time[a] > 2.0]
    sizes = np.array([float(np.linalg.norm(force[a:b].mean(axis=0))) for a, b in rests])
    if sizes.size < 2:
        return 0.0, float("nan")
    steps = np.diff(sizes)
    row = int(np.argmax(np.abs(steps)))
    return float(steps[row]), float(time[rests[row + 1][0]])
