"""The recorded half of an error budget in one call: windows, what was predicted, diagnosis, twins, verdict."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from insnav.errors.diagnosis.causes import Diagnosis, diagnose
from insnav.errors.diagnosis.equivalent_sensor_errors import SensorFit, fit_sensors
from insnav.errors.diagnosis.error_regression import Regression, regression
from insnav.errors.diagnosis.simulated_replica import FEWEST, Twins, twins
from insnav.errors.outage.free_inertial import Windows, free_windows
from insnav.errors.outage.statistics import COMPONENTS, Growth, by_motion, growth, table_times
from insnav.errors.outage.window_drive import driven, starts
from insnav.errors.outage.window_reference import Judge, judged_by_fixes
from insnav.errors.outage.window_start import StartChoice
from insnav.exceptions import ConfigError
from insnav.filter.error_model import ErrorModel
from insnav.filter.prepare import Prepared
from insnav.imu import ImuSpec
from insnav.sample_statistics import CONFIDENCE
from insnav.types import Trajectory

MINUTE = 60.0  # [s]
_JUDGED = ("north", "east", "down", "horizontal")


@dataclass(frozen=True, slots=True)
class RecordedSettings:
    """What a user may want to choose about the windows.

    Attributes
    ----------
    length : float
        Of the windows [s].
    first : float or None
        Where the first begins, after the start of navigation [s]; a minute, or less if the drive is short.
    spacing : float or None
        From one to the next [s]; so that about sixty fit.
    start : {"forward", "smoothed"}
        What windows begin with; smoothed starts are not independent of the errors they are judged by.
    raw : bool
        Also windows with the sensors as they were turned on.
    twins : int
        How many simulated twins; none with zero.
    seed : int
        Of the twins.
    workers : int
        Processes.
    """

    length: float = MINUTE
    first: float | None = None
    spacing: float | None = None
    start: StartChoice = "forward"
    raw: bool = False
    twins: int = 0
    seed: int = 0
    workers: int = 1


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether what was recorded at the end of the windows is what was predicted.

    Attributes
    ----------
    component : str
    recorded, low, high : float
        RMS error and its interval [m].
    predicted : float
        [m]
    explained : bool
        Not larger than predicted, as far as the windows tell.
    cautious : bool
        So much smaller that the prediction is too large.
    """

    component: str
    recorded: float
    low: float
    high: float
    predicted: float
    explained: bool
    cautious: bool


@dataclass(frozen=True, slots=True)
class RecordedPart:
    """All about windows of one kind: calibrated, or with sensors as turned on.

    Attributes
    ----------
    windows : Windows
    growth : Growth
        At the times of the tables.
    curve : Growth
        At every time.
    motions : dict
        `growth` of windows ``static``, ``straight``, ``turning``; None where there are none.
    diagnosis : Diagnosis
    sensors : SensorFit
    regression : Regression
    twins : Twins or None
    verdicts : tuple of Verdict
        North, East, Down, horizontal at the end.
    """

    windows: Windows
    growth: Growth
    curve: Growth
    motions: dict[str, Growth | None]
    diagnosis: Diagnosis
    sensors: SensorFit
    regression: Regression
    twins: Twins | None
    verdicts: tuple[Verdict, ...]


@dataclass(frozen=True, slots=True)
class RecordedBudget:
    """The recorded half of an error budget.

    Attributes
    ----------
    settings : RecordedSettings
    judge : str
        What errors are against, in words.
    duration : float
        Of the drive as it was navigated [s].
    calibrated : RecordedPart
        The filter's estimates of sensor errors taken off.
    raw : RecordedPart or None
        None taken off.
    spec : ImuSpec
        The stated IMU.
    track : Trajectory
        The smoothed drive.
    notes : tuple of str
        What was assumed and found.
    """

    settings: RecordedSettings
    judge: str
    duration: float
    calibrated: RecordedPart
    raw: RecordedPart | None
    spec: ImuSpec
    track: Trajectory
    notes: tuple[str, ...]


def recorded_budget(
    ready: Prepared,
    spec: ImuSpec,
    judge: Judge | None = None,
    settings: RecordedSettings | None = None,
    progress: Callable[[float], None] | None = None,
) -> RecordedBudget:
    """Cut a drive into free-inertial windows and find out why they err as they do.

    Parameters
    ----------
    ready : Prepared
        The drive; whatever else helps the filter besides fixes is not used within the windows.
    spec : ImuSpec
        The stated IMU.
    judge : Judge, optional
        What counts as true; the withheld fixes by default.
    settings : RecordedSettings, optional
    progress : callable, optional
        Called with the fraction done.

    Raises
    ------
    ConfigError
        Windows outside 10 to 300 s, one or two twins.
    InputError
        A drive too short for one window, or no window without a gap.
    """
    settings = settings or RecordedSettings()
    if settings.twins < 0 or 0 < settings.twins < FEWEST:
        raise ConfigError(f"{settings.twins} twins make no band", fix=f"ask for {FEWEST} or more, or for 0")
    judge = judge or judged_by_fixes(ready)
    stamps = starts(ready, settings.length, settings.first, settings.spacing)
    drive = driven(ready, stamps, _share(progress, 0.0, 0.15))
    spacing = float(np.median(np.diff(stamps))) if len(stamps) > 1 else settings.length
    kinds = (False, True) if settings.raw else (False,)
    share = 0.1 if settings.twins else 0.8
    windows = [
        free_windows(
            drive,
            judge,
            settings.length,
            spacing,
            raw=raw,
            start=settings.start,
            progress=_share(progress, 0.15 + share * number / len(kinds), share / len(kinds)),
        )
        for number, raw in enumerate(kinds)
    ]
    made: tuple[Twins | None, ...] = (None,) * len(kinds)
    if settings.twins and settings.start == "forward":
        made = twins(
            drive,
            judge,
            spec,
            windows,
            table_times(windows[0]),
            settings.twins,
            seed=settings.seed,
            workers=settings.workers,
            progress=_share(progress, 0.15 + share, 0.8 - share),
        )
    parts = [_part(each, ready.model, theirs) for each, theirs in zip(windows, made, strict=True)]
    if progress is not None:
        progress(1.0)
    solution = drive.run.solution
    assert drive.run.smoothed is not None
    return RecordedBudget(
        settings,
        judge.name,
        float(solution.time[-1] - solution.time[0]),
        parts[0],
        parts[1] if settings.raw else None,
        spec,
        drive.run.smoothed.solution,
        (*ready.notes, *_notes(judge, spec, settings, parts[0], lasting=ready.settings.correlated is not None)),
    )


def _part(windows: Windows, model: ErrorModel, made: Twins | None) -> RecordedPart:
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
        verdicts(summed, one_specimen=windows.raw),
    )


def verdicts(found: Growth, *, one_specimen: bool = False) -> tuple[Verdict, ...]:
    """Compare recorded and predicted error at the last time.

    Errors are explained if their interval reaches down to the prediction; with too few windows for an interval, if
    their square is one that as many normal errors could have.

    Parameters
    ----------
    found : Growth
    one_specimen : bool
        All windows err by the same few numbers, the turn-on errors of one IMU: what was predicted for many of them may
        be missed as far as one draw may miss it.
    """
    out = []
    tail = 0.5 * (1.0 - CONFIDENCE)
    for name in _JUDGED:
        i = COMPONENTS.index(name)
        rms, low, high, predicted = (float(v[-1, i]) for v in (found.rms, found.low, found.high, found.predicted))
        draws = (2.0 if name == "horizontal" else 1.0) if one_specimen else max(found.effective, 1.0)
        below, above = (predicted * float(np.sqrt(chi2.ppf(p, draws) / draws)) for p in (tail, 1.0 - tail))
        if np.isfinite(low) and not one_specimen:
            explained, cautious = low <= predicted, high < predicted
        else:
            explained, cautious = rms <= above, rms < below
        out.append(Verdict(name, rms, low, high, predicted, bool(explained), bool(cautious)))
    return tuple(out)


def _notes(judge: Judge, spec: ImuSpec, settings: RecordedSettings, part: RecordedPart, *, lasting: bool) -> list[str]:
    """What was assumed, and what is missing, in words."""
    notes = []
    if judge.withheld:
        notes.append(
            "No reference was given: the drive is judged by its own withheld fixes, and errors that they have in "
            "common with those before a window are not seen"
        )
    short = [
        f"{name} {sensor.correlation_time:.3g} s"
        for name, sensor in (("gyro", spec.gyro), ("accel", spec.accel))
        if np.any(sensor.bias_instability) and sensor.correlation_time < 5.0 * settings.length
    ]
    if short:
        notes.append(
            f"In-run bias changes within a window (correlation time {', '.join(short)}): columns analytic, covariance "
            "and simulated count it as a random walk, which is too much; that of the filter is right"
        )
    if judge.withheld and lasting:
        notes.append(
            "Errors of these fixes last, and are in the start of a window as in what judges it: recorded errors come "
            "out too small by up to the size of the fixes' own; only the twins make the same mistake"
        )
    if spec.absent:
        notes.append(
            f"The IMU file does not give {', '.join(spec.absent)}: taken as zero, so that less is predicted than there "
            "may be"
        )
    if settings.start == "smoothed":
        notes.append(
            "Not independent: windows begin with the smoothed state, which knows the fixes that judge them; the error "
            "is then smaller than that of any navigation in real time"
            + ("; no twins were made" if settings.twins else "")
        )
    missing = [name for name, found in part.motions.items() if found is None]
    if "static" in missing:
        notes.append("No window is at rest: what bias and tilt do without motion was not seen")
    if "straight" in missing and "static" in missing:
        notes.append("All windows have turns: which curve an error follows is told less well")
    return notes


def _share(progress: Callable[[float], None] | None, begin: float, part: float) -> Callable[[float], None] | None:
    return None if progress is None else lambda done: progress(begin + part * done)
