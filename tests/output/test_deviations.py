"""Standard deviations of roll, pitch and heading, and of the clock error's share, against numerical derivatives."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from insnav.attitude import dcm_from_rph, quat_from_rph
from insnav.kernels import output

RPH = np.array([[0.3, -0.4, 2.0], [0.3, -0.4, -2.0], [-0.8, 1.2, 0.5], [0.1, 0.2, -1e-20]])


def by_phi(rph: np.ndarray) -> np.ndarray:
    """Derivative of roll, pitch, heading of ``(I - [phi x]) C`` by phi."""
    c, step = Rotation.from_matrix(dcm_from_rph(rph)), 1e-6
    ends = [[(Rotation.from_rotvec(-way * e) * c).as_euler("ZYX")[::-1] for e in np.eye(3)] for way in (step, -step)]
    return np.asarray((np.subtract(*ends) / (2.0 * step)).T)


def test_deviations_of_angles_follow_from_the_covariance_of_the_attitude():
    """Rows 1 and 3 are known; row 2 is between them, row 0 before the first; headings are within one turn."""
    rng = np.random.default_rng(4)
    time, known, axes_sd = np.array([0.0, 1.0, 1.5, 3.0]), np.array([1, 3]), np.array([1e-3, 2e-3, 3e-3])
    root = 0.01 * rng.standard_normal((2, 3, 3))
    p, own = root @ np.swapaxes(root, 1, 2), rng.uniform(0.01, 2.0, (2, 6))
    variance = np.column_stack([own, p[:, [0, 1, 2], [0, 1, 2]], p[:, 0, 1], p[:, 0, 2], p[:, 1, 2]])
    rph, sd = RPH.copy(), np.full((4, 9), np.nan)
    output.deviations(time, known, variance, axes_sd, rph, sd)
    for row, each, of in zip(known, p, own, strict=True):
        by = by_phi(RPH[row])
        wanted = np.sqrt(np.append(of, np.diag(by @ each @ by.T) + axes_sd**2))
        np.testing.assert_allclose(sd[row], wanted, rtol=1e-6)
    np.testing.assert_array_equal(sd[0], sd[1])
    np.testing.assert_allclose(sd[2], 0.75 * sd[1] + 0.25 * sd[3], rtol=1e-12)
    np.testing.assert_allclose(rph[:, 2], [2.0, 2.0 * np.pi - 2.0, 0.5, 0.0], rtol=1e-15)


def test_an_error_of_the_clock_moves_velocity_and_attitude_along_the_motion():
    """Variances of a state that is taken at another time, against the covariance of the motion times the error."""
    state = np.concatenate([np.zeros((2, 6)), quat_from_rph(RPH[:2])], axis=1)
    rate, acceleration = np.array([0.3, -0.2, 0.5]), np.array([1.0, -2.0, 0.5])
    variance = np.ones((1, 12))
    output.add_moved(state, np.array([1]), np.concatenate([rate, acceleration])[None], 0.02, variance)
    turned = dcm_from_rph(RPH[1]) @ rate
    moved = 0.02 * np.concatenate([np.zeros(3), acceleration, turned])
    products = 0.02**2 * np.array([turned[0] * turned[1], turned[0] * turned[2], turned[1] * turned[2]])
    np.testing.assert_allclose(variance[0] - 1.0, np.append(moved**2, products), rtol=1e-9)
