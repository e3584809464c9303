"""Division of a bench record into poses: intervals at rest, in any units.

All criteria are ratios (of variances, of directions): raw counts work like m/s^2.

References
----------
D. Tedaldi, A. Pretto, E. Menegatti, "A robust and easy to implement method for IMU calibration without external
equipments", ICRA 2014, section on the static detector. It compares the variance of the specific force in a moving
window with a multiple of the variance at rest. Here the quietest tenth of the record defines the variance at rest, so
the record may begin in motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.exceptions import InputError
from insnav.sample_statistics import moving_variance
from insnav.tabular import runs_of
from insnav.types import BoolArray, FloatArray, ImuData

WINDOW = 1.0  # window of the variance [s]
SHORTEST = 0.5  # least rest between two windows with motion [s]: 1.5 s of rest altogether
FEWEST = 10  # samples of a pose
QUIET_SHARE = 0.1  # quantile of the variance that represents rest
CONTRAST = 25.0  # least variance ratio of the most active tenth to rest, in a record of positions and motions
KNOCK = 1.5 * WINDOW  # a shorter break of rest, without change of pose, is a knock [s]
SAME_POSE = 0.01  # change of specific force, over its spread in the record, within one pose
CLIPPED = 3  # successive extreme samples that mark the end of the range


@dataclass(frozen=True, slots=True)
class Pose:
    """Means over one interval at rest."""

    first: int  # samples ``first`` up to, not including, ``last``
    last: int
    start: float  # times of the first and of the last of them [s]
    end: float
    force: FloatArray  # (3,) mean of the accelerometers and of the gyros, in the units of the record
    rate: FloatArray
    force_sd: FloatArray  # (3,) standard deviation of one sample

    @property
    def count(self) -> int:
        """Number of samples."""
        return self.last - self.first


def pose_between(imu: ImuData, first: int, last: int) -> Pose:
    """Means over samples ``first`` up to, not including, ``last``.

    `first`, `last`: at least two samples inside the record.
    """
    force, rate = imu.accel[first:last], imu.gyro[first:last]
    start, end = float(imu.time[first]), float(imu.time[last - 1])
    return Pose(first, last, start, end, force.mean(axis=0), rate.mean(axis=0), force.std(axis=0, ddof=1))


@dataclass(frozen=True, slots=True)
class Activity:
    """Variance of the specific force along a record, relative to rest."""

    ratio: FloatArray  # (n,) variance in a moving window over that at rest [-]
    interval: float  # sampling interval [s]


def measure_activity(imu: ImuData) -> Activity:
    """Measure the activity of a record.

    Raises: InputError: the record is too short, or rest and motion do not differ.
    """
    interval = float(np.median(np.diff(imu.time))) if imu.time.size > 1 else np.inf
    window = 2 * round(0.5 * WINDOW / interval) + 1 if np.isfinite(interval) else 0
    if window < FEWEST or imu.time.size < 10 * window:
        raise InputError("lab.poses_short", count=imu.time.size, interval_s=interval, rate_hz=FEWEST / WINDOW)
    variance = moving_variance(imu.accel, window).sum(axis=1)
    variance[: window // 2] = variance[-(window // 2) :] = np.inf  # no whole window about these
    known = variance[np.isfinite(variance)]
    # a simulated record without noise has no variance at all at rest: rounding is the least there can be
    floor = max(float(np.quantile(known, QUIET_SHARE)), 1e-12 * float(np.mean(imu.accel**2)), np.finfo(float).tiny)
    contrast = float(np.quantile(known, 1.0 - QUIET_SHARE)) / floor
    if contrast < CONTRAST:
        raise InputError("lab.no_contrast", ratio=np.sqrt(contrast))
    return Activity(variance / floor, interval)


def find_poses(imu: ImuData, activity: Activity, factor: float) -> tuple[Pose, ...]:
    """Find the intervals at rest in a record.

    `activity`: of this record. `factor`: largest standard deviation at rest, relative to the quietest tenth. Poses are
    in order of time. The window keeps half its length between a pose and any motion. Of a pose interrupted by a knock
    the longer part is kept, to count the pose once.
    """
    still: BoolArray = activity.ratio < factor * factor
    shortest = max(FEWEST, round(SHORTEST / activity.interval))
    found = [pose_between(imu, first, end) for first, end in runs_of(still).tolist() if end - first >= shortest]
    if not found:
        return ()
    force = np.array([pose.force for pose in found])
    spread = float(np.linalg.norm(force - force.mean(axis=0), axis=1).max())
    kept = found[:1]
    for pose in found[1:]:
        change = float(np.linalg.norm(pose.force - kept[-1].force))
        if pose.start - kept[-1].end > KNOCK or change > SAME_POSE * spread:
            kept.append(pose)
        elif pose.count > kept[-1].count:
            kept[-1] = pose
    return tuple(kept)


def clipped(values: FloatArray, moving: BoolArray) -> BoolArray:
    """Find samples in which a channel stays at its largest or smallest value.

    `values` (n, 3): samples in any unit. `moving` (n,): rows to test: repeated values at rest are normal.
    Returns (n,).
    """
    found = np.zeros(values.shape[0], dtype=np.bool_)
    for column in values.T:
        for extreme in (column.min(), column.max()):
            for first, end in runs_of((column == extreme) & moving):
                if end - first >= CLIPPED:
                    found[first:end] = True
    return found
