"""GNSS outage test: windows of a drive navigated without fixes, and their error growth.

Every window continues from the filter's state at its first epoch, after all earlier fixes and without fixes inside;
other aiding continues. Fixes return for a while after the window, so that the smoother has fixes on both sides.

The growth has RMS, 95 % and largest error with intervals, and predicted errors. Measured errors are differences to a
reference and include its variance: this applies to RMS, quantiles and largest errors. Only `Growth.corrected` subtracts
the variance. If nothing remains, the error is below the reference noise: unknown, not zero.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from insnav.attitude import rph_from_quat, wrap_pi
from insnav.engine import Workers, every, share_of
from insnav.errors.outage import free_inertial
from insnav.errors.outage.free_inertial import Outage, Windows
from insnav.exceptions import ConfigError
from insnav.filter.error_model import FilterState
from insnav.filter.filter_input import FilterInput, Output
from insnav.filter.gates import OF_REFERENCE
from insnav.filter.navigate import feed
from insnav.filter.navigator import Navigator
from insnav.findings import Code, Finding
from insnav.sample_statistics import CONFIDENCE, chi_square, effective_count, interval, mean_square_interval, means
from insnav.tabular import Tabular
from insnav.types import BoolArray, FloatArray, GpsData, IntArray

if TYPE_CHECKING:
    from insnav.errors.evaluated_run import EvaluatedRun

COMPONENTS = ("north", "east", "down", "along", "cross", "horizontal")
OUTAGE_COMPONENTS = ("horizontal", "vertical", "velocity", "heading", "smoothed horizontal", "smoothed vertical")
_STEP = 10.0  # interval of the times in tables, for windows up to a minute [s]
_ROWS = 6  # number of times in the table of longer windows
_SHARED = 0.25  # least reported share of the mean square common to all windows [-]


@dataclass(frozen=True, slots=True)
class Growth:
    """Error statistics of windows of one length at some times since their start, in SI units and radians."""

    times: FloatArray  # (k,) times since the start of a window [s]
    components: tuple[str, ...]  # names of the columns: `COMPONENTS` or `OUTAGE_COMPONENTS`
    count: int  # number of windows
    known: IntArray  # (k, q) number of windows with known error
    effective: float  # effective sample size: equivalent number of non-overlapping windows
    rms: FloatArray  # (k, q) root mean square including reference errors; ``NaN`` if unknown
    # (k, q) RMS with the reference variance subtracted; ``NaN`` also if below the noise of the reference
    corrected: FloatArray
    reference: FloatArray  # (k, q) RMS standard deviation of the reference
    # (k, q) 95 % confidence interval of `corrected`; errors common to all windows count as one sample. ``NaN`` for a
    # too small effective sample size, zero where the interval reaches below the reference noise
    low: FloatArray
    high: FloatArray
    p95: FloatArray  # (k, q) 95 % quantile of the absolute error, including reference errors
    largest: FloatArray  # (k, q) maximum of the absolute error, including reference errors
    predicted: FloatArray  # (k, q) RMS predicted standard deviation
    # (k, q) share of errors within 3 sd of prediction plus reference [-]; for several axes their mean
    inside: FloatArray
    # (k, q) significant share of the mean square common to all windows, from the mean error [-]. Horizontal errors:
    # north and east, or along and across the track. Another drive has another common error
    common: FloatArray

    @property
    def length(self) -> float:
        """Final time [s]."""
        return float(self.times[-1])

    @property
    def inside_at_end(self) -> float:
        """Share of North, East and Down errors within 3 sd at the final time [-]."""
        vertical = "vertical" if "vertical" in self.components else "down"
        inside = self.inside[-1]
        return float(2.0 * inside[self.column("horizontal")] + inside[self.column(vertical)]) / 3.0

    @property
    def below_noise(self) -> BoolArray:
        """True for a known error below the noise of the reference, (k, q)."""
        return np.asarray(np.isfinite(self.rms) & ~np.isfinite(self.corrected))

    def column(self, component: str) -> int:
        """Return the column of a component."""
        return self.components.index(component)


def table_times(windows: Windows) -> FloatArray:
    """Return the times of the tables: 10, 20, …, 60 s, or at most six times in longer windows."""
    step = _STEP if windows.length <= _ROWS * _STEP else _STEP * np.ceil(windows.length / (_ROWS * _STEP))
    times: FloatArray = np.arange(step, windows.length + 1e-6, step)
    return times if len(times) else windows.grid[-1:]


def columns_at(windows: Windows, times: FloatArray) -> IntArray:
    """Find the columns of the grid nearest to some times."""
    return np.array([int(np.argmin(np.abs(windows.grid - time))) for time in times], dtype=np.int64)


def components(windows: Windows) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute errors, predicted and reference variances on every axis, and along and across the track.

    Returns: `error`, `variance`, `reference` (n, k, 6): `COMPONENTS`. The horizontal error is a length; its variances
    are sums over both axes.
    """
    c, s = np.cos(windows.course), np.sin(windows.course)
    north, east, down = np.moveaxis(windows.error[:, :, :3], -1, 0)
    error = np.stack([north, east, down, c * north + s * east, c * east - s * north, np.hypot(north, east)], axis=-1)
    parts = []
    for p in (windows.covariance[:, :, :3, :3], windows.reference_sd[:, :, :3, None] ** 2 * np.eye(3)):
        nn, ee, dd, ne = p[..., 0, 0], p[..., 1, 1], p[..., 2, 2], p[..., 0, 1]
        along, cross = c * c * nn + 2 * c * s * ne + s * s * ee, s * s * nn - 2 * c * s * ne + c * c * ee
        parts.append(np.stack([nn, ee, dd, along, cross, nn + ee], axis=-1))
    return error, parts[0], parts[1]


def growth(windows: Windows, times: FloatArray | None = None) -> Growth:
    """Summarise free-inertial windows at some times. `times` (k,) [s]; by default from `table_times`."""
    columns = columns_at(windows, table_times(windows) if times is None else times)
    error, variance, reference = (values[:, columns] for values in components(windows))
    inside = (error**2 <= 9.0 * (variance + reference)).astype(np.float64)
    inside[..., 5] = inside[..., :2].mean(axis=-1)
    axes = [error[..., [i]] for i in range(5)] + [error[..., :2]]
    # turn-on errors of one sensor are common to all windows, even if changing headings average them out
    shared = 1.0 if windows.uncalibrated else 0.0
    return _summed(
        windows.grid[columns], COMPONENTS, windows.start, windows.length, axes, variance, reference, inside, shared
    )


def outage_growth(windows: Sequence[Outage]) -> list[Growth]:
    """Summarise outages of each length: errors at the end, and smoothed errors where their predicted sd is largest."""
    growths = []
    for length in sorted({window.length for window in windows}):
        chosen = [window for window in windows if window.length == length]
        vectors = [np.stack(each) for each in zip(*(_vectors(window) for window in chosen), strict=True)]
        variance, reference, inside = (np.empty((len(chosen), 1, len(vectors))) for _ in range(3))
        for column, vector in enumerate(vectors):
            error, sd, reference_sd = np.moveaxis(vector, 1, 0)
            variance[:, 0, column] = np.sum(sd**2, axis=1)
            reference[:, 0, column] = np.nansum(reference_sd**2, axis=1)
            inside[:, 0, column] = np.mean(np.abs(error) <= 3.0 * np.hypot(sd, reference_sd), axis=1)
        axes = [vector[:, None, 0] for vector in vectors]
        start = np.array([window.start for window in chosen])
        growths.append(_summed(np.array([length]), OUTAGE_COMPONENTS, start, length, axes, variance, reference, inside))
    return growths


def common_error(found: Growth) -> tuple[Finding, ...]:
    """Report the share of the horizontal error common to all windows, if it is large."""
    share = float(found.common[-1, found.column("horizontal")])
    finding = Finding.of(Code.OUTAGE_COMMON, share=share, limit_share=_SHARED, duration_s=found.length)
    return (finding,) if share >= _SHARED else ()


def horizontal_at(windows: Sequence[Outage], times: Sequence[float], near: float) -> tuple[FloatArray, FloatArray]:
    """Compute horizontal error and sd of outages at the epochs nearest to some times.

    `times`: since their start [s]. `near`: largest distance of such an epoch [s].
    Returns: `error`, `sd` (n, k) [m]; ``NaN`` without an epoch.
    """
    result = np.full((2, len(windows), len(times)), np.nan)
    for row, window in enumerate(windows):
        for column, wanted in enumerate(times):
            epoch = int(np.argmin(np.abs(window.elapsed - wanted)))
            if abs(window.elapsed[epoch] - wanted) < near:
                result[:, row, column] = np.hypot(*window.error[epoch, :2]), np.hypot(*window.sd[epoch, :2])
    return result[0], result[1]


def by_motion(windows: Windows, times: FloatArray | None = None) -> dict[str, Growth | None]:
    """Compute `growth` of stationary, straight and turning windows; None without such windows."""
    growths: dict[str, Growth | None] = {}
    for motion in free_inertial.MOTIONS:
        chosen = windows.motion == motion
        growths[motion] = growth(windows.only(chosen), times) if chosen.any() else None
    return growths


def _vectors(window: Outage) -> list[FloatArray]:
    """Return error, sd and reference sd, (3, axes), of each of `OUTAGE_COMPONENTS`."""
    end = np.stack([window.error[-1], window.sd[-1], window.reference_sd[-1]])
    heading = np.array([[window.heading[-1]], [window.heading_sd[-1]], [0.0]])
    # epoch of the largest predicted sd, a choice that does not depend on reference noise
    row = int(np.argmax(np.hypot(window.smoothed_sd[:, 0], window.smoothed_sd[:, 1])))
    smoothed = np.stack([window.smoothed[row], window.smoothed_sd[row], window.reference_sd[row]])
    return [end[:, :2], end[:, 2:3], end[:, 3:], heading, smoothed[:, :2], smoothed[:, 2:3]]


def _summed(
    times: FloatArray,
    names: tuple[str, ...],
    start: FloatArray,
    length: float,
    error: Sequence[FloatArray],
    variance: FloatArray,
    reference: FloatArray,
    inside: FloatArray,
    shared: float = 0.0,
) -> Growth:
    """Summarise errors, (n, k, axes) per component, with predicted and reference variances.

    `shared`: known least share of the mean square common to all windows.
    """
    size = np.stack([np.linalg.norm(each, axis=-1) for each in error], axis=-1)
    known, ones = np.isfinite(size), np.ones((1, len(start)))
    effective = effective_count(start, length)

    def mean(values: FloatArray | BoolArray) -> FloatArray:
        return np.asarray(means(np.where(known, values, np.nan), ones)[0])

    square, reference_square = mean(size**2), mean(reference)
    # degrees of freedom of a squared error, below the number of axes if one dominates (Satterthwaite 1946)
    per_axis = [means(each**2, ones)[0] for each in error]
    axes = np.stack([each.sum(axis=-1) ** 2 / np.maximum((each**2).sum(axis=-1), 1e-300) for each in per_axis], -1)
    # share of the mean square that the mean error explains beyond chance: an error common to all windows
    common_square = [(means(each, ones)[0] ** 2).sum(axis=-1) for each in error]
    if "along" in names:
        col = [names.index(each) for each in ("horizontal", "along", "cross")]
        common_square[col[0]] = np.maximum(common_square[col[0]], common_square[col[1]] + common_square[col[2]])
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (np.stack(common_square, axis=-1) - square / effective) / max(1.0 - 1.0 / effective, 1e-9) / square
    common = np.clip(np.where(effective > 1.0, share, np.nan), 0.0, 1.0)
    low, high = (
        each - reference_square for each in mean_square_interval(start, length, size**2, axes, np.fmax(common, shared))
    )
    remaining = square - reference_square
    with np.errstate(divide="ignore", invalid="ignore"):
        rms = np.sqrt(square), np.sqrt(np.where(remaining > 0.0, remaining, np.nan)), np.sqrt(reference_square)
        ends = np.sqrt(np.maximum(low, 0.0)), np.sqrt(np.maximum(high, 0.0))
        extremes = _quantile(size, 0.95), _quantile(size, 1.0)
        predicted, count = np.sqrt(mean(variance)), known.sum(axis=0)
        return Growth(
            times, names, len(start), count, effective, *rms, *ends, *extremes, predicted, mean(inside), common
        )


def _quantile(values: FloatArray, share: float) -> FloatArray:
    """Compute a quantile of the known values over the windows; ``NaN`` without values."""
    none = ~np.isfinite(values).any(axis=0)
    return np.asarray(np.where(none, np.nan, np.nanquantile(np.where(none, 0.0, values), share, axis=0)))


_MEAN_SIZE = np.sqrt(2.0 / np.pi)  # mean absolute value of a standard normal number
_ONE_SENSOR = 1.7  # effective number of independent turn-on errors of two level axes (201 simulated drives)


@dataclass(frozen=True, slots=True)
class Regression:
    """Regression of recorded error sizes on predicted standard deviations."""

    slope: float  # one if the prediction is right, two if errors are twice as large as predicted
    # 95 % confidence interval: the wider of block bootstrap and chi-square. Chi-square counts two axes per independent
    # window, and one window if all share turn-on errors. ``NaN``: the effective sample size is too small
    low: float
    high: float
    # share of the variation explained by the line [-]: at most about 0.6 for normal errors of very different predicted
    # sizes, less for similar predictions
    r_squared: float
    # (m,) points: predicted standard deviation including reference, and error size over the mean size of a standard
    # normal number [m]
    predicted: FloatArray
    recorded: FloatArray


def regression(windows: Windows) -> Regression:
    """Regress North and East errors at the times of the tables on their prediction, through the origin.

    The points are weighted by the inverse of their predicted variance, as the scatter grows with the size.
    """
    columns = columns_at(windows, table_times(windows))
    error, variance, reference = (values[:, columns, :2] for values in components(windows))
    predicted = np.sqrt(variance + reference)
    recorded = np.abs(error) / _MEAN_SIZE

    ratio, known = recorded / predicted, np.isfinite(recorded)
    total, count = np.where(known, ratio, 0.0).sum(axis=(1, 2)), known.sum(axis=(1, 2))

    def slope(weights: FloatArray) -> FloatArray:
        return np.asarray((weights @ total) / (weights @ count))

    low, high = interval(windows.start, windows.length, slope)
    estimate = float(np.mean(ratio[known]))
    freedom = _ONE_SENSOR if windows.uncalibrated else 2.0 * effective_count(windows.start, windows.length)
    ends = (chi_square(freedom, 0.5 + sign * 0.5 * CONFIDENCE) for sign in (1.0, -1.0))
    narrow, wide = (estimate * np.sqrt(freedom / end) for end in ends)
    low, high = np.minimum(low, narrow), np.maximum(high, wide)
    x, y = predicted[known], recorded[known]
    residual = float(np.sum((y - estimate * x) ** 2 / x**2))
    mean = float(np.sum(y / x**2) / np.sum(1.0 / x**2))
    scatter = float(np.sum((y - mean) ** 2 / x**2))
    return Regression(estimate, float(low), float(high), 1.0 - residual / scatter if scatter > 0.0 else np.nan, x, y)


RECOVERY = 60.0  # time after the window with fixes for the smoother [s]
_STATES = ("north_m", "east_m", "down_m", "v_north_m_s", "v_east_m_s", "v_down_m_s")
_COMPARED = 0.25  # interval to which a reference is thinned [s]


def outages(
    ready: FilterInput,
    *,
    lengths: Sequence[float],
    first: float | None = None,
    spacing: float | None = None,
    reference: GpsData | Callable[[FloatArray], GpsData] | None = None,
    workers: Workers = 1,
    progress: Callable[[float], None] | None = None,
) -> list[Outage]:
    """Simulate GNSS outages throughout a drive.

    `lengths`: window lengths [s]. `first`: time from the start of navigation to the first window [s]; by default a
    minute, or less if the drive is short. `spacing`: interval between starts of windows of one length [s]; by default
    about sixty windows fit. Windows may overlap, as each continues from the filter's state after all earlier fixes.
    `reference`: better antenna positions for the comparison, or a function of the final lever arm (3,) [m]; by
    default the removed fixes.
    Raises: ConfigError: lengths or spacing not above zero. InputError: the drive is too short for any window.
    """
    lengths = sorted(set(lengths))
    wrong = [value for value in (*lengths, *([] if spacing is None else [spacing])) if not 0.0 < value < np.inf]
    if wrong or not lengths:
        raise ConfigError("outage.bad_windows", given_s=tuple(wrong))
    fixes = ready.fix_time
    begin, end = ready.initial.time, float(min(ready.imu.time[-1], fixes[-1]))
    rows = free_inertial.window_starts(
        fixes, begin, end, lengths[0], first=first, spacing=spacing, rule="quarter of drive"
    )
    share = 0.3  # share of the computing time for the drive itself
    drive = free_inertial.navigated_drive(ready, ready.gps.time[rows], share_of(progress, 0.0, share))
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
    # a worker process receives only the samples of its window
    jobs = [(free_inertial.part_of(ready, state, length + RECOVERY), state, length) for state, length in tasks]
    results = every(_window, jobs, workers, (reference, course), share_of(progress, share, 1.0 - share))
    return [window for window in results if window is not None and window.elapsed.size]


def _window(
    reference: GpsData | None, course: FloatArray, job: tuple[FilterInput, FilterState, float]
) -> Outage | None:
    """Navigate one window and its recovery, on its part of the drive."""
    ready, state, length = job
    delay = ready.receiver.delay.value
    start, stop = state.time + delay, state.time + delay + length
    gps = _fixes(ready.gps, reference, start, stop, stop + RECOVERY)
    inside = (gps.time > start + 1e-6) & (gps.time <= stop + 1e-6)
    if not inside.any():
        return None
    # minimal solution output, as only the epochs are used
    navigator = Navigator(replace(ready, gps=gps, output=Output(1.0)), state)
    history = feed(navigator, ready.imu).history().smooth()
    rows = np.searchsorted(history.time, gps.time[inside] - delay - 1e-6)
    rows = rows[rows < history.time.shape[0]]
    values = history.innovations[rows]
    reference_sd = np.column_stack([gps.position_sd[inside], gps.velocity_sd[inside]])[: rows.shape[0]]
    elapsed = history.time[rows] - state.time
    filtered = values[:, :6], np.sqrt(np.maximum(values[:, 6:12], 0.0))
    smoothed = values[:, 12:18], np.sqrt(np.maximum(values[:, 18:24], 0.0))
    heading = wrap_pi(rph_from_quat(history.state[rows, 6:])[:, 2] - np.interp(history.time[rows], *course.T))
    speed = float(np.mean(np.linalg.norm(history.state[rows, 3:6], axis=1)))
    return Outage(start, length, elapsed, *filtered, *smoothed, reference_sd, heading, np.sqrt(values[:, 24]), speed)


def _fixes(gps: GpsData, reference: GpsData | None, start: float, stop: float, end: float) -> GpsData:
    """Select the fixes from `stop` to `end`, and before `stop` fixes or reference epochs for comparison only."""
    later = (gps.time > start + 1e-6) & (gps.time <= end)
    inside = later & (gps.time <= stop + 1e-6)
    if reference is None:
        compared = gps.rows(inside & gps.valid)
    else:
        time = reference.time
        chosen = (time > start + 1e-6) & (time <= stop + 1e-6)
        step = float(np.median(np.diff(time))) if time.shape[0] > 1 else _COMPARED
        stride = max(1, round(_COMPARED / step))
        # rows are counted back from the end of the window, so that its last epoch is kept
        chosen &= (np.arange(time.shape[0]) - int(np.searchsorted(time, stop + 1e-6)) + 1) % stride == 0
        compared = reference.rows(chosen)
    after = gps.rows(later & ~inside)
    if after.fix is None:
        after = replace(after, fix=np.ones(after.time.shape[0], dtype=np.int64))
    # receiver headings are missing in the window, and return with the fixes
    unknown = None if gps.heading is None else np.full(compared.time.shape[0], np.nan)
    kind = 0 if reference is None else OF_REFERENCE
    return replace(free_inertial.comparison_only(compared, kind), heading=unknown).joined(after)


@dataclass(frozen=True, slots=True)
class OutageStudy:
    """Outage windows, and the run with all fixes."""

    windows: tuple[Outage, ...]  # outages in order of length, then of time
    growth: tuple[Growth, ...]  # error statistics of the windows of each length
    reference: str  # description of the reference
    run: EvaluatedRun | None = None  # None if read from a folder


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

    start: FloatArray  # (m,) start of the window [s]
    length: FloatArray  # (m,) length of the window [s]
    elapsed: FloatArray  # (m,) time since the start [s]
    error: FloatArray  # (m, 6) error of the filter: position [m], velocity [m/s]
    sd: FloatArray  # (m, 6) sd of the filter [m], [m/s]
    smoothed: FloatArray  # (m, 6) error of the smoother [m], [m/s]
    smoothed_sd: FloatArray  # (m, 6) sd of the smoother [m], [m/s]
    reference_sd: FloatArray  # (m, 6) sd of the reference [m], [m/s]
    heading: FloatArray  # (m,) heading error [rad]
    heading_sd: FloatArray  # (m,) sd of the heading [rad]
    speed: FloatArray  # (m,) mean speed in the window [m/s]

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
        result = []
        for first, last in pairwise(edges):
            part: dict[str, Any] = {name: getattr(self, name)[first:last] for name in self.COLUMNS}
            scalars: dict[str, Any] = {name: float(part.pop(name)[0]) for name in ("start", "length", "speed")}
            result.append(Outage(**part, **scalars))
        return tuple(result)
