"""pyins on the same data: same noise figures, start and lever arm, and its own default step."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pyins import filters, inertial_sensor, measurements, strapdown
from pyins.util import ACCEL_COLS, GYRO_COLS, LLA_COLS, RPH_COLS, VEL_COLS

from insnav.types import GpsData, ImuData
from insnav.units import DEG, DEG_PER_H, DEG_PER_SQRT_H, M_S_PER_SQRT_H, MGAL, PPM


@dataclass(frozen=True)
class PeerRun:
    """CPU time of the filter alone [s], samples filtered, and the positions (latitude, longitude [deg], height [m])."""

    cpu_s: float
    samples: int
    time: NDArray[np.float64]
    lla_deg: NDArray[np.float64]


def run_pyins(imu: ImuData, gps: GpsData, start: dict[str, Any], seconds: float) -> PeerRun:
    """Filter the first `seconds` after the start state; compiling its integrator is not counted."""
    tables = [_tables(imu, gps, start, span) for span in (2.0, seconds)]
    _navigate(*tables[0], start)
    begin = time.process_time()
    trajectory = _navigate(*tables[1], start)
    cpu = time.process_time() - begin
    lla_deg = trajectory[LLA_COLS].to_numpy()
    return PeerRun(cpu, len(tables[1][0]), trajectory.index.to_numpy(), lla_deg)


def _tables(
    imu: ImuData, gps: GpsData, start: dict[str, Any], seconds: float
) -> tuple[pd.DataFrame, list[measurements.Measurement]]:
    """Increments with pyins' own coning and sculling, and positions; making them is not counted either."""
    begin, end = start["time_s"], start["time_s"] + seconds
    rows = (imu.time > begin - 1e-6) & (imu.time < end + 1e-6)  # pyins wants one sample before
    table = pd.DataFrame(np.hstack([imu.gyro, imu.accel])[rows], index=imu.time[rows], columns=GYRO_COLS + ACCEL_COLS)
    increments = strapdown.compute_increments_from_imu(table, "increment")
    rows = (gps.time > begin + 1e-6) & (gps.time < end + 1e-6)
    lla_deg = np.column_stack([gps.lla[rows, :2] / DEG, gps.lla[rows, 2]])
    fixes = pd.DataFrame(lla_deg, index=gps.time[rows], columns=LLA_COLS)
    position = measurements.Position(fixes, 1.0, np.array(start["lever_b_m"]))
    position.R = np.diag(start["imu"]["gps"]) ** 2  # the constructor takes one figure for all axes
    return increments, [position]


def _navigate(increments: pd.DataFrame, fixes: list[measurements.Measurement], start: dict[str, Any]) -> pd.DataFrame:
    figures = start["imu"]
    wander = np.sqrt(2.0 / (3600.0 * figures["corr_h"]))  # driving noise of a Gauss-Markov process of unit variance
    gyro_bias, accel_bias = figures["gb"] * DEG_PER_H, figures["ab"] * MGAL
    gyro = inertial_sensor.EstimationModel(
        gyro_bias, figures["arw"] * DEG_PER_SQRT_H, gyro_bias * wander, np.eye(3) * figures["gs"] * PPM
    )
    accel = inertial_sensor.EstimationModel(
        accel_bias, figures["vrw"] * M_S_PER_SQRT_H, accel_bias * wander, np.eye(3) * figures["as_"] * PPM
    )
    pva = pd.Series(
        [
            start["lat_deg"],
            start["lon_deg"],
            start["height_m"],
            *start["v_n_m_s"],
            *start["roll_pitch_heading_deg"],
        ],
        index=LLA_COLS + VEL_COLS + RPH_COLS,
        name=start["time_s"],
    )
    position_sd, velocity_sd = (
        float(np.sqrt(np.mean(np.square(start[k])))) for k in ("sd_position_m", "sd_velocity_m_s")
    )
    level_sd, heading_sd = float(np.mean(start["sd_attitude_deg"][:2])), start["sd_attitude_deg"][2]
    result = filters.run_feedback_filter(
        pva, position_sd, velocity_sd, level_sd, heading_sd, increments, gyro, accel, fixes
    )
    trajectory: pd.DataFrame = result.trajectory
    return trajectory
