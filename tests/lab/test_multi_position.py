"""Calibration by hand against simulated truth, and on the recorded one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from insnav.exceptions import InputError
from insnav.imu import ImuErrors, correct, corrupt
from insnav.imu.model import ErrorTerms
from insnav.input.readers.imu import read_imu
from insnav.lab.multi_position.many_positions import (
    PosesCalibration,
    calibrate_poses,
    clipped,
    find_poses,
    measure_activity,
    pose_between,
    prepare,
    rotations,
)
from insnav.lab.multi_position.method import errors_in_si, file_errors
from insnav.lab.multi_position.triad import Triad, corrected, directions, fit_gravity_norm, norm_error, sphere
from insnav.types import FloatArray, ImuData
from tests.lab.hand import RATE, G, random_record, record, turn
from tests.refusals import refused
from tests.shared import recorded

TRUE = ImuErrors(
    gyro_bias=np.array([0.010, -0.006, 0.002]),
    gyro_matrix=np.array([[1.020, 0.004, -0.006], [0.003, 0.985, 0.008], [-0.002, 0.005, 1.010]]),
    accel_bias=np.array([0.15, -0.20, 0.08]),
    accel_matrix=np.array([[1.004, 0.0, 0.0], [0.006, 0.993, 0.0], [-0.004, 0.009, 1.012]]),
)
G_SENSITIVITY = np.array([[2.0, -1.0, 0.5], [0.0, 1.5, -2.0], [1.0, 0.5, -1.0]]) * 1e-4  # [rad/s per m/s^2]
ACCEL_NOISE, GYRO_NOISE = 0.02, 0.01  # of a sample [m/s^2], [rad/s]


def measured(rng: np.random.Generator, poses: int = 24, noise: float = 1.0, gyro_noise: float = GYRO_NOISE) -> ImuData:
    ideal = random_record(rng, poses)
    wrong = corrupt(ideal, TRUE)
    shape = wrong.gyro.shape
    return replace(
        wrong,
        gyro=wrong.gyro + ideal.accel @ G_SENSITIVITY.T + noise * gyro_noise * rng.normal(size=shape),
        accel=wrong.accel + noise * ACCEL_NOISE * rng.normal(size=shape),
    )


@pytest.fixture(scope="module")
def found() -> PosesCalibration:
    return calibrate_poses(measured(np.random.default_rng(1)), G)


def test_without_noise_the_truth_is_found() -> None:
    found = calibrate_poses(measured(np.random.default_rng(3), noise=0.0), G)
    assert len(found.poses) == 24
    np.testing.assert_allclose(found.accel.bias, TRUE.accel_bias, atol=1e-9)
    np.testing.assert_allclose(found.accel.matrix, TRUE.accel_matrix, atol=1e-10)
    np.testing.assert_allclose(found.gyro.bias, TRUE.gyro_bias, atol=1e-9)
    # g-sensitivity in motion is taken off with interpolated samples, and the turns sampled at 50 Hz: a few ppm
    np.testing.assert_allclose(found.gyro.matrix, TRUE.gyro_matrix, atol=1e-5)
    np.testing.assert_allclose(found.g_sensitivity, G_SENSITIVITY, atol=1e-9)


def test_a_covariance_without_noise_has_steps_too() -> None:
    """Zero, or singular to round-off, where no factor of Cholesky exists; else the same outer products."""
    from insnav.lab.multi_position.many_positions import _steps

    rng = np.random.default_rng(2)
    full, flat = rng.normal(size=(4, 4)), np.outer([1.0, 2.0, 0.0, -1.0], [1.0, 2.0, 0.0, -1.0])
    for covariance in (np.zeros((4, 4)), flat - 1e-18 * np.eye(4), full @ full.T):
        steps = _steps(covariance)
        np.testing.assert_allclose(steps.T @ steps, covariance, atol=1e-12)


def scores_of_corrected(found: PosesCalibration, rng: np.random.Generator) -> FloatArray:
    """Errors of corrected data over what is printed as their standard deviation."""
    rate, force = 3.0 * rng.uniform(-1.0, 1.0, (60, 3)), G * rng.uniform(-1.0, 1.0, (60, 3))
    time = 0.01 * np.arange(60.0)
    shown = corrupt(ImuData(time, rate, force), replace(TRUE, gyro_terms=ErrorTerms(g_sensitivity=G_SENSITIVITY)))
    got = correct(shown, file_errors(found))
    errors, sd = errors_in_si(found)
    rate_sd, force_sd = sd.corrected(errors, rate, force)
    return np.column_stack(((got.gyro - rate) / rate_sd, (got.accel - force) / force_sd))


@pytest.mark.parametrize("gyro_noise", [GYRO_NOISE, 0.05 * GYRO_NOISE])
def test_the_truth_lies_within_the_printed_uncertainty_as_often_as_it_should(gyro_noise: float) -> None:
    """Also where what the gyros' matrix has from the accelerometers outweighs its own noise."""
    accel, gyro, bias, corrected_data = [], [], [], []
    lower = np.tril_indices(3)
    seeds = 12
    for seed in range(seeds):
        found = calibrate_poses(measured(np.random.default_rng(500 + seed), 20, 1.0, gyro_noise), G)
        accel.append((found.accel.bias - TRUE.accel_bias) / found.accel.bias_sd)
        accel.append(((found.accel.matrix - TRUE.accel_matrix)[lower] / found.accel.matrix_sd[lower])[:6])
        gyro.append(((found.gyro.matrix - TRUE.gyro_matrix) / found.gyro.matrix_sd).ravel())
        bias.append((found.gyro.bias - TRUE.gyro_bias) / found.gyro.bias_sd)
        bias.append(((found.g_sensitivity - G_SENSITIVITY) / found.g_sensitivity_sd).ravel())
        corrected_data.append(scores_of_corrected(found, np.random.default_rng(seed)))
    # rates and specific forces, dependent within a seed: their scatter is that of the seeds
    assert 0.7 < np.sqrt(np.mean(np.square(corrected_data))) < 1.5
    # degrees of freedom: poses less parameters, two components a turn less parameters, poses less four
    for name, scores, freedom in (("accel", accel, 11), ("gyro", gyro, 29), ("rest", bias, 16)):
        z = np.concatenate(scores)
        limit = stats.t.ppf(0.975, freedom)
        inside = float(np.mean(np.abs(z) < limit))
        assert 0.90 < inside < 0.985, (name, inside)
        expected = np.sqrt(freedom / (freedom - 2.0))
        assert 0.85 < np.sqrt(np.mean(z**2)) / expected < 1.15, (name, np.sqrt(np.mean(z**2)) / expected)


def test_turns_about_a_moving_axis_are_integrated_with_their_coning() -> None:
    # attitude Rz(a) Rx(b) with a and b in motion at once; the means of the body rates by Gauss's rule
    n, first, last = 200, 50, 150
    edges = np.arange(n + 1) / RATE
    nodes, weights = np.polynomial.legendre.leggauss(8)
    time = edges[:-1, None] + (nodes + 1.0) / (2.0 * RATE)
    share = np.clip((time - first / RATE) / ((last - first) / RATE), 0.0, 1.0)
    b = 1.5 * np.sin(2.0 * np.pi * share) ** 2
    b_dot = 1.5 * 2.0 * np.pi * np.sin(4.0 * np.pi * share) * RATE / (last - first)
    a_dot = 4.0 * np.sin(np.pi * share) ** 2
    rate = np.stack((b_dot, a_dot * np.sin(b), a_dot * np.cos(b)), axis=-1)
    gyro = np.einsum("nqi,q->ni", rate, weights) / 2.0
    data = ImuData(edges[1:], gyro, np.zeros((n, 3)))
    poses = pose_between(data, 0, first), pose_between(data, last, n)
    turns = prepare(data, poses, np.zeros(n, dtype=bool))
    turned = rotations(turns, np.zeros(3), np.eye(3))[0]
    end = turn(np.array([0.0, 0.0, 1.0]), 4.0 * (last - first) / RATE / 2.0)
    np.testing.assert_allclose(turned.T, end, atol=2e-5)


def test_left_out_errors_are_those_of_sensors_not_of_the_fit(found: PosesCalibration) -> None:
    fitted, other = np.sqrt(np.mean(found.norm_after**2)), np.sqrt(np.mean(found.norm_left_out**2))
    assert 1.0 < other / fitted < 3.0
    assert np.sqrt(np.mean(found.turn_left_out**2)) > np.sqrt(np.mean(found.turn_after**2))
    assert found.accel_share.sum() == pytest.approx(9.0)
    assert found.gyro_share.sum() == pytest.approx(9.0)


def test_the_calibration_takes_the_errors_off(found: PosesCalibration) -> None:
    rng = np.random.default_rng(77)
    ideal = random_record(rng, 8)
    got = ImuErrors(found.gyro.bias, found.gyro.matrix, found.accel.bias, found.accel.matrix)
    left = correct(corrupt(ideal, TRUE), got)
    before = corrupt(ideal, TRUE)
    assert np.abs(left.accel - ideal.accel).max() < 0.05 * np.abs(before.accel - ideal.accel).max()
    assert np.abs(left.gyro - ideal.gyro).max() < 0.1 * np.abs(before.gyro - ideal.gyro).max()


def test_counts_give_the_same_as_si(found: PosesCalibration) -> None:
    data = measured(np.random.default_rng(1))
    raw = replace(data, gyro=data.gyro * 4800.0 + 32700.0, accel=data.accel * 415.0 + 32900.0)
    counted = calibrate_poses(raw, G, counts=True)
    np.testing.assert_allclose(counted.accel.matrix / 415.0, found.accel.matrix, atol=1e-8)
    np.testing.assert_allclose((counted.accel.bias - 32900.0) / 415.0, found.accel.bias, atol=1e-7)
    np.testing.assert_allclose(counted.gyro.matrix / 4800.0, found.gyro.matrix, atol=1e-6)
    np.testing.assert_allclose(counted.accel.matrix_sd / 415.0, found.accel.matrix_sd, rtol=1e-3, atol=1e-12)


def test_turns_at_the_end_of_the_range_are_not_used(found: PosesCalibration) -> None:
    data = measured(np.random.default_rng(1))
    limit = 0.8 * np.abs(data.gyro).max()
    cut = replace(data, gyro=np.clip(data.gyro, -limit, limit))
    again = calibrate_poses(cut, G)
    assert again.clipped > 2
    assert not again.turn_used.all()
    assert np.abs((again.gyro.matrix - TRUE.gyro_matrix) / again.gyro.matrix_sd).max() < 4.5


@pytest.mark.parametrize(
    ("spoil", "code"),
    [
        (lambda d: replace(d, accel=d.accel / 9.8), "lab.force_unit"),
        (lambda d: replace(d, gyro=d.gyro * 180.0 / np.pi), "lab.gyros_in_degrees"),
        (lambda d: replace(d, accel=d.accel + np.array([0.0, 0.0, 9.0])), "lab.force_offset"),
        (lambda d: replace(d, sampling="increment"), "lab.increments"),
        (lambda d: replace(d, time=d.time[:60], gyro=d.gyro[:60], accel=d.accel[:60]), "lab.poses_short"),
        (lambda d: replace(d, accel=np.full_like(d.accel, 5.6)), "lab.no_contrast"),
        (lambda d: replace(d, time=d.time[:1500], gyro=d.gyro[:1500], accel=d.accel[:1500]), "lab.few_poses"),
    ],
)
def test_bad_data_are_refused_with_the_reason(spoil, code: str) -> None:
    data = measured(np.random.default_rng(1))
    with refused(InputError, code):
        calibrate_poses(spoil(data), G)


@pytest.mark.parametrize(
    ("gyro", "axes"),
    [
        (lambda gyro: gyro[:, [1, 0, 2]], ("+y", "+x", "+z")),
        (lambda gyro: gyro * np.array([1.0, 1.0, -1.0]), ("+x", "+y", "-z")),
    ],
)
def test_exchanged_gyros_are_refused_with_the_axes_that_fit(gyro, axes: tuple[str, ...]) -> None:
    data = measured(np.random.default_rng(1))
    with refused(InputError, "lab.gyros_exchanged") as caught:
        calibrate_poses(replace(data, gyro=gyro(data.gyro)), G)
    assert caught.value.values["axes"] == axes


def test_a_record_without_rest_is_refused() -> None:
    rng = np.random.default_rng(5)
    n = 6000
    shaking = ImuData(
        np.arange(1, n + 1) / RATE, rng.normal(size=(n, 3)), np.array([0, 0, -G]) + rng.normal(size=(n, 3))
    )
    with refused(InputError, "lab.no_contrast"):
        calibrate_poses(shaking, G)


def test_level_poses_only_are_refused_and_the_missing_one_is_named() -> None:
    # turned about the vertical and slightly tilted: nothing is known of x and y
    z = np.array([0.0, 0.0, 1.0])
    moves = [(z, 1.5)] * 15
    ideal, _, _ = record(moves, np.array([0.02, 0.01, -1.0]))
    rng = np.random.default_rng(2)
    noisy = replace(ideal, accel=ideal.accel + ACCEL_NOISE * rng.normal(size=ideal.accel.shape))
    with refused(InputError, "lab.poses_undetermined") as caught:
        calibrate_poses(noisy, G)
    assert caught.value.values["condition"] > caught.value.values["limit"]
    assert caught.value.values["pose"] != ("z down",)


def test_six_poses_along_the_axes_leave_misalignment_open() -> None:
    force = np.tile(np.vstack((G * np.eye(3), -G * np.eye(3))), (3, 1))
    with refused(InputError, "lab.poses_undetermined") as caught:
        fit_gravity_norm(force, G, Triad())
    assert all("misalignment" in name for name in caught.value.values["parameters"])
    assert len(caught.value.values["pose"]) > 1


def test_the_pose_asked_for_mends_it() -> None:
    axes = np.tile(np.vstack((G * np.eye(3), -G * np.eye(3))), (2, 1))
    halfway = G * directions()[np.count_nonzero(np.abs(directions()) > 1e-6, axis=1) == 2]
    fit = fit_gravity_norm(np.vstack((axes, halfway)), G, Triad())
    assert fit.triad.condition < 10.0


def test_jacobian_of_the_norm_is_that_of_differences() -> None:
    from insnav.lab.multi_position.triad import norm_jacobian, packed, unpacked

    rng = np.random.default_rng(8)
    force = 400.0 * G * directions() + 33000.0
    start = Triad(33000.0 + rng.normal(size=3), 400.0 * np.eye(3) + np.tril(rng.normal(size=(3, 3))), *_no_sd(), 1.0)
    p = packed(start)
    step = 1e-6 * np.maximum(np.abs(p), 1.0)
    numeric = np.column_stack(
        [
            (norm_error(unpacked(p + d), force, G) - norm_error(unpacked(p - d), force, G)) / (2.0 * d.max())
            for d in np.diag(step)
        ]
    )
    exact = norm_jacobian(p, force)
    np.testing.assert_allclose(exact, numeric, atol=1e-6 * np.abs(exact).max())


def _no_sd() -> tuple[FloatArray, FloatArray]:
    return np.zeros(3), np.zeros((3, 3))


def test_sphere_is_exact_for_equal_sensors() -> None:
    found = sphere(415.0 * G * directions() + np.array([33100.0, 33300.0, 32400.0]), G)
    np.testing.assert_allclose(found.bias, [33100.0, 33300.0, 32400.0], rtol=1e-12)
    np.testing.assert_allclose(found.matrix, 415.0 * np.eye(3), rtol=1e-10)


def test_rests_are_found_inside_the_true_ones_and_a_knock_does_not_double_a_pose() -> None:
    moves = [(np.array([1.0, 0.0, 0.0]), 1.2), (np.array([0.0, 1.0, 0.0]), 1.4)]
    ideal, _, rests = record(moves * 4, np.array([0.0, 0.0, -1.0]), rest=5.0)
    rng = np.random.default_rng(6)
    accel = ideal.accel + ACCEL_NOISE * rng.normal(size=ideal.accel.shape)
    accel[rests[2][0] + 100] += 5.0
    data = replace(ideal, accel=accel)
    activity = measure_activity(data)
    assert np.isinf(activity.ratio[:25]).all()  # no whole window of a second
    assert np.isinf(activity.ratio[-25:]).all()
    poses = find_poses(data, activity, 3.0)
    assert len(poses) == len(rests)
    for pose, (first, last) in zip(poses, rests, strict=True):
        assert first <= pose.first < pose.last <= last


def test_clipping_is_a_run_at_the_extreme_in_motion_only() -> None:
    values = np.zeros((20, 3))
    values[5:9, 0] = 3.0
    values[12:14, 1] = 2.0
    moving = np.ones(20, dtype=bool)
    assert np.flatnonzero(clipped(values + 1e-3 * np.arange(20)[:, None], moving)).tolist() == []
    values[:, 1:] += 1e-3 * np.arange(20)[:, None]
    values[:5, 0], values[9:, 0] = np.linspace(0, 1, 5), np.linspace(0, 1, 11)
    assert np.flatnonzero(clipped(values, moving)).tolist() == [5, 6, 7, 8]
    assert not clipped(values, ~moving).any()


def test_recorded_counts_show_gravity_and_close_their_turns() -> None:
    """Xsens MTi in raw counts, 38 poses: gravity to 0.1 mg, turns to 0.14 deg, and the author's own figures."""
    folder = recorded("calib_imutk_xsens")
    reading = read_imu(folder / "raw_counts.csv.gz", use="counts")
    found = calibrate_poses(reading.data, 9.81744, counts=True)
    assert len(found.poses) == pytest.approx(38, abs=2)
    assert np.sqrt(np.mean(found.norm_before**2)) > 20.0 * np.sqrt(np.mean(found.norm_after**2))
    assert np.sqrt(np.mean(found.norm_after**2)) < 0.12e-3 * G
    assert np.sqrt(np.mean(found.norm_left_out**2)) < 0.18e-3 * G
    rms = [np.rad2deg(np.sqrt(np.mean(miss**2))) for miss in (found.turn_before, found.turn_plain, found.turn_after)]
    assert rms[0] > 3.0
    assert rms[1] < 0.55
    assert rms[2] < 0.16
    assert np.rad2deg(np.sqrt(np.mean(found.turn_left_out**2))) < 0.18
    # a 16-bit converter: its middle is the zero of every sensor but for a few percent of the range
    np.testing.assert_allclose(found.accel.bias, 32768.0, atol=0.02 * 65536)
    np.testing.assert_allclose(found.gyro.bias, 32768.0, atol=0.02 * 65536)
    # one make of sensor on all axes
    assert np.ptp(np.diag(found.accel.matrix)) < 0.01 * found.accel.matrix[0, 0]
    assert np.ptp(np.diag(found.gyro.matrix)) < 0.01 * found.gyro.matrix[0, 0]


def test_corrected_is_the_inverse_of_the_model() -> None:
    triad = Triad(TRUE.accel_bias, TRUE.accel_matrix, *_no_sd(), 1.0)
    force = G * directions()
    np.testing.assert_allclose(corrected(triad, force @ TRUE.accel_matrix.T + TRUE.accel_bias), force, atol=1e-12)
