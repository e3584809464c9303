"""The budget on paper beside recorded windows: the motion and the start of one of them, and the errors of all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.errors.budget import (
    Budget,
    RecordedColumn,
    SampledMotion,
    Source,
    beside_known,
    known_sources,
    sampled,
)
from insnav.errors.budget.from_windows import RecordedBudget, RecordedPart
from insnav.errors.outage.statistics import growth
from insnav.imu import ImuSpec
from insnav.simulate.truth_from_track import truth_from_track

_MARGIN = 5.0  # of the track on both sides of a window [s]


def shown_part(budget: RecordedBudget) -> RecordedPart:
    """Windows that stand beside the paper: uncalibrated if these were asked for."""
    return budget.calibrated if budget.raw is None else budget.raw


def typical_window(part: RecordedPart) -> int:
    """Number of the window whose predicted horizontal error at the end is the median one."""
    last = part.windows.covariance[:, -1]
    size = last[:, 0, 0] + last[:, 1, 1]
    return int(np.argsort(size)[len(size) // 2])


def window_motion(budget: RecordedBudget, duration: float) -> SampledMotion:
    """Motion of the typical window, from the smoothed track of the drive.

    Parameters
    ----------
    budget : RecordedBudget
    duration : float
        From its start on [s].
    """
    part, track = shown_part(budget), budget.track
    start = float(part.windows.start[typical_window(part)])
    first, last = np.searchsorted(track.time, [start - _MARGIN, start + duration + _MARGIN])
    first = max(0, first - 1)
    truth = truth_from_track(track.rows(slice(first, last + 1)))
    begin = min(max(start - truth.start, 0.0), truth.duration - duration)
    words = f"that of the drive from {start:.1f} s on, the window with the median prediction"
    return sampled(truth, begin, duration, words)


def start_sources(budget: RecordedBudget) -> tuple[Source, ...]:
    """What the filter, or with sensors as turned on the IMU file, says of the start of the typical window.

    Parameters
    ----------
    budget : RecordedBudget
    """
    part = shown_part(budget)
    return known_sources(part.windows.start_covariance[typical_window(part)])


def spec_in_windows(budget: RecordedBudget) -> ImuSpec:
    """What the IMU adds to that on the way.

    Parameters
    ----------
    budget : RecordedBudget
    """
    kind = "as turned on" if shown_part(budget).windows.raw else "calibrated by the filter"
    return replace(beside_known(budget.spec), name=f"{budget.spec.name}, {kind}")


def with_recorded(found: Budget, budget: RecordedBudget) -> Budget:
    """Put the errors of the windows beside those on paper.

    Parameters
    ----------
    found : Budget
        Of `spec_in_windows`, `start_sources` and `window_motion`.
    budget : RecordedBudget
    """
    part = shown_part(budget)
    times = found.time[found.chosen]
    summed = growth(part.windows, times)
    kind = "sensors as turned on" if part.windows.raw else "calibrated by the filter"
    column = RecordedColumn(
        times,
        summed.rms[:, 0],
        summed.rms[:, 1],
        summed.rms[:, 2],
        summed.predicted[:, :3],
        part.windows.count,
        f"{part.windows.count} windows of {part.windows.length:g} s, {kind}, against {budget.judge}",
    )
    return replace(found, recorded=column)
