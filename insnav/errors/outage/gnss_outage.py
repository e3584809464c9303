"""GNSS outage test: windows of a drive navigated without its fixes.

Every window continues from the filter's state at its first epoch, after all earlier fixes and without fixes inside;
other aiding continues. Later fixes return for a while, so that the smoother has both ends.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from insnav.attitude import rph_from_quat, wrap_pi
from insnav.engine import Workers, every, share_of
from insnav.errors.outage.statistics import Growth
from insnav.errors.outage.windows import Outage, comparison_only, navigated_drive, part_of, valid, window_starts
from insnav.exceptions import ConfigError
from insnav.filter.error_model import FilterState
from insnav.filter.gates import OF_REFERENCE
from insnav.filter.navigate import feed
from insnav.filter.navigator import Navigator
from insnav.filter.prepare import Prepared
from insnav.tabular import Tabular
from insnav.types import FloatArray, GpsData

if TYPE_CHECKING:
    from insnav.errors.evaluated_run import EvaluatedRun

RECOVERY = 60.0  # time after the window with fixes for the smoother [s]
_STATES = ("north_m", "east_m", "down_m", "v_north_m_s", "v_east_m_s", "v_down_m_s")
_COMPARED = 0.25  # interval to which a reference is thinned [s]


def outages(
    ready: Prepared,
    *,
    lengths: Sequence[float],
    first: float | None = None,
    spacing: float | None = None,
    reference: GpsData | Callable[[FloatArray], GpsData] | None = None,
    workers: Workers = 1,
    progress: Callable[[float], None] | None = None,
) -> list[Outage]:
    """Simulate GNSS outages throughout a drive.

    `lengths`: lengths of the windows [s]. `first`: start of the first window, after the start of navigation [s]; by
    default a minute, or less if the drive is short. `spacing`: between starts of windows of one length [s]; by default
    about sixty fit. Windows overlap if it is less than their length: each continues from the filter with all earlier
    fixes. `reference`: better antenna positions for the comparison, or a function of the final lever arm (3,) [m]; by
    default the removed fixes.
    Raises: ConfigError: lengths or spacing not above zero. InputError: the drive is too short for any window.
    """
    lengths = sorted(set(lengths))
    wrong = [value for value in (*lengths, *([] if spacing is None else [spacing])) if not 0.0 < value < np.inf]
    if wrong or not lengths:
        raise ConfigError("outage.bad_windows", given_s=tuple(wrong))
    fixes = ready.gps.time - ready.settings.delay
    begin, end = ready.initial.time, float(min(ready.imu.time[-1], fixes[-1]))
    rows = window_starts(fixes, begin, end, lengths[0], first=first, spacing=spacing, rule="quarter of drive")
    share = 0.3  # share of the drive itself in the work
    drive = navigated_drive(ready, ready.gps.time[rows], share_of(progress, 0.0, share))
    assert drive.run.smoothed is not None
    if callable(reference):
        reference = reference(drive.run.lever_b)
    solution = drive.run.smoothed.solution
    course = np.column_stack([solution.time - drive.clock, np.unwrap(solution.rph[:, 2])])
    tasks = [
        (state, length)
        for length in lengths
        for state in drive.states
        if state.time + length <= min(end, ready.unbroken_until(state.time)) + 1e-6
    ]
    # input of a window for its process
    jobs = [(part_of(ready, state, length + RECOVERY), state, length) for state, length in tasks]
    results = every(_window, jobs, workers, (reference, course), share_of(progress, share, 1.0 - share))
    return [window for window in results if window is not None and window.elapsed.size]


def _window(reference: GpsData | None, course: FloatArray, job: tuple[Prepared, FilterState, float]) -> Outage | None:
    """Navigate one window and its recovery, on its part of the drive."""
    ready, state, length = job
    delay = ready.settings.delay
    start, stop = state.time + delay, state.time + delay + length
    gps = _fixes(ready.gps, reference, start, stop, stop + RECOVERY)
    inside = (gps.time > start + 1e-6) & (gps.time <= stop + 1e-6)
    if not inside.any():
        return None
    # minimal output: only the epochs count
    settings = replace(ready.settings, output_interval=1.0, smooth=True)
    navigator = Navigator(state, ready.model, gps, ready.alignment, ready.nominal, settings)
    found = feed(navigator, ready.imu).history().smooth()
    at = np.searchsorted(found.time, gps.time[inside] - delay - 1e-6)
    at = at[at < found.time.shape[0]]
    values = found.innovations[at]
    reference_sd = np.column_stack([gps.position_sd[inside], gps.velocity_sd[inside]])[: at.shape[0]]
    speed = np.linalg.norm(found.state[at, 3:6], axis=1)
    return Outage(
        start,
        length,
        found.time[at] - state.time,
        values[:, :6],
        np.sqrt(np.maximum(values[:, 6:12], 0.0)),
        values[:, 12:18],
        np.sqrt(np.maximum(values[:, 18:24], 0.0)),
        reference_sd,
        wrap_pi(rph_from_quat(found.state[at, 6:])[:, 2] - np.interp(found.time[at], *course.T)),
        np.sqrt(values[:, 24]),
        float(np.mean(speed)),
    )


def _fixes(gps: GpsData, reference: GpsData | None, start: float, stop: float, end: float) -> GpsData:
    """Select fixes from `start` to `end`; until `stop` for comparison only, from the reference if available."""
    later = (gps.time > start + 1e-6) & (gps.time <= end)
    inside = later & (gps.time <= stop + 1e-6)
    if reference is None:
        compared = gps.rows(inside & valid(gps))
    else:
        time = reference.time
        chosen = (time > start + 1e-6) & (time <= stop + 1e-6)
        step = float(np.median(np.diff(time))) if time.shape[0] > 1 else _COMPARED
        stride = max(1, round(_COMPARED / step))
        # counted back from the end of the window, the most important epoch
        chosen &= (np.arange(time.shape[0]) - int(np.searchsorted(time, stop + 1e-6)) + 1) % stride == 0
        compared = reference.rows(chosen)
    after = gps.rows(later & ~inside)
    if after.fix is None:
        after = replace(after, fix=np.ones(after.time.shape[0], dtype=np.int64))
    # receiver headings are removed and returned with the fixes
    unknown = None if gps.heading is None else np.full(compared.time.shape[0], np.nan)
    kind = 0 if reference is None else OF_REFERENCE
    return replace(comparison_only(compared, kind), heading=unknown).joined(after)


@dataclass(frozen=True, slots=True)
class OutageStudy:
    """Outage windows, and the run with all fixes."""

    windows: tuple[Outage, ...]  # in order of length, then of time
    growth: tuple[Growth, ...]  # their error statistics by length
    reference: str  # description of the reference
    run: EvaluatedRun | None = None  # None if read from a folder ...


@dataclass(frozen=True, slots=True)
class OutageEpochs(Tabular):
    """All epochs of all windows, concatenated; fields as in `Outage`, repeated in each row of a window."""

    COLUMNS: ClassVar = {
        "start": ("start_time_s",),
        "length": ("length_time_s",),
        "elapsed": ("time_s",),
        "error": tuple(f"error_{name}" for name in _STATES),
        "sd": tuple(f"sd_{name}" for name in _STATES),
        "smoothed": tuple(f"smoothed_{name}" for name in _STATES),
        "smoothed_sd": tuple(f"smoothed_sd_{name}" for name in _STATES),
        "reference_sd": tuple(f"reference_sd_{name}" for name in _STATES),
        "heading": ("heading_deg",),
        "heading_sd": ("heading_sd_deg",),
        "speed": ("speed_m_s",),
    }

    start: FloatArray  # (m,) [s]
    length: FloatArray  # (m,) [s]
    elapsed: FloatArray  # (m,) [s]
    # (m, 6) [m], [m/s]
    error: FloatArray
    sd: FloatArray
    smoothed: FloatArray
    smoothed_sd: FloatArray
    reference_sd: FloatArray
    # (m,) [rad]
    heading: FloatArray
    heading_sd: FloatArray
    speed: FloatArray  # (m,) [m/s]

    @classmethod
    def of(cls, windows: Sequence[Outage]) -> OutageEpochs:
        """Concatenate the epochs of some windows."""
        columns = {}
        for name in cls.COLUMNS:
            parts = [(getattr(each, name), len(each.elapsed)) for each in windows]
            columns[name] = np.concatenate([np.full(n, v) if np.ndim(v) == 0 else v for v, n in parts])
        return cls(**columns)

    def windows(self) -> tuple[Outage, ...]:
        """Return the windows in their order."""
        begins = np.flatnonzero((np.diff(self.start) != 0.0) | (np.diff(self.length) != 0.0)) + 1
        edges = [0, *begins.tolist(), len(self.start)]
        found = []
        for first, last in pairwise(edges):
            part: dict[str, Any] = {name: getattr(self, name)[first:last] for name in self.COLUMNS}
            once: dict[str, Any] = {name: float(part.pop(name)[0]) for name in ("start", "length", "speed")}
            found.append(Outage(**part, **once))
        return tuple(found)
