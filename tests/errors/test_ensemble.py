"""Ensembles: figures of runs with known errors, bands of known distributions, and the filter itself put to the test."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import chi2

from insnav.attitude import quat_from_rotvec, quat_from_rph, quat_multiply, rph_from_quat
from insnav.earth import lla_offset
from insnav.errors.ensemble import COMPONENTS, FIGURES, GROUPS, band, ensemble, inside, reduced
from insnav.exceptions import AlignmentError, InputError
from insnav.filter.filter_input import Output
from insnav.filter.navigate import navigate_recording
from insnav.filter.prepare import GivenStart
from insnav.filter.receiver import Delay, LeverArm, Receiver
from insnav.findings import Code, Finding
from insnav.imu import ImuSpec, load_imu
from insnav.simulate import GpsErrors, Truth, corrupt_gps, corrupt_imu, gps_from_truth, imu_from_truth, reference
from insnav.simulate.montecarlo import Failure, Runs, Sample, monte_carlo
from insnav.types import Alignment, Epochs, ImuData, Innovations, Run, SensorErrors
from tests.filter import drives
from tests.simulate.motions import town

TRUTH = town(start=500.0)
SD = np.array([0.5, 0.7, 1.0, 0.05, 0.06, 0.04, 0.003, 0.004, 0.01])
NO_AXES = np.zeros(3)
NOTHING = np.empty(0)


def run_with(error: np.ndarray, sd: np.ndarray, *, seconds: int = 60, later: float = 0.0) -> Run:
    """A run whose errors are known at every second: position, velocity, and ``phi`` of the attitude."""
    time = TRUTH.start + later + np.arange(seconds, dtype=float)
    true = reference(TRUTH, time)
    q_nb = quat_multiply(quat_from_rotvec(-error[:, 6:]), quat_from_rph(true.rph))
    lla, v_n = lla_offset(true.lla, error[:, :3]), true.v_n + error[:, 3:6]
    covariance = np.tile(np.diag(sd**2), (seconds, 1, 1))
    fixes = np.zeros((seconds, 6))
    used = np.arange(seconds) % 10 > 0  # six of sixty are not
    return Run(
        replace(true, lla=lla, v_n=v_n, rph=rph_from_quat(q_nb), sd=np.tile(sd, (seconds, 1))),
        Innovations(time, fixes, fixes, fixes[:, 0], fixes[:, 0], used, used),
        SensorErrors(NOTHING, np.empty((0, 12)), np.empty((0, 12))),
        (
            Finding.of(Code.FILTER_RESET, time[3], distance_m=0.0),
            Finding.of(Code.GATE_POSITION, time[4], nis=0.0),
        ),
        Alignment(time[0], true.rph[0], sd[6:], NOTHING, NOTHING, None, *drives.GIVEN),
        Epochs(time, lla, v_n, q_nb, covariance),
    )


def runs_of(samples: list[Sample]) -> Runs:
    number = np.arange(1, len(samples) + 1)
    return Runs(number, number, np.array([s.figures for s in samples]), np.sum([s.series for s in samples], axis=0), ())


def errors_of(seed: int, scale: float = 1.0) -> np.ndarray:
    return scale * SD * np.random.default_rng(seed).standard_normal((60, 9))


def test_errors_at_each_second_are_the_root_mean_square_over_the_runs():
    errors = [errors_of(seed) for seed in range(20)]
    found = ensemble(runs_of([reduced(run_with(e, SD), TRUTH, NO_AXES) for e in errors]), TRUTH)
    np.testing.assert_array_equal(found.time, TRUTH.start + np.arange(60))
    np.testing.assert_array_equal(found.count, 20)
    np.testing.assert_allclose(found.rms[:, :6], np.sqrt(np.mean(np.square(errors), axis=0))[:, :6], rtol=1e-5)
    np.testing.assert_allclose(found.sd, np.tile(SD, (60, 1)), rtol=1e-12)


def test_figures_of_a_run():
    error = errors_of(1)
    figures = dict(zip(FIGURES, reduced(run_with(error, SD), TRUTH, NO_AXES).figures, strict=True))
    assert figures["rms_north"] == pytest.approx(np.sqrt(np.mean(error[:, 0] ** 2)), rel=1e-5)
    assert figures["rms_v_down"] == pytest.approx(np.sqrt(np.mean(error[:, 5] ** 2)), rel=1e-9)
    assert figures["rms_horizontal"] == pytest.approx(np.sqrt(np.mean(error[:, :2] ** 2) * 2), rel=1e-5)
    assert figures["largest_horizontal"] == pytest.approx(np.hypot(*error[:, :2].T).max(), rel=1e-5)
    assert figures["rms_heading"] == pytest.approx(np.sqrt(np.mean(error[:, 8] ** 2)), rel=0.02)
    assert (figures["positions"], figures["rejected"], figures["resets"]) == (60, 6, 1)


@pytest.mark.parametrize(("scale", "nees"), [(1.0, 1.0), (2.0, 4.0), (0.5, 0.25)])
def test_normalised_error_tells_how_true_the_covariance_is(scale, nees):
    samples = [reduced(run_with(errors_of(seed, scale), SD), TRUTH, NO_AXES) for seed in range(60)]
    found = ensemble(runs_of(samples), TRUTH)
    # 60 runs, 60 seconds, 3 axes: the mean of so many squares has a standard deviation of 1.4 %
    np.testing.assert_allclose(found.nees.mean(axis=0), nees, rtol=0.06)
    share = inside(found).mean(axis=0)
    if scale == 1.0:
        assert share.min() > 0.85  # 95 % of sixty, less three standard deviations
    else:
        assert share.max() < 0.05


def test_errors_are_normalised_by_the_whole_covariance():
    error = np.zeros((60, 9))
    error[:, :2] = 1e-3, -1e-3  # against the correlation of the stated errors
    run = run_with(error, np.full(9, 1e-3))
    covariance = run.epochs.covariance.copy()
    covariance[:, 0, 1] = covariance[:, 1, 0] = 0.95e-6
    run = replace(run, epochs=replace(run.epochs, covariance=covariance))
    figures = reduced(run, TRUTH, NO_AXES).figures
    assert figures[FIGURES.index("nees_position")] == pytest.approx(2.0 / (1.0 - 0.95) / 3.0, rel=1e-4)


def test_attitude_is_known_no_better_than_the_axes_of_the_sensors():
    error = np.zeros((60, 9))
    error[:, 6:] = 0.01  # ten times the sd of the filter
    run = run_with(error, np.full(9, 1e-3))
    figure = FIGURES.index("nees_attitude")
    assert reduced(run, TRUTH, NO_AXES).figures[figure] == pytest.approx(100.0, rel=1e-3)
    both = 0.01**2 / (0.01**2 + 1e-3**2)  # variances of axes and estimate add up
    assert reduced(run, TRUTH, np.full(3, 0.01)).figures[figure] == pytest.approx(both, rel=1e-3)


def test_only_runs_that_navigate_count_at_a_time():
    late = run_with(errors_of(2)[:30], SD, seconds=30, later=29.6)  # nearest are the seconds from 30 on
    samples = [reduced(run, TRUTH, NO_AXES) for run in (run_with(errors_of(1), SD), late)]
    found = ensemble(runs_of(samples), TRUTH)
    np.testing.assert_array_equal(found.count, np.repeat([1, 2], 30))
    np.testing.assert_array_equal(found.nees_count, np.repeat([1, 2], 30))


def test_rows_beyond_the_motion_are_left_out():
    error = np.zeros((10, 9))
    run = run_with(error, SD, seconds=10, later=TRUTH.duration - 9.0)
    moved = replace(run, solution=replace(run.solution, time=run.solution.time + 0.25))
    assert reduced(moved, TRUTH, NO_AXES).series[:, 0].sum() == 9
    gone = replace(run, solution=replace(run.solution, time=run.solution.time + 100.0))
    with pytest.raises(InputError, match=r"diagnosis.no_row_in_motion"):
        reduced(gone, TRUTH, NO_AXES)


def test_band_is_that_of_chi_square():
    degrees = np.array([1, 3, 30, 900])
    low, high = band(degrees)
    np.testing.assert_allclose(low, chi2.ppf(0.025, degrees) / degrees, rtol=1e-9)
    np.testing.assert_allclose(high, chi2.ppf(0.975, degrees) / degrees, rtol=1e-9)


def test_an_ensemble_of_failures_says_why():
    failure = Failure(1, 42, AlignmentError("session.no_rest").facts)
    nothing = Runs(NOTHING.astype(int), NOTHING.astype(int), np.empty((0, 0)), NOTHING, (failure,))
    with pytest.raises(InputError, match=r"diagnosis.all_runs_failed") as caught:
        ensemble(nothing, TRUTH)
    assert caught.value.values["cause"] == failure.error
    assert "42" in str(caught.value)


@dataclass(frozen=True)
class Drive:
    """A drive with a stop in each of its laps, measured and navigated."""

    motion: Truth
    spec: ImuSpec
    perfect: ImuData
    heading: float

    def __call__(self, seed: int) -> Sample:
        imu = corrupt_imu(self.perfect, self.spec, (seed, 1)).imu
        time = self.motion.start + np.arange(1.0, self.motion.duration)
        errors = GpsErrors((1.5, 1.5, 3.0), velocity_noise=(0.1, 0.1, 0.15))
        gps = corrupt_gps(gps_from_truth(self.motion, time, drives.LEVER_B), errors, (seed, 2))
        receiver, output = Receiver(LeverArm(drives.LEVER_B), Delay(sd=0.05)), Output(smooth=False)
        run = navigate_recording(
            imu, gps, self.spec, receiver, known=GivenStart(heading=self.heading), output=output
        ).run
        return reduced(run, self.motion, NO_AXES)


@pytest.mark.parametrize("grade", ["automotive", "tactical"])
def test_the_filter_is_as_good_as_it_says(grade):
    spec = load_imu(grade)
    # misalignment is noise to the filter and none to the sensors: it is judged elsewhere
    aligned = {"misalignment": np.zeros(3)}
    spec = replace(spec, gyro=replace(spec.gyro, **aligned), accel=replace(spec.accel, **aligned))
    motion = drives.truth(3)
    time = motion.start + np.arange(round(motion.duration * 50) + 1) / 50
    runs = monte_carlo(Drive(motion, spec, imu_from_truth(motion, time, "mean"), 0.4), 40, 3)
    assert not runs.failures
    found = ensemble(runs, motion)
    late = found.nees_time > motion.start + 60.0
    mean = found.nees[late].mean(axis=0)
    share = inside(found)[late].mean(axis=0)
    print(grade, dict(zip(GROUPS, mean.round(3), strict=True)), "inside", share.round(2))
    assert np.all((mean > 0.85) & (mean < 1.15))
    assert np.all(share > 0.6)  # errors last for a minute: few of the seconds are independent
    later = found.time > motion.start + 60.0
    ratio = np.sqrt(np.mean(found.rms[later] ** 2, axis=0) / np.mean(found.sd[later] ** 2, axis=0))
    print(dict(zip(COMPONENTS, ratio.round(2), strict=True)))
    assert np.all((ratio > 0.8) & (ratio < 1.2))
