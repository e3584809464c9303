"""The rotation of the Earth is in the gyros of a stationary IMU, and neither a bias nor a turn."""

from __future__ import annotations

import numpy as np

from insnav.alignment.static import StationaryMeans, gyro_bias
from insnav.attitude import dcm_from_rph, quat_from_rph
from insnav.earth import earth_rate_n, gravity_n
from insnav.imu.specification import ImuSpec, SensorSpec
from insnav.kernels.alignment import gyro_history
from insnav.units import DEG, DEG_PER_H

LAT = 0.8
RPH = np.array([0.3, -0.2, 2.0])


def test_the_gyro_bias_is_what_the_earth_rate_does_not_explain():
    bias = np.array([3.0, -2.0, 5.0]) * DEG_PER_H
    rate = dcm_from_rph(RPH).T @ earth_rate_n(LAT) + bias
    means = StationaryMeans(0.0, 100.0, rate, np.zeros(3), np.zeros(3), np.zeros(3))
    found, _ = gyro_bias(means, ImuSpec("any", SensorSpec(), SensorSpec()), RPH, 0.1 * DEG, LAT)
    np.testing.assert_allclose(found, bias, rtol=1e-9)


def test_a_stationary_imu_keeps_its_attitude_and_feels_gravity_along_down():
    n, dt = 6000, 0.1  # ten minutes: the Earth turns by 2.5 deg
    c = dcm_from_rph(RPH)
    force = c.T @ -gravity_n(LAT, 0.0)
    q, u = np.empty((n + 1, 4)), np.empty((n + 1, 3))
    turn, push = np.tile(c.T @ earth_rate_n(LAT) * dt, (n, 1)), np.tile(force * dt, (n, 1))
    gyro_history(quat_from_rph(RPH), earth_rate_n(LAT), np.full(n, dt), turn, push, q, u)
    np.testing.assert_allclose(q[-1], q[0], atol=1e-9)
    np.testing.assert_allclose(u[-1], -gravity_n(LAT, 0.0) * n * dt, atol=1e-5)
