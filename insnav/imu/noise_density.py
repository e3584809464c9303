"""White noise of an IMU at rest, and the nearest preset.

A vehicle at rest moves on its suspension below a few Hz, and its engine causes a few lines above. The Allan deviation
includes both. White noise of density N is the floor of the spectrum between them: its power spectral density is N^2 at
every frequency (IEEE Std 952-1997, annex C, angle random walk). The 25 % quantile of the spectrum over a band ignores
signals that occupy less than three quarters of the band.
"""

from __future__ import annotations

import math
from dataclasses import replace
from statistics import NormalDist

import numpy as np

from insnav import spill
from insnav.earth import OMEGA_EARTH
from insnav.exceptions import InputError
from insnav.imu.model import per_sample, sample_intervals
from insnav.imu.specification import PRESETS, ImuSpec
from insnav.types import FloatArray, ImuData, RoundingChange
from insnav.units import DEG_PER_H, DEG_PER_SQRT_H, M_S_PER_SQRT_H

# Length of the averaged pieces, which is the shortest record [s], and both ends of the band [Hz]. Below the band are
# drift and window leakage of the mean; above are engines, quantisation and the filters of the sensors.
BAND = 4.0, 0.5, 10.0
# Band of the noise that matters between fixes. An idling engine is above; its oscillation does not build up an angle.
SLOW = 20.0, 0.1, 0.5
PIECES = 64  # memory is released after this many pieces
NYQUIST_PART = 0.8  # largest share of the Nyquist frequency in a band: anti-aliasing filters lower the floor above
QUANTILE = 0.25  # the floor is this quantile of the power in the band
LEVELS = 0.1  # a sensor is coarsely quantised if its distinct values are at most this share of its samples
# Rounding acts as a bias if two neighbouring values have more than this share of the samples [-]. Noise with a
# third of a step as sd gives this share in the middle of a step, and leaves a tenth of the bias.
HELD = 0.93
LOOKED = 1 << 16  # number of samples examined for the resolution

# Of presets within this factor of the nearest distance, the least accurate is chosen. Noise alone does not separate
# neighbouring grades, and too accurate a grade makes the filter over-confident in biases.
SAME = 1.5
# If the gyros' mean at rest agrees with the Earth's rate within this share, biases above the Earth's rate are
# improbable (below one per cent).
EARTH_SEEN = 0.1
_SMALLEST = 1e-12  # lower limit of noise in SI units, far below any sensor: keeps its logarithm finite


def white_noise(
    imu: ImuData, start: float, end: float, band: tuple[float, float, float] = BAND
) -> tuple[FloatArray, FloatArray]:
    """Estimate the white noise of the sensors from a stationary interval.

    The estimate is the 25 % quantile of the power spectral density over a band (0.5 to 10 Hz). It is divided by the
    quantile of unit white noise (chi-square; P. D. Welch, IEEE Trans. Audio Electroacoust. AU-15 (1967) 70). The result
    is at least the noise of rounding; see `resolution_noise`.

    `start`, `end`: the stationary interval [s], both ends included, at least 4 s. `band`: `BAND` or `SLOW`. The
    relative sd of a density is 18 % from 4 s and 5 % from 20 s; with `SLOW` 15 % from 60 s.
    Returns: `gyro` (3,): noise density of the gyros [rad/sqrt(s)]. `accel` (3,): noise density of the accelerometers
    [m/s/sqrt(s)].
    Raises: InputError: the interval is too short or sampled too slowly.
    """
    rows = _rows(imu, start, end)
    count = rows.stop - rows.start
    interval = float(np.median(np.diff(imu.time[rows][: spill.ROWS]))) if count > 1 else math.inf
    segment, lowest, highest = band
    length, highest = round(segment / interval), min(highest, NYQUIST_PART * 0.5 / interval)
    first, last, span = float(imu.time[0]), float(imu.time[-1]), f"{start:.3f} s to {end:.3f} s"
    if start > last or start <= end < first:
        example = f"{first:.0f}:{first + end - start:.0f}"
        raise InputError("imu.static_outside", where=span, first_s=first, last_s=last, example=example)
    if length > count or highest < 2.0 * lowest:
        hz = 4.0 * lowest / NYQUIST_PART
        raise InputError(
            "imu.static_too_short", where=span, count=count, first_s=first, last_s=last, needed_s=segment, needed_hz=hz
        )
    density = np.sqrt(_floor(imu, rows, interval, length, (lowest, highest)))
    gyro, accel = resolution_noise(imu)
    return np.maximum(density[:3], gyro), np.maximum(density[3:], accel)


def _rows(imu: ImuData, start: float, end: float) -> slice:
    """Return the samples from `start` to `end`, both included."""
    return slice(int(np.searchsorted(imu.time, start)), int(np.searchsorted(imu.time, end, side="right")))


def _floor(imu: ImuData, rows: slice, interval: float, length: int, band: tuple[float, float]) -> FloatArray:
    """Estimate the floor of the two-sided power spectral density of each axis, (6,) [unit^2/Hz]."""
    window = np.hanning(length + 1)[:-1, None]  # periodic Hann window
    step = length // 2
    count = (rows.stop - rows.start - length) // step + 1
    power = np.zeros((length // 2 + 1, 6))
    intervals = sample_intervals(imu)[:, None] if imu.sampling == "increment" else None
    for number, first in enumerate(range(rows.start, rows.start + count * step, step)):
        samples = slice(first, first + length)
        piece = np.hstack([imu.gyro[samples], imu.accel[samples]])
        if intervals is not None:
            piece /= intervals[samples]
        if number % PIECES == 0:  # limits memory, as a stop may last for days
            spill.release()
        power += np.abs(np.fft.rfft((piece - piece.mean(axis=0)) * window, axis=0)) ** 2
    power *= interval / (count * float(np.sum(window**2)))
    frequency = np.fft.rfftfreq(length, interval)
    inside = power[(frequency >= band[0]) & (frequency <= band[1])]
    # degrees of freedom of the average over half-overlapping Hann windows (Welch 1967)
    freedom = 36.0 * count**2 / (19.0 * count - 1.0)
    return np.asarray(np.quantile(inside, QUANTILE, axis=0) / _chi_square_quantile(QUANTILE, freedom) * freedom)


def _chi_square_quantile(probability: float, freedom: float) -> float:
    """Approximate the chi-square quantile (Wilson and Hilferty, PNAS 17 (1931) 684), within 2 % from 2 degrees on."""
    spread = 2.0 / (9.0 * freedom)
    return freedom * (1.0 - spread + NormalDist().inv_cdf(probability) * math.sqrt(spread)) ** 3


def resolution_noise(imu: ImuData) -> tuple[FloatArray, FloatArray]:
    """Compute the white noise that rounding of the samples causes, gyros and accelerometers as in `white_noise`.

    A rounding error is uniform over one step. If the signal crosses steps, the error is white with a variance per
    sample of step^2 / 12 (B. Widrow and I. Kollar, "Quantization Noise", Cambridge 2008, chapter 4). A constant output
    at rest has no such noise.
    """
    interval = float(np.median(np.diff(imu.time[: spill.ROWS])))
    density = np.sqrt(interval / 12.0) / (interval if imu.sampling == "increment" else 1.0)
    gyro, accel = (np.array([resolution(column) for column in signals.T]) for signals in (imu.gyro, imu.accel))
    return density * gyro, density * accel


def rounding_changes(imu: ImuData) -> tuple[RoundingChange, ...]:
    """Find the times at which the rounding errors of coarsely quantised gyros change.

    If a gyro has hardly more than two values within a second, noise does not average its rounding error. The error acts
    as a bias until the rate moves to another step.
    """
    step = np.array([resolution(column) for column in imu.gyro.T])
    if not step.any():
        return ()
    first = np.unique(np.searchsorted(imu.time, np.arange(imu.time[0], imu.time[-1])))
    seconds = np.split(imu.gyro, first[1:])
    variance = np.array([rounding_variance(second_values, step) for second_values in seconds])
    level = np.where(variance > 0.0, [second_values.mean(axis=0) for second_values in seconds], np.inf)
    level_kept, start = np.ones((len(seconds) - 1, 3), dtype=np.bool_), level[0].copy()
    for second, constant in zip(level[1:], level_kept, strict=True):  # compared with `start`: slow changes add up
        constant[:] = np.isclose(second, start, rtol=0.0, atol=0.25 * step)  # infinite in seconds without rounding bias
        start[~constant] = second[~constant]
    for axis, constant in enumerate(level_kept.T):  # mean variance of each run of seconds at one level
        run_number = np.cumsum(np.append(False, ~constant))
        variance[:, axis] = (np.bincount(run_number, variance[:, axis]) / np.bincount(run_number))[run_number]
    variance /= np.median(per_sample(imu)) ** 2
    return tuple(
        RoundingChange(float(imu.time[first[i + 1]]), *np.where(level_kept[i], np.nan, variance[i : i + 2]))
        for i in np.flatnonzero(~level_kept.all(axis=1))
    )


def rounding_variance(values: FloatArray, step: FloatArray) -> FloatArray:
    """Compute the variance of the mean rounding error of each column, (3,); zero if noise averages the error.

    `values` (n, 3), `step` (3,): resolution. A share f of the samples has a neighbouring value. Noise of sd s then
    gives the mean error f - 1/2 - s q(f), in steps, with the normal quantile q. It is between f - 1/2 without noise and
    nearly zero; a uniform distribution there has the variance (1/2 - f)^2 / 3. A constant value gives step^2 / 12 (B.
    Widrow and I. Kollar, "Quantization Noise", Cambridge 2008, chapters 4 and 19).
    """
    deviation = values - np.median(values, axis=0)
    shares = [(np.abs(deviation - side * step) < 0.75 * step).mean(axis=0) for side in (-0.5, 0.0, 0.5)]
    one_value = np.maximum(shares[1], 0.5)
    return np.where(np.maximum(shares[0], shares[2]) > HELD, (step * (one_value - 0.5)) ** 2 / 3.0, 0.0)


def resolution(column: FloatArray) -> float:
    """Return the median distance between neighbouring values of a signal; 0 if it is not coarsely quantised."""
    samples = column[:: 1 + column.shape[0] // LOOKED]
    levels = np.unique(samples)
    if levels.size > LEVELS * samples.size or levels.size < 3:
        return 0.0
    gaps = np.diff(levels)
    return float(np.median(gaps[gaps > 1e-9 * np.abs(levels).max()]))


def nearest_preset(
    gyro_density: FloatArray,
    accel_density: FloatArray,
    mean_rate: FloatArray | None = None,
    rounded: FloatArray | float = 0.0,
) -> tuple[ImuSpec, str]:
    """Choose the preset with white noise nearest to a measured one.

    The distance is between log noise of the quietest axes, as other axes contain more vehicle vibration. Accelerometers
    at rest in a vehicle measure more vibration than own noise, so only noisier presets count as distant. Of presets
    almost equally near, the least accurate is chosen. Presets with gyro biases above the Earth's rate are excluded if
    the gyros resolve the Earth's rate.

    `gyro_density` (3,): noise density of the gyros [rad/sqrt(s)]. `accel_density` (3,): noise density of the
    accelerometers [m/s/sqrt(s)]. `mean_rate` (3,): mean gyro output over the stationary interval [rad/s].
    `rounded` (3,): its standard deviation by rounding [rad/s].
    Returns: `spec`: the preset. On every axis its random walk is at least the measured one. Its gyro bias is at least
    the difference between mean rate and Earth rate.
    """
    from insnav.imu.imu_file import load_imu  # imported here, as noise estimation needs no pydantic

    excess = 0.0 if mean_rate is None else rate_excess(mean_rate)
    earth_seen = mean_rate is not None and excess + np.max(rounded) < EARTH_SEEN * OMEGA_EARTH
    specs = [load_imu(name) for name in PRESETS]
    if earth_seen:
        specs = [spec for spec in specs if np.max(spec.gyro.bias) < OMEGA_EARTH]
    distances = [
        math.hypot(
            _log_ratio(gyro_density, spec.gyro.random_walk), min(0.0, _log_ratio(accel_density, spec.accel.random_walk))
        )
        for spec in specs
    ]
    limit = min(distances) + math.log(SAME)
    spec = next(spec for spec, distance in zip(specs, distances, strict=True) if distance <= limit)
    seen = " and the gyros show the Earth's rate" if earth_seen else ""
    biased = f", and with a gyro bias of {excess / DEG_PER_H:.2g} deg/h" if np.any(excess > spec.gyro.bias) else ""
    sentence = (
        f"The white noise at rest is {_span(gyro_density, DEG_PER_SQRT_H)} deg/sqrt(h) and "
        f"{_span(accel_density, M_S_PER_SQRT_H)} m/s/sqrt(h){seen}; the nearest preset is {spec.name!r}, "
        f"taken with the measured noise where that is larger{biased}."
    )
    raised = raise_to_rest(spec, gyro_density, accel_density, excess, rounded)
    return replace(raised, source=f"{sentence} The other figures: {spec.source}"), sentence


def raise_to_rest(
    spec: ImuSpec, gyro: FloatArray, accel: FloatArray, excess: float, rounded: FloatArray | float
) -> ImuSpec:
    """Raise a specification to noise densities (3,) at rest, and to gyro biases: `rate_excess` and rounding (3,)."""
    noise = replace(spec.accel, random_walk=np.maximum(spec.accel.random_walk, accel))
    walk, bias = np.maximum(spec.gyro.random_walk, gyro), np.hypot(np.maximum(spec.gyro.bias, excess), rounded)
    return replace(spec, gyro=replace(spec.gyro, bias=bias, random_walk=walk), accel=noise)


def rate_excess(mean_rate: FloatArray) -> float:
    """Compute the least gyro bias [rad/s] for a mean rate (3,) at rest: its magnitude minus the Earth's rate."""
    return abs(float(np.linalg.norm(mean_rate)) - OMEGA_EARTH)


def identify(imu: ImuData, start: float, end: float) -> tuple[ImuSpec, str]:
    """Identify an IMU from a stationary interval: noise and mean rate, then `nearest_preset`.

    `start`, `end`: the stationary interval [s].
    Raises: InputError: the interval is too short or sampled too slowly.
    """
    return nearest_preset(*white_noise(imu, start, end), *mean_rate(imu, start, end))


def mean_rate(imu: ImuData, start: float, end: float) -> tuple[FloatArray, FloatArray]:
    """Compute the mean rate of the gyros from `start` to `end` [s], and its sd by rounding, (3,) each [rad/s]."""
    rows = _rows(imu, start, end)
    step = np.array([resolution(column) for column in imu.gyro.T])
    interval = sample_intervals(imu)[rows].mean() if imu.sampling == "increment" else 1.0
    rounded = np.sqrt(rounding_variance(imu.gyro[rows][:LOOKED], step))
    return spill.mean(imu.gyro[rows]) / interval, rounded / interval


def _log_ratio(measured: FloatArray, preset: FloatArray) -> float:
    return math.log(max(float(np.min(measured)), _SMALLEST) / float(np.min(preset)))


def _span(density: FloatArray, unit: float) -> str:
    return f"{np.min(density) / unit:.2g} to {np.max(density) / unit:.2g}"
