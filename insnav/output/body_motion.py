"""Angular rate and acceleration of a vehicle, from the rows of its trajectory."""

from __future__ import annotations

import numpy as np

from insnav.attitude import dcm_from_rph, quat_conjugate, quat_from_rph, quat_multiply
from insnav.earth import transport_rate_n
from insnav.spline import Spline
from insnav.types import FloatArray, Trajectory

_GAP = 2.0  # median steps: a spline across a longer one would swing [-]
_FEWEST = 4  # rows of a spline


def body_motion(track: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Differentiate attitude and velocity by cubic splines.

    Returns: rate ``w_eb_b`` (n, 3) [rad/s] and acceleration over ground (n, 3) [m/s^2], body axes: without rotation and
    gravity of the Earth. Zero in parts of fewer than four rows between gaps, NaN where the trajectory is unknown.
    """
    q = quat_from_rph(track.rph)
    turned = np.where(np.sum(q[1:] * q[:-1], axis=1) < 0.0, -1.0, 1.0)
    q *= np.concatenate([[1.0], np.cumprod(turned)])[:, None]
    slope = np.zeros((len(q), 7))
    step = np.diff(track.time)
    for rows in np.split(np.arange(len(q)), np.flatnonzero(step > _GAP * np.median(step)) + 1):
        if len(rows) >= _FEWEST:
            time = track.time[rows]
            slope[rows] = Spline(time, np.hstack([q, track.v_n])[rows]).changes(time)[0]
    to_body = np.swapaxes(dcm_from_rph(track.rph), 1, 2)
    over = transport_rate_n(track.lla[:, 0], track.lla[:, 2], track.v_n)
    acceleration = slope[:, 4:] + np.cross(over, track.v_n)
    rate = 2.0 * quat_multiply(quat_conjugate(q), slope[:, :4])[:, 1:] + np.einsum("nij,nj->ni", to_body, over)
    return rate, np.einsum("nij,nj->ni", to_body, acceleration)
