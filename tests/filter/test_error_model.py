"""Noise, correlation times and initial covariance against what they are to describe."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.alignment.static import level
from insnav.attitude import dcm_from_rph, quat_from_rph, rph_from_quat
from insnav.earth import OMEGA_EARTH, gravity_n
from insnav.filter.error_model import error_model, initial_state, layout
from insnav.filter.gates import Gates
from insnav.filter.navigator import Navigator
from insnav.filter.receiver import Receiver
from insnav.findings import Code
from insnav.imu.specification import ImuSpec, SensorSpec
from insnav.kernels import epoch, measurements
from insnav.types import Alignment, GpsData, ImuData
from insnav.units import DEG, DEG_PER_H, UG
from tests.filter import drives

LLA = np.array([0.8, 0.1, 100.0])
RPH = np.array([0.02, -0.03, 2.0])
STATIC = Code.ALIGN_LEVEL_STATIC, Code.ALIGN_HEADING_GIVEN


def initial_covariance(heading_method: Code, turned: float = 0.0) -> np.ndarray:
    alignment = Alignment(
        0.0,
        RPH + turned * np.eye(3)[2],
        np.full(3, 1e-9),
        np.zeros(3),
        np.full(3, np.inf),
        (0.0, 60.0),
        Code.ALIGN_LEVEL_STATIC,
        heading_method,
    )
    model = error_model(drives.SPEC, 21)
    return initial_state(alignment, model, LLA, np.zeros(3), np.ones(3), np.ones(3)).covariance


def attitude_error_of(roll: float, pitch: float, heading: float) -> np.ndarray:
    """``phi`` of ``C_hat = (I - [phi x]) C``."""
    turn = np.eye(3) - dcm_from_rph(np.array([roll, pitch, heading])) @ dcm_from_rph(RPH).T
    return np.array([turn[2, 1], turn[0, 2], turn[1, 0]])


def test_driving_noise_and_correlation_time_of_the_biases():
    """``2 sd^2 / T`` of the in-run bias; a turn-on bias adds to the stationary variance and not to the noise."""
    plain = error_model(drives.SPEC, 21)
    size, time = drives.SPEC.gyro.bias_instability, drives.SPEC.gyro.correlation_time
    np.testing.assert_allclose(plain.noise[6:9], 2.0 * size**2 / time)
    np.testing.assert_allclose(plain.decay[:3], 1.0 / time)
    turn_on = 100 * DEG_PER_H * np.ones(3)
    both = error_model(replace(drives.SPEC, gyro=replace(drives.SPEC.gyro, bias=turn_on)), 21)
    np.testing.assert_allclose(both.noise[6:9], plain.noise[6:9])
    np.testing.assert_allclose(both.noise[6:9] / (2.0 * both.decay[:3]), turn_on**2 + size**2)


@pytest.mark.parametrize("axis", range(3))
def test_the_tilt_of_a_levelled_imu_goes_with_its_accelerometer_bias(axis: int):
    bias = 100 * UG * np.eye(3)[axis]
    measured = dcm_from_rph(RPH).T @ -gravity_n(LLA[0], LLA[2]) + bias
    tilt = attitude_error_of(*level(measured), RPH[2])
    p = initial_covariance(Code.ALIGN_HEADING_GIVEN)
    # the estimated bias is zero at first: its error is the negative of the bias
    by_bias = p[6:9, 12:15] / np.diag(p)[12:15]
    np.testing.assert_allclose((by_bias @ -bias)[:2], tilt[:2], rtol=1e-3, atol=3e-7)


@pytest.mark.parametrize("axis", range(3))
def test_the_heading_of_a_gyrocompass_goes_with_its_gyro_bias(axis: int):
    bias = 0.01 * DEG_PER_H * np.eye(3)[axis]
    c = dcm_from_rph(RPH)
    rate = c.T @ (OMEGA_EARTH * np.array([np.cos(LLA[0]), 0.0, -np.sin(LLA[0])])) + bias
    levelled = dcm_from_rph(np.array([RPH[0], RPH[1], 0.0])) @ rate
    heading = float(np.arctan2(-levelled[1], levelled[0]))
    error = attitude_error_of(RPH[0], RPH[1], heading)
    p = initial_covariance(Code.ALIGN_HEADING_GYROCOMPASS)
    by_bias = p[6:9, 9:12] / np.diag(p)[9:12]
    assert abs(error[2]) < 0.1 * DEG
    np.testing.assert_allclose((by_bias @ -bias)[2], error[2], rtol=1e-3, atol=1e-9)


def test_a_correction_of_the_heading_turns_what_accelerometers_have_done():
    """As if the levelled IMU had begun with that heading."""
    estimated, error, phi = np.zeros(measurements.LAG + 1), np.zeros(21), np.eye(21)
    estimated[measurements.STATE] = *LLA, *np.zeros(3), *quat_from_rph(RPH)
    error[8] = 0.3
    epoch.take(np.empty(0), estimated, error, layout(Receiver()).places, True)
    heading = rph_from_quat(estimated[measurements.STATE][6:])[2]
    epoch.turn(phi, estimated)
    expected = initial_covariance(Code.ALIGN_HEADING_GIVEN, heading - RPH[2])
    np.testing.assert_allclose(
        phi @ initial_covariance(Code.ALIGN_HEADING_GIVEN) @ phi.T, expected, rtol=1e-9, atol=1e-15
    )
    # and so the velocity: any relation of it in the axes of the IMU is the same one before and after
    in_body = np.random.default_rng(1).normal(size=(3, 12))
    before, after = (dcm_from_rph(RPH + turned * np.eye(3)[2]) @ in_body for turned in (0.0, heading - RPH[2]))
    np.testing.assert_allclose(phi[3:6, 3:6] @ before, after, atol=1e-9)
    assert abs(heading - RPH[2]) > 0.29
    assert estimated[measurements.TURNED] == 0.0


@pytest.mark.parametrize("sd", [1e-6, 0.05, 0.3, 2.0])
def test_what_is_not_known_of_the_heading_changes_the_velocity_along_its_change_too(sd: float):
    """Mean square over headings that are normally distributed, by quadrature."""
    estimated, q = np.zeros(measurements.LAG + 1), np.zeros((21, 21))
    estimated[measurements.STATE][3:5], estimated[measurements.BEGAN] = (7.0, -2.0), (3.0, 1.0)
    epoch.not_linear(q, estimated, np.diag(np.where(np.arange(21) == 8, sd**2, 0.0)))
    at, weight = np.polynomial.hermite_e.hermegauss(60)
    expected = 25.0 * (weight @ (1.0 - np.cos(sd * at)) ** 2) / weight.sum()
    np.testing.assert_allclose(np.diagonal(q)[3:5], expected, rtol=2e-3)
    assert np.count_nonzero(q) <= 2


def test_a_tilt_that_is_corrected_makes_another_axis_vertical_and_noise_to_and_fro_none():
    """By a tilt t, sin(t) of a horizontal bias is vertical: its square times the variance, however many steps it takes.

    One that goes to and fro, as of fixes with too small a standard deviation, comes back to the same axes.
    """
    tilt, p, at = 0.02, np.diag(np.where(np.arange(21) == 12, 0.3**2, 0.0)), layout(Receiver()).places
    for steps in ([1.0], [1.0, -1.0] * 500):
        estimated, added = np.zeros(measurements.LAG + 1), np.zeros((21, 21))
        estimated[measurements.STATE] = *LLA, *np.zeros(3), *quat_from_rph(RPH)
        for step in steps:
            error = np.zeros(21)
            error[7] = step * tilt
            epoch.take(np.empty(0), estimated, error, at, True)
            epoch.not_linear(added, estimated, p)
        expected = (np.sin(tilt) * 0.3) ** 2 * (1.0 if len(steps) == 1 else epoch.TO_AND_FRO)
        np.testing.assert_allclose(np.diagonal(added)[12:15], expected, rtol=1e-3)


@pytest.mark.parametrize("seen_sd", [1e-6, 3e-5, 1e-2])
def test_the_first_gyro_bias_is_the_mean_of_specification_and_alignment(seen_sd: float):
    """Drawn from the specification, seen with noise: its error is as large as stated, and no estimate is better."""
    rng = np.random.default_rng(4)
    model = error_model(drives.SPEC, 21)
    true = rng.standard_normal((2000, 3)) * model.sd[:3]
    seen = true + rng.standard_normal((2000, 3)) * seen_sd
    found = []
    for each in seen:
        alignment = Alignment(0.0, RPH, np.full(3, 1e-9), each, np.full(3, seen_sd), (0.0, 60.0), *STATIC)
        found.append(initial_state(alignment, model, LLA, np.zeros(3), np.ones(3), np.ones(3)))
    error = np.array([state.gyro_bias for state in found]) - true
    sd = np.sqrt(np.diag(found[0].covariance)[9:12])
    np.testing.assert_allclose(np.sqrt(np.mean(error**2, axis=0)), sd, rtol=0.06)
    assert (sd <= np.minimum(model.sd[:3], seen_sd)).all()


def attitude_variance(spec: ImuSpec, time: np.ndarray, rate: float) -> np.ndarray:
    """Of a filter that starts without errors, turns at `rate` [rad/s] and is given no fix worth the name."""
    model = error_model(spec, 21)
    start = Alignment(0.0, np.zeros(3), np.full(3, 1e-9), np.zeros(3), np.full(3, np.inf), None, *drives.GIVEN)
    initial = initial_state(start, model, LLA, np.zeros(3), np.full(3, 1e-6), np.full(3, 1e-6))
    shape = (time.size, 1)
    imu = ImuData(time, np.tile([0.0, 0.0, rate], shape), np.tile([0.0, 0.0, -9.8], shape))
    useless = np.full((1, 3), 1e9)
    fix = GpsData(time[-1:] - 0.01, LLA[None], np.full((1, 3), np.nan), useless, useless)
    begin, none = drives.Begin(initial, start), np.zeros(3)
    navigator = Navigator(drives.ready(imu, fix, begin, model, lever_b=none, gates=Gates(max_sd=np.inf), smooth=False))
    navigator.feed(imu)
    return np.diagonal(navigator.finish().epochs.covariance[0])[6:9]


def test_misalignment_makes_attitude_errors_in_proportion_to_the_rotation():
    """Variance ``sd^2 w^2 T`` for every second of a turn, with manoeuvres of one second."""
    size, rate, span = 1e-3, 0.2, 20.0
    spec = ImuSpec("misaligned", SensorSpec(misalignment=size * np.ones(3)), SensorSpec())
    found = attitude_variance(spec, np.arange(1, round(50.0 * span) + 1) / 50.0, rate)
    np.testing.assert_allclose(found, size**2 * rate**2 * span, rtol=0.02)


@pytest.mark.parametrize("length", [0.5, 1.5])
def test_a_data_gap_loses_the_attitude_with_the_square_of_its_length(length: float):
    """A rate that changes unseen by 0.1 rad/s^2 is off by ``0.1 T^2`` after the gap."""
    time = np.arange(1, 501) / 50.0
    kept = time[(time < 5.01) | (time > 5.01 + length)]
    found = attitude_variance(ImuSpec("perfect", SensorSpec(), SensorSpec()), kept, 0.0)
    np.testing.assert_allclose(found, (0.1 * length**2) ** 2, rtol=0.1)
