"""One simulated recording: what an IMU and a receiver, sampled from their specifications, make of an exact motion."""

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
from insnav.simulate.ideal_sensors import gps_from_truth, imu_from_truth, reference
from insnav.simulate.imu_errors import corrupt_imu
from insnav.simulate.truth import Truth
from insnav.types import FloatArray, GpsData, ImuData, Sampling, Trajectory

REFERENCE_RATE = 10.0  # [Hz]
IDEAL_GPS_RATE = 1.0  # of a receiver without errors [Hz]
SLOWEST, FASTEST = 1.0, 10_000.0  # sampling rates that make sense [Hz]
MOTION_STREAM, _IMU_STREAM, _GPS_STREAM = 0, 1, 2  # with the seed: one for each source of randomness


@dataclass(frozen=True, slots=True)
class Recording:
    """What was recorded, and the truth behind it."""

    imu: ImuData  # samples with errors and faults
    gps: GpsData  # fixes with errors and faults
    reference: Trajectory  # exact motion of the IMU at `REFERENCE_RATE`
    errors: ImuErrors | None  # constant errors of the IMU that was sampled; None if it has none
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
    """Measure a motion with sensors sampled from their specifications; None is a sensor without errors.

    `seed`: the same seed gives the same recording; other seeds other sensor realisations and other noise. `rate`: of
    the IMU [Hz]; `sampling` {"mean", "instant", "increment"}. `faults`: applied one after the other; one that changes
    nothing is refused. `temperature` (n,): of the IMU at each sample [deg C]. `perfect`: what `perfect_imu` gives for
    the same truth, rate and sampling: spares doing it again for every seed.
    Raises: ConfigError: a rate that makes no sense, or a motion shorter than two samples.
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
    """Whether two records hold the same numbers."""
    mine, yours = one.columns(), other.columns()
    return mine.keys() == yours.keys() and all(np.array_equal(v, yours[k], equal_nan=True) for k, v in mine.items())


def perfect_imu(truth: Truth, rate: float = 100.0, sampling: Sampling = "mean") -> ImuData:
    """Measure a motion with an IMU without errors; see `simulate_recording`."""
    if not SLOWEST <= rate <= FASTEST:
        raise ConfigError("sim.sampling_rate", where="rate", rate_hz=rate, lowest_hz=SLOWEST, highest_hz=FASTEST)
    edges = times(truth, rate)
    if len(edges) < 3:
        raise ConfigError("sim.too_short_to_sample", where="rate", duration_s=truth.duration, rate_hz=rate)
    return imu_from_truth(truth, edges, sampling)


def temperature_ramp(imu: ImuData, ends: tuple[float, float] | None) -> FloatArray | None:
    """Temperature at each sample ``(n,)`` [deg C], linear between the first and the last one; None without `ends`."""
    return None if ends is None else np.linspace(*ends, len(imu.time))


def times(truth: Truth, rate: float) -> FloatArray:
    """Evenly spaced times of the whole motion at a rate [Hz], its start included, ``(n,)`` [s]."""
    return truth.start + np.arange(math.floor(truth.duration * rate * (1.0 + 1e-12)) + 1) / rate
