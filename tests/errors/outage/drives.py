"""A simulated drive with stops, straights and turns, and an IMU whose errors are known."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from insnav.errors.outage.free_inertial import (
    Windows,
    free_window_starts,
    free_windows,
    navigated_drive,
    reference_from_fixes,
)
from insnav.filter.filter_input import FilterInput
from insnav.filter.prepare import prepare
from insnav.filter.receiver import Receiver
from insnav.imu import ImuErrors, ImuSpec, SensorSpec, corrupt
from insnav.simulate import LevelTruth
from insnav.simulate.recording import perfect_imu
from insnav.simulate.sensor_errors import GpsErrors, GpsSpec, corrupt_imu, measure_gps
from insnav.types import ImuData
from insnav.units import DEG, DEG_PER_H, DEG_PER_SQRT_H, M_S_PER_SQRT_H, UG
from tests.simulate.motions import Segment, drive

PLACE = np.array([45.0 * DEG, 7.0 * DEG, 240.0])
ONES = np.ones(3)
SPEC = ImuSpec(
    "with a bias of 10 deg/h and 1 mg",
    SensorSpec(bias=10.0 * DEG_PER_H * ONES, random_walk=0.02 * DEG_PER_SQRT_H * ONES),
    SensorSpec(bias=1000.0 * UG * ONES, random_walk=0.01 * M_S_PER_SQRT_H * ONES),
)
RECEIVER = GpsSpec("carrier phase", GpsErrors((0.05, 0.05, 0.08), velocity_noise=(0.02, 0.02, 0.03)))
SIGNS = np.array([1.0, -1.0, 1.0])
RATE = 50.0  # [Hz]
LAP = (
    Segment(20.0),
    Segment(10.0, speed=15.0),
    Segment(45.0),
    Segment(8.0, turn=90 * DEG),
    Segment(30.0),
    Segment(8.0, turn=90 * DEG),
    Segment(70.0),
    Segment(8.0, turn=100 * DEG),
    Segment(15.0),
    Segment(10.0, speed=0.0),
)


@lru_cache(maxsize=2)
def motion(laps: int = 2) -> LevelTruth:
    made = drive(LAP * laps, PLACE, seed=1, heading=0.4, roll=0.02, pitch=-0.03)
    assert isinstance(made, LevelTruth)
    return made


@lru_cache(maxsize=2)
def perfect(laps: int = 2) -> ImuData:
    return perfect_imu(motion(laps), RATE)


def noise_only() -> ImuSpec:
    return replace(SPEC, gyro=replace(SPEC.gyro, bias=np.zeros(3)), accel=replace(SPEC.accel, bias=np.zeros(3)))


@lru_cache(maxsize=8)
def injected(seed: int = 1, laps: int = 2) -> FilterInput:
    """A drive whose sensors have exactly 10 deg/h and 1 mg on every axis, and noise."""
    noisy = corrupt_imu(perfect(laps), noise_only(), (seed, 1)).imu
    errors = ImuErrors(gyro_bias=SPEC.gyro.bias * SIGNS, accel_bias=SPEC.accel.bias * SIGNS)
    return prepare(corrupt(noisy, errors), measure_gps(motion(laps), RECEIVER, (seed, 2)), SPEC, Receiver())[0]


def drawn(seed: int, spec: ImuSpec = SPEC) -> FilterInput:
    """A drive with an IMU sampled from a specification; the filter uses `SPEC`."""
    imu = corrupt_imu(perfect(), spec, (seed, 3)).imu
    return prepare(imu, measure_gps(motion(), RECEIVER, (seed, 4)), SPEC, Receiver())[0]


@lru_cache(maxsize=4)
def windows(uncalibrated: bool = False, length: float = 60.0, spacing: float = 10.0) -> Windows:
    ready = injected()
    drive_ = navigated_drive(ready, free_window_starts(ready, length, spacing=spacing))
    return free_windows(drive_, reference_from_fixes(ready), length, spacing, uncalibrated=uncalibrated)
