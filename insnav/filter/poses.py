"""Poses: a solution at wanted epochs, and of another point of the vehicle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.attitude import dcm_from_rph, skew
from insnav.earth import earth_rate_n, lla_offset
from insnav.strapdown import TIME_TOLERANCE
from insnav.types import BoolArray, Epochs, FloatArray, IntArray, Trajectory


def on_grid(time: FloatArray, every: float) -> BoolArray:
    """Find the rows whose times (n,) [s] are whole multiples of `every` [s]; all if it is zero."""
    if every <= 0.0:
        return np.ones(time.shape, dtype=np.bool_)
    return np.asarray(np.abs(time - np.round(time / every) * every) < TIME_TOLERANCE)


def rows_of(time: FloatArray, epochs: FloatArray) -> IntArray:
    """Return the rows of `time` (n,) at `epochs` (m,) [s]; epochs without a row are left out."""
    row = np.searchsorted(time, epochs - 2.0 * TIME_TOLERANCE)
    row = row[row < time.size]
    return np.asarray(row[np.abs(time[row] - epochs[: row.size]) < 4.0 * TIME_TOLERANCE], dtype=np.int64)


def covariance_at(time: FloatArray, epochs: Epochs) -> FloatArray:
    """Interpolate the covariance of position, velocity, attitude linearly in time, (n, 9, 9); zero without epochs."""
    if not epochs.time.size:
        return np.zeros((time.size, 9, 9))
    first = np.clip(np.searchsorted(epochs.time, time) - 1, 0, max(epochs.time.size - 2, 0))
    second = np.minimum(first + 1, epochs.time.size - 1)
    step = np.maximum(epochs.time[second] - epochs.time[first], TIME_TOLERANCE)
    share = np.clip((time - epochs.time[first]) / step, 0.0, 1.0)[:, None, None]
    return np.asarray((1.0 - share) * epochs.covariance[first] + share * epochs.covariance[second])


def move_to_point(
    track: Trajectory, w_eb_b: FloatArray, point_b: FloatArray, covariance: FloatArray, rate_sd: FloatArray
) -> Trajectory:
    """Move a trajectory to another point of the rigid vehicle, with its standard deviations.

    Parameters
    ----------
    track : Trajectory
        At the IMU, ``(n,)`` rows.
    w_eb_b : (n, 3) array
        Angular rate relative to the Earth [rad/s].
    point_b : (3,) array
        The point seen from the IMU, body axes [m].
    covariance : (n, 9, 9) array
        Of position [m], velocity [m/s], attitude [rad]: only correlations and attitude are used. `track` has the
        standard deviations of position and velocity, and the least ones of roll, pitch and heading.
    rate_sd : (3,) array
        Standard deviation of the rates [rad/s].

    Notes
    -----
    Groves (2013), section 14.3.1: position ``p + C r``, velocity ``v + C (w_eb x r)``. With ``C_hat = (I - [phi x]) C``
    the error of ``C r`` is ``(C r) x phi``.
    """
    c = dcm_from_rph(track.rph)
    lever_n, slip_n = c @ point_b, np.einsum("nij,nj->ni", c, np.cross(w_eb_b, point_b))
    sd = track.sd
    if sd is not None:
        sd = sd.copy()
        # rows of sd of roll, pitch, heading beyond the covariance: rotation between sensor axes and IMU, and widening
        heading, level = track.rph[:, 2], np.zeros(len(track.time))
        pitch_axis = np.column_stack([-np.sin(heading), np.cos(heading), level])
        axes = np.stack([c[:, :, 0], pitch_axis, np.tile([0.0, 0.0, 1.0], (len(level), 1))], axis=2)
        own = np.linalg.pinv(axes)
        attitude = covariance[:, 6:, 6:]
        more = np.maximum(sd[:, 6:] ** 2 - np.einsum("nij,njk,nik->ni", own, attitude, own), 0.0)
        attitude = attitude + np.einsum("nij,nj,nkj->nik", axes, more, axes)
        turned = c @ skew(point_b)
        noise = [0.0, np.einsum("nij,j->ni", turned**2, rate_sd**2)]
        for by, rows, further in zip((lever_n, slip_n), (slice(0, 3), slice(3, 6)), noise, strict=True):
            s, size = skew(by), np.sqrt(np.maximum(np.einsum("nii->ni", covariance[:, rows, rows]), 1e-30))
            cross = covariance[:, rows, 6:] * (np.minimum(sd[:, rows] / size, 1e6) * (size > 1e-12))[:, :, None]
            variance = sd[:, rows] ** 2 + np.einsum("nij,njk,nik->ni", s, attitude, s) + further
            sd[:, rows] = np.sqrt(np.maximum(variance + 2.0 * np.einsum("nij,nij->ni", cross, s), 0.0))
    return replace(track, lla=lla_offset(track.lla, lever_n), v_n=track.v_n + slip_n, sd=sd)


def poses_of(
    track: Trajectory,
    w_ib_b: FloatArray,
    known: Epochs,
    epochs: FloatArray,
    point_b: FloatArray | None,
    rate_sd: FloatArray,
) -> Trajectory:
    """Take the rows of a solution at `epochs` (all without them), and move them to a point; see `move_to_point`."""
    rows: IntArray | slice = rows_of(track.time, epochs) if epochs.size else slice(None)
    poses = track.rows(rows)
    if point_b is None:
        return poses
    earth = np.einsum("nij,ni->nj", dcm_from_rph(poses.rph), earth_rate_n(poses.lla[:, 0]))
    return move_to_point(poses, w_ib_b[rows] - earth, point_b, covariance_at(poses.time, known), rate_sd)
