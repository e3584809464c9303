"""Attitude: quaternions, direction cosine matrices, rotation vectors, roll-pitch-heading.

``q_nb`` (scalar first) and ``C_nb`` take body coordinates to navigation coordinates: ``v_n = C_nb @ v_b``. Roll, pitch
and heading are the rotations about the forward, right and down axis, heading first (z-y-x). At pitch +90 deg only
heading minus roll is defined, at -90 deg only their sum. Both angles are then returned as computed.

References
----------
Groves, "Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems", 2nd ed., 2013, section 2.2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from insnav.types import FloatArray


def wrap_pi(angle: ArrayLike) -> FloatArray:
    """Wrap an angle to [-pi, pi) [rad]."""
    return np.asarray((np.asarray(angle, dtype=float) + np.pi) % (2 * np.pi) - np.pi)


def wrap_two_pi(angle: ArrayLike) -> FloatArray:
    """Wrap an angle to [0, 2 pi) [rad]."""
    wrapped = np.asarray(np.asarray(angle, dtype=float) % (2 * np.pi))
    return np.where(wrapped >= 2 * np.pi, 0.0, wrapped)  # rounding turns a tiny negative angle into 2 pi


def skew(v: ArrayLike) -> FloatArray:
    """Build the matrix (..., 3, 3) of the cross product with v (..., 3): ``skew(v) @ u = v x u`` (Groves, eq. 2.50)."""
    v = np.asarray(v, dtype=float)
    matrix = np.zeros((*v.shape, 3))
    matrix[..., [2, 0, 1], [1, 2, 0]] = v
    matrix[..., [1, 2, 0], [2, 0, 1]] = -v
    return matrix


def quat_multiply(p: ArrayLike, q: ArrayLike) -> FloatArray:
    """Multiply quaternions ``(..., 4)``: the rotation `q` followed by `p` (Groves 2013, appendix E.6)."""
    p0, p1, p2, p3 = np.moveaxis(np.asarray(p, dtype=float), -1, 0)
    q0, q1, q2, q3 = np.moveaxis(np.asarray(q, dtype=float), -1, 0)
    return np.stack(
        [
            p0 * q0 - p1 * q1 - p2 * q2 - p3 * q3,
            p0 * q1 + p1 * q0 + p2 * q3 - p3 * q2,
            p0 * q2 - p1 * q3 + p2 * q0 + p3 * q1,
            p0 * q3 + p1 * q2 - p2 * q1 + p3 * q0,
        ],
        axis=-1,
    )


def quat_conjugate(q: ArrayLike) -> FloatArray:
    """Return the inverse rotation of a unit quaternion, (..., 4)."""
    return np.asarray(np.asarray(q, dtype=float) * np.array([1.0, -1.0, -1.0, -1.0]))


def quat_from_rotvec(rotvec: ArrayLike) -> FloatArray:
    """Convert a rotation vector ``(..., 3)``, axis times angle [rad], to a unit quaternion ``(..., 4)``."""
    rotvec = np.asarray(rotvec, dtype=float)
    half = 0.5 * np.linalg.norm(rotvec, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * rotvec], axis=-1)


def rotvec_from_quat(q: ArrayLike) -> FloatArray:
    """Convert a unit quaternion ``(..., 4)`` to a rotation vector ``(..., 3)`` [rad], of length at most pi."""
    q = np.asarray(q, dtype=float)
    q = np.where(q[..., :1] < 0, -q, q)
    s = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    half = np.arctan2(s, q[..., :1])
    return np.asarray(2.0 * q[..., 1:] / np.sinc(half / np.pi))


def dcm_from_quat(q: ArrayLike) -> FloatArray:
    """Convert a unit quaternion ``q_nb`` (..., 4) to ``C_nb`` (..., 3, 3) (Groves 2013, eq. 2.34)."""
    a, b, c, d = np.moveaxis(np.asarray(q, dtype=float), -1, 0)
    return np.stack(
        [
            np.stack([a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)], -1),
            np.stack([2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)], -1),
            np.stack([2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d], -1),
        ],
        -2,
    )


def quat_from_rph(rph: ArrayLike) -> FloatArray:
    """Convert roll, pitch, heading ``(..., 3)`` [rad] to a quaternion ``q_nb`` ``(..., 4)`` (Groves 2013, eq. 2.38)."""
    half = 0.5 * np.asarray(rph, dtype=float)
    cr, cp, ch = np.moveaxis(np.cos(half), -1, 0)
    sr, sp, sh = np.moveaxis(np.sin(half), -1, 0)
    return np.stack(
        [
            cr * cp * ch + sr * sp * sh,
            sr * cp * ch - cr * sp * sh,
            cr * sp * ch + sr * cp * sh,
            cr * cp * sh - sr * sp * ch,
        ],
        axis=-1,
    )


def rph_from_quat(q: ArrayLike) -> FloatArray:
    """Convert a unit quaternion ``q_nb`` ``(..., 4)`` to roll, pitch, heading (Groves 2013, eq. 2.38, inverted).

    Returns: (..., 3): roll in [-pi, pi), pitch in [-pi/2, pi/2], heading in [0, 2 pi) [rad].
    """
    a, b, c, d = np.moveaxis(np.asarray(q, dtype=float), -1, 0)
    # By eq. 2.38, a + c and d - b are u cos(x) and u sin(x) with x = (heading - roll) / 2. Also, a - c and d + b are
    # v cos(y) and v sin(y) with y = (heading + roll) / 2. Here u and v are sqrt(2) times sine and cosine of
    # pitch / 2 + 45 deg. At pitch -90 deg u is zero and x arbitrary, at +90 deg v is zero and y arbitrary. The three
    # returned angles still describe the attitude exactly.
    half_difference, half_sum = np.arctan2(d - b, a + c), np.arctan2(d + b, a - c)
    pitch = 2 * np.arctan2(np.hypot(a + c, d - b), np.hypot(a - c, d + b)) - np.pi / 2
    return np.stack([wrap_pi(half_sum - half_difference), pitch, wrap_two_pi(half_sum + half_difference)], axis=-1)


def dcm_from_rph(rph: ArrayLike) -> FloatArray:
    """Convert roll, pitch, heading (..., 3) [rad] to ``C_nb`` (..., 3, 3)."""
    return dcm_from_quat(quat_from_rph(rph))


def rph_by_turn(dcm: ArrayLike, turn: ArrayLike) -> FloatArray:
    """Compute the change of roll, pitch, heading by small rotations about North, East, Down; invalid near the vertical.

    `dcm` (..., 3, 3): ``C_nb``; `turn` (..., 3) [rad] (Euler rates: Groves 2013, eq. 2.58). Returns: (..., 3) [rad].
    """
    c, turn = np.asarray(dcm, dtype=float), np.asarray(turn, dtype=float)
    cos_pitch = np.hypot(c[..., 0, 0], c[..., 1, 0])
    ahead = (c[..., 0, 0] * turn[..., 0] + c[..., 1, 0] * turn[..., 1]) / cos_pitch
    right = (c[..., 0, 0] * turn[..., 1] - c[..., 1, 0] * turn[..., 0]) / cos_pitch
    return np.stack([ahead / cos_pitch, right, turn[..., 2] - c[..., 2, 0] * ahead / cos_pitch], axis=-1)


def quat_from_dcm(dcm: ArrayLike) -> FloatArray:
    """Convert a direction cosine matrix to a quaternion, starting from its largest component (Shepperd 1978).

    `dcm` (..., 3, 3): ``C_nb``.
    Returns: (..., 4): unit quaternion with a non-negative scalar part.
    """
    m = np.asarray(dcm, dtype=float)
    trace = m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2]
    squares = np.stack([trace, m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]], axis=-1)
    # Row i of the matrix k is 4 q_i q. Every row gives q; the row with the largest diagonal loses no digits.
    k = np.zeros((*m.shape[:-2], 4, 4))
    k[..., 0, 0] = 1 + trace
    for i in range(3):
        j, n = (i + 1) % 3, (i + 2) % 3
        k[..., 0, i + 1] = k[..., i + 1, 0] = m[..., n, j] - m[..., j, n]
        k[..., i + 1, i + 1] = 1 + 2 * m[..., i, i] - trace
        k[..., i + 1, j + 1] = k[..., j + 1, i + 1] = m[..., i, j] + m[..., j, i]
    largest = np.argmax(squares, axis=-1)[..., None, None]
    q = np.take_along_axis(k, np.broadcast_to(largest, (*m.shape[:-2], 1, 4)), axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.asarray(np.where(q[..., :1] < 0, -q, q))
