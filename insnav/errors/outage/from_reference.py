"""Free-inertial windows from the position and velocity of a reference: what attitude and sensor errors alone make."""

from __future__ import annotations

import numpy as np

from insnav import strapdown
from insnav.earth import lla_offset, ned_offset
from insnav.imu import ImuErrors, correct
from insnav.types import FloatArray, ImuData, Run, SensorErrors, Trajectory

_LEAD = 1.0  # samples before and after a window, for the polynomials at its ends [s]


def end_errors(
    run: Run,
    imu: ImuData,
    reference: Trajectory,
    length: float,
    most: int,
    *,
    settle: float = 0.0,
    run_clock: float = 0.0,
    reference_clock: float = 0.0,
) -> FloatArray:
    """Horizontal error at the end of windows navigated by the IMU alone.

    Position and velocity at the start are those of the reference, attitude and sensor errors those of the filter.

    `length`: of the windows [s]; `most`: how many windows at most, evenly along the drive and without overlap;
    `settle`: the first begins so long after the start [s]; `run_clock`, `reference_clock`: times of the run and of the
    reference minus those of the samples [s].
    Returns: (n,) [m]; empty if the drive is too short.
    """
    filtered = run.solution
    begin = max(filtered.time[0] - run_clock, reference.time[0] - reference_clock, imu.time[0]) + settle
    last = min(filtered.time[-1] - run_clock, reference.time[-1] - reference_clock, imu.time[-1] - _LEAD) - length
    error = []
    for wanted in np.arange(begin, last, max(length, (last - begin) / most)):
        row = int(np.searchsorted(filtered.time - run_clock, wanted))
        start = float(filtered.time[row]) - run_clock
        if start > last:
            break
        end = start + length
        lla, v_n = _state(reference, start + reference_clock)
        samples = imu.rows(slice(*np.searchsorted(imu.time, [start - _LEAD, end + _LEAD])))
        parts = strapdown.intervals(correct(samples, _estimated(run.sensor_errors, start + run_clock)))
        inc = strapdown.increments(parts, strapdown.split(parts, np.array([start, end]), 0, len(parts.end)))
        tolerance = strapdown.TIME_TOLERANCE
        inc = inc.rows((inc.time > start + tolerance) & (inc.time < end + tolerance))
        navigated = strapdown.navigate(inc, lla, v_n, filtered.rph[row])
        there, _ = _state(reference, end + reference_clock)
        error.append(float(np.hypot(*ned_offset(navigated.lla[-1], there)[:2])))
    return np.array(error)


def _state(trajectory: Trajectory, time: float) -> tuple[FloatArray, FloatArray]:
    """Position and velocity between two rows: by the velocity from the nearer one, and on a straight line."""
    at = int(strapdown.nearest_rows(trajectory.time, time))
    after = min(at + 1, len(trajectory.time) - 1)
    first = after - 1
    share = (time - trajectory.time[first]) / (trajectory.time[after] - trajectory.time[first])
    v_n = trajectory.v_n[first] + share * (trajectory.v_n[after] - trajectory.v_n[first])
    way = 0.5 * (trajectory.v_n[at] + v_n) * (time - trajectory.time[at])
    return lla_offset(trajectory.lla[at], way), v_n


def _estimated(errors: SensorErrors, time: float) -> ImuErrors:
    """Sensor errors as estimated until a time."""
    value = errors.value[max(int(np.searchsorted(errors.time, time, side="right")) - 1, 0)]
    return ImuErrors(
        gyro_bias=value[0:3],
        gyro_matrix=np.diag(1.0 + value[6:9]),
        accel_bias=value[3:6],
        accel_matrix=np.diag(1.0 + value[9:12]),
    )
