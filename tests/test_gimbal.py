"""The platform's integrators against closed forms, its equations against motions known exactly."""

from __future__ import annotations

import numpy as np
import pytest

from insnav.attitude import dcm_from_rph
from insnav.earth import gravity_n, ned_offset
from insnav.exceptions import ConfigError, DivergenceError, InputError
from insnav.gimbal import (
    DAMPING_TIME,
    INTEGRATORS,
    PlatformErrors,
    integral,
    navigate_platform,
    torquing_rates,
)
from insnav.simulate import circle, straight
from insnav.simulate.truth import Kinematics, Truth
from tests.refusals import refused

PLACE = np.array([0.8, 0.2, 3000.0])
ORDER = {"forward": 1, "backward": 1, "mean": 2, "fourth": 4}


def sampled(truth: Truth, time: np.ndarray) -> tuple[Kinematics, np.ndarray]:
    """Motion, and the specific force along North, East, Down."""
    at = truth.evaluate(time)
    return at, np.einsum("nij,nj->ni", dcm_from_rph(at.rph), at.f_b)


def order_of(steps: np.ndarray, errors: list[float]) -> float:
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_the_order_of_convergence_on_a_sine(integrator):
    counts = np.array([40, 80, 160, 320])
    errors = []
    for count in counts:
        t = np.linspace(0.0, 5.0, count + 1)
        errors.append(float(np.abs(integral(t, np.sin(t), integrator) - (1.0 - np.cos(t))).max()))
    assert order_of(5.0 / counts, errors) == pytest.approx(ORDER[integrator], abs=0.1)


def test_a_straight_line_is_integrated_as_the_rules_say():
    """y = 2 x: forward is short by the step times the way, backward too long by as much, the others exact."""
    x = np.linspace(0.0, 3.0, 31)
    off = {name: integral(x, 2.0 * x, name)[-1] - 9.0 for name in INTEGRATORS}
    assert off["forward"] == pytest.approx(-0.1 * 3.0, abs=1e-12)
    assert off["backward"] == pytest.approx(0.1 * 3.0, abs=1e-12)
    assert off["mean"] == pytest.approx(0.0, abs=1e-12)
    assert off["fourth"] == pytest.approx(0.0, abs=1e-12)


def test_the_polynomial_is_better_than_steps_over_two_samples():
    """Simpson's rule over pairs of samples is the other fourth-order method that sampled data allow."""
    t = np.linspace(0.0, 6.0, 301)
    y, h = np.sin(t), t[1]
    pairs = h / 3.0 * np.sum(y[:-2:2] + 4.0 * y[1:-1:2] + y[2::2])
    by_pairs = abs(pairs - (1.0 - np.cos(6.0)))
    by_polynomial = abs(integral(t, y, "fourth")[-1] - (1.0 - np.cos(6.0)))
    assert by_pairs / by_polynomial == pytest.approx(16.0, rel=0.15)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_the_order_of_convergence_on_a_turning_aircraft(integrator):
    truth = circle(PLACE, 150.0, 0.02, 320.0)
    steps, errors = np.array([8.0, 4.0, 2.0, 1.0]), []
    for step in steps:
        at, f_n = sampled(truth, np.arange(round(320.0 / step) + 1) * step)
        t = np.arange(len(f_n)) * step
        got = navigate_platform(t, f_n, at.lla[0], at.v_n[0], integrator=integrator).solution
        errors.append(float(np.linalg.norm(ned_offset(got.lla, at.lla), axis=1).max()))
    # near the ends the polynomial looks to one side only: a little better than its order on the way down
    assert order_of(steps, errors) == pytest.approx(ORDER[integrator], abs=0.15 if ORDER[integrator] < 4 else 1.3)


def test_a_flight_sampled_unevenly_is_found_again():
    """At 100 Hz with jitter and lost samples, fourth order: 1200 s within a tenth of a millimetre."""
    truth = circle(PLACE, 200.0, 0.01, 600.0)
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.uniform(0.008, 0.012, 58000))
    t = np.concatenate([[0.0], np.delete(t, rng.integers(1, 57000, 500))])
    t = t[t < 600.0]
    at, f_n = sampled(truth, t)
    got = navigate_platform(t, f_n, at.lla[0], at.v_n[0]).solution
    assert np.abs(ned_offset(got.lla, at.lla)).max() < 1e-4
    assert np.abs(got.v_n - at.v_n).max() < 1e-6
    # and uniform steps taken for granted would be far off
    even = np.linspace(0.0, t[-1], len(t))
    wrong = navigate_platform(even, f_n, at.lla[0], at.v_n[0]).solution
    assert np.abs(ned_offset(wrong.lla, at.lla)).max() > 1.0


@pytest.mark.parametrize("vertical", ["free", "damped"])
def test_a_climb_needs_a_vertical_channel(vertical):
    truth = straight(np.array([-0.7, 3.14, 500.0]), 120.0, 1.2, 300.0, climb=8.0)
    t = np.arange(3001) / 10.0
    at, f_n = sampled(truth, t)
    got = navigate_platform(
        t,
        f_n,
        at.lla[0],
        at.v_n[0],
        vertical=vertical,
        height=at.lla[:, 2] if vertical == "damped" else None,
    ).solution
    assert np.abs(ned_offset(got.lla, at.lla)).max() < 1e-4
    assert np.abs(got.v_n - at.v_n).max() < 1e-6
    assert got.lla[-1, 1] < 0.0  # it crossed the date line


def at_rest(duration: float, rate: float, lla: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(round(duration * rate) + 1) / rate
    return t, np.tile(-gravity_n(lla[0], lla[2]), (len(t), 1))


def test_a_free_vertical_channel_runs_away_as_gravity_falls_off_with_height():
    """``cosh(sqrt(2 g / R) t)``, of which the ellipsoid's own fall-off of gravity with height is 0.3 % different."""
    t, f_n = at_rest(1200.0, 10.0, PLACE)
    d = 1e-3
    g = gravity_n(PLACE[0], np.array([PLACE[2] - d, PLACE[2] + d]))[:, 2]
    k = np.sqrt(-(g[1] - g[0]) / (2 * d))
    off = PLACE + np.array([0.0, 0.0, 5.0])
    got = navigate_platform(t, f_n, off, np.zeros(3), vertical="free").solution
    np.testing.assert_allclose(got.lla[:, 2] - PLACE[2], 5.0 * np.cosh(k * t), rtol=1e-3)
    assert k == pytest.approx(1.0 / 570.0, rel=0.01)


def test_the_damped_vertical_channel_forgets_an_error_of_height_as_designed():
    """Three equal roots: ``x'''  + 3 x''/T + 3 x'/T^2 + x/T^3 = 0`` from the loop's own start; a bias leaves none."""
    t, f_n = at_rest(1500.0, 10.0, PLACE)
    off = PLACE + np.array([0.0, 0.0, 5.0])
    errors = PlatformErrors(bias=np.array([0.0, 0.0, 1e-3]))
    height = np.full(len(t), PLACE[2])
    got = navigate_platform(t, f_n, off, np.zeros(3), vertical="damped", height=height, errors=errors)
    x = (got.undisturbed.lla[:, 2] - PLACE[2]) / 5.0
    s = t / DAMPING_TIME
    # x(0) = 1, x'(0) = -k1, x''(0) = k1^2 - k2 + 2g/R = 6/T^2
    np.testing.assert_allclose(x, np.exp(-s) * (1.0 - 2.0 * s + 0.5 * s**2), atol=2e-4)
    assert abs(got.solution.lla[-1, 2] - PLACE[2]) < 0.01
    assert np.abs(got.solution.lla[:, 2] - got.undisturbed.lla[:, 2]).max() > 1.0


def test_torquing_rates_are_those_of_the_laboratory_formulas():
    truth = circle(PLACE, 200.0, 0.01, 100.0)
    at, f_n = sampled(truth, np.arange(101.0))
    run = navigate_platform(np.arange(101.0), f_n, at.lla[0], at.v_n[0])
    lat, height, (vn, ve) = at.lla[:, 0], at.lla[:, 2], at.v_n[:, :2].T
    w, a, e2 = 7.292115e-5, 6378137.0, 0.00669437999014
    n = a / np.sqrt(1 - e2 * np.sin(lat) ** 2)
    rx, ry = n + height, n * (1 - e2) / (1 - e2 * np.sin(lat) ** 2) + height
    east, north = -vn / ry, w * np.cos(lat) + ve / rx
    up = w * np.sin(lat) + ve * np.tan(lat) / rx
    np.testing.assert_allclose(torquing_rates(run.solution), np.column_stack([north, east, -up]), atol=1e-13)


def test_a_platform_at_rest_turns_with_the_earth_when_it_is_not_torqued_right():
    """A drift about down makes heading, and a heading error shows as a tilt about north by the Earth's rate."""
    t, f_n = at_rest(60.0, 10.0, PLACE)
    errors = PlatformErrors(tilt=np.array([0.0, 0.0, 1e-3]), drift=np.array([0.0, 0.0, 1e-6]))
    tilt = navigate_platform(t, f_n, PLACE, np.zeros(3), errors=errors).tilt
    assert tilt[0] == pytest.approx([0.0, 0.0, 1e-3], abs=1e-12)
    north = 7.292115e-5 * np.cos(PLACE[0])
    assert tilt[-1, 2] == pytest.approx(1e-3 * (1.0 - 0.5 * (north * 60.0) ** 2) + 60e-6, abs=2e-10)
    # -w_in x phi: east component -(w_D phi_N - w_N phi_D) = w_N phi_D
    growth = north * (1e-3 * 60.0 + 0.5e-6 * 3600.0)
    assert tilt[-1, 1] == pytest.approx(growth, rel=1e-3)


def test_a_large_tilt_is_a_rotation_not_a_small_angle():
    t, f_n = at_rest(1.0, 100.0, PLACE)
    errors = PlatformErrors(tilt=np.array([0.0, 0.1, 0.0]))
    v = navigate_platform(t, f_n, PLACE, np.zeros(3), errors=errors).solution.v_n[-1]
    assert v[0] == pytest.approx(gravity_n(PLACE[0], PLACE[2])[2] * np.sin(0.1), rel=1e-4)


def test_every_so_manieth_sample_is_the_same_solution():
    t, f_n = at_rest(100.0, 10.0, PLACE)
    errors = PlatformErrors(drift=np.array([1e-6, 0.0, 0.0]))
    all_of_it = navigate_platform(t, f_n, PLACE, np.zeros(3), errors=errors)
    some = navigate_platform(t, f_n, PLACE, np.zeros(3), errors=errors, every=7)
    np.testing.assert_array_equal(some.solution.lla, all_of_it.solution.lla[::7])
    np.testing.assert_array_equal(some.solution.time, t[::7])
    np.testing.assert_array_equal(some.tilt, all_of_it.tilt[::7])


def test_with_the_vertical_channel_off_nobody_needs_the_vertical_force():
    truth = circle(PLACE, 200.0, 0.01, 100.0)
    at, f_n = sampled(truth, np.arange(1001) / 10.0)
    t = np.arange(1001) / 10.0
    full = navigate_platform(t, f_n, at.lla[0], at.v_n[0]).solution
    f_n[:, 2] = np.nan
    np.testing.assert_array_equal(navigate_platform(t, f_n, at.lla[0], at.v_n[0]).solution.lla, full.lla)


@pytest.mark.parametrize(
    ("change", "error", "code"),
    [
        ({"lla": np.array([np.pi / 2 - 5e-4, 0.0, 0.0])}, ConfigError, "platform.start_near_pole"),
        ({"vertical": "damped"}, ConfigError, "platform.no_height"),
        ({"height": np.zeros(11)}, ConfigError, "platform.unused_height"),
        ({"v_n": np.array([0.0, 0.0, 1.0])}, ConfigError, "platform.vertical_velocity"),
        ({"errors": PlatformErrors(tilt=np.array([0.0, 0.3, 0.0]))}, ConfigError, "platform.not_level"),
        ({"time": np.zeros(1), "f_n": np.zeros((1, 3))}, InputError, "platform.few_samples"),
        ({"time": np.r_[np.arange(10.0), 8.0]}, InputError, "platform.not_increasing"),
        ({"f_n": np.full((11, 3), np.nan)}, InputError, "platform.not_finite"),
        (
            {"lla": np.array([1.5, 0.0, 0.0]), "v_n": np.array([90000.0, 0.0, 0.0])},
            DivergenceError,
            "platform.near_pole",
        ),
        ({"f_n": np.tile([0.0, 0.0, -1e6], (11, 1)), "vertical": "free"}, DivergenceError, "platform.free_height"),
    ],
)
def test_what_cannot_be_navigated_is_refused(change, error, code):
    t, f_n = at_rest(10.0, 1.0, PLACE)
    arguments = {"time": t, "f_n": f_n, "lla": PLACE, "v_n": np.zeros(3)} | change
    with refused(error, code):
        navigate_platform(**arguments)
