"""Simulated runs: the same errors as simulated recordings, and the covariance that is predicted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, f

from insnav.attitude import quat_conjugate, quat_from_rph, quat_multiply, rotvec_from_quat
from insnav.earth import ned_offset
from insnav.errors.budget import error_budget
from insnav.errors.budget.error_budget import budget, free_runs
from insnav.errors.budget.predicted import covariance
from insnav.errors.budget.sources import SampledMotion, at_rest, families, only, sampled, sources_of
from insnav.exceptions import ConfigError
from insnav.imu import ImuSpec, SensorSpec, corrupt, load_imu, sample_errors
from insnav.simulate import corrupt_imu
from insnav.strapdown import increments, intervals, navigate
from insnav.types import ImuData, Trajectory
from tests.errors.budget.imus import plain, whole
from tests.simulate.motions import town

ROWS = np.array([500, 1000, 2000])


@pytest.fixture(scope="module")
def driving() -> SampledMotion:
    return sampled(town(), 11.0, 40.0)


def samples(motion: SampledMotion) -> ImuData:
    return ImuData(motion.truth.time[1:], motion.rate, motion.force)


def navigated(imu: ImuData, motion: SampledMotion) -> np.ndarray:
    """Errors (m, 9) of the package's own way from samples to a solution."""
    true = motion.truth
    found = navigate(increments(intervals(imu)), true.lla[0], true.v_n[0], true.rph[0])
    at = Trajectory(*(np.asarray(getattr(true, name))[ROWS] for name in ("time", "lla", "v_n", "rph")))
    turn = quat_multiply(quat_from_rph(found.rph[ROWS - 1]), quat_conjugate(quat_from_rph(at.rph)))
    position = ned_offset(found.lla[ROWS - 1], at.lla)
    return np.hstack([position, found.v_n[ROWS - 1] - at.v_n, -rotvec_from_quat(turn)])


def quiet(spec: ImuSpec) -> ImuSpec:
    """Constant errors alone."""
    noises = ("bias_instability", "random_walk", "rate_random_walk", "flicker", "rate_ramp", "quantisation")
    none = {key: np.zeros(3) for key in noises}
    return ImuSpec("quiet", replace(spec.gyro, **none), replace(spec.accel, **none))


def test_constant_errors_are_those_of_simulated_recordings(driving):
    """Realisation by realisation the same errors, navigated by the whole chain from samples to solution."""
    spec = quiet(whole())
    found = free_runs(spec, driving, ROWS, 3, (5, 0))
    for run in range(3):
        drawn = sample_errors(spec, np.random.default_rng(np.random.SeedSequence((5, 0), spawn_key=(run,))))
        wanted = navigated(corrupt(samples(driving), drawn), driving)
        size = np.repeat([np.abs(wanted[:, part]).max() for part in (slice(0, 3), slice(3, 6), slice(6, 9))], 3)
        assert (np.abs(found[run] - wanted) / size).max() < 1e-4


def test_noise_is_that_of_simulated_recordings(driving):
    """The spread of two independent sets of runs, one made sample by sample in a kernel, one by the simulator."""
    spec, count = whole(), 150
    spec = replace(spec, initial=None, clock=type(spec.clock)())
    noisy = {
        key: np.zeros(3) for key in ("bias", "scale_factor", "misalignment", "asymmetry", "quadratic", "g_sensitivity")
    }
    spec = replace(spec, gyro=replace(spec.gyro, **noisy), accel=replace(spec.accel, **noisy))
    imu = samples(driving)
    short = replace(imu, time=imu.time[:2000], gyro=imu.gyro[:2000], accel=imu.accel[:2000])
    by_simulator = np.array([navigated(corrupt_imu(short, spec, (9, k)).imu, driving) for k in range(count)])
    # flicker noise knows the length of its record: the same for both
    motion = sampled(town(), 11.0, 20.0)
    by_kernel = free_runs(spec, motion, ROWS, count, 10)
    ratio = np.mean(by_kernel**2, axis=0) / np.mean(by_simulator**2, axis=0)
    low, high = f.ppf([1e-4, 1 - 1e-4], count, count)
    print("ratios", ratio.min().round(2), ratio.max().round(2), "of", low.round(2), high.round(2))
    assert ratio.min() > low
    assert ratio.max() < high


@pytest.mark.parametrize(("spec", "hold"), [(plain(), False), (whole(), True)], ids=["plain", "whole, held"])
def test_predicted_covariance_is_that_of_the_runs(driving, spec, hold):
    runs, slope = 500, 2e-5
    found = free_runs(spec, driving, ROWS, runs, 4, deflection=slope, hold=hold)
    predicted = covariance(sources_of(spec, slope), driving, ROWS, hold=hold).sum(axis=1)
    free = [0, 1, 3, 4, 6, 7, 8] if hold else list(range(9))
    if hold:
        assert np.abs(found[..., [2, 5]]).max() < 1e-8
    for row in range(len(ROWS)):
        whole_of = predicted[row][np.ix_(free, free)]
        error = found[:, row, free]
        # every direction at once: the normalised squared errors are chi-square with the count of states
        total = np.sum(error @ np.linalg.inv(whole_of) * error)
        low, high = chi2.ppf([1e-4, 1 - 1e-4], runs * len(free))
        print(f"mean normalised squared error {total / runs / len(free):.3f}")
        assert low < total < high
        # and each variance
        ratio = np.mean(error**2, axis=0) / np.diag(whole_of)
        low, high = chi2.ppf([1e-5, 1 - 1e-5], runs) / runs
        assert np.all((ratio > low) & (ratio < high)), ratio


def test_each_family_alone_is_as_predicted(driving):
    """Also that no source is left out of the runs, or sampled twice."""
    spec, runs, slope, row = whole(), 60, 2e-5, np.array([1500])
    sources = sources_of(spec, slope)
    parts = covariance(sources, driving, row)[0]
    low, high = np.sqrt(chi2.ppf([1e-6, 1 - 1e-6], runs) / runs)
    for number, family in enumerate(families(sources)):
        of = [k for k, source in enumerate(sources) if source.family == family]
        wanted = np.sqrt(np.diagonal(parts[of].sum(axis=0)))
        bent = slope if family == "gravity model" else 0.0
        error = free_runs(only(spec, family), driving, row, runs, (3, number), deflection=bent)[:, 0]
        found = np.sqrt(np.mean(error**2, axis=0))
        # compare what the source does, not what of it leaks elsewhere; late samples turn the axes of others meanwhile
        group = np.array([np.linalg.norm(v) for v in np.split(wanted, 3)])
        main = np.flatnonzero(wanted > 0.5 * np.repeat(group, 3))
        main = main[main < 6] if family != "timing offset" else main[main < 3]
        ratio = found[main] / wanted[main]
        slack = 0.35 if family == "timing offset" else 0.0
        assert np.all((ratio > low - slack) & (ratio < high + slack)), (family, ratio)


def test_what_comes_late_moves_as_much_as_predicted(driving):
    """Run by run: one number drawn, and every error is that times the sensitivity."""
    row, spec = np.array([1000]), only(whole(), "timing offset")
    error = free_runs(spec, driving, row, 300, 6)[:, 0]
    sd = np.sqrt(np.diagonal(covariance(sources_of(spec), driving, row)[0].sum(axis=0)))
    along = error[:, :2] @ (sd[:2] * np.sign(error[0, :2])) / np.sum(sd[:2] ** 2)
    low, high = chi2.ppf([1e-5, 1 - 1e-5], 300) / 300
    assert low < np.mean(along**2) < high
    np.testing.assert_allclose(
        np.abs(along[:, None] * sd[:2]), np.abs(error[:, :2]), atol=0.05 * np.abs(error[:, :2]).max()
    )


def test_in_run_bias_and_gravity_are_as_large_as_predicted():
    """Many short runs at rest: a process that forgets within the run, and gravity that is not that of the model."""
    motion, row, runs = at_rest(6.0), np.array([600]), 1500
    sensor = SensorSpec(bias_instability=np.full(3, 1e-3), correlation_time=0.5)
    bare = ImuSpec("forgets", SensorSpec(), sensor)
    low, high = chi2.ppf([1e-5, 1 - 1e-5], runs) / runs
    for spec, slope in ((bare, 0.0), (ImuSpec("right", SensorSpec(), SensorSpec()), 1e-4)):
        error = free_runs(spec, motion, row, runs, 7, deflection=slope)[:, 0]
        wanted = np.diagonal(covariance(sources_of(spec, slope), motion, row)[0].sum(axis=0))
        ratio = np.mean(error[:, :6] ** 2, axis=0) / wanted[:6]
        assert np.all((ratio > low) & (ratio < high)), ratio


def test_the_first_runs_do_not_depend_on_how_many_follow(driving):
    rows = np.array([300])
    few, many = (free_runs(whole(), driving, rows, runs, 8) for runs in (3, 6))
    np.testing.assert_array_equal(few, many[:3])
    other = free_runs(whole(), driving, rows, 3, 9)
    assert np.abs(other - few).min() > 0.0


def test_processes_make_the_same_runs(driving, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(error_budget, "_BLOCK", 2)
    one, two = (free_runs(whole(), driving, ROWS, 5, 8, workers=workers) for workers in (1, "processes:2"))
    assert one.tobytes() == two.tobytes()


def test_budget_joins_the_columns(driving):
    found = budget(plain(), driving, (10.0, 20.0, 30.0), runs=40, seed=2)
    np.testing.assert_allclose(found.time[found.chosen], [10.0, 20.0, 30.0], atol=1e-9)
    assert found.simulated.parts.shape == found.covariance.parts.shape == (len(found.time), len(found.families), 9)
    at = found.chosen
    ratio = found.simulated.total[at] / found.covariance.total[at]
    assert np.all((ratio > 0.6) & (ratio < 1.5))
    np.testing.assert_allclose(found.analytic.total[at][:, :2], found.covariance.total[at][:, :2], rtol=0.01)
    assert np.all(found.worst[:, :3] >= found.covariance.total[:, :3] - 1e-15)
    low, high = found.simulated.band
    np.testing.assert_allclose([low**2 * 40, high**2 * 40], chi2.ppf([0.025, 0.975], 40), rtol=1e-9)
    assert found.simulated.nees[at] == pytest.approx(np.ones(3), abs=5 * np.sqrt(2 / (40 * 9)))


def test_one_minute_budget_of_the_paper():
    """Bias, tilt and drift of a navigation grade IMU: the figures that a hand calculation gives."""
    deg = np.pi / 180.0
    spec = ImuSpec(
        "paper", SensorSpec(bias=np.full(3, 0.00806 * deg / 3600)), SensorSpec(bias=np.full(3, 50e-6 * 9.7803))
    )
    spec = replace(spec, initial=replace(load_start(), tilt=0.003 * deg))
    found = budget(spec, at_rest(60.0), [60.0])
    parts = dict(zip(found.families, found.analytic.parts[found.chosen[0], :, 0], strict=True))
    scale = 9.7803 / found.gravity  # the motion is at another latitude
    wanted = {"accel bias": 0.8802, "initial tilt": 0.9218 / scale, "gyro bias": 0.0138 / scale}
    for name, value in wanted.items():
        assert parts[name] == pytest.approx(value, abs=6e-5)
    # all at once, and the little that the rotation of the Earth brings in from the other axes
    assert 0.0 < found.worst[found.chosen[0], 0] / sum(wanted.values()) - 1.0 < 3e-3
    rss = np.sqrt(sum(v * v for v in wanted.values()))
    assert found.covariance.total[found.chosen[0], 0] == pytest.approx(rss, rel=1e-3)
    assert found.short_form_error(60.0)[0] == pytest.approx(-0.00047, abs=2e-5)


def load_start():
    from insnav.imu import InitialSpec

    return InitialSpec()


@pytest.mark.parametrize(("times", "words"), [((), ()), ((0.05,), (0.05,)), ((50.0,), (50.0,)), ((4000.0,), (4000.0,))])
def test_times_beyond_the_motion_are_refused(driving, times, words):
    with pytest.raises(ConfigError, match=r"budget.bad_times") as caught:
        budget(plain(), driving, times)
    assert caught.value.values["times_s"] == words


def test_an_imu_without_errors_is_refused(driving):
    with pytest.raises(ConfigError, match=r"budget.no_errors"):
        budget(ImuSpec("ideal", SensorSpec(), SensorSpec()), driving, (10.0,))


def test_a_consumer_imu_is_beyond_a_linear_model():
    """A turn-on bias of half a degree per second: the runs say so, the normalised error shows it."""
    found = budget(load_imu("consumer"), sampled(town(), 11.0, 40.0), (40.0,), runs=20)
    assert found.simulated.nees[found.chosen[-1]] > 2.0
