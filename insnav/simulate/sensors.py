"""Errors of inertial sensors: a specimen drawn from a specification, its drift, noise and resolution."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from insnav.imu import ImuErrors, ImuSpec, SensorSpec, corrupt, draw_errors, sample_intervals
from insnav.types import FloatArray, ImuData

Seed = int | tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ImuSimulation:
    """What a simulated IMU shows, and the errors in it.

    Attributes
    ----------
    imu : ImuData
        Samples with errors.
    errors : ImuErrors
        Its constant errors: turn-on bias, scale factor, misalignment.
    gyro_bias, accel_bias : (n, 3) array
        Whole bias over time, turn-on and in-run [rad/s], [m/s^2].
    """

    imu: ImuData
    errors: ImuErrors
    gyro_bias: FloatArray
    accel_bias: FloatArray


def corrupt_imu(
    imu: ImuData,
    spec: ImuSpec,
    seed: Seed,
    *,
    gyro_step: float = 0.0,
    accel_step: float = 0.0,
) -> ImuSimulation:
    """Draw an IMU from a specification and let it measure.

    Constant errors come first (`insnav.imu.corrupt`), then in-run bias, white noise, rounding.

    Parameters
    ----------
    imu : ImuData
        Error-free samples, at least two.
    spec : ImuSpec
        Sizes of the errors.
    seed : int or tuple of int
        The same seed gives the same errors.
    gyro_step, accel_step : float
        Resolution, in the unit of the samples; zero for none.

    Returns
    -------
    ImuSimulation
        The samples and their errors.

    Raises
    ------
    InputError
        Fewer than two samples.
    """
    constant, gyro_seed, accel_seed = np.random.SeedSequence(seed).spawn(3)
    errors = draw_errors(spec, np.random.default_rng(constant))
    wrong = corrupt(imu, errors)
    dt = sample_intervals(imu)[:, None]
    gyro_drift, gyro_noise = drift_and_noise(imu.time, dt, spec.gyro, np.random.default_rng(gyro_seed))
    accel_drift, accel_noise = drift_and_noise(imu.time, dt, spec.accel, np.random.default_rng(accel_seed))
    # The noise of an instant is taken to be that of the mean: a sensor's bandwidth is about its rate.
    span = dt if imu.sampling == "increment" else 1.0
    gyro = wrong.gyro + (gyro_drift + gyro_noise) * span
    accel = wrong.accel + (accel_drift + accel_noise) * span
    wrong = replace(wrong, gyro=to_steps(gyro, gyro_step), accel=to_steps(accel, accel_step))
    return ImuSimulation(wrong, errors, errors.gyro_bias + gyro_drift, errors.accel_bias + accel_drift)


def drift_and_noise(
    time: FloatArray, dt: FloatArray, sensor: SensorSpec, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """In-run bias, and white noise as the mean over each interval.

    Parameters
    ----------
    time : (n,) array
        Times of the samples [s].
    dt : (n, 1) array
        Lengths of their intervals [s].
    sensor : SensorSpec
        Sizes.
    rng : numpy.random.Generator
        Source of randomness; how much is taken does not depend on the sizes.

    Returns
    -------
    drift, noise : (n, 3) array
        In the unit of the bias.
    """
    noise = rng.standard_normal((len(time), 3)) * (sensor.random_walk / np.sqrt(dt))
    drift = gauss_markov(rng, time, sensor.bias_instability, sensor.correlation_time)
    drift += np.cumsum(rng.standard_normal((len(time), 3)) * (sensor.rate_random_walk * np.sqrt(dt)), axis=0)
    return drift, noise


def to_steps(values: FloatArray, step: float) -> FloatArray:
    """Values rounded to multiples of `step`; as they are if it is zero."""
    return np.round(values / step) * step if step > 0.0 else values


def gauss_markov(rng: np.random.Generator, time: FloatArray, sd: FloatArray, correlation_time: float) -> FloatArray:
    """Stationary first-order Gauss-Markov process on three axes.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of randomness.
    time : (n,) array
        Times [s], taken as evenly spaced at their mean distance.
    sd : (3,) array
        Standard deviation at every instant.
    correlation_time : float
        Time after which the correlation is 1/e [s]; infinite makes a constant.

    Returns
    -------
    (n, 3) array
        Samples, in the unit of `sd`: ``x_k = a x_(k-1) + sd sqrt(1 - a^2) w_k`` with ``a = exp(-dt / T)``
        (Maybeck, Stochastic Models, Estimation, and Control, vol. 1, 1979, section 4.11).
    """
    ratio = (time[-1] - time[0]) / max(1, len(time) - 1) / correlation_time
    decay = math.exp(-ratio)
    drive = rng.standard_normal((len(time), 3)) * sd
    drive[1:] *= math.sqrt(-math.expm1(-2.0 * ratio))
    process: FloatArray = lfilter([1.0], [1.0, -decay], drive, axis=0)
    return process
