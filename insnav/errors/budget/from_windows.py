"""Recorded part of an error budget: windows, prediction, diagnosis, simulated replicas, verdict.

The budget of a drive uses the motion and the initial state of its typical window. A simulated replica has the track of
the drive, the specified IMU and GPS errors, the same filter and the same windows. If IMU specification and reported
standard deviations are right, the recorded drive is statistically equal to its replicas.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # scipy loads its subpackages on first use

from insnav.attitude import quat_from_rotvec, quat_from_rph, quat_multiply, rph_from_quat
from insnav.earth import lla_offset
from insnav.engine import Workers, share_of
from insnav.errors.budget.error_budget import Budget, RecordedColumn
from insnav.errors.budget.sources import SampledMotion, Source, sampled, start_sources
from insnav.errors.diagnosis.causes import Diagnosis, SensorFit, diagnose, fit_sensors
from insnav.errors.evaluated_run import failure
from insnav.errors.outage import free_inertial
from insnav.errors.outage.free_inertial import NavigatedDrive, StartChoice, WindowReference, Windows
from insnav.errors.outage.gnss_outage import Growth, Regression, by_motion, growth, regression, table_times
from insnav.exceptions import ConfigError, InputError
from insnav.filter.error_model import ErrorModel, InitialState
from insnav.filter.filter_input import Aiding, FilterInput
from insnav.filter.gps_noise import CorrelatedNoise
from insnav.filter.receiver import Lag
from insnav.findings import Code, Finding
from insnav.imu import ImuSpec, SensorSpec
from insnav.progress import announce
from insnav.sample_statistics import CONFIDENCE, chi_square
from insnav.simulate.montecarlo import Failure, Sample, monte_carlo
from insnav.simulate.recording import perfect_imu
from insnav.simulate.sensor_errors import ImuSimulation, corrupt_imu, gauss_markov
from insnav.simulate.truth import LevelTruth, Truth, gps_from_truth
from insnav.simulate.truth_from_track import Residual, track_residual, truth_from_track
from insnav.types import FloatArray, GpsData, Trajectory

FEWEST = 3  # least number of replicas for a prediction band
_EDGE = 0.05  # margin without simulated fixes at both ends of the track [s]
_IMU, _FIXES, _START, _REFERENCE = 1, 2, 3, 4  # numbers of independent random streams
MINUTE = 60.0  # [s]


@dataclass(frozen=True, slots=True)
class Replicas:
    """Window errors of several replicas, their prediction band, and the recorded window errors."""

    times: FloatArray  # (k,) times of the tables [s]
    # (s, k, 6) RMS error of each replica, reference errors included, `insnav.errors.outage.gnss_outage.COMPONENTS` [m]
    rms: FloatArray
    low: FloatArray  # (k, 6) lower limit of a 95 % prediction band of a further replica, joint over three axes [m]
    high: FloatArray  # (k, 6) upper limit [m]
    recorded: FloatArray  # (k, 6) RMS error of the recorded windows, reference errors included [m]
    reference: FloatArray  # (k, 6) RMS standard deviation of the reference [m]
    apart: Residual  # distance between the motion of the replica and the recorded track
    failures: tuple[Failure, ...]  # replicas that could not be navigated

    @property
    def inside(self) -> np.ndarray:
        """True if the recorded RMS is in the band, (k, 6); false if unknown."""
        return np.asarray((self.recorded >= self.low) & (self.recorded <= self.high))

    @property
    def band(self) -> tuple[FloatArray, FloatArray]:
        """Band without the reference variance: `low`, `high` (k, 6), columns as in `rms` [m]."""
        low, high = (np.sqrt(np.maximum(each**2 - self.reference**2, 0.0)) for each in (self.low, self.high))
        return np.asarray(low), np.asarray(high)

    @property
    def agree(self) -> bool:
        """True if recorded North, East and Down are in the band at the end of the windows."""
        return bool(self.inside[-1, :3].all())


@dataclass(frozen=True, slots=True)
class ReplicaTask:
    """Task of a Monte Carlo: one replica for a seed."""

    ready: FilterInput  # the recorded drive with error-free IMU samples
    spec: ImuSpec
    truth: LevelTruth  # motion of the drive
    fixes: GpsData  # error-free fixes at the recorded epochs, with the reported standard deviations
    reference: WindowReference  # error-free reference
    starts: FloatArray  # (n,) start times of windows [s]
    length: float  # length of the windows [s]
    spacing: float  # interval between the starts of windows [s]
    kinds: tuple[bool, ...]  # for each kind of window: True if uncalibrated
    times: FloatArray  # (k,) times of the tables [s]

    def __call__(self, seed: int) -> Sample:
        """Return the RMS errors of the windows of each kind at the times of the tables, concatenated."""
        rms = [growth(windows, self.times).rms for windows in self.windows(seed)]
        return Sample(np.concatenate([each.ravel() for each in rms]), np.zeros(1))

    def windows(self, seed: int) -> tuple[Windows, ...]:
        """Simulate and navigate one replica; return its windows of each kind."""
        sensors = corrupt_imu(self.ready.imu, self.spec, (seed, _IMU))
        receiver, lag = self.ready.receiver, Lag(moments=self.ready.receiver.lag.moments)
        fixes = _with_errors(self.fixes, (seed, _FIXES), receiver.correlated)
        start = _started(self.ready.initial, self.truth, sensors, np.random.default_rng((seed, _START)))
        ready = replace(
            self.ready,
            imu=sensors.imu,
            gps=fixes,
            receiver=replace(receiver, delay=replace(receiver.delay, value=0.0), lag=lag),
            aiding=Aiding(),
        ).replace_start(self.ready.alignment, start)
        if self.reference.own_fixes:
            compared = fixes.rows(np.isin(fixes.time, self.reference.fixes.time))
        else:
            compared = _with_errors(self.reference.fixes, (seed, _REFERENCE), None)
        reference = replace(self.reference, fixes=compared)
        drive = free_inertial.navigated_drive(ready, self.starts, smooth=False)
        return tuple(
            free_inertial.free_windows(drive, reference, self.length, self.spacing, uncalibrated=each, times=self.times)
            for each in self.kinds
        )


def replica_task(
    drive: NavigatedDrive, reference: WindowReference, spec: ImuSpec, windows: Sequence[Windows], times: FloatArray
) -> ReplicaTask:
    """Build the motion of the replica from the smoothed drive, with perfect measurements.

    `times` (k,): times of the tables [s].
    """
    ready = drive.ready
    assert drive.run.smoothed is not None
    track = drive.run.smoothed.solution
    # a reset or the end of a block may produce duplicate times, which are removed
    truth = truth_from_track(track.rows(np.concatenate([[True], np.diff(track.time) > 1e-6])))
    antenna = drive.run.lever_b
    point = antenna if reference.lever_b is None else reference.lever_b
    return ReplicaTask(
        replace(ready, imu=perfect_imu(truth, 1.0 / ready.nominal, ready.imu.sampling)),
        spec,
        truth,
        _perfect_fixes(truth, ready.gps, antenna),
        replace(reference, fixes=_perfect_fixes(truth, reference.fixes, point)),
        windows[0].start,
        windows[0].length,
        windows[0].spacing,
        tuple(each.uncalibrated for each in windows),
        times,
    )


def replicas(
    drive: NavigatedDrive,
    task: ReplicaTask,
    windows: Sequence[Windows],
    count: int,
    *,
    seed: int = 0,
    workers: Workers = 1,
    progress: Callable[[float], None] | None = None,
) -> tuple[Replicas, ...]:
    """Simulate replicas, and compare their RMS errors with the recorded ones for each kind of windows.

    `count`: number of replicas, three or more.
    Raises: InputError: fewer than three replicas could be navigated.

    Notes
    -----
    The band is the prediction interval of a further sample of a log-normal distribution, with mean and deviation from
    the replicas (Hahn and Meeker, "Statistical Intervals", 1991, section 4.7).
    """
    assert drive.run.smoothed is not None
    runs = monte_carlo(task, count, seed, workers=workers, progress=progress)
    n = len(runs.number)
    if n < FEWEST:
        first = runs.failures[0].error if runs.failures else ""
        raise InputError("diagnosis.few_replicas", count=n, total=count, failure=first, limit=FEWEST)
    rms = runs.figures.reshape(n, len(windows), len(task.times), -1)
    far = track_residual(task.truth, drive.run.smoothed.solution)
    return tuple(_among(each, rms[:, kind], task.times, far, runs.failures) for kind, each in enumerate(windows))


def _among(
    windows: Windows, rms: FloatArray, times: FloatArray, far: Residual, failures: tuple[Failure, ...]
) -> Replicas:
    """Compute the prediction band of the replicas for comparison with the recorded windows."""
    n = len(rms)
    size = np.log(np.maximum(rms, 1e-12))
    # each of three axes has a third of the miss probability, so that the band is joint
    quantile = 1.0 - 0.5 * (1.0 - CONFIDENCE) / 3.0
    half_width = float(scipy.special.stdtrit(n - 1, quantile)) * np.std(size, axis=0, ddof=1) * np.sqrt(1.0 + 1.0 / n)
    middle, recorded = size.mean(axis=0), growth(windows, times)
    low, high = np.exp(middle - half_width), np.exp(middle + half_width)
    return Replicas(times, rms, low, high, recorded.rms, recorded.reference, far, failures)


def _perfect_fixes(truth: Truth, gps: GpsData, lever_b: FloatArray) -> GpsData:
    """Build error-free fixes at the recorded epochs within the motion, with the same missing values."""
    end = truth.start + truth.duration
    recorded = replace(gps.rows((gps.time >= truth.start + _EDGE) & (gps.time <= end - _EDGE)), heading=None)
    perfect = gps_from_truth(truth, recorded.time, lever_b)
    return replace(recorded, lla=perfect.lla, v_n=np.where(np.isfinite(recorded.v_n), perfect.v_n, np.nan))


def _with_errors(gps: GpsData, seed: tuple[int, int], correlated: CorrelatedNoise | None) -> GpsData:
    """Add errors of the reported standard deviation to each fix, with the given time-correlated share."""
    rng = np.random.default_rng(seed)
    share = 0.0 if correlated is None else correlated.share
    error = rng.standard_normal(gps.lla.shape) * np.sqrt(1.0 - share)
    if correlated is not None:
        error += np.sqrt(share) * gauss_markov(rng, gps.time, np.ones(3), correlated.time)
    velocity = rng.standard_normal(gps.v_n.shape) * np.nan_to_num(gps.velocity_sd)
    if correlated is not None and correlated.velocity_sd is not None:
        velocity += gauss_markov(rng, gps.time, correlated.velocity_sd, correlated.velocity_time)
    return replace(gps, lla=lla_offset(gps.lla, error * gps.position_sd), v_n=gps.v_n + velocity)


def _started(initial: InitialState, truth: Truth, sensors: ImuSimulation, rng: np.random.Generator) -> InitialState:
    """Sample an initial state from its covariance, conditional on the sensor errors."""
    begin = max(initial.time, truth.start)
    true = truth.evaluate(np.array([begin]))
    covariance = initial.covariance
    errors = sensors.errors
    row = min(int(np.searchsorted(sensors.imu.time, begin)), len(sensors.imu.time) - 1)
    gyro_bias = sensors.gyro_bias[row] + rng.standard_normal(3) * np.sqrt(np.diag(covariance)[9:12])
    sensor = -np.concatenate(
        [
            sensors.gyro_bias[row] - gyro_bias,
            sensors.accel_bias[row],
            np.diag(errors.gyro_matrix) - 1.0,
            np.diag(errors.accel_matrix) - 1.0,
        ]
    )
    # navigation errors conditional on the sensor errors: mean by the gain, and remaining covariance
    gain = covariance[:9, 9:] @ np.linalg.pinv(covariance[9:, 9:], rcond=1e-12, hermitian=True)
    conditional = covariance[:9, :9] - gain @ covariance[9:, :9]
    value, vector = np.linalg.eigh(0.5 * (conditional + conditional.T))
    error = gain @ sensor + vector @ (np.sqrt(np.maximum(value, 0.0)) * rng.standard_normal(9))
    # attitude error phi: C_hat = (I - [phi x]) C
    return replace(
        initial,
        from_fix=False,
        time=begin,
        lla=lla_offset(true.lla[0], error[:3]),
        v_n=true.v_n[0] + error[3:6],
        rph=rph_from_quat(quat_multiply(quat_from_rotvec(-error[6:]), quat_from_rph(true.rph[0]))),
        gyro_bias=gyro_bias,
    )


@dataclass(frozen=True, slots=True)
class WindowSettings:
    """Settings of the windows."""

    length: float = MINUTE  # length of the windows [s]
    # time from the start of navigation to the first window [s]; None: a minute, or less in a short drive
    first: float | None = None
    spacing: float | None = None  # interval between starts [s]; None: about sixty windows
    start: StartChoice = "forward"  # initial state; a smoothed state is not independent of the reference
    uncalibrated: bool = False  # evaluate also windows with uncorrected turn-on errors
    replicas: int = 0  # number of simulated replicas
    seed: int = 0  # random seed of the replicas
    workers: Workers = 1  # processes or engine of the replicas


@dataclass(frozen=True, slots=True)
class Verdict:
    """Agreement of the recorded error at the end of the windows with the prediction."""

    component: str
    # RMS error and its 95 % confidence interval [m]; `recorded` is NaN below the noise of the reference
    recorded: float
    low: float
    high: float
    predicted: float  # predicted RMS error [m]
    explained: bool  # True if the recorded error is not significantly larger than predicted
    cautious: bool  # True if the recorded error is significantly smaller than predicted


@dataclass(frozen=True, slots=True)
class RecordedPart:
    """Results of windows of one kind, calibrated or uncalibrated."""

    windows: Windows
    growth: Growth  # error growth at the times of the tables
    curve: Growth  # error growth at all times of the windows
    # `growth` of windows ``static``, ``straight``, ``turning``; None without such windows
    motions: dict[str, Growth | None]
    diagnosis: Diagnosis
    sensors: SensorFit
    regression: Regression
    replicas: Replicas | None
    verdicts: tuple[Verdict, ...]  # for North, East, Down, horizontal, at the end of the windows


@dataclass(frozen=True, slots=True)
class RecordedBudget:
    """Recorded part of an error budget."""

    settings: WindowSettings
    reference: str  # description of the reference
    duration: float  # duration of the navigated drive [s]
    calibrated: RecordedPart  # windows corrected by the filter's estimates of sensor errors
    uncalibrated: RecordedPart | None  # windows without these corrections
    spec: ImuSpec  # specification of the IMU
    track: Trajectory  # smoothed trajectory of the drive
    notes: tuple[Finding, ...]  # findings about the drive and the windows

    @property
    def shown(self) -> RecordedPart:
        """Part for the comparison with other columns: uncalibrated windows if requested."""
        return self.calibrated if self.uncalibrated is None else self.uncalibrated


def recorded_budget(
    ready: FilterInput,
    spec: ImuSpec,
    reference: WindowReference | None = None,
    settings: WindowSettings | None = None,
    progress: Callable[[float], None] | None = None,
) -> RecordedBudget:
    """Divide a drive into free-inertial windows and find the causes of their errors.

    `ready`: the drive. Its windows use neither fixes nor other aiding. `reference`: reference of the errors; by default
    the fixes of the drive.
    Raises: ConfigError: windows outside 10 to 300 s, one or two replicas. InputError: a drive too short for one window,
    or every window has a gap.
    """
    settings = settings or WindowSettings()
    if settings.replicas < 0 or 0 < settings.replicas < FEWEST:
        raise ConfigError("budget.few_replicas", count=settings.replicas, limit=FEWEST)
    reference = reference or free_inertial.reference_from_fixes(ready)
    starts = free_inertial.free_window_starts(ready, settings.length, settings.first, settings.spacing)
    drive = free_inertial.navigated_drive(ready, starts, share_of(progress, 0.0, 0.15))
    spacing = float(np.median(np.diff(starts))) if len(starts) > 1 else settings.length
    kinds = (False, True) if settings.uncalibrated else (False,)
    share = 0.1 if settings.replicas else 0.8
    windows = [
        free_inertial.free_windows(
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
    simulated: tuple[Replicas | None, ...] = (None,) * len(kinds)
    if settings.replicas and settings.start == "forward":
        announce("simulating replicas")
        simulated = replicas(
            drive,
            replica_task(drive, reference, spec, windows, table_times(windows[0])),
            windows,
            settings.replicas,
            seed=settings.seed,
            workers=settings.workers,
            progress=share_of(progress, 0.15 + share, 0.8 - share),
        )
    parts = [_part(each, ready.model, theirs) for each, theirs in zip(windows, simulated, strict=True)]
    if progress is not None:
        progress(1.0)
    solution = drive.run.solution
    assert drive.run.smoothed is not None
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
            *_findings(reference, spec, settings, parts[0], correlated=ready.receiver.correlated is not None),
        ),
    )


def _part(windows: Windows, model: ErrorModel, made: Replicas | None) -> RecordedPart:
    times = table_times(windows)
    recorded = growth(windows, times)
    return RecordedPart(
        windows,
        recorded,
        growth(windows, windows.grid),
        by_motion(windows, times),
        diagnose(windows, model),
        fit_sensors(windows, model),
        regression(windows),
        made,
        verdicts(recorded, one_sensor=windows.uncalibrated),
    )


def verdicts(found: Growth, *, one_sensor: bool = False) -> tuple[Verdict, ...]:
    """Compare recorded and predicted RMS error at the end of the windows.

    Errors are explained if their mean square is plausible (chi-square) for the predicted sd, or if their confidence
    interval reaches the prediction. An error common to all windows is one sample. If it is the share c of
    the mean square, n windows are equivalent to ``1 / (c^2 + (1 - c)^2 / n)`` samples (Satterthwaite 1946).

    `one_sensor`: the turn-on errors of one IMU cause the errors of all windows, which then count as one sample.
    """
    out = []
    tail = 0.5 * (1.0 - CONFIDENCE)
    for name in ("north", "east", "down", "horizontal"):
        i = found.column(name)
        rms, low, high, predicted = (float(v[-1, i]) for v in (found.corrected, found.low, found.high, found.predicted))
        # an error below the noise of the reference counts as zero, so it is not larger than predicted
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
    """Report assumptions of the budget, absent error terms and absent kinds of windows."""
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


_MARGIN = 5.0  # length of the track on both sides of a window [s]


def typical_window(part: RecordedPart) -> int:
    """Return the index of the window whose predicted final variances, horizontal and down, are nearest their mean.

    The budget of this window then predicts the RMS of all windows.
    """
    north, east, down = np.diagonal(part.windows.covariance[:, -1], axis1=1, axis2=2)[:, :3].T
    sizes = np.column_stack((north + east, down))
    mean = sizes.mean(axis=0)
    return int(np.argmin(np.sum(np.abs(sizes - mean) / np.maximum(mean, np.finfo(float).tiny), axis=1)))


def window_motion(budget: RecordedBudget, duration: float) -> SampledMotion:
    """Compute the motion of the typical window from the smoothed track of the drive.

    `duration`: length of the motion from the start of the window [s].
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
    """Compute the error sources at the start of the typical window from its start covariance."""
    return start_sources(budget.shown.windows.start_covariance[typical_window(budget.shown)])


def spec_in_windows(budget: RecordedBudget) -> ImuSpec:
    """Return a specification of IMU errors after the start of a window: noise, bias change, terms without states.

    In-run bias since the start is a random walk with the driving noise of the IMU file's Gauss-Markov process,
    ``2 sd^2 / T`` (Gelb 1974, section 3.6). This holds for times far below T. Accelerometer misalignment acts as a bias
    through gravity, and is included as such.
    """
    spec, name = budget.spec, f"{budget.spec.name}, {_kind(budget)}"
    accel = replace(_since(spec.accel), misalignment=np.zeros(3))
    return replace(spec, name=name, gyro=_since(spec.gyro), accel=accel, initial=None)


def with_recorded(found: Budget, budget: RecordedBudget) -> Budget:
    """Add the recorded column. `found`: budget from `spec_in_windows`, `window_start_sources` and `window_motion`."""
    windows = budget.shown.windows
    times = found.time[found.chosen]
    recorded = growth(windows, times)
    columns = [recorded.column(name) for name in ("north", "east", "down", "horizontal")]
    column = RecordedColumn(
        time=times,
        corrected=recorded.corrected[:, columns],
        low=recorded.low[:, columns],
        high=recorded.high[:, columns],
        predicted=recorded.predicted[:, columns],
        windows=windows.count,
        description=f"{windows.count} windows of {windows.length:g} s, {_kind(budget)}, against {budget.reference}",
    )
    return replace(found, recorded=column)


def _kind(budget: RecordedBudget) -> str:
    return "uncalibrated sensors" if budget.shown.windows.uncalibrated else "calibrated by the filter"


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
