"""Errors of a trajectory against a reference of the same drive, summary statistics, comparison of several runs.

Error is estimate minus truth, at the epochs of the reference. Cubic Hermite interpolation of position brings the
estimate to those epochs, with errors below a millimetre at 10 Hz. Several runs are compared at their common epochs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import chain, count
from operator import itemgetter
from typing import Any, ClassVar, NamedTuple

import numpy as np

from insnav import attitude, spill
from insnav.earth import lla_offset, ned_offset
from insnav.exceptions import InputError
from insnav.input.interpret.overlap import LEAP, ZONE, named_offset
from insnav.sample_statistics import rms
from insnav.tabular import Tabular, unit_of
from insnav.types import BoolArray, FloatArray, GpsData, IntArray, Trajectory

EPOCHS = 500  # number of reference epochs in a search, enough to resolve the turns of a drive
FEWEST = 10  # least number of common epochs
# a reference of another drive differs from the fixes by more than this [m], and than this share of the drive's extent
APART, OTHERWISE = 50.0, 0.5
ALIKE = 0.1  # tracks agree if they differ by less than this share of their extent [-]
MOVING_M_S = 0.5  # a faster vehicle counts as moving
LONGEST_STEP = 2.0  # a step longer than this many median steps is a gap, without interpolation
_SAME_TIME = 1e-6  # tolerance of equal times, for their rounding [steps]


def other_drive(reference: Trajectory, track: Trajectory, gps: GpsData | None) -> float:
    """Return the median distance of a reference of another drive from the fixes [m]; zero if the drive is the same.

    The reference of another drive does not follow the fixes, whereas the track does.
    """
    if gps is None:
        return 0.0
    inside = (gps.time >= reference.time[0]) & (gps.time <= reference.time[-1]) & np.isfinite(gps.lla[:, 0])
    inside &= (gps.time >= track.time[0]) & (gps.time <= track.time[-1])
    if np.count_nonzero(inside) < FEWEST:
        return 0.0
    time, fixes = gps.time[inside], gps.lla[inside]
    origin = np.median(fixes, axis=0)
    fixed = ned_offset(fixes, origin)[:, :2]
    offset, misfit = (_at(time, each.time, ned_offset(each.lla, origin)) - fixed for each in (reference, track))
    if _spread(offset) < max(APART, OTHERWISE * _spread(fixed)) or _spread(misfit) > ALIKE * _spread(offset):
        return 0.0
    return float(np.median(np.linalg.norm(offset, axis=1)))


def no_time_in_common(reference: Trajectory, track: Trajectory) -> InputError:
    """Build the error for no common time; suggest a clock offset of half hours and leap seconds if the tracks match."""
    values: dict[str, Any] = {"reference_s": tuple(reference.time[[0, -1]]) if len(reference.time) else ()}
    values |= {"solution_s": tuple(track.time[[0, -1]]) if len(track.time) else ()}
    offset, distance = _hours_off(reference, track)
    if not offset:
        return InputError("ref.no_common_time", **values)
    values |= named_offset(offset, 0.0)[1]
    return InputError("ref.no_common_time_offset", offset_s=offset, apart_m=distance, **values)


def apart(reference: Trajectory, track: Trajectory) -> Callable[[float], FloatArray]:
    """Return a function of the lead of the reference clock [s]: reference minus track North, East, (k, 2) [m]."""
    rows = np.unique(np.linspace(0, len(reference.time) - 1, EPOCHS).astype(np.int64))
    time, origin = reference.time[rows], track.lla[0]
    there, here = ned_offset(reference.lla[rows], origin)[:, :2], ned_offset(track.lla, origin)

    def at(late: float) -> FloatArray:
        inside = (time - late >= track.time[0]) & (time - late <= track.time[-1])
        return np.asarray(there[inside] - _at(time[inside] - late, track.time, here))

    return at


def _hours_off(reference: Trajectory, track: Trajectory) -> tuple[float, float]:
    """Find the clock offset in half hours and leap seconds that matches two tracks [s], and their distance [m]."""
    if not (len(reference.time) and len(track.time)):
        return 0.0, 0.0
    difference = apart(reference, track)
    earliest, latest = track.time[0] - reference.time[-1], track.time[-1] - reference.time[0]
    zones = ZONE * np.arange(np.floor((earliest - LEAP) / ZONE), np.ceil((latest + LEAP) / ZONE) + 1.0)
    best = (0.0, ALIKE * _spread(ned_offset(track.lla, track.lla[0])[:, :2]))
    for offset in (zones[:, None] + [0.0, LEAP, -LEAP]).ravel():
        if len(gap := difference(-offset)) >= FEWEST:
            best = min(best, (float(offset), float(np.median(np.linalg.norm(gap, axis=1)))), key=itemgetter(1))
    return best


def _at(time: FloatArray, known: FloatArray, place: FloatArray) -> FloatArray:
    """Interpolate places (n, 2 or 3) North, East at other times, (m, 2)."""
    return np.column_stack([np.interp(time, known, axis) for axis in place.T[:2]])


def _spread(place: FloatArray) -> float:
    """Compute the median distance of places from their median place [m]."""
    return float(np.median(np.linalg.norm(place - np.median(place, axis=0), axis=1)))


@dataclass(frozen=True, slots=True)
class TrajectoryErrors(Tabular):
    """Estimate minus truth at the epochs of the reference that the estimate covers."""

    COLUMNS: ClassVar = {
        "time": ("time_s",),
        "position": ("north_m", "east_m", "down_m"),
        "velocity": ("velocity_north_m_s", "velocity_east_m_s", "velocity_down_m_s"),
        "attitude": ("roll_deg", "pitch_deg", "heading_deg"),
        "sd": Trajectory.COLUMNS["sd"],
        "speed": ("speed_m_s",),
    }

    time: FloatArray  # (m,) epochs of the reference [s]
    position: FloatArray  # (m, 3) error North, East, Down [m]
    velocity: FloatArray  # (m, 3) error North, East, Down [m/s]; ``NaN`` where the reference has no velocity
    # (m, 3) error in roll, pitch, heading [rad], within +-pi; ``NaN`` where the reference has no attitude
    attitude: FloatArray
    sd: FloatArray | None  # (m, 9) stated standard deviation of the estimate, columns as in `Trajectory`
    speed: FloatArray  # (m,) speed of the reference, or of the estimate if the reference has none [m/s]

    @property
    def moving(self) -> BoolArray:
        """Epochs faster than `MOVING_M_S`, (m,)."""
        return np.asarray(self.speed > MOVING_M_S, dtype=np.bool_)

    @property
    def horizontal(self) -> FloatArray:
        """Length of the horizontal position error, (m,) [m]."""
        return np.hypot(self.position[:, 0], self.position[:, 1])


def position_errors(
    estimate: Trajectory, reference: Trajectory, *, lever_b: FloatArray | None = None
) -> TrajectoryErrors:
    """Compute errors of position, velocity and attitude at the epochs of the reference.

    Reference epochs outside the estimate's span, or inside one of its gaps, are omitted.

    `estimate`: trajectory to evaluate; interpolation uses its velocity, the lever arm its attitude. `lever_b` (3,): the
    point of the reference seen from the point of the estimate, body axes [m].
    Raises: InputError: no epoch of the reference lies inside the estimate.
    """
    if lever_b is not None:
        estimate = at_point(estimate, lever_b)
    index, share, covered = _brackets(estimate.time, reference.time)
    if not covered.any():
        raise no_time_in_common(reference, estimate)
    index, share = index[covered], share[covered]
    truth = np.flatnonzero(covered)
    lla, v_n, rph, sd = _interpolated(estimate, index, share)
    speed = np.linalg.norm(reference.v_n[truth], axis=1)
    return TrajectoryErrors(
        time=reference.time[truth],
        position=ned_offset(lla, reference.lla[truth]),
        velocity=v_n - reference.v_n[truth],
        attitude=attitude.wrap_pi(rph - reference.rph[truth]),
        sd=sd,
        speed=np.where(np.isfinite(speed), speed, np.linalg.norm(v_n, axis=1)),
    )


def interpolated(track: Trajectory, time: FloatArray) -> Trajectory:
    """Interpolate a trajectory at times (m,) [s], without times outside it or in its gaps; see `_interpolated`."""
    index, share, covered = _brackets(track.time, time)
    return Trajectory(time[covered], *_interpolated(track, index[covered], share[covered]))


def on_clock(errors: TrajectoryErrors, track: Trajectory, late: float) -> TrajectoryErrors:
    """Correct the position errors of a track for a reference clock that leads by `late` [s]."""
    spans = (_brackets(time, errors.time) for time in (track.time + late, track.time))
    (earlier, part, inside), (index, share, covered) = spans
    rows = inside & covered
    corrected, original = (_interpolated(track, i[rows], s[rows])[0] for i, s in ((earlier, part), (index, share)))
    return replace(errors.rows(rows), position=errors.position[rows] + ned_offset(corrected, original))


def at_point(trajectory: Trajectory, lever_b: FloatArray) -> Trajectory:
    """Move a trajectory to another point of the same rigid body.

    `lever_b` (3,): the other point seen from the first, body axes [m].
    Returns: trajectory with attitude and standard deviations of the first point.

    Notes
    -----
    Groves (2013), section 14.3.1. Differences of the lever arm in local axes replace the product of rotation rate and
    lever arm.
    """
    lever_n = attitude.dcm_from_rph(trajectory.rph) @ np.asarray(lever_b, dtype=np.float64)
    v_n = trajectory.v_n + _rates(trajectory.time, lever_n)
    return replace(trajectory, lla=lla_offset(trajectory.lla, lever_n), v_n=v_n)


def accuracy(errors: TrajectoryErrors) -> dict[str, Any] | None:
    """Compute mean, RMS, 95 % and largest error of every quantity in the reference.

    Returns: ``n``, the number of epochs. For each quantity (``north_m``, ``horizontal_m``, …) a dict of ``mean``,
    ``rms``, ``p95``, ``max`` (the last two of the absolute error). None if the reference lacks the quantity.
    ``cep50_m`` and ``r95_m``: radii that contain 50 % and 95 % of the horizontal errors. None without epochs.
    """
    if not len(errors.time):
        return None
    horizontal = errors.horizontal
    table: dict[str, Any] = {"n": len(errors.time), "horizontal_m": _statistics(horizontal)}
    for group in ("position", "velocity", "attitude"):
        for name, column in zip(errors.COLUMNS[group], getattr(errors, group).T, strict=True):
            table[name] = _statistics(column / unit_of(name))
    table["velocity_horizontal_m_s"] = _statistics(np.hypot(errors.velocity[:, 0], errors.velocity[:, 1]))
    table["cep50_m"], table["r95_m"] = (float(np.percentile(horizontal, p)) for p in (50.0, 95.0))
    return table


def accuracy_by_motion(errors: TrajectoryErrors) -> dict[str, Any]:
    """Compute `accuracy` of ``all`` epochs, and separately of ``static`` and ``moving`` epochs."""
    return {
        "all": accuracy(errors),
        "static": accuracy(errors.rows(~errors.moving)),
        "moving": accuracy(errors.rows(errors.moving)),
    }


def nees(errors: TrajectoryErrors) -> dict[str, Any] | None:
    """Test the stated standard deviations: normalised squared error, and the share inside 3 sd.

    Returns: for ``position``, ``velocity`` and ``attitude``: ``nees``, the mean over epochs and axes of (error / sd)^2,
    one if the sd is true. ``inside_3_sd``: the share of errors inside 3 sd (0.997 if normal). None for a group without
    reference. None if the estimate has no sd.

    Notes
    -----
    The sd contains no correlation between axes, so each axis is normalised by itself. For the full form see Bar-Shalom,
    Li and Kirubarajan (2001), section 5.4.2.
    """
    if errors.sd is None:
        return None
    groups = ("position", "velocity", "attitude")
    return {name: _normalised(getattr(errors, name), errors.sd[:, 3 * i : 3 * i + 3]) for i, name in enumerate(groups)}


def _normalised(error: FloatArray, sd: FloatArray) -> dict[str, float] | None:
    known = np.isfinite(error) & np.isfinite(sd) & (sd > 0.0)
    if not known.any():
        return None
    ratio = np.abs(error[known]) / sd[known]
    return {"nees": float(np.mean(ratio**2)), "inside_3_sd": float(np.mean(ratio <= 3.0))}


def _statistics(error: FloatArray) -> dict[str, float] | None:
    known = error[np.isfinite(error)]
    if known.size == 0:
        return None
    size = np.abs(known)
    return {
        "mean": float(np.mean(known)),
        "rms": rms(known),
        "p95": float(np.percentile(size, 95.0)),
        "max": float(np.max(size)),
    }


def _brackets(time: FloatArray, wanted: FloatArray) -> tuple[IntArray, FloatArray, BoolArray]:
    """Return the interval of `time` around each wanted time, the elapsed share of it, and False in a gap or outside."""
    if len(time) < 2:
        return np.zeros(len(wanted), dtype=np.intp), np.zeros(len(wanted)), np.isin(wanted, time)
    index = np.clip(np.searchsorted(time, wanted, side="right") - 1, 0, len(time) - 2)
    step = np.diff(time)
    share = (wanted - time[index]) / step[index]
    on_node = np.minimum(np.abs(share), np.abs(share - 1.0)) < _SAME_TIME
    inside = (share > -_SAME_TIME) & (share < 1.0 + _SAME_TIME)
    return index, share, inside & (on_node | ~_gaps(step)[index])


def _gaps(step: FloatArray) -> BoolArray:
    return np.asarray(step > LONGEST_STEP * np.median(step), dtype=np.bool_)


def _rates(time: FloatArray, value: FloatArray) -> FloatArray:
    """Compute time derivatives of values (n, k) at their times, to second order, one-sided next to a gap."""
    if len(time) < 2:
        return np.zeros_like(value)
    step = np.diff(time)
    slope = np.diff(value, axis=0) / step[:, None]
    weight = np.where(_gaps(step), 0.0, 1.0 / step)
    before, after = np.append(0.0, weight), np.append(weight, 0.0)
    total = before + after
    isolated = total == 0.0  # a sample between two gaps gets zero slope, instead of a slope across a gap
    total[isolated] = 1.0
    first, last = np.concatenate((slope[:1], slope)), np.concatenate((slope, slope[-1:]))
    return np.asarray((before[:, None] * first + after[:, None] * last) / total[:, None])


def _interpolated(
    estimate: Trajectory, index: IntArray, share: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray | None]:
    """Interpolate position, velocity, attitude and sd at the shares `share` of the intervals `index` of an estimate."""
    if len(estimate.time) < 2:
        sd = None if estimate.sd is None else estimate.sd[index]
        return estimate.lla[index], estimate.v_n[index], estimate.rph[index], sd
    s = share[:, None]
    step = np.diff(estimate.time)[index][:, None]
    v_n = _known_velocity(estimate)
    path = ned_offset(estimate.lla[index + 1], estimate.lla[index])
    # cubic Hermite interpolation of the displacement from the start of the interval
    moved = (
        s * (1.0 - s) ** 2 * step * v_n[index]
        + s**2 * (3.0 - 2.0 * s) * path
        - s**2 * (1.0 - s) * step * v_n[index + 1]
    )
    velocity = (1.0 - s) * estimate.v_n[index] + s * estimate.v_n[index + 1]
    sd = None if estimate.sd is None else (1.0 - s) * estimate.sd[index] + s * estimate.sd[index + 1]
    return lla_offset(estimate.lla[index], moved), velocity, _attitude(estimate.rph, index, s), sd


def _known_velocity(trajectory: Trajectory) -> FloatArray:
    """Return the velocity of a trajectory; where it is unknown, the time derivative of its positions."""
    given = np.isfinite(trajectory.v_n)
    if given.all():
        return trajectory.v_n
    path = np.zeros_like(trajectory.lla)
    path[1:] = np.cumsum(ned_offset(trajectory.lla[1:], trajectory.lla[:-1]), axis=0)
    return np.where(given, trajectory.v_n, _rates(trajectory.time, path))


def _attitude(rph: FloatArray, index: IntArray, share: FloatArray) -> FloatArray:
    """Interpolate attitude along the shortest rotation between neighbouring samples (Shoemake 1985)."""
    q = attitude.quat_from_rph(rph)
    first, second = q[index], q[index + 1]
    turn = attitude.rotvec_from_quat(attitude.quat_multiply(attitude.quat_conjugate(first), second))
    return attitude.rph_from_quat(attitude.quat_multiply(first, attitude.quat_from_rotvec(share * turn)))


def travelled(solution: Trajectory) -> tuple[float, float, float]:
    """Compute distance and time in motion, and largest speed. Slow epochs count as stationary.

    Returns: `distance` [m]. `moving`: time faster than `MOVING_M_S` [s]. `fastest` [m/s].
    """
    speed = spill.by_blocks(lambda v: np.sqrt(v[:, 0] ** 2 + v[:, 1] ** 2 + v[:, 2] ** 2), solution.v_n)
    step = np.where(speed[1:] > MOVING_M_S, np.diff(solution.time), 0.0)
    return float(np.sum(speed[1:] * step)), float(np.sum(step)), float(speed.max(initial=0.0))


class Solution(NamedTuple):
    """Solution of a run, for comparison with a reference."""

    run: str  # name of the run
    solution: str  # kind of solution: filtered or smoothed
    trajectory: Trajectory
    lever_b: FloatArray  # (3,) antenna of the run seen from the IMU, body axes [m]


@dataclass(frozen=True, slots=True)
class Compared:
    """Errors of a solution of a run."""

    run: str  # name of the run
    solution: str  # kind of solution: filtered or smoothed
    errors: TrajectoryErrors  # errors at the common epochs of all runs


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of runs with one reference."""

    reference: Trajectory  # reference with all its epochs
    compared: tuple[Compared, ...]  # in input order; a smoothed solution follows the filtered one of its run

    def rows(self) -> list[dict[str, Any]]:
        """List the accuracy of each solution.

        Returns: ``run``, ``solution``, ``accuracy`` from `insnav.errors.metrics.accuracy`, ``consistency`` from
        `insnav.errors.metrics.nees`.
        """
        return [
            {
                "run": each.run,
                "solution": each.solution,
                "accuracy": accuracy(each.errors),
                "consistency": nees(each.errors),
            }
            for each in self.compared
        ]

    def named(self) -> dict[str, TrajectoryErrors]:
        """Return the errors of each solution under a unique name."""
        named: dict[str, TrajectoryErrors] = {}
        for each in self.compared:
            name = f"{each.run}-smoothed" if each.solution == "smoothed" else each.run
            numbered = chain([name], (f"{name}-{number}" for number in count(2)))
            named[next(free for free in numbered if free not in named and free != "reference")] = each.errors
        return named


def compare_solutions(
    solutions: Sequence[Solution], reference: Trajectory, lever_b: FloatArray | None = None
) -> Comparison:
    """Compare solutions with a reference, at their common epochs.

    `lever_b` (3,): the point of the reference seen from the IMU, body axes [m]; None for the antenna of each run.
    Raises: InputError: no epoch common to all solutions and the reference.
    """
    errors = []
    for each in solutions:
        try:
            point = each.lever_b if lever_b is None else lever_b
            errors.append(position_errors(each.trajectory, reference, lever_b=point))
        except InputError as error:
            error.where = error.where or each.run
            raise
    common = reduce(np.intersect1d, [each.time for each in errors])
    if len(common) == 0:
        ends = [(source.run, *each.time[[0, -1]]) for source, each in zip(solutions, errors, strict=True)]
        raise InputError("compare.no_common_time", spans=tuple(f"{run}: {a:.1f} … {b:.1f} s" for run, a, b in ends))
    compared = (
        Compared(source.run, source.solution, each.rows(np.isin(each.time, common)))
        for source, each in zip(solutions, errors, strict=True)
    )
    return Comparison(reference, tuple(compared))
