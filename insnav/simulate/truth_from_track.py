"""Conversion of a recorded track to an exact motion: the simulated replica of a drive.

Splines are fitted jointly to position and velocity, and to attitude. Motion faster than their knots, mainly vibration,
is lost. The result is an exact motion close to the recorded one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, PchipInterpolator
from scipy.linalg import solveh_banded
from scipy.sparse import csr_array, diags_array

from insnav.earth import components, metres_per_unit, ned_offset
from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.simulate.truth import LevelTruth, Spline, Truth, spline_of
from insnav.types import FloatArray, Trajectory

_SPACING = 0.2  # knot spacing, unless the track has fewer than two rows in this time [s]
_DEGREE = 5
# fit tolerances of positions and velocities: only their ratio matters, and velocity is smoother
_POSITION_SD, _VELOCITY_SD, _ANGLE_SD = 0.05, 0.02, 1e-3
_STIFFNESS = 1e-3  # weight of the penalty that bridges gaps, relative to a position: far below the weight of a row
_MOVING = 1.0  # speed above which the course is used as heading [m/s]
_PASSES = 5  # iterations of the robust fit
_FAR = 3.0  # residual, in standard deviations, with half weight
_FEWEST = 20  # smallest number of rows of a track
_FAR_OFF = 1.0  # rms position difference beyond which a replica is doubtful [m]
_WILD = 10.0  # acceleration over ground beyond which a replica is doubtful [m/s^2]
_LONG_GAP = 3.0  # time without a row beyond which a replica is doubtful [s]
_GAP = 1.0  # time without a row beyond which rows are interpolated [s]
_LOOK = 0.05  # interval between the examined accelerations [s]
_STEEPEST, _HIGHEST_LATITUDE = math.radians(80.0), math.radians(85.0)


def truth_from_track(track: Trajectory) -> LevelTruth:
    """Build an exact motion close to a track.

    `track`: positions, with velocities and attitudes where known. Without attitude the heading is the course, the pitch
    the climb angle, and the roll zero. Gaps are bridged without overshoot.
    Returns: from the first row to the last, continuous in four derivatives.
    Raises: InputError: fewer than 20 rows, within 5 deg of a pole, or a pitch beyond 80 deg.

    Notes
    -----
    Penalised spline (Eilers and Marx, "Flexible smoothing with B-splines and penalties", Statistical Science 11 (1996)
    89-121) of degree five with knots every 0.2 s. Weighted least squares fit positions and velocities; the penalty only
    bridges gaps.
    """
    if len(track.time) < _FEWEST:
        raise InputError("sim.short_track", count=len(track.time), limit=_FEWEST)
    if np.abs(track.lla[:, 0]).max() > _HIGHEST_LATITUDE:
        raise InputError("sim.track_near_pole", limit_rad=0.5 * math.pi - _HIGHEST_LATITUDE)
    rph = _attitude(track)
    track, rph = _bridged(track, rph)
    if np.abs(rph[:, 1]).max() > _STEEPEST:
        raise InputError("sim.steep_track", limit_rad=_STEEPEST)
    start, duration = float(track.time[0]), float(track.time[-1] - track.time[0])
    tau = track.time - start
    origin = track.lla[0].copy()
    scale = metres_per_unit(track.lla)
    offset = track.lla - origin
    offset[:, 1] = np.unwrap(track.lla[:, 1]) - origin[1]
    rates = track.v_n * [1.0, 1.0, -1.0] / scale
    spacing = max(_SPACING, 2.0 * float(np.median(np.diff(tau))))
    size = scale.mean(axis=0)
    coefficients = [
        _fitted(tau, duration, spacing, offset[:, i] * size[i], rates[:, i] * size[i]) / size[i] for i in range(3)
    ]
    angle_coefficients = [_fitted(tau, duration, spacing, rph[:, i] / _ANGLE_SD * _POSITION_SD, None) for i in range(3)]
    position = _curve(duration, spacing, np.column_stack(coefficients))
    attitude = _curve(duration, spacing, np.column_stack(angle_coefficients) * (_ANGLE_SD / _POSITION_SD))
    return LevelTruth(origin, position, attitude, duration, start)


@dataclass(frozen=True, slots=True)
class Residual:
    """Differences between a motion and its track, and extreme values of both."""

    # root mean square of the differences [m], [m/s]; NaN without velocities in the track
    position: float
    velocity: float
    # largest difference of position [m], and its time [s]
    farthest: float
    farthest_time: float
    # largest acceleration over ground of the motion [m/s^2], and its time [s]
    acceleration: float
    acceleration_time: float
    # longest time without a row [s], and its start [s]
    gap: float
    gap_time: float

    @property
    def doubts(self) -> tuple[Finding, ...]:
        """Findings that make it doubtful that the motion is a replica of the drive."""
        rms, acceleration, gap = self.position, self.acceleration, self.gap
        farthest_time, jump, begin = self.farthest_time, self.farthest, self.gap_time
        far = Finding.of(Code.REPLICA_FAR, farthest_time, rms_m=rms, limit_m=_FAR_OFF, farthest_m=jump)
        wild = Finding.of(Code.REPLICA_WILD, self.acceleration_time, acceleration_m_s2=acceleration, limit_m_s2=_WILD)
        absent = Finding.of(Code.REPLICA_GAP, begin, begin + gap, gap_s=gap, limit_s=_LONG_GAP)
        checks = (rms <= _FAR_OFF, far), (acceleration <= _WILD, wild), (gap <= _LONG_GAP, absent)
        return tuple(finding for plausible, finding in checks if not plausible)


def track_residual(truth: Truth, track: Trajectory) -> Residual:
    """Compute the differences between a motion and the track from which it was built."""
    kinematics = truth.evaluate(track.time)
    distance = np.linalg.norm(ned_offset(track.lla, kinematics.lla), axis=1)
    has_velocity = np.isfinite(track.v_n).all(axis=1)
    velocity_error = np.linalg.norm((track.v_n - kinematics.v_n)[has_velocity], axis=1)
    time: FloatArray = truth.start + np.arange(math.floor(truth.duration / _LOOK) + 1.0) * _LOOK
    acceleration = np.linalg.norm(np.gradient(truth.evaluate(time).v_n, _LOOK, axis=0), axis=1)
    farthest, peak, gap = int(np.argmax(distance)), int(np.argmax(acceleration)), int(np.argmax(np.diff(track.time)))
    return Residual(
        float(np.sqrt(np.mean(distance**2))),
        float(np.sqrt(np.mean(velocity_error**2))) if len(velocity_error) else math.nan,
        float(distance[farthest]),
        float(track.time[farthest]),
        float(acceleration[peak]),
        float(time[peak]),
        float(track.time[gap + 1] - track.time[gap]),
        float(track.time[gap]),
    )


def _knots(duration: float, spacing: float) -> FloatArray:
    """Build evenly spaced knots from the first instant to the last, with repeated outer knots."""
    inner = np.linspace(0.0, duration, max(2, math.ceil(duration / spacing) + 1))
    return np.concatenate([np.zeros(_DEGREE), inner, np.full(_DEGREE, duration)])


def _fitted(
    t: FloatArray, duration: float, spacing: float, values: FloatArray, slopes: FloatArray | None
) -> FloatArray:
    """Fit spline coefficients (k,) to values (n,) [m] at times `t` (n,) [s], and to slopes (n,) [m/s] where known.

    Outliers are de-weighted (Cauchy's weights, Huber and Ronchetti, "Robust Statistics", 2009, chapter 7): a receiver's
    track has jumps.
    """
    knots = _knots(duration, spacing)
    count = len(knots) - _DEGREE - 1
    t = np.clip(t, 0.0, duration)
    basis = csr_array(BSpline.design_matrix(t, knots, _DEGREE))
    ones = np.ones(count)  # for the penalty on third differences of the coefficients
    third_difference = csr_array(
        diags_array([-ones[3:], 3 * ones[3:], -3 * ones[3:], ones[3:]], offsets=[0, 1, 2, 3], shape=(count - 3, count))
    )
    rows = [(basis, values, _POSITION_SD)]
    has_slope = np.isfinite(slopes) if slopes is not None else np.zeros(len(t), dtype=np.bool_)
    if slopes is not None and has_slope.any():
        span = knots[_DEGREE + 1 : _DEGREE + count] - knots[1:count]
        ends = np.full(count - 1, float(_DEGREE)) / span
        change = csr_array(diags_array([-ends, ends], offsets=[0, 1], shape=(count - 1, count)))
        lower = csr_array(BSpline.design_matrix(t[has_slope], knots[1:-1], _DEGREE - 1))
        rows.append((csr_array(lower @ change), slopes[has_slope], _VELOCITY_SD))
    weights = [np.full(len(known_values), 1.0 / sd**2) for _, known_values, sd in rows]
    coefficients: FloatArray = np.zeros(count)
    for _ in range(_PASSES):
        normal = csr_array(_STIFFNESS / _POSITION_SD**2 * (third_difference.T @ third_difference))
        right_side = np.zeros(count)
        for (matrix, known_values, _), weight in zip(rows, weights, strict=True):
            weighed = csr_array(matrix.T @ diags_array(weight))
            normal = csr_array(normal + weighed @ matrix)
            right_side += weighed @ known_values
        bands = np.zeros((_DEGREE + 1, count))  # upper bands of the normal matrix
        for k in range(_DEGREE + 1):
            bands[_DEGREE - k, k:] = normal.diagonal(k)
        coefficients = np.asarray(solveh_banded(bands, right_side))
        for i, (matrix, known_values, least_sd) in enumerate(rows):
            residual = known_values - matrix @ coefficients
            sd = max(least_sd, 1.4826 * float(np.median(np.abs(residual))))
            weights[i] = 1.0 / (sd**2 + (residual / _FAR) ** 2)  # Cauchy's weights
    return coefficients


def _curve(duration: float, spacing: float, coefficients: FloatArray) -> Spline:
    return spline_of(BSpline(_knots(duration, spacing), coefficients, _DEGREE))


def _attitude(track: Trajectory) -> FloatArray:
    """Return roll, pitch and heading without jumps (n, 3) [rad]; unknown attitude follows from the velocity."""
    rph = track.rph.copy()
    has_rph = np.isfinite(rph).all(axis=1)
    if not has_rph.all():
        mean_velocity = np.gradient(ned_offset(track.lla, track.lla[0]), track.time, axis=0)
        v_north, v_east, v_down = components(np.where(np.isfinite(track.v_n), track.v_n, mean_velocity))
        over_ground = np.hypot(v_north, v_east)
        moving = over_ground > _MOVING
        rph[~has_rph, 0] = 0.0
        rph[~has_rph, 1] = np.where(moving, np.arctan2(-v_down, np.maximum(over_ground, _MOVING)), 0.0)[~has_rph]
        usable = has_rph | moving
        if not usable.any():
            rph[:, 2] = 0.0
        else:
            course = np.where(has_rph, rph[:, 2], np.arctan2(v_east, v_north))
            rph[:, 2] = np.interp(track.time, track.time[usable], np.unwrap(course[usable]))
    rph[:, 2] = np.unwrap(rph[:, 2])
    return rph


def _bridged(track: Trajectory, rph: FloatArray) -> tuple[Trajectory, FloatArray]:
    """Add rows in gaps of track and attitude, where a smooth spline alone would overshoot.

    Shape-preserving cubics (Fritsch and Carlson, SIAM J. Numer. Anal. 17 (1980) 238-246) stay within the range of the
    neighbouring rows.
    """
    steps = np.diff(track.time)
    median_step = float(np.median(steps))
    wide = np.flatnonzero(steps > max(_GAP, 3.0 * median_step))  # steps that are gaps in the track
    if not len(wide):
        return track, rph
    spacing = max(_SPACING, median_step)
    new = np.concatenate([np.arange(track.time[i] + spacing, track.time[i + 1] - 0.5 * spacing, spacing) for i in wide])
    time = np.concatenate([track.time, new])
    order = np.argsort(time)
    unwrapped = np.column_stack([track.lla[:, 0], np.unwrap(track.lla[:, 1]), track.lla[:, 2]])
    lla, rph = (np.concatenate([rows, PchipInterpolator(track.time, rows)(new)])[order] for rows in (unwrapped, rph))
    v_n = np.concatenate([track.v_n, np.full((len(new), 3), np.nan)])[order]
    return Trajectory(time[order], lla, v_n, rph), rph
