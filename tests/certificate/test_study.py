"""The integrators for study against the same formulas written with arrays, and their orders."""

from __future__ import annotations

import numpy as np
import pytest

from insnav import strapdown
from insnav.attitude import dcm_from_quat, quat_conjugate, quat_multiply, rotvec_from_quat
from insnav.certificate.integrators import attitude_after, steps_of
from insnav.certificate.motions import Cone
from insnav.exceptions import ConfigError
from insnav.types import FloatArray, ImuData
from tests.refusals import refused

STUDY = ("rk4", "rotvec", "euler")


def record(sampling: str, n: int = 30, seed: int = 3) -> ImuData:
    """Large rates and forces at uneven times, no two alike."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.008, 0.011, n))
    size = 0.01 if sampling == "increment" else 1.0
    return ImuData(time, size * rng.normal(0, 20.0, (n, 3)), size * rng.normal(0, 50.0, (n, 3)), sampling)


def lines(parts: strapdown.Intervals, values: FloatArray, k: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rate at the start, middle and end of an interval: samples at the middle (at the end if instantaneous) joined."""
    if parts.instant:
        return values[k - 1], 0.5 * (values[k - 1] + values[k]), values[k]
    rate = values / parts.dt[:, None]
    middle = parts.end - 0.5 * parts.dt
    begin, end = (
        np.array([np.interp(t, middle, rate[:, i]) for i in range(3)])
        for t in (parts.end[k] - parts.dt[k], parts.end[k])
    )
    return begin, rate[k], end


def classical(parts: strapdown.Intervals, k: int) -> tuple[FloatArray, FloatArray]:
    """One Runge-Kutta step of quaternion and velocity; rotation vector and velocity."""
    h = parts.dt[k]
    w, f = lines(parts, parts.gyro, k), lines(parts, parts.accel, k)

    def slope(y: FloatArray, at: int) -> FloatArray:
        q = y[:4]
        turn = dcm_from_quat(q / np.linalg.norm(q))
        return np.concatenate([0.5 * quat_multiply(q, np.concatenate([[0.0], w[at]])), turn @ f[at]])

    y = np.array([1.0, 0, 0, 0, 0, 0, 0])
    a = slope(y, 0)
    b = slope(y + 0.5 * h * a, 1)
    c = slope(y + 0.5 * h * b, 1)
    d = slope(y + h * c, 2)
    y = y + h / 6 * (a + 2 * b + 2 * c + d)
    return rotvec_from_quat(y[:4] / np.linalg.norm(y[:4])), y[4:]


@pytest.mark.parametrize("sampling", ["increment", "mean", "instant"])
def test_rk4_is_runge_kutta_on_straight_lines(sampling):
    parts = strapdown.intervals(record(sampling))
    found = steps_of(strapdown.increments(parts, method="rk4"))
    for k in range(1, parts.end.size - 1):
        rotation, velocity = classical(parts, k)
        np.testing.assert_allclose(found.rotation[k], rotation, rtol=0, atol=1e-13)
        np.testing.assert_allclose(found.velocity[k], velocity, rtol=0, atol=1e-12)


@pytest.mark.parametrize("sampling", ["increment", "mean", "instant"])
def test_euler_goes_straight_on(sampling):
    parts = strapdown.intervals(record(sampling))
    found = steps_of(strapdown.increments(parts, method="euler"))
    for k in range(1, parts.end.size):
        angle, gained = (
            parts.dt[k] * values[k - 1] if parts.instant else values[k] for values in (parts.gyro, parts.accel)
        )
        size = np.linalg.norm(angle)
        np.testing.assert_allclose(found.rotation[k], 2 * np.arctan(0.5 * size) * angle / size, rtol=0, atol=1e-14)
        np.testing.assert_allclose(found.velocity[k], gained, rtol=0, atol=1e-14)


@pytest.mark.parametrize("sampling", ["increment", "mean", "instant"])
def test_rotvec_takes_the_mean_rate_for_constant(sampling):
    parts = strapdown.intervals(record(sampling))
    found = strapdown.increments(parts, method="rotvec")
    mean = parts.gyro
    if parts.instant:
        mean = np.concatenate([np.zeros((1, 3)), 0.5 * parts.dt[1:, None] * (parts.gyro[:-1] + parts.gyro[1:])])
    np.testing.assert_allclose(found.dtheta, mean, rtol=0, atol=1e-15)
    assert (found.coning == 0.0).all()
    assert (found.sculling == 0.0).all()


def error_of_coning(method: str, rate: float) -> float:
    """Attitude error after 0.7 of a cycle of coning from instantaneous rates [rad]; after a whole one errors cancel."""
    motion, time = Cone(0.2, 2 * np.pi), np.arange(round(0.7 * rate) + 1) / rate
    imu = ImuData(time, motion.rate(time), np.zeros((time.size, 3)), "instant")
    steps = steps_of(strapdown.increments(strapdown.intervals(imu), method=method))
    true = quat_multiply(quat_conjugate(motion.quaternion(time[:1])[0]), motion.quaternion(time[-1:])[0])
    return float(np.linalg.norm(rotvec_from_quat(quat_multiply(quat_conjugate(true), attitude_after(steps.rotation)))))


@pytest.mark.parametrize(("method", "order"), [("euler", 1.0), ("rotvec", 2.0), ("rk4", 2.0), ("polynomial", 4.0)])
def test_order_of_convergence(method, order):
    # the straight line between samples makes rk4 one of second order; the polynomial is of higher order than it needs
    coarse, fine = error_of_coning(method, 100.0), error_of_coning(method, 200.0)
    print(method, np.log2(coarse / fine))
    assert np.log2(coarse / fine) >= order - 0.1
    if order <= 2.0:
        assert np.log2(coarse / fine) <= order + 0.1


def test_the_default_is_the_polynomial():
    parts = strapdown.intervals(record("increment"))
    found, named = strapdown.increments(parts), strapdown.increments(parts, method="polynomial")
    np.testing.assert_array_equal(found.coning, named.coning)
    assert not np.array_equal(found.coning, strapdown.increments(parts, method="rk4").coning)


@pytest.mark.parametrize("method", STUDY)
def test_a_body_that_does_not_turn_is_exact(method):
    imu = ImuData(np.arange(1, 5) * 0.01, np.zeros((4, 3)), np.full((4, 3), 0.1), "increment")
    found = steps_of(strapdown.increments(strapdown.intervals(imu), method=method))
    assert (found.rotation == 0.0).all()
    np.testing.assert_allclose(found.velocity, 0.1, rtol=1e-15)


@pytest.mark.parametrize("method", [*STUDY, "heun"])
def test_pieces_and_unknown_methods_are_refused(method):
    parts = strapdown.intervals(record("increment"))
    pieces = None if method == "heun" else strapdown.split(parts, parts.end[3:4] - 0.004, 0, parts.end.size)
    code = "data.unknown_integrator" if method == "heun" else "data.integrator_of_parts"
    with refused(ConfigError, code) as caught:
        strapdown.increments(parts, pieces, method=method)
    assert caught.value.values["method"] == method
    assert "polynomial" in caught.value.values["known"]
