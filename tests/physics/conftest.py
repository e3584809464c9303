"""Truths that are dear to make."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow.csv
import pytest

from insnav import strapdown
from insnav.types import FloatArray, ImuData, Increments
from insnav.units import DEG
from tests.shared import standard_job


@dataclass(frozen=True)
class CleanJob:
    """The error-free standard job from the moment it moves on."""

    imu: ImuData  # the whole record, increments
    increments: Increments  # from `start` on
    reference: FloatArray  # time [s], latitude, longitude [rad], height [m], velocity, roll, pitch, heading [rad]
    start: float


def table(path) -> FloatArray:
    return np.column_stack([c.to_numpy() for c in pyarrow.csv.read_csv(path).columns])


@pytest.fixture(scope="session")
def clean_job(tmp_path_factory) -> CleanJob:
    folder = standard_job(tmp_path_factory, "clean")
    data, reference = table(folder / "imu.csv"), table(folder / "ref.csv")
    reference[:, [1, 2, 7, 8, 9]] *= DEG
    imu = ImuData(data[:, 0], data[:, 1:4], data[:, 4:7], "increment")
    start = float(reference[3200, 0])  # 320 s in: the vehicle moves and its attitude changes
    return CleanJob(imu, later(strapdown.increments(strapdown.intervals(imu)), start), reference, start)


def later(inc: Increments, start: float) -> Increments:
    """The part of increments that begins at `start`."""
    return inc.rows(inc.time > start + 1e-6)
