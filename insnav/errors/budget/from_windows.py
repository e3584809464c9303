"""Recorded part of an error budget: windows, prediction, diagnosis, simulated replicas, verdict.

The budget of a drive predicts from motion and initial state of its typical window.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from insnav.engine import Workers, share_of
from insnav.errors.budget.error_budget import Budget, RecordedColumn
from insnav.errors.budget.sources import SampledMotion, Source, sampled, start_sources
from insnav.errors.diagnosis.causes import Diagnosis, SensorFit, diagnose, fit_sensors
from insnav.errors.diagnosis.simulated_replica import FEWEST, Replicas, replica_task, replicas
from insnav.errors.evaluated_run import failure
from insnav.errors.outage.free_inertial import Windows, free_window_starts, free_windows
from insnav.errors.outage.gnss_outage import Growth, Regression, by_motion, growth, regression, table_times
from insnav.errors.outage.windows import StartChoice, WindowReference, navigated_drive, reference_from_fixes
from insnav.exceptions import ConfigError
from insnav.filter.error_model import ErrorModel
from insnav.filter.prepare import Prepared
from insnav.findings import Code, Finding
from insnav.imu import ImuSpec, SensorSpec
from insnav.progress import announce
from insnav.sample_statistics import CONFIDENCE, chi_square
from insnav.simulate.truth_from_track import truth_from_track
from insnav.types import Trajectory

MINUTE = 60.0  # [s]


@dataclass(frozen=True, slots=True)
class WindowSettings:
    """Settings of the windows."""

    length: float = MINUTE  # of the windows [s]
    # start of the first, after the start of navigation [s]; None: a minute, or less in a short drive
    first: float | None = None
    spacing: float | None = None  # interval between starts [s]; None: about sixty fit
    start: StartChoice = "forward"  # initial state; a smoothed state is not independent of the reference
    uncalibrated: bool = False  # also windows with uncorrected turn-on errors
    replicas: int = 0  # number of simulated replicas
    seed: int = 0  # of the replicas
    workers: Workers = 1  # processes or engine of the replicas


@dataclass(frozen=True, slots=True)
class Verdict:
    """Agreement of the recorded error at the end of the windows with the prediction."""

    component: str
    # RMS error and its 95 % confidence interval [m]; `recorded` is NaN below the noise of the reference
    recorded: float
    low: float
    high: float
    predicted: float  # [m]
    explained: bool  # not significantly larger than predicted
    cautious: bool  # significantly smaller: the prediction is too large


@dataclass(frozen=True, slots=True)
class RecordedPart:
    """Results of windows of one kind, calibrated or uncalibrated."""

    windows: Windows
    growth: Growth  # at the times of the tables
    curve: Growth  # at every time
    # `growth` of windows ``static``, ``straight``, ``turning``; None without such windows
    motions: dict[str, Growth | None]
    diagnosis: Diagnosis
    sensors: SensorFit
    regression: Regression
    replicas: Replicas | None
    verdicts: tuple[Verdict, ...]  # North, East, Down, horizontal at the end


@dataclass(frozen=True, slots=True)
class RecordedBudget:
    """Recorded part of an error budget."""

    settings: WindowSettings
    reference: str  # description of the reference
    duration: float  # of the navigated drive [s]
    calibrated: RecordedPart  # corrected by the filter's estimates of sensor errors
    uncalibrated: RecordedPart | None  # nothing corrected
    spec: ImuSpec  # specification of the IMU
    track: Trajectory  # the smoothed drive
    notes: tuple[Finding, ...]  # of the drive and of the windows

    @property
    def shown(self) -> RecordedPart:
        """Windows for the comparison with other columns: uncalibrated if requested."""
        return self.calibrated if self.uncalibrated is None else self.uncalibrated


def recorded_budget(
    ready: Prepared,
    spec: ImuSpec,
    reference: WindowReference | None = None,
    settings: WindowSettings | None = None,
    progress: Callable[[float], None] | None = None,
) -> RecordedBudget:
    """Divide a drive into free-inertial windows and find the causes of their errors.

    `ready`: the drive; the windows use no other aiding, either. `reference`: of the errors; by default the fixes of the
    drive.
    Raises: ConfigError: windows outside 10 to 300 s, one or two replicas. InputError: a drive too short for one window,
    or no window without a gap.
    """
    settings = settings or WindowSettings()
    if settings.replicas < 0 or 0 < settings.replicas < FEWEST:
        raise ConfigError("budget.few_replicas", count=settings.replicas, limit=FEWEST)
    reference = reference or reference_from_fixes(ready)
    starts = free_window_starts(ready, settings.length, settings.first, settings.spacing)
    drive = navigated_drive(ready, starts, share_of(progress, 0.0, 0.15))
    spacing = float(np.median(np.diff(starts))) if len(starts) > 1 else settings.length
    kinds = (False, True) if settings.uncalibrated else (False,)
    share = 0.1 if settings.replicas else 0.8
    windows = [
        free_windows(
            drive,
            reference,
            settings.length,
            spacing,
            uncalibrated=kind,
            start=settings.start,
            progress=share_of(progress, 0.15 + share * number / len(kinds), share / len(kinds)),
        )
        for number, kind in enumerate(kinds)
    ]
    made: tuple[Replicas | None, ...] = (None,) * len(kinds)
    if settings.replicas and settings.start == "forward":
        announce("simulating replicas")
        made = replicas(
            drive,
            replica_task(drive, reference, spec, windows, table_times(windows[0])),
            windows,
            settings.replicas,
            seed=settings.seed,
            workers=settings.workers,
            progress=share_of(progress, 0.15 + share, 0.8 - share),
        )
    parts = [_part(each, ready.model, theirs) for each, theirs in zip(windows, made, strict=True)]
    if progress is not None:
        progress(1.0)
    solution = drive.run.solution
    assert drive.run.smoothed is not None
    correlated = ready.settings.correlated is not None
    return RecordedBudget(
        replace(settings, workers=1),  # the result does not depend on the workers
        reference.name,
        float(solution.time[-1] - solution.time[0]),
        parts[0],
        parts[1] if settings.uncalibrated else None,
        spec,
        drive.run.smoothed.solution,
        (
            *filter(None, (failure(drive.run),)),
            *ready.notes,
            *_findings(reference, spec, settings, parts[0], correlated=correlated),
        ),
    )


def _part(windows: Windows, model: ErrorModel, made: Replicas | None) -> RecordedPart:
    times = table_times(windows)
    summed = growth(windows, times)
    return RecordedPart(
        windows,
        summed,
        growth(windows, windows.grid),
        by_motion(windows, times),
        diagnose(windows, model),
        fit_sensors(windows, model),
        regression(windows),
        made,
        verdicts(summed, one_sensor=windows.uncalibrated),
    )


def verdicts(found: Growth, *, one_sensor: bool = False) -> tuple[Verdict, ...]:
    """Compare recorded and predicted error at the last time.

    Errors are explained unless their confidence interval lies above the prediction, or if their square is plausible for
    as many normal errors. An error common to all windows is one sample. If it is the share c of the mean square, n
    windows are equivalent to ``1 / (c^2 + (1 - c)^2 / n)`` samples (Satterthwaite 1946).

    `one_sensor`: the errors of all windows come from the turn-on errors of one IMU. Their RMS may differ from the
    prediction like a single sample.
    """
    out = []
    tail = 0.5 * (1.0 - CONFIDENCE)
    for name in ("north", "east", "down", "horizontal"):
        i = found.column(name)
        rms, low, high, predicted = (float(v[-1, i]) for v in (found.corrected, found.low, found.high, found.predicted))
        # an error below the noise of the reference is not larger than predicted
        recorded = 0.0 if found.below_noise[-1, i] else rms
        common = float(np.nan_to_num(found.common[-1, i]))
        samples = 1.0 / (common**2 + (1.0 - common) ** 2 / max(found.effective, 1.0))
        if one_sensor:
            samples = 2.0 if name == "horizontal" else 1.0
        below, above = (predicted * float(np.sqrt(chi_square(samples, p) / samples)) for p in (tail, 1.0 - tail))
        explained, cautious = recorded <= above, rms < below
        if np.isfinite(low) and not one_sensor:
            explained |= low <= predicted
            cautious &= high < predicted
        out.append(Verdict(name, rms, low, high, predicted, bool(explained), bool(cautious)))
    return tuple(out)


def _findings(
    reference: WindowReference, spec: ImuSpec, settings: WindowSettings, part: RecordedPart, *, correlated: bool
) -> Iterator[Finding]:
    """Report assumptions and missing items."""
    if reference.own_fixes:
        yield Finding.of(Code.BUDGET_OWN_FIXES)
    gyro, accel = (
        sensor.correlation_time
        if np.any(sensor.bias_instability) and sensor.correlation_time < 5.0 * settings.length
        else math.nan
        for sensor in (spec.gyro, spec.accel)
    )
    if not math.isnan(gyro) or not math.isnan(accel):
        yield Finding.of(Code.BUDGET_IN_RUN_BIAS, gyro_s=gyro, accel_s=accel, limit_s=5.0 * settings.length)
    if reference.own_fixes and correlated:
        yield Finding.of(Code.BUDGET_CORRELATED_FIXES)
    if spec.absent:
        yield Finding.of(Code.BUDGET_ABSENT, terms=spec.absent)
    if settings.start == "smoothed":
        yield Finding.of(Code.BUDGET_SMOOTHED_START, replicas=settings.replicas or math.nan)
    if part.motions["static"] is None:
        yield Finding.of(Code.BUDGET_NO_STATIONARY_WINDOW)
        if part.motions["straight"] is None:
            yield Finding.of(Code.BUDGET_ALL_TURNING)


_MARGIN = 5.0  # of the track on both sides of a window [s]


def typical_window(part: RecordedPart) -> int:
    """Return the window whose predicted final variances, horizontal and down, are nearest their mean.

    The budget of this window then predicts the RMS of all windows.
    """
    north, east, down = np.diagonal(part.windows.covariance[:, -1], axis1=1, axis2=2)[:, :3].T
    sizes = np.column_stack((north + east, down))
    mean = sizes.mean(axis=0)
    return int(np.argmin(np.sum(np.abs(sizes - mean) / np.maximum(mean, np.finfo(float).tiny), axis=1)))


def window_motion(budget: RecordedBudget, duration: float) -> SampledMotion:
    """Motion of the typical window, from the smoothed track of the drive.

    `duration`: from the start of the window [s].
    """
    part, track = budget.shown, budget.track
    start = float(part.windows.start[typical_window(part)])
    first, last = np.searchsorted(track.time, [start - _MARGIN, start + duration + _MARGIN])
    first = max(0, first - 1)
    truth = truth_from_track(track.rows(slice(first, last + 1)))
    begin = min(max(start - truth.start, 0.0), truth.duration - duration)
    text = f"motion of the drive from {start:.1f} s, the window closest to the mean prediction"
    return sampled(truth, begin, duration, text)


def window_start_sources(budget: RecordedBudget) -> tuple[Source, ...]:
    """Errors at the start of the typical window, from the covariance of the filter or the specification."""
    return start_sources(budget.shown.windows.start_covariance[typical_window(budget.shown)])


def spec_in_windows(budget: RecordedBudget) -> ImuSpec:
    """Return the IMU errors that arise within the window."""
    return replace(in_run_errors(budget.spec), name=f"{budget.spec.name}, {_kind(budget)}")


def with_recorded(found: Budget, budget: RecordedBudget) -> Budget:
    """Add the recorded column.

    `found`: budget from `spec_in_windows`, `window_start_sources` and `window_motion`.
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
    """Return the errors that an IMU adds after the start: noise, bias change, terms without filter states.

    In-run bias since the start is a random walk with the driving noise of the IMU file's Gauss-Markov process,
    ``2 sd^2 / T`` (Gelb 1974, section 3.6). This holds for times far below T. Accelerometer misalignment acts as a bias
    through gravity, and is included as such.
    """
    return replace(
        spec, gyro=_since(spec.gyro), accel=replace(_since(spec.accel), misalignment=np.zeros(3)), initial=None
    )


def _since(sensor: SensorSpec) -> SensorSpec:
    drive = sensor.rate_random_walk**2 + 2.0 * sensor.bias_instability**2 / sensor.correlation_time
    none = np.zeros(3)
    return replace(sensor, bias=none, bias_instability=none, scale_factor=none, rate_random_walk=np.sqrt(drive))


@dataclass(frozen=True, slots=True)
class BudgetStudy:
    """Budget and its drive."""

    budget: Budget
    # free-inertial windows of the drive; None for a budget without a record
    windows: RecordedBudget | None = None
