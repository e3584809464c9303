"""Motions that several tests look at."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np

from insnav.imu import load_imu
from insnav.imu.specification import ImuSpec
from insnav.simulate import GpsErrors, corrupt_gps, corrupt_imu, gps_from_truth, imu_from_truth
from insnav.simulate.motion.moves import Vehicle
from insnav.simulate.truth import Truth
from insnav.types import GpsData, ImuData

PLACE = np.array([np.radians(48.0), np.radians(11.0), 500.0])
_SAMPLE = runpy.run_path(str(Path(__file__).parents[2] / "trajectories" / "make_sample.py"))
# A car driven as that of the sample: speed, heading and grade change together within a segment.
Segment, drive = _SAMPLE["Segment"], _SAMPLE["drive"]


def measured(truth: Truth, rate: float, imu: str | ImuSpec, gps: GpsErrors, seed: int) -> tuple[ImuData, GpsData]:
    """Samples at a rate [Hz], and a fix a second, of the place of the IMU."""
    spec = load_imu(imu) if isinstance(imu, str) else imu
    samples = imu_from_truth(truth, truth.start + np.arange(round(truth.duration * rate) + 1) / rate)
    fixes = gps_from_truth(truth, truth.start + np.arange(1.0, truth.duration), np.zeros(3))
    return corrupt_imu(samples, spec, (seed, 1)).imu, corrupt_gps(fixes, gps, (seed, 2))


def town(start: float = 0.0, place: np.ndarray = PLACE, **body: object) -> Truth:
    """Two minutes of a car: at rest, off, through two bends, over a hill, and to rest again."""
    segments = (
        Segment(12.0),
        Segment(10.0, speed=14.0),
        Segment(6.0, turn=np.radians(80.0)),
        Segment(12.0, grade=0.05),
        Segment(8.0, speed=18.0, turn=np.radians(-120.0)),
        Segment(12.0, grade=-0.03),
        Segment(30.0, speed=9.0, turn=np.radians(200.0)),
        Segment(20.0, speed=0.0, grade=0.0),
        Segment(10.0),
    )
    return drive(segments, place, seed=7, heading=0.5, roll=0.01, pitch=-0.02, start=start, body=Vehicle(**body))
