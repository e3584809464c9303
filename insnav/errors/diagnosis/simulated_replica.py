"""Simulated replica of a drive: its track, the specified IMU and GPS errors, the same filter and windows.

If IMU specification and reported standard deviations are right, the recorded drive is statistically equal to its
replicas.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts are loaded on first use

from insnav.attitude import quat_from_rotvec, quat_from_rph, quat_multiply, rph_from_quat
from insnav.earth import lla_offset
from insnav.engine import Workers
from insnav.errors.outage.free_inertial import Windows, free_windows
from insnav.errors.outage.gnss_outage import growth
from insnav.errors.outage.windows import NavigatedDrive, WindowReference, navigated_drive
from insnav.exceptions import InputError
from insnav.filter.error_model import InitialState
from insnav.filter.gps_correlation import CorrelatedNoise
from insnav.filter.prepare import Prepared
from insnav.imu import ImuSpec
from insnav.sample_statistics import CONFIDENCE
from insnav.simulate.imu_errors import ImuSimulation, corrupt_imu, gauss_markov
from insnav.simulate.montecarlo import Failure, Sample, monte_carlo
from insnav.simulate.recording import perfect_imu
from insnav.simulate.truth import LevelTruth, Truth, gps_from_truth
from insnav.simulate.truth_from_track import Residual, track_residual, truth_from_track
from insnav.types import FloatArray, GpsData

FEWEST = 3  # replicas for a band
_EDGE = 0.05  # at both ends of the track there are no fixes [s]
_IMU, _FIXES, _START, _REFERENCE = 1, 2, 3, 4  # streams of random numbers


@dataclass(frozen=True, slots=True)
class Replicas:
    """Window errors of several replicas, and the position of the recorded ones among them."""

    times: FloatArray  # (k,) [s]
    # (s, k, 6) RMS error of each replica, reference errors included, `insnav.errors.outage.gnss_outage.COMPONENTS` [m]
    rms: FloatArray
    # (k, 6) 95 % prediction band of a further replica, joint over three axes [m]
    low: FloatArray
    high: FloatArray
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
        """Band with the reference variance subtracted: `low` and `high` (k, 6) [m]."""
        low, high = (np.sqrt(np.maximum(each**2 - self.reference**2, 0.0)) for each in (self.low, self.high))
        return np.asarray(low), np.asarray(high)

    @property
    def agree(self) -> bool:
        """True if recorded North, East and Down are in the band at the end of the windows."""
        return bool(self.inside[-1, :3].all())


@dataclass(frozen=True, slots=True)
class ReplicaTask:
    """Task of a Monte Carlo: one replica for a seed."""

    ready: Prepared  # the recorded drive with perfect samples
    spec: ImuSpec
    truth: LevelTruth  # the motion
    fixes: GpsData  # perfect fixes at the recorded epochs, with the reported standard deviations
    reference: WindowReference  # perfect reference
    starts: FloatArray  # (n,) start times of windows [s]
    # of the windows [s]
    length: float
    spacing: float
    kinds: tuple[bool, ...]  # True for each kind of uncalibrated windows
    times: FloatArray  # (k,) of the tables [s]

    def __call__(self, seed: int) -> Sample:
        """Return the RMS of its windows of each kind at the times of the tables, concatenated."""
        found = [growth(windows, self.times).rms for windows in self.windows(seed)]
        return Sample(np.concatenate([each.ravel() for each in found]), np.zeros(1))

    def windows(self, seed: int) -> tuple[Windows, ...]:
        """Simulate, navigate and divide into windows."""
        sensors = corrupt_imu(self.ready.imu, self.spec, (seed, _IMU))
        fixes = _with_errors(self.fixes, (seed, _FIXES), self.ready.settings.correlated)
        ready = replace(
            self.ready,
            imu=sensors.imu,
            gps=fixes,
            settings=replace(self.ready.settings, delay=0.0, velocity_lag=0.0, lag_sd=0.0, aiding=None),
            initial=_started(self.ready.initial, self.truth, sensors, np.random.default_rng((seed, _START))),
        )
        if self.reference.own_fixes:
            compared = fixes.rows(np.isin(fixes.time, self.reference.fixes.time))
        else:
            compared = _with_errors(self.reference.fixes, (seed, _REFERENCE), None)
        reference = replace(self.reference, fixes=compared)
        drive = navigated_drive(ready, self.starts, smooth=False)
        return tuple(
            free_windows(drive, reference, self.length, self.spacing, uncalibrated=each, times=self.times)
            for each in self.kinds
        )


def replica_task(
    drive: NavigatedDrive, reference: WindowReference, spec: ImuSpec, windows: Sequence[Windows], times: FloatArray
) -> ReplicaTask:
    """Build the motion of the replica from the smoothed drive, with perfect measurements.

    `times` (k,): of the tables [s].
    """
    ready = drive.ready
    assert drive.run.smoothed is not None
    track = drive.run.smoothed.solution
    # without duplicate times, which a reset or the end of a block may produce
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
    """Simulate replicas and locate the recorded windows of each kind among them.

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
    """Locate recorded windows among their replicas."""
    n = len(rms)
    size = np.log(np.maximum(rms, 1e-12))
    # a third of the miss probability per axis, for a joint probability
    certain = 1.0 - 0.5 * (1.0 - CONFIDENCE) / 3.0
    half = float(scipy.special.stdtrit(n - 1, certain)) * np.std(size, axis=0, ddof=1) * np.sqrt(1.0 + 1.0 / n)
    middle, summed = size.mean(axis=0), growth(windows, times)
    low, high = np.exp(middle - half), np.exp(middle + half)
    return Replicas(times, rms, low, high, summed.rms, summed.reference, far, failures)


def _perfect_fixes(truth: Truth, gps: GpsData, lever_b: FloatArray) -> GpsData:
    """Build error-free fixes at the recorded epochs within the motion, with the same missing values."""
    end = truth.start + truth.duration
    inside = (gps.time >= truth.start + _EDGE) & (gps.time <= end - _EDGE)
    like = replace(gps.rows(inside), heading=None)
    made = gps_from_truth(truth, like.time, lever_b)
    return replace(like, lla=made.lla, v_n=np.where(np.isfinite(like.v_n), made.v_n, np.nan))


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
    at = truth.evaluate(np.array([begin]))
    p = initial.covariance
    errors = sensors.errors
    row = min(int(np.searchsorted(sensors.imu.time, begin)), len(sensors.imu.time) - 1)
    gyro_bias = sensors.gyro_bias[row] + rng.standard_normal(3) * np.sqrt(np.diag(p)[9:12])
    sensor = -np.concatenate(
        [
            sensors.gyro_bias[row] - gyro_bias,
            sensors.accel_bias[row],
            np.diag(errors.gyro_matrix) - 1.0,
            np.diag(errors.accel_matrix) - 1.0,
        ]
    )
    gain = p[:9, 9:] @ np.linalg.pinv(p[9:, 9:], rcond=1e-12, hermitian=True)
    left = p[:9, :9] - gain @ p[9:, :9]
    value, vector = np.linalg.eigh(0.5 * (left + left.T))
    error = gain @ sensor + vector @ (np.sqrt(np.maximum(value, 0.0)) * rng.standard_normal(9))
    # C_hat = (I - [phi x]) C
    q_nb = quat_multiply(quat_from_rotvec(-error[6:]), quat_from_rph(at.rph[0]))
    return replace(
        initial,
        from_fix=False,
        time=begin,
        lla=lla_offset(at.lla[0], error[:3]),
        v_n=at.v_n[0] + error[3:6],
        rph=rph_from_quat(q_nb),
        gyro_bias=gyro_bias,
    )
