"""The simulated twin of a drive: its track, the stated IMU and the stated fixes, the same filter, the same windows.

If the figures of the IMU and of the fixes are right, the recorded drive is one more of its twins.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from insnav.attitude import quat_from_rotvec, quat_from_rph, quat_multiply, rph_from_quat
from insnav.earth import lla_offset
from insnav.errors.outage.free_inertial import Windows, free_windows
from insnav.errors.outage.statistics import growth
from insnav.errors.outage.window_drive import Driven, driven
from insnav.errors.outage.window_reference import Judge
from insnav.exceptions import InputError
from insnav.filter.error_model import InitialState
from insnav.filter.gps_correlation import CorrelatedNoise
from insnav.filter.prepare import Prepared
from insnav.imu import ImuSpec
from insnav.sample_statistics import CONFIDENCE
from insnav.simulate.ideal_sensors import gps_from_truth
from insnav.simulate.imu_errors import ImuSimulation, corrupt_imu, gauss_markov
from insnav.simulate.montecarlo import Sample, monte_carlo
from insnav.simulate.recording import perfect_imu
from insnav.simulate.truth import LevelTruth, Truth
from insnav.simulate.truth_from_track import Residual, apart, truth_from_track
from insnav.types import FloatArray, GpsData, ImuData, Trajectory

FEWEST = 3  # twins from which a band can be told
_EDGE = 0.05  # of the track is not asked for fixes [s]
_IMU, _FIXES, _START, _JUDGE = 1, 2, 3, 4  # streams of random numbers


@dataclass(frozen=True, slots=True)
class Twins:
    """What the windows of several twins amount to, and where the recorded ones lie among them.

    Attributes
    ----------
    times : (k,) array
        [s]
    rms : (s, k, 6) array
        RMS of each twin with the judge's uncertainty in it, `insnav.errors.outage.statistics.COMPONENTS` [m].
    low, high : (k, 6) array
        Band that holds one more twin with 95 %, all three axes of it together [m].
    recorded : (k, 6) array
        RMS of the recorded windows, also with the judge's uncertainty in it [m].
    judge : (k, 6) array
        RMS of that uncertainty [m].
    apart : Residual
        How far the twin's motion is from the recorded track.
    failures : tuple of str
        Twins that could not be navigated, and why.
    """

    times: FloatArray
    rms: FloatArray
    low: FloatArray
    high: FloatArray
    recorded: FloatArray
    judge: FloatArray
    apart: Residual
    failures: tuple[str, ...]

    @property
    def inside(self) -> np.ndarray:
        """(k, 6) array: whether the recorded RMS lies in the band; false where it is not known."""
        return np.asarray((self.recorded >= self.low) & (self.recorded <= self.high))

    @property
    def band(self) -> tuple[FloatArray, FloatArray]:
        """(k, 6) arrays: `low` and `high` with the uncertainty of the judge taken off [m]."""
        low, high = (np.sqrt(np.maximum(each**2 - self.judge**2, 0.0)) for each in (self.low, self.high))
        return np.asarray(low), np.asarray(high)

    @property
    def agree(self) -> bool:
        """Recorded North, East and Down are in the band at the end of the windows."""
        return bool(self.inside[-1, :3].all())


@dataclass(frozen=True, slots=True)
class TwinTask:
    """One twin, given its seed: the task of a Monte Carlo.

    Attributes
    ----------
    ready : Prepared
        The recorded drive: settings, model, start. Its samples are not used.
    spec : ImuSpec
        The stated IMU.
    truth : Truth
        The motion.
    perfect : ImuData
        What an IMU without errors measures.
    fixes : GpsData
        What a receiver without errors measures at the recorded epochs, with the standard deviations stated there.
    judge : Judge
        The same of the judge.
    stamps : (n,) array
        Where windows begin [s].
    length, spacing : float
        Of the windows [s].
    kinds : tuple of bool
        For each kind of windows whether sensor errors are left in.
    times : (k,) array
        Of the tables [s].
    """

    ready: Prepared
    spec: ImuSpec
    truth: LevelTruth
    perfect: ImuData
    fixes: GpsData
    judge: Judge
    stamps: FloatArray
    length: float
    spacing: float
    kinds: tuple[bool, ...]
    times: FloatArray

    def __call__(self, seed: int) -> Sample:
        """RMS of its windows of each kind at the times of the tables, one after the other."""
        found = [growth(windows, self.times).judged_rms for windows in self.windows(seed)]
        return Sample(np.concatenate([each.ravel() for each in found]), np.zeros(1))

    def windows(self, seed: int) -> tuple[Windows, ...]:
        """Simulate, navigate, cut."""
        specimen = corrupt_imu(self.perfect, self.spec, (seed, _IMU))
        lasting = self.ready.settings.correlated
        fixes = _measured(self.fixes, (seed, _FIXES), lasting)
        ready = replace(
            self.ready,
            imu=specimen.imu,
            gps=fixes,
            settings=replace(self.ready.settings, delay=0.0, velocity_lag=0.0, aiding=None),
            initial=_started(self.ready.initial, self.truth, specimen, np.random.default_rng((seed, _START))),
        )
        if self.judge.withheld:
            judge = replace(self.judge, fixes=fixes.rows(np.isin(fixes.time, self.judge.fixes.time)))
        else:
            judge = replace(self.judge, fixes=_measured(self.judge.fixes, (seed, _JUDGE), None))
        drive = driven(ready, self.stamps, smooth=False)
        return tuple(
            free_windows(drive, judge, self.length, self.spacing, raw=raw, times=self.times) for raw in self.kinds
        )


def twin_task(drive: Driven, judge: Judge, spec: ImuSpec, windows: Sequence[Windows], times: FloatArray) -> TwinTask:
    """Make the twin's motion from the smoothed drive, and what perfect sensors measure of it.

    Parameters
    ----------
    drive : Driven
        Smoothed.
    judge : Judge
    spec : ImuSpec
        The stated IMU.
    windows : sequence of Windows
        The recorded ones, of each kind.
    times : (k,) array
        Of the tables [s].
    """
    ready = drive.ready
    assert drive.run.smoothed is not None
    track = drive.run.smoothed.solution
    truth = truth_from_track(_whole(track))
    rate = 1.0 / ready.nominal
    sampling = ready.imu.sampling
    perfect = perfect_imu(truth, rate, sampling)
    return TwinTask(
        replace(ready, imu=perfect),
        spec,
        truth,
        perfect,
        _perfect_fixes(truth, ready.gps, drive.run.lever_b),
        replace(
            judge,
            fixes=_perfect_fixes(truth, judge.fixes, drive.run.lever_b if judge.lever_b is None else judge.lever_b),
        ),
        windows[0].start,
        windows[0].length,
        windows[0].spacing,
        tuple(each.raw for each in windows),
        times,
    )


def twins(
    drive: Driven,
    judge: Judge,
    spec: ImuSpec,
    windows: Sequence[Windows],
    times: FloatArray,
    count: int,
    *,
    seed: int = 0,
    workers: int = 1,
    progress: Callable[[float], None] | None = None,
) -> tuple[Twins, ...]:
    """Make some twins and look where the recorded windows of each kind lie among them.

    Parameters
    ----------
    drive, judge, spec, windows, times
        See `twin_task`.
    count : int
        How many, three or more.
    seed : int
        The same seed gives the same twins.
    workers : int
        Processes.
    progress : callable, optional
        Called with the fraction done.

    Raises
    ------
    InputError
        Fewer than three twins could be navigated.

    Notes
    -----
    The band is the prediction interval of one more number from a log-normal distribution whose mean and deviation are
    those of the twins (Hahn and Meeker, "Statistical Intervals", 1991, section 4.7).
    """
    assert drive.run.smoothed is not None
    task = twin_task(drive, judge, spec, windows, times)
    runs = monte_carlo(task, count, seed, workers=workers, progress=progress)
    failures = tuple(f"twin {each.number}: {each.reason}" for each in runs.failures)
    n = len(runs.number)
    if n < FEWEST:
        raise InputError(
            "too few twins make no band",
            why=f"{n} of {count} could be navigated" + (f"; {failures[0]}" if failures else ""),
            fix=f"ask for {FEWEST} or more",
        )
    rms = runs.figures.reshape(n, len(windows), len(times), -1)
    far = apart(task.truth, drive.run.smoothed.solution)
    return tuple(_among(each, rms[:, kind], times, far, failures) for kind, each in enumerate(windows))


def _among(windows: Windows, rms: FloatArray, times: FloatArray, far: Residual, failures: tuple[str, ...]) -> Twins:
    """Recorded windows among those of their twins."""
    n = len(rms)
    size = np.log(np.maximum(rms, 1e-12))
    # a third of what may be missed for each axis, so that together they miss it no more often
    certain = 1.0 - 0.5 * (1.0 - CONFIDENCE) / 3.0
    half = float(student.ppf(certain, n - 1)) * np.std(size, axis=0, ddof=1) * np.sqrt(1.0 + 1.0 / n)
    middle, summed = size.mean(axis=0), growth(windows, times)
    return Twins(
        times,
        rms,
        np.exp(middle - half),
        np.exp(middle + half),
        summed.judged_rms,
        summed.judge,
        far,
        failures,
    )


def _whole(track: Trajectory) -> Trajectory:
    """The track without rows at the same time, as a reset or the end of a block may leave them."""
    keep = np.concatenate([[True], np.diff(track.time) > 1e-6])
    return track.rows(keep)


def _perfect_fixes(truth: Truth, gps: GpsData, lever_b: FloatArray) -> GpsData:
    """Fixes at the recorded epochs within the motion, without errors; what was not measured is not."""
    end = truth.start + truth.duration
    inside = (gps.time >= truth.start + _EDGE) & (gps.time <= end - _EDGE)
    like = replace(gps.rows(inside), heading=None)
    made = gps_from_truth(truth, like.time, lever_b)
    return replace(like, lla=made.lla, v_n=np.where(np.isfinite(like.v_n), made.v_n, np.nan))


def _measured(gps: GpsData, seed: tuple[int, int], lasting: CorrelatedNoise | None) -> GpsData:
    """Add errors of the size that each fix states; a part of them lasts."""
    rng = np.random.default_rng(seed)
    share = 0.0 if lasting is None else lasting.share
    error = rng.standard_normal(gps.lla.shape) * np.sqrt(1.0 - share)
    if lasting is not None:
        process = gauss_markov(rng, gps.time, np.ones(3), lasting.time)
        error += np.sqrt(share) * process
    velocity = rng.standard_normal(gps.v_n.shape) * np.nan_to_num(gps.velocity_sd)
    return replace(gps, lla=lla_offset(gps.lla, error * gps.position_sd), v_n=gps.v_n + velocity)


def _started(initial: InitialState, truth: Truth, specimen: ImuSimulation, rng: np.random.Generator) -> InitialState:
    """A start of the filter that is as wrong as its covariance says, given what is wrong with the sensors."""
    begin = max(initial.time, truth.start)
    at = truth.evaluate(np.array([begin]))
    p = initial.covariance
    errors = specimen.errors
    row = min(int(np.searchsorted(specimen.imu.time, begin)), len(specimen.imu.time) - 1)
    gyro_bias = specimen.gyro_bias[row] + rng.standard_normal(3) * np.sqrt(np.diag(p)[9:12])
    sensor = -np.concatenate(
        [
            specimen.gyro_bias[row] - gyro_bias,
            specimen.accel_bias[row],
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
