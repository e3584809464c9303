"""pyins and GTSAM on the standard job: same noise figures, start and lever arm, positions only."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insnav.filter.prepare import Start
from insnav.imu import ImuSpec, SensorSpec
from insnav.types import GpsData, ImuData
from insnav.units import DEG, DEG_PER_H, DEG_PER_SQRT_H, M_S_PER_SQRT_H, MGAL, PPM

sys.path.insert(0, str(Path(__file__).parents[2] / "reports"))

import peers as peer_programs
from peers import Task


@dataclass(frozen=True)
class PeerRun:
    """CPU time of the filter alone [s], samples filtered, and the positions (latitude, longitude [deg], height [m])."""

    cpu_s: float
    samples: int
    time: NDArray[np.float64]
    lla_deg: NDArray[np.float64]


def run_pyins(imu: ImuData, gps: GpsData, start: dict[str, Any], seconds: float) -> PeerRun:
    """Filter the first `seconds` after the start state; compiling its integrator is not counted."""
    return _positions(peer_programs.run_pyins(_task(imu, gps, start, seconds)))


def run_gtsam(imu: ImuData, gps: GpsData, start: dict[str, Any], seconds: float) -> PeerRun:
    """Smooth the first `seconds` after the start state."""
    return _positions(peer_programs.run_gtsam(_task(imu, gps, start, seconds)))


def _positions(run: peer_programs.PeerRun) -> PeerRun:
    return PeerRun(run.cpu_s, run.samples, run.solution.time, run.solution.lla / [DEG, DEG, 1.0])


def _task(imu: ImuData, gps: GpsData, start: dict[str, Any], seconds: float) -> Task:
    figures, begin = start["imu"], start["time_s"]
    n = int(np.searchsorted(imu.time, begin + seconds + 1e-6))
    part = ImuData(imu.time[:n], imu.gyro[:n], imu.accel[:n], imu.sampling, imu.stamp)
    rows = (gps.time > begin + 0.5) & (gps.time < begin + seconds + 1e-6)
    unknown = np.full((int(rows.sum()), 3), np.nan)
    sd = np.broadcast_to(np.array(figures["gps"], dtype=np.float64), unknown.shape)
    fixes = GpsData(gps.time[rows], gps.lla[rows], unknown, sd, unknown)

    def sensor(bias: float, walk: float, scale: float) -> SensorSpec:
        return SensorSpec(
            bias_instability=np.full(3, bias),
            correlation_time=3600.0 * figures["corr_h"],
            random_walk=np.full(3, walk),
            scale_factor=np.full(3, scale),
        )

    spec = ImuSpec(
        "job",
        sensor(figures["gb"] * DEG_PER_H, figures["arw"] * DEG_PER_SQRT_H, figures["gs"] * PPM),
        sensor(figures["ab"] * MGAL, figures["vrw"] * M_S_PER_SQRT_H, figures["as_"] * PPM),
    )
    begun = Start(
        begin,
        np.array([start["lat_deg"] * DEG, start["lon_deg"] * DEG, start["height_m"]]),
        np.array(start["v_n_m_s"]),
        np.array(start["roll_pitch_heading_deg"]) * DEG,
        np.array(start["sd_position_m"]),
        np.array(start["sd_velocity_m_s"]),
        np.array(start["sd_attitude_deg"]) * DEG,
    )
    return Task(part, fixes, begun, np.array(start["lever_b_m"]), spec)
