"""A day of a platform and of a strapdown navigator at rest: the same errors do the same, and theory says what."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm

from insnav import strapdown
from insnav.earth import earth_rate_n, gravity_n, ned_offset
from insnav.errors.platform_errors import measured_periods, periods, static_errors
from insnav.exceptions import ConfigError, InputError
from insnav.gimbal import PlatformErrors, navigate_platform
from insnav.types import ImuData
from insnav.units import DEG_PER_H, UG
from tests.physics import equations as eq
from tests.refusals import refused

PLACE = np.array([np.radians(45.0), 0.2, 100.0])
DAY, RATE, KEPT = 86400.0, 2.0, 120  # [s], [Hz], one state a minute is looked at
HOUR_DEG = DEG_PER_H
CASES = {
    "drift north": PlatformErrors(drift=np.array([0.01, 0.0, 0.0]) * HOUR_DEG),
    "drift east": PlatformErrors(drift=np.array([0.0, 0.01, 0.0]) * HOUR_DEG),
    "drift down": PlatformErrors(drift=np.array([0.0, 0.0, 0.01]) * HOUR_DEG),
    "bias": PlatformErrors(bias=np.array([50.0, -30.0, 0.0]) * UG),
    "tilt": PlatformErrors(tilt=np.array([1e-4, -5e-5, 0.0])),
    "heading": PlatformErrors(tilt=np.array([0.0, 0.0, 1e-3])),
    "everything": PlatformErrors(
        np.array([2e-5, -4e-5, 3e-4]), np.array([0.01, -0.02, 0.01]) * HOUR_DEG, np.array([20.0, 10.0, 0.0]) * UG
    ),
}


def scaled(name: str, size: float) -> PlatformErrors:
    errors = CASES[name]
    return PlatformErrors(size * errors.tilt, size * errors.drift, size * errors.bias)


@cache
def platform_day(name: str, size: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time [s], error of position N, E [m], tilt [rad]."""
    t = np.arange(round(DAY * RATE) + 1) / RATE
    f_n = np.tile(-gravity_n(PLACE[0], PLACE[2]), (len(t), 1))
    run = navigate_platform(t, f_n, PLACE, np.zeros(3), errors=scaled(name, size), every=KEPT)
    return run.solution.time, ned_offset(run.solution.lla, PLACE)[:, :2], run.tilt


@cache
def strapdown_day(name: str, size: float = 1.0) -> np.ndarray:
    """Error of position N, E [m] of a strapdown navigator whose body is level and heads north."""
    n = round(DAY * RATE)
    errors = scaled(name, size)
    # a gyro of a strapdown system that shows too much turns the computed axes the other way
    gyro = np.tile(earth_rate_n(PLACE[0]) - errors.drift, (n, 1))
    accel = np.tile(errors.bias - gravity_n(PLACE[0], PLACE[2]), (n, 1))
    imu = ImuData(np.arange(1, n + 1) / RATE, gyro, accel)
    held = np.full(n, PLACE[2]), np.zeros(n)
    start = -errors.tilt  # the computed attitude lags behind axes that are turned
    got = strapdown.navigate(
        strapdown.increments(strapdown.intervals(imu)), PLACE, np.zeros(3), start, vertical=held, every=KEPT
    )
    return ned_offset(got.lla, PLACE)[:, :2]


def linear_model(name: str, time: np.ndarray) -> np.ndarray:
    """Position error N, E [m] by matrix exponential of a seven-state model, two radii, written down anew."""
    lat, h = PLACE[0], PLACE[2]
    rm, rn = (r + h for r in eq.radii(lat))
    g = float(gravity_n(lat, h)[2])
    s, c = eq.OMEGA * np.sin(lat), eq.OMEGA * np.cos(lat)
    a = np.zeros((8, 8))  # x_N, x_E, v_N, v_E, phi_N, phi_E, phi_D, 1
    a[0, 2] = a[1, 3] = 1.0
    a[2, 3], a[3, 2] = -2.0 * s, 2.0 * s
    a[2, 5], a[3, 4] = g, -g
    a[4, 5], a[5, 4], a[5, 6], a[6, 5] = -s, s, c, -c
    a[4, 0], a[6, 0] = -s / rm, -c / rm
    a[4, 3], a[5, 2], a[6, 3] = 1.0 / rn, -1.0 / rm, -np.tan(lat) / rn
    errors = CASES[name]
    a[2:4, 7], a[4:7, 7] = errors.bias[:2], errors.drift
    step = expm(a * (time[1] - time[0]))
    x = np.concatenate([np.zeros(4), errors.tilt, [1.0]])
    out = np.empty((len(time), 2))
    for k in range(len(time)):
        out[k] = x[:2]
        x = step @ x
    return out


@pytest.mark.parametrize("name", CASES)
def test_a_day_of_the_platform_is_as_the_linear_model_says(name):
    time, position, _ = platform_day(name)
    expected = linear_model(name, time)
    assert np.abs(position - expected).max() < 3e-3 * np.abs(expected).max()


@pytest.mark.parametrize("name", CASES)
def test_the_closed_form_has_the_amplitudes_of_the_platform(name):
    """But for the square of the errors: a tenth of them is off it by a tenth of the part."""
    for size, bar in ((1.0, 5e-3), (0.1, 5e-4)):
        time, position, tilt = platform_day(name, size)
        theory = static_errors(time, PLACE[0], PLACE[2], scaled(name, size))
        assert np.ptp(position, axis=0) == pytest.approx(np.ptp(theory.position, axis=0), rel=bar)
        assert np.abs(position - theory.position).max() < bar * np.abs(theory.position).max()
        assert np.abs(tilt - theory.tilt).max() < bar * np.abs(theory.tilt).max()


@pytest.mark.parametrize("lat", [0.0, 5.0, -60.0])
def test_the_closed_form_knows_both_radii_and_begins_at_zero(lat):
    place = np.array([np.radians(lat), 0.2, 100.0])
    t = np.arange(0.0, DAY + 1.0, 5.0)
    f_n = np.tile(-gravity_n(place[0], place[2]), (len(t), 1))
    run = navigate_platform(t, f_n, place, np.zeros(3), errors=scaled("everything", 0.01), every=12)
    position = ned_offset(run.solution.lla, place)[:, :2]
    theory = static_errors(run.solution.time, place[0], place[2], scaled("everything", 0.01))
    assert np.abs(position - theory.position).max() < 1e-4 * np.abs(theory.position).max()
    assert np.abs(run.solution.v_n[:, :2] - theory.velocity).max() < 1e-4 * np.abs(theory.velocity).max()
    later = static_errors(run.solution.time[700:], place[0], place[2], scaled("everything", 0.01))
    np.testing.assert_allclose(later.position, theory.position[700:], atol=1e-9)


@pytest.mark.parametrize("name", CASES)
def test_the_periods_are_those_of_theory_within_half_a_percent(name):
    time, position, _ = platform_day(name)
    found, theory = measured_periods(time, position, PLACE[0], PLACE[2]), periods(PLACE[0], PLACE[2])
    assert found.schuler == pytest.approx(theory.schuler, rel=5e-3)
    assert found.schuler / 60.0 == pytest.approx(84.4, rel=5e-3)
    assert found.foucault == pytest.approx(theory.foucault, rel=5e-3)
    if name == "bias":
        assert found.earth is None
    else:
        assert found.earth == pytest.approx(86164.1, rel=5e-3)


@pytest.mark.parametrize("name", ["drift east", "everything"])
def test_the_same_errors_do_the_same_to_a_strapdown_navigator(name):
    """But for the square of the errors, 45 m where they are 16 km off, as both mechanizations are nonlinear."""
    time, position, _ = platform_day(name)
    other = strapdown_day(name)
    difference = np.abs(position[1:] - other).max()
    assert difference < 4e-3 * np.abs(position).max()
    smaller = np.abs(platform_day(name, 0.1)[1][1:] - strapdown_day(name, 0.1)).max()
    assert difference / smaller == pytest.approx(100.0, rel=0.05)
    found, theory = measured_periods(time[1:], other, PLACE[0], PLACE[2]), periods(PLACE[0], PLACE[2])
    assert found.schuler == pytest.approx(theory.schuler, rel=5e-3)
    assert found.foucault == pytest.approx(theory.foucault, rel=5e-3)


@pytest.mark.parametrize("lat", [-75.0, -30.0, 10.0, 60.0])
def test_periods_at_other_latitudes(lat):
    place = np.array([np.radians(lat), 0.0, 0.0])
    time = np.arange(1441) * 60.0
    errors = PlatformErrors(tilt=np.array([1e-5, 2e-5, 1e-4]), drift=np.array([0.01, -0.01, 0.02]) * HOUR_DEG)
    theory = static_errors(time, place[0], 0.0, errors)
    found, expected = measured_periods(time, theory.position, place[0], 0.0), periods(place[0], 0.0)
    assert found.schuler == pytest.approx(expected.schuler, rel=1e-6)
    assert found.foucault == pytest.approx(expected.foucault, rel=1e-3)
    assert found.earth == pytest.approx(expected.earth, rel=1e-3)


def test_simple_cases_of_the_closed_form():
    """On the pole of a short time: bias ``B / w^2 (1 - cos w t)``, tilt ``R phi (cos w t - 1)``, drift a ramp."""
    t = np.linspace(0.0, 600.0, 61)
    lat, g = np.radians(45.0), float(gravity_n(np.radians(45.0), 0.0)[2])
    swing = 2.0 * np.pi / periods(lat, 0.0).schuler
    bias = static_errors(t, lat, 0.0, PlatformErrors(bias=np.array([1e-3, 0.0, 0.0])))
    np.testing.assert_allclose(bias.position[:, 0], 1e-3 / swing**2 * (1.0 - np.cos(swing * t)), atol=0.1)
    np.testing.assert_allclose(bias.velocity[:, 0], 1e-3 / swing * np.sin(swing * t), atol=1e-3)
    tilt = static_errors(t, lat, 0.0, PlatformErrors(tilt=np.array([0.0, 1e-4, 0.0])))
    swung = g * 1e-4 / swing**2 * (1.0 - np.cos(swing * t))
    np.testing.assert_allclose(tilt.position[:, 0], swung, rtol=2e-3, atol=1e-9)  # rounding at the start
    drift = static_errors(t, lat, 0.0, PlatformErrors(drift=np.array([0.0, 1e-6, 0.0])))
    ramp = g * 1e-6 / swing**2 * (t - np.sin(swing * t) / swing)
    np.testing.assert_allclose(drift.position[1:, 0], ramp[1:], rtol=5e-3)


def test_what_has_no_period_is_refused():
    with refused(ConfigError, "platform.no_foucault"):
        periods(0.0, 0.0)
    with refused(InputError, "platform.record_too_short"):
        measured_periods(np.arange(100.0), np.zeros((100, 2)), 0.8, 0.0)
