"""A platform with errors in a turning vehicle, written down anew: its axes in inertial space, its formulas in E, N, U.

Nothing here is of the package but the motion and the numbers compared: the platform's axes are integrated as a matrix
from them to inertial axes, torqued at the rates computed, and the specific force is brought there from the true level.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insnav.attitude import dcm_from_rph
from insnav.earth import ned_offset
from insnav.gimbal import PlatformErrors, navigate_platform
from insnav.simulate import circle
from insnav.units import DEG, DEG_PER_H, UG
from tests.physics import equations as eq

HEIGHT, STEP = 3000.0, 0.5
ERRORS = PlatformErrors(
    tilt=np.array([3e-4, -5e-4, 2e-3]),
    drift=np.array([0.1, -0.2, 0.3]) * DEG_PER_H,
    bias=np.array([500.0, -300.0, 100.0]) * UG,
)


def level_axes(time: float, lat: float, lon: float) -> np.ndarray:
    """Columns North, East, Down in inertial axes."""
    turned = lon + eq.OMEGA * time
    s, c, sl, cl = np.sin(lat), np.cos(lat), np.sin(turned), np.cos(turned)
    return np.array([[-s * cl, -sl, -c * cl], [-s * sl, cl, -c * sl], [c, 0.0, -s]])


def rates(x: np.ndarray, f_i: np.ndarray) -> np.ndarray:
    """State: latitude, longitude, velocity North, East, axes of the platform in inertial ones."""
    (lat, _, v_n, v_e), c_ip = x[:4], x[4:].reshape(3, 3)
    ry, rx = (radius + HEIGHT for radius in eq.radii(lat))
    f_n, f_e, _ = c_ip.T @ f_i + ERRORS.bias
    harmful = 2.0 * eq.OMEGA * np.sin(lat) + v_e * np.tan(lat) / rx
    w_e, w_n = -v_n / ry, eq.OMEGA * np.cos(lat) + v_e / rx
    w_u = eq.OMEGA * np.sin(lat) + v_e * np.tan(lat) / rx
    torqued = np.array([w_n, w_e, -w_u]) + ERRORS.drift
    level = [v_n / ry, v_e / (rx * np.cos(lat)), f_n - harmful * v_e + eq.gravity(lat, HEIGHT)[0], f_e + harmful * v_n]
    return np.concatenate([level, (c_ip @ eq.cross(torqued)).ravel()])


@pytest.mark.parametrize("lat_deg", [48.0, -70.0])
def test_a_platform_with_errors_in_a_turning_vehicle(lat_deg):
    truth = circle(np.array([lat_deg * DEG, 3.1, HEIGHT]), 150.0, 0.01, 600.0)
    time = np.arange(round(600.0 / STEP) * 2 + 1) * STEP / 2.0
    at = truth.evaluate(time)
    f_n = np.einsum("nij,nj->ni", dcm_from_rph(at.rph), at.f_b)
    axes = [level_axes(t, *lla[:2]) for t, lla in zip(time, at.lla, strict=True)]
    f_i = [c @ f for c, f in zip(axes, f_n, strict=True)]
    x = np.concatenate(
        [at.lla[0, :2], at.v_n[0, :2], (axes[0] @ Rotation.from_rotvec(ERRORS.tilt).as_matrix()).ravel()]
    )
    for k in range(0, len(time) - 2, 2):
        a = rates(x, f_i[k])
        b = rates(x + 0.5 * STEP * a, f_i[k + 1])
        c = rates(x + 0.5 * STEP * b, f_i[k + 1])
        x = x + STEP / 6.0 * (a + 2.0 * b + 2.0 * c + rates(x + STEP * c, f_i[k + 2]))
    run = navigate_platform(time[::2], f_n[::2], at.lla[0], at.v_n[0], errors=ERRORS)
    end = run.solution
    assert np.linalg.norm(ned_offset(end.lla[-1:], at.lla[-1:])) > 500.0
    assert np.abs(ned_offset(end.lla[-1:], np.array([[*x[:2], HEIGHT]]))).max() < 1e-6
    assert np.abs(end.v_n[-1, :2] - x[2:4]).max() < 1e-9
    tilt = Rotation.from_matrix(axes[-1].T @ x[4:].reshape(3, 3)).as_rotvec()
    assert np.abs(run.tilt[-1] - tilt).max() < 1e-12
