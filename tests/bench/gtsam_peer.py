"""GTSAM's batch smoother on the same data: preintegrated IMU factors between fixes, GPS factors, biases as a walk."""

from __future__ import annotations

import time
from typing import Any

import gtsam
import numpy as np
import pymap3d
from gtsam.symbol_shorthand import B, V, X

from insnav.attitude import dcm_from_rph
from insnav.types import GpsData, ImuData
from insnav.units import DEG, DEG_PER_H, DEG_PER_SQRT_H, M_S_PER_SQRT_H, MGAL
from tests.bench.peer import PeerRun

OMEGA = 7.292115e-5


def run_gtsam(imu: ImuData, gps: GpsData, start: dict[str, Any], seconds: float) -> PeerRun:
    """Smooth the first `seconds` after the start state, in the tangent plane there (North, East, Down)."""
    origin = start["lat_deg"], start["lon_deg"], start["height_m"]
    begin = start["time_s"]
    rows = (gps.time > begin + 0.5) & (gps.time < begin + seconds + 1e-6)
    ned = np.column_stack(pymap3d.geodetic2ned(*(gps.lla[rows] / [DEG, DEG, 1.0]).T, *origin))
    fixes = gps.time[rows]
    step = np.diff(imu.time, prepend=2.0 * imu.time[0] - imu.time[1])
    gyro, accel = imu.gyro / step[:, None], imu.accel / step[:, None]
    first, *edges = np.searchsorted(imu.time, np.concatenate([[begin], fixes]) + 1e-6)
    cpu = time.process_time()
    values = _smooth(start, ned, gyro, accel, step, np.array([first, *edges]), gps.position_sd[rows][0])
    cpu = time.process_time() - cpu
    pose = [values.atPose3(X(k + 1)) for k in range(len(fixes))]
    lla = pymap3d.ned2geodetic(*np.array([p.translation() for p in pose]).T, *origin)
    return PeerRun(cpu, int(edges[-1] - first), fixes, np.column_stack(lla))


def _smooth(
    start: dict[str, Any],
    ned: np.ndarray,
    gyro: np.ndarray,
    accel: np.ndarray,
    step: np.ndarray,
    edges: np.ndarray,
    position_sd: np.ndarray,
) -> gtsam.Values:
    figures = start["imu"]
    params = gtsam.PreintegrationParams.MakeSharedD(9.7945)
    params.setGyroscopeCovariance((figures["arw"] * DEG_PER_SQRT_H) ** 2 * np.eye(3))
    params.setAccelerometerCovariance((figures["vrw"] * M_S_PER_SQRT_H) ** 2 * np.eye(3))
    params.setIntegrationCovariance(1e-8 * np.eye(3))
    lat = start["lat_deg"] * DEG
    params.setOmegaCoriolis(OMEGA * np.array([np.cos(lat), 0.0, -np.sin(lat)]))
    bias_sd = np.array([figures["ab"] * MGAL] * 3 + [figures["gb"] * DEG_PER_H] * 3)
    walk = gtsam.noiseModel.Diagonal.Sigmas(bias_sd * np.sqrt(2.0 / (3600.0 * figures["corr_h"])))
    fix_noise = gtsam.noiseModel.Diagonal.Sigmas(position_sd)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    state = gtsam.NavState(
        gtsam.Pose3(gtsam.Rot3(dcm_from_rph(np.array(start["roll_pitch_heading_deg"]) * DEG)), np.zeros(3)),
        np.array(start["v_n_m_s"]),
    )
    zero = gtsam.imuBias.ConstantBias()
    attitude_sd = np.array(start["sd_attitude_deg"]) * DEG
    sd = np.concatenate([attitude_sd, start["sd_position_m"]])
    graph.add(gtsam.PriorFactorPose3(X(0), state.pose(), gtsam.noiseModel.Diagonal.Sigmas(sd)))
    graph.add(
        gtsam.PriorFactorVector(V(0), state.velocity(), gtsam.noiseModel.Diagonal.Sigmas(start["sd_velocity_m_s"]))
    )
    graph.add(gtsam.PriorFactorConstantBias(B(0), zero, gtsam.noiseModel.Diagonal.Sigmas(bias_sd)))
    values.insert(X(0), state.pose())
    values.insert(V(0), state.velocity())
    values.insert(B(0), zero)
    lever = np.array(start["lever_b_m"])
    measured = gtsam.PreintegratedImuMeasurements(params, zero)
    for k in range(len(edges) - 1):
        measured.resetIntegration()
        for i in range(edges[k], edges[k + 1]):
            measured.integrateMeasurement(accel[i], gyro[i], step[i])
        graph.add(gtsam.ImuFactor(X(k), V(k), X(k + 1), V(k + 1), B(k), measured))
        graph.add(gtsam.BetweenFactorConstantBias(B(k), B(k + 1), zero, walk))
        graph.add(gtsam.GPSFactorArm(X(k + 1), ned[k], lever, fix_noise))
        state = measured.predict(state, zero)
        # the fix is the better guess of the position: without it the first linearization is kilometres off
        state = gtsam.NavState(gtsam.Pose3(state.attitude(), ned[k]), state.velocity())
        values.insert(X(k + 1), state.pose())
        values.insert(V(k + 1), state.velocity())
        values.insert(B(k + 1), zero)
    return gtsam.LevenbergMarquardtOptimizer(graph, values, gtsam.LevenbergMarquardtParams()).optimize()
