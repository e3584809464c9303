"""The budget of a recorded drive: motion and start of its typical window to predict from, and its recorded errors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from insnav.errors.budget.error_budget import Budget, RecordedColumn
from insnav.errors.budget.from_windows import RecordedBudget, RecordedPart
from insnav.errors.budget.sampled_motion import SampledMotion, sampled
from insnav.errors.budget.sources import Source, start_sources
from insnav.errors.outage.statistics import growth
from insnav.imu import ImuSpec, SensorSpec
from insnav.simulate.truth_from_track import truth_from_track

_MARGIN = 5.0  # of the track on both sides of a window [s]


def typical_window(part: RecordedPart) -> int:
    """Number of the window whose predicted variances at the end, horizontal and down, are nearest their mean.

    So the budget of this one window predicts what the RMS of all windows is compared with.
    """
    north, east, down = np.diagonal(part.windows.covariance[:, -1], axis1=1, axis2=2)[:, :3].T
    sizes = np.column_stack((north + east, down))
    mean = sizes.mean(axis=0)
    return int(np.argmin(np.sum(np.abs(sizes - mean) / np.maximum(mean, np.finfo(float).tiny), axis=1)))


def window_motion(budget: RecordedBudget, duration: float) -> SampledMotion:
    """Motion of the typical window, from the smoothed track of the drive.

    `duration`: from its start on [s].
    """
    part, track = budget.shown, budget.track
    start = float(part.windows.start[typical_window(part)])
    first, last = np.searchsorted(track.time, [start - _MARGIN, start + duration + _MARGIN])
    first = max(0, first - 1)
    truth = truth_from_track(track.rows(slice(first, last + 1)))
    begin = min(max(start - truth.start, 0.0), truth.duration - duration)
    text = f"that of the drive from {start:.1f} s, the window nearest the mean prediction"
    return sampled(truth, begin, duration, text)


def window_start_sources(budget: RecordedBudget) -> tuple[Source, ...]:
    """Errors at the start of the typical window, from the covariance of the filter or the specification."""
    return start_sources(budget.shown.windows.start_covariance[typical_window(budget.shown)])


def spec_in_windows(budget: RecordedBudget) -> ImuSpec:
    """Errors that the IMU adds within the window."""
    return replace(in_run_errors(budget.spec), name=f"{budget.spec.name}, {_kind(budget)}")


def with_recorded(found: Budget, budget: RecordedBudget) -> Budget:
    """Add the recorded column.

    `found`: of `spec_in_windows`, `window_start_sources` and `window_motion`.
    """
    windows = budget.shown.windows
    times = found.time[found.chosen]
    summed = growth(windows, times)
    columns = [summed.column(name) for name in ("north", "east", "down", "horizontal")]
    column = RecordedColumn(
        time=times,
        corrected=summed.corrected[:, columns],
        low=summed.low[:, columns],
        high=summed.high[:, columns],
        predicted=summed.predicted[:, columns],
        windows=windows.count,
        description=f"{windows.count} windows of {windows.length:g} s, {_kind(budget)}, against {budget.reference}",
    )
    return replace(found, recorded=column)


def _kind(budget: RecordedBudget) -> str:
    return "uncalibrated sensors" if budget.shown.windows.uncalibrated else "calibrated by the filter"


def in_run_errors(spec: ImuSpec) -> ImuSpec:
    """What an IMU adds to the errors at the start: noise, change of the bias, terms the filter has no states for.

    In-run bias since the start is a random walk that is driven as the Gauss-Markov process of the IMU file is,
    ``2 sd^2 / T`` (Gelb 1974, section 3.6), right for times far below T. Misalignment of accelerometers shows in
    gravity as a bias, and is counted there.
    """
    return replace(
        spec,
        gyro=_since(spec.gyro),
        accel=replace(_since(spec.accel), misalignment=np.zeros(3)),
        initial=None,
    )


def _since(sensor: SensorSpec) -> SensorSpec:
    drive = sensor.rate_random_walk**2 + 2.0 * sensor.bias_instability**2 / sensor.correlation_time
    none = np.zeros(3)
    return replace(sensor, bias=none, bias_instability=none, scale_factor=none, rate_random_walk=np.sqrt(drive))


@dataclass(frozen=True, slots=True)
class BudgetStudy:
    """A budget and the drive that it is of."""

    budget: Budget
    # free-inertial windows of the drive; None for a budget of a motion without a record
    windows: RecordedBudget | None = None
