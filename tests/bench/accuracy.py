"""Errors against the truth of the job, in the terms of an independent package.

The truth, at 10 Hz, is never interpolated: its vibration is too fast for that. What is judged is brought to its
times instead, which need not be those of the samples, as a delay found in the data is laid to the IMU's clock.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray
from pyins import transform

from insnav.types import Epochs
from insnav.units import DEG

Array = NDArray[np.float64]
LLA, RPH = ("lat_deg", "lon_deg", "height_m"), ("roll_deg", "pitch_deg", "heading_deg")
HALF_STEP = 0.05  # of the truth [s]


class Truth:
    """Reference of the job, from some time on."""

    def __init__(self, path: Path, after: float) -> None:
        table = pyarrow.csv.read_csv(path)
        rows = table.column("time_s").to_numpy() > after
        self.time = table.column("time_s").to_numpy()[rows]
        self.lla_deg, self.rph_deg = (_columns(table, names)[rows] for names in (LLA, RPH))

    def position_errors(self, time: Array, lla_deg: Array) -> Array:
        """North, East, Down [m], (n, 3), at the times of the truth within those of a densely sampled track."""
        inside = self._inside(time)
        return _ned(_interpolate(self.time[inside], time, lla_deg), self.lla_deg[inside])

    def attitude_errors(self, time: Array, rph_deg: Array) -> Array:
        """Roll, pitch, heading [deg], (n, 3), likewise."""
        inside = self._inside(time)
        turned = np.unwrap(rph_deg, period=360.0, axis=0)
        difference = _interpolate(self.time[inside], time, turned) - self.rph_deg[inside]
        return np.asarray((difference + 180.0) % 360.0 - 180.0)

    def _inside(self, time: Array) -> NDArray[np.bool_]:
        return np.asarray((self.time >= time[0]) & (self.time <= time[-1]))


def rms(errors: Array) -> list[float]:
    """Root mean square of each column."""
    return [float(x) for x in np.sqrt(np.mean(errors**2, axis=0))]


def solution_rms(folder: Path, truth: Truth) -> tuple[list[float], list[float]]:
    """RMS of North, East, Down [m] and of roll, pitch, heading [deg] of a run folder's solution at full rate."""
    table = pyarrow.parquet.read_table(folder / "solution.parquet", columns=["time_s", *LLA, *RPH])
    time = table.column("time_s").to_numpy()
    return rms(truth.position_errors(time, _columns(table, LLA))), rms(
        truth.attitude_errors(time, _columns(table, RPH))
    )


def position_nees(epochs: Epochs, truth: Truth) -> float:
    """Mean normalised estimation error squared of position over the filter epochs; 3 if consistent."""
    row = np.minimum(np.searchsorted(truth.time, epochs.time - HALF_STEP), truth.time.size - 1)
    ahead = truth.time[row] - epochs.time
    near = np.abs(ahead) <= HALF_STEP
    lla_deg = np.column_stack([epochs.lla[near, :2] / DEG, epochs.lla[near, 2]])
    # milliseconds from an epoch to the truth nearest to it: the velocity tells the way between
    error = _ned(lla_deg, truth.lla_deg[row[near]]) + epochs.v_n[near] * ahead[near, None]
    weighted = np.linalg.solve(epochs.covariance[near, :3, :3], error[..., None])[..., 0]
    return float(np.mean(np.einsum("ni,ni->n", error, weighted)))


def _ned(lla_deg: Array, truth_deg: Array) -> Array:
    return np.asarray(transform.compute_lla_difference(lla_deg, truth_deg))


def _interpolate(at: Array, time: Array, values: Array) -> Array:
    return np.column_stack([np.interp(at, time, column) for column in values.T])


def _columns(table: pyarrow.Table, names: tuple[str, ...]) -> Array:
    return np.column_stack([table.column(name).to_numpy() for name in names])
