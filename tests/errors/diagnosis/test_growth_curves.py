"""Curves are found from few numbers and from many, and are as uncertain as they say."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from insnav.errors.diagnosis.causes import (
    about_the_curve,
    end_of_run,
    explain_end,
    fit_curve,
    position_terms,
    velocity_terms,
)
from insnav.exceptions import InputError
from insnav.units import DEG, G0

TIME = np.arange(2.0, 61.0, 2.0)
GRAVITY = 9.8
ACCEL_NOISE, GYRO_NOISE = (2e-4) ** 2, (2e-6) ** 2  # [m^2/s^3], [rad^2/s]


def test_a_recorded_minute_is_a_pure_square_of_half_a_milliradian():
    # position and velocity error at the end of one recorded minute, and nothing else
    end = (np.array([number]) for number in (60.0, -8.231, -0.2754))
    found = fit_curve(*end, np.diag([0.1**2, 0.005**2]))
    assert found.terms == ("t²",)
    tilt, bias = found.value[1] / GRAVITY, found.value[1] / G0
    print(f"{1e3 * tilt:.3f} mrad, {tilt / DEG:.4f} deg, or {1e3 * bias:.3f} mg")
    assert found.value[0] == found.value[2] == 0.0
    assert abs(tilt) == pytest.approx(0.47e-3, abs=0.005e-3)
    assert abs(tilt) / DEG == pytest.approx(0.027, abs=0.0005)
    assert abs(bias) == pytest.approx(0.47e-3, abs=0.005e-3)
    assert abs(tilt) / (0.003 * DEG) == pytest.approx(9.0, abs=0.1)  # the tilt that had been assumed
    assert np.isinf(found.sd).all()  # three terms cannot be told from two numbers


@pytest.mark.parametrize(("term", "coefficient"), [(0, 0.3), (1, 4e-3), (2, 2e-4)])
def test_each_pure_curve_is_named(term: int, coefficient: float):
    value = np.zeros(3)
    value[term] = coefficient
    curve = made(value)
    assert curve.terms == (("t", "t²", "t³")[term],)
    assert curve.value[term] == pytest.approx(coefficient, rel=1e-9)
    np.testing.assert_allclose(curve.value, value, atol=1e-9)


def test_coefficients_have_their_meaning():
    # 10 deg/h about a level axis are 17.1 m after a minute, 1 mg of bias 17.65 m, 0.1 m/s 6 m
    drift, bias, speed = 10.0 * DEG / 3600.0, 1e-3 * G0, 0.1
    position = speed * TIME + bias * TIME**2 / 2.0 + GRAVITY * drift * TIME**3 / 6.0
    velocity = speed + bias * TIME + GRAVITY * drift * TIME**2 / 2.0
    assert position[-1] == pytest.approx(6.0 + 17.65 + 17.10, abs=0.01)
    found = fit_curve(TIME, position, velocity, np.diag(np.full(2 * len(TIME), 0.01**2)))
    np.testing.assert_allclose(found.value, [speed, bias, GRAVITY * drift], rtol=1e-8)


def test_a_mixture_needs_all_its_terms():
    curve = made(np.array([0.2, -5e-3, 3e-4]))
    assert curve.terms == ("t", "t²", "t³")


def test_velocities_sharpen_the_fit_and_may_be_absent():
    with_them, without = made(np.array([0.0, 4e-3, 0.0])), made(np.array([0.0, 4e-3, 0.0]), velocities=False)
    assert (with_them.sd < without.sd).all()
    assert np.isfinite(without.sd).all()


def test_covariance_about_the_curve_is_that_of_integrated_noise():
    rng, runs, dt = np.random.default_rng(3), 4000, 0.25
    steps = 80
    accel = rng.standard_normal((runs, steps)) * np.sqrt(ACCEL_NOISE / dt)
    turn = np.cumsum(rng.standard_normal((runs, steps)) * np.sqrt(GYRO_NOISE * dt), axis=1)
    velocity = np.cumsum((accel + GRAVITY * turn) * dt, axis=1)
    position = np.cumsum(velocity * dt, axis=1)
    at = np.array([39, 79])
    sample = np.hstack([position[:, at], velocity[:, at]])
    expected = about_the_curve((at + 1) * dt, np.zeros(4), 0.0, ACCEL_NOISE, GYRO_NOISE, GRAVITY)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        (sample.T @ sample / runs) / np.outer(scale, scale), expected / np.outer(scale, scale), atol=0.12
    )


def test_coefficients_scatter_as_stated():
    rng = np.random.default_rng(5)
    noise = about_the_curve(TIME, np.full(2 * len(TIME), 0.05**2), 0.1**2, ACCEL_NOISE, GYRO_NOISE, GRAVITY)
    root = np.linalg.cholesky(noise)
    true = np.array([0.05, 2e-3, 1e-4])
    clean = np.vstack([position_terms(TIME), velocity_terms(TIME)]) @ true
    normalised, rough = [], []
    for _ in range(400):
        seen = clean + root @ rng.standard_normal(len(clean))
        found = fit_curve(TIME, seen[: len(TIME)], seen[len(TIME) :], noise)
        normalised.append((found.value - true) @ np.linalg.solve(found.covariance, found.value - true))
        rough.append(found.roughness)
    print(f"mean squared error by its sd: {np.mean(normalised) / 3.0:.3f}; roughness {np.mean(rough):.3f}")
    assert np.mean(normalised) / 3.0 == pytest.approx(1.0, abs=0.12)
    assert np.mean(rough) == pytest.approx(1.0, abs=0.05)


def test_a_jump_is_rough():
    clean = position_terms(TIME) @ np.array([0.0, 4e-3, 0.0])
    jumped = clean + np.where(TIME > 30.0, 5.0, 0.0)
    noise = about_the_curve(TIME, np.full(2 * len(TIME), 0.05**2), 0.1**2, ACCEL_NOISE, GYRO_NOISE, GRAVITY)
    assert fit_curve(TIME, jumped, np.full(len(TIME), np.nan), noise).roughness > 100.0


def made(value: np.ndarray, velocities: bool = True):
    velocity = velocity_terms(TIME) @ value if velocities else np.full(len(TIME), np.nan)
    noise = about_the_curve(TIME, np.full(2 * len(TIME), 0.02**2), 0.0, ACCEL_NOISE, GYRO_NOISE, GRAVITY)
    return fit_curve(TIME, position_terms(TIME) @ value, velocity, noise)


def test_the_end_of_a_run_is_what_grew_since_its_last_fix():
    time = np.arange(0.0, 91.0)
    since = np.maximum(time - 30.0, 0.0)
    tilt = 0.47e-3
    position = np.column_stack([0.3 + 0.0 * time, -0.2 - 0.5 * G0 * tilt * since**2, 0.0 * time])
    velocity = np.column_stack([0.0 * time, -G0 * tilt * since, 0.0 * time])
    used = SimpleNamespace(time=np.arange(1.0, 36.0), used_position=np.arange(1.0, 36.0) <= 30.0)  # the last five fail
    errors = SimpleNamespace(time=time, position=position, velocity=velocity)
    run = SimpleNamespace(errors=errors, run=SimpleNamespace(innovations=used))
    length, end, speed = end_of_run(run)
    assert length == 60.0
    east = explain_end(length, end, speed, 0.1, 0.005)[1]
    assert east.terms == ("t²",)
    assert east.alone[1] / G0 == pytest.approx(-tilt, rel=1e-9)
    with pytest.raises(InputError, match=r"diagnosis.ends_with_fixes"):
        end_of_run(
            SimpleNamespace(
                errors=errors,
                run=SimpleNamespace(innovations=SimpleNamespace(time=time, used_position=np.ones(91, dtype=bool))),
            )
        )
    with pytest.raises(InputError, match=r"diagnosis.no_end_error"):
        end_of_run(SimpleNamespace(errors=None, run=run.run))
