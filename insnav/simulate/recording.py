"""Simulated recording: an exact motion measured by an IMU and a receiver sampled from their specifications."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from insnav.exceptions import ConfigError
from insnav.imu import ImuErrors, ImuSpec
from insnav.simulate import gps_errors as receiver
from insnav.simulate.faults import Fault
from insnav.simulate.gps_errors import GpsSpec
from insnav.simulate.imu_errors import corrupt_imu
from insnav.simulate.truth import Truth, gps_from_truth, imu_from_truth, reference
from insnav.types import FloatArray, GpsData, ImuData, Sampling, Trajectory

REFERENCE_RATE = 10.0  # [Hz]
IDEAL_GPS_RATE = 1.0  # of an error-free receiver [Hz]
SLOWEST, FASTEST = 1.0, 10_000.0  # plausible sampling rates [Hz]
MOTION_STREAM, _IMU_STREAM, _GPS_STREAM = 0, 1, 2  # random streams of a seed, one per source of randomness


@dataclass(frozen=True, slots=True)
class Recording:
    """Simulated data with their truth."""

    imu: ImuData  # samples with errors and faults
    gps: GpsData  # fixes with errors and faults
    reference: Trajectory  # exact motion of the IMU at `REFERENCE_RATE`
    errors: ImuErrors | None  # constant errors of the sampled IMU; None without errors
    lever_b: FloatArray  # (3,) antenna seen from the IMU, body axes [m]


def simulate_recording(
    truth: Truth,
    imu_spec: ImuSpec | None,
    gps_spec: GpsSpec | None,
    seed: int,
    *,
    rate: float = 100.0,
    sampling: Sampling = "mean",
    faults: Sequence[Fault] = (),
    temperature: FloatArray | None = None,
    perfect: ImuData | None = None,
) -> Recording:
    """Measure a motion with sensors sampled from their specifications; None means an error-free sensor.

    `seed`: determines sensor realisations and noise. `rate`: of the IMU [Hz]. `sampling` {"mean", "instant",
    "increment"}. `faults`: applied in order; a fault without effect is refused. `temperature` (n,): of the IMU at each
    sample [deg C]. `perfect`: result of `perfect_imu` for the same truth, rate and sampling, for reuse with many seeds.
    Raises: ConfigError: an implausible rate, or a motion shorter than two samples.
    """
    samples = perfect if perfect is not None else perfect_imu(truth, rate, sampling)
    errors = None
    if imu_spec is not None:
        shown = corrupt_imu(samples, imu_spec, (seed, _IMU_STREAM), temperature=temperature)
        samples, errors = shown.imu, shown.errors
        del shown  # its biases are as large as the samples
    if gps_spec is not None:
        fixes, lever_b = receiver.measure_gps(truth, gps_spec, (seed, _GPS_STREAM)), np.asarray(gps_spec.lever_b)
    else:
        lever_b = np.zeros(3)
        fixes = gps_from_truth(truth, times(truth, IDEAL_GPS_RATE)[1:], lever_b)
    for fault in faults:
        before = samples, fixes
        samples, fixes = fault.apply(samples, fixes, truth.start)
        if _same(before[0], samples) and _same(before[1], fixes):
            raise ConfigError(
                "sim.fault_without_effect",
                where="--fault",
                verb=fault.verb,
                begin_s=max(fault.begin, 0.0),
                duration_s=truth.duration,
            )
    return Recording(samples, fixes, reference(truth, times(truth, REFERENCE_RATE)), errors, lever_b)


def _same(one: ImuData | GpsData, other: ImuData | GpsData) -> bool:
    """Return whether two records contain the same numbers."""
    mine, yours = one.columns(), other.columns()
    return mine.keys() == yours.keys() and all(np.array_equal(v, yours[k], equal_nan=True) for k, v in mine.items())


def perfect_imu(truth: Truth, rate: float = 100.0, sampling: Sampling = "mean") -> ImuData:
    """Measure a motion with an error-free IMU; see `simulate_recording`."""
    if not SLOWEST <= rate <= FASTEST:
        raise ConfigError("sim.sampling_rate", where="rate", rate_hz=rate, lowest_hz=SLOWEST, highest_hz=FASTEST)
    edges = times(truth, rate)
    if len(edges) < 3:
        raise ConfigError("sim.too_short_to_sample", where="rate", duration_s=truth.duration, rate_hz=rate)
    return imu_from_truth(truth, edges, sampling)


def temperature_ramp(imu: ImuData, ends: tuple[float, float] | None) -> FloatArray | None:
    """Interpolate the temperature at each sample ``(n,)`` [deg C], from first to last; None without `ends`."""
    return None if ends is None else np.linspace(*ends, len(imu.time))


def times(truth: Truth, rate: float) -> FloatArray:
    """Return evenly spaced times of the whole motion at a rate [Hz], including its start, ``(n,)`` [s]."""
    return truth.start + np.arange(math.floor(truth.duration * rate * (1.0 + 1e-12)) + 1) / rate
