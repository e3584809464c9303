"""Sensor statistics from IMU samples: resolution, noise at rest and in motion, vibration, clock."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import scipy  # loads its submodules on first use

from insnav.exceptions import InputError
from insnav.imu.model import per_sample
from insnav.imu.noise_density import resolution, white_noise
from insnav.tabular import runs_of
from insnav.types import BoolArray, FloatArray, ImuData

AXES = tuple(f"{sensor} {axis}" for sensor in ("gyro", "accel") for axis in "xyz")
SEGMENT = 4.0  # length of the averaged segments of the vibration spectrum [s]
LOWEST = 5.0  # lowest frequency of a vibration line: vehicle motion dominates below [Hz]
PROMINENT = 20.0  # least power of a vibration line, relative to the median of its neighbourhood
NEIGHBOURS = 41  # number of frequency bins in the neighbourhood
PEAKS = 3  # largest number of reported lines
JOLT = 5.0  # least step to report, as a multiple of the median change from second to second
JITTER_GAP = 1.5  # samples are missing in intervals longer than this multiple of the median


@dataclass(frozen=True, slots=True)
class AxisFigures:
    """Statistics of one sensor axis in SI units."""

    name: str
    at_rest: float  # mean while stationary [rad/s] or [m/s^2]; NaN if never stationary
    noise: float  # white noise density while stationary [rad/sqrt(s)] or [m/s/sqrt(s)]; NaN if never stationary
    in_motion: float  # standard deviation of the change between samples, over sqrt(2), while moving
    largest: float  # largest magnitude of a sample [rad/s] or [m/s^2]
    resolution: float  # distance between neighbouring values of a coarsely quantised sensor; 0 for others
    repeated: float  # share of samples equal to the previous one


@dataclass(frozen=True, slots=True)
class VibrationPeak:
    """Line in the spectrum of the specific force in motion."""

    axis: str
    frequency: float  # frequency of the line [Hz]
    rms: float  # root mean square of the line [m/s^2]


@dataclass(frozen=True, slots=True)
class ImuFigures:
    """Statistics of IMU samples."""

    axes: tuple[AxisFigures, ...]
    peaks: tuple[VibrationPeak, ...]
    jitter: float  # standard deviation of the intervals, without missing samples [s]
    missing: int  # number of intervals with missing samples
    gravity_steps: tuple[float, float]  # largest change of specific force from stop to stop [m/s^2], and its time [s]
    jolt: tuple[float, float]  # largest step of specific force within a stop [m/s^2], its time [s]; 0 if usual


def inspect_samples(imu: ImuData, rest: tuple[float, float] | None, still: BoolArray | None = None) -> ImuFigures:
    """Compute sensor statistics of a record.

    `rest`: start and end of one stationary interval [s]. `still` (n,): True for every sample of the record at which the
    vehicle is stationary.
    """
    scale = per_sample(imu)
    values = np.hstack([imu.gyro / scale, imu.accel / scale])
    at_rest, noise, in_rest = np.full(6, np.nan), np.full(6, np.nan), np.zeros(len(values), dtype=np.bool_)
    moving = np.ones(len(values), dtype=np.bool_)
    if rest is not None:
        in_rest = (imu.time >= rest[0]) & (imu.time <= rest[1])
        moving = ~in_rest if still is None else ~still
        at_rest = values[in_rest].mean(axis=0) if in_rest.any() else at_rest
        with suppress(InputError):
            noise = np.concatenate(white_noise(imu, *rest))
    change = np.diff(values, axis=0)
    both_moving = moving[1:] & moving[:-1]
    step = np.diff(imu.time)
    median_step = float(np.median(step))
    raw, interval = np.hstack([imu.gyro, imu.accel]), median_step if imu.sampling == "increment" else 1.0
    axes = tuple(
        AxisFigures(
            name,
            float(at_rest[i]),
            float(noise[i]),
            float(np.std(change[both_moving, i]) / np.sqrt(2.0)) if both_moving.any() else float("nan"),
            float(np.abs(values[:, i]).max()),
            resolution(raw[:, i]) / interval,
            float(np.mean(change[:, i] == 0.0)),
        )
        for i, name in enumerate(AXES)
    )
    no_gap = step < JITTER_GAP * median_step
    return ImuFigures(
        axes,
        _peaks(values[moving, 3:], 1.0 / median_step),
        float(np.std(step[no_gap])),
        int(np.count_nonzero(~no_gap)),
        (0.0, float("nan")) if still is None else _gravity_step(imu.time, values[:, 3:], still),
        (0.0, float("nan")) if rest is None else _jolt(imu.time[in_rest], values[in_rest, 3:], median_step),
    )


def _peaks(force: FloatArray, rate: float) -> tuple[VibrationPeak, ...]:
    """Find the strongest vibration lines: peaks of the power spectrum far above their neighbourhood."""
    length = round(SEGMENT * rate)
    if len(force) < 4 * length or rate < 4.0 * LOWEST:
        return ()
    peaks = []
    frequency, power = scipy.signal.welch(force, rate, nperseg=length, axis=0)
    for i, axis in enumerate("xyz"):
        ratio = power[:, i] / np.maximum(scipy.ndimage.median_filter(power[:, i], NEIGHBOURS, mode="constant"), 1e-300)
        candidates = np.flatnonzero((ratio > PROMINENT) & (frequency > LOWEST))
        for row in candidates[np.argsort(power[candidates, i])[::-1]][:PEAKS]:
            lobe = slice(max(row - 2, 0), row + 3)
            if power[row, i] < power[lobe, i].max():  # this bin is on the flank of a stronger line
                continue
            rms = float(np.sqrt(np.sum(power[lobe, i]) * (frequency[1] - frequency[0])))
            peaks.append(VibrationPeak(axis, float(frequency[row]), rms))
    return tuple(sorted(peaks, key=lambda each: -each.rms)[:PEAKS])


def _jolt(time: FloatArray, force: FloatArray, interval: float) -> tuple[float, float]:
    """Find the largest change of mean specific force from second to second [m/s^2], its time [s]; 0 if usual."""
    n = max(1, round(1.0 / interval))
    seconds = force[: len(force) // n * n].reshape(-1, n, 3).mean(axis=1)
    change = np.linalg.norm(np.diff(seconds, axis=0), axis=1)
    if len(change) < 3 or not change.max() > JOLT * np.median(change):
        return 0.0, float("nan")
    row = int(np.argmax(change))
    return float(change[row]), float(time[(row + 1) * n])


def _gravity_step(time: FloatArray, force: FloatArray, still: BoolArray) -> tuple[float, float]:
    """Find the largest change of the magnitude of specific force from one stop to the next [m/s^2], its time [s]."""
    stops = [(a, b) for a, b in runs_of(still) if time[b - 1] - time[a] > 2.0]
    sizes = np.array([float(np.linalg.norm(force[a:b].mean(axis=0))) for a, b in stops])
    if sizes.size < 2:
        return 0.0, float("nan")
    steps = np.diff(sizes)
    row = int(np.argmax(np.abs(steps)))
    return float(steps[row]), float(time[stops[row + 1][0]])
