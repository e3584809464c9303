"""The platform in the certificate: plain rules show the errors that theory gives them, and what is broken is named."""

from __future__ import annotations

import numpy as np
import pytest

from insnav.certificate import platform_checks as gimbal
from insnav.certificate import strapdown_checks
from insnav.certificate.integrators import Check, integrators
from insnav.gimbal import PlatformErrors


@pytest.fixture(scope="module")
def checks() -> dict[str, Check]:
    return {check.case: check for check in gimbal.platform()}


def test_fourth_order_keeps_every_bar(checks):
    assert [case for case, check in checks.items() if not check.passed] == []
    for check in checks.values():
        assert tuple(name for name, _ in check.values) == ("fourth", "mean", "forward", "backward")
        assert np.isfinite([value for _, value in check.values]).all(), check


def test_rectangles_miss_a_straight_line_by_the_step_times_the_way(checks):
    found = dict(checks["y = 2x from 0 to 3 in 30 steps, error of 9"].values)
    assert found["forward"] == pytest.approx(0.1 * 3.0)
    assert found["backward"] == pytest.approx(0.1 * 3.0)
    assert found["mean"] < 1e-12


def test_euler_is_off_on_circles_as_half_a_step_of_acceleration_says(checks):
    """Its velocity is that of half a step before: wrong by ``h/2 (a(t) - a(0))``; on a circle a is ``v w``.

    The position is off by ``h/2 (dv - a(0) t)``, and what grows is h/2 times 2 m/s^2; over an hour the Schuler pendulum
    brings it back: ``h/2 v w / w_s^2 (1 - cos w_s t)``, at most ``h v w / w_s^2``.
    """
    schuler = 2.0 * np.pi / 5062.0
    found = dict(checks["1 h of circles at 20 m/s"].values)
    for name in ("forward", "backward"):
        assert found[name] < 0.1 * 2.0 / schuler**2
        assert found[name] > 100.0
    assert found["fourth"] < 1e-5 < 0.1 < found["mean"]


def test_all_orders_are_judged_and_only_one_elsewhere(checks):
    required = {case: check.required for case, check in checks.items()}
    orders = [case for case in required if case.startswith("order")]
    assert len(orders) == 2
    assert all(required[case] == (4 if case in orders else 1) for case in required)


@pytest.mark.parametrize(("broken", "by"), [("mean", "forward"), ("fourth", "mean"), ("backward", "fourth")])
def test_an_integrator_of_another_order_is_named(monkeypatch, broken, by):
    from insnav import gimbal as package

    monkeypatch.setitem(package._METHOD, broken, package._METHOD[by])
    failed = [check.case for check in gimbal.orders() if not check.passed]
    assert len([case for case in failed if case.startswith("order")]) == 2


def test_a_longitude_that_is_not_wrapped_is_found(monkeypatch):
    whole = gimbal.navigate_platform

    def navigate(*arguments, **options):
        found = whole(*arguments, **options)
        found.solution.lla[:, 1] = np.unwrap(found.solution.lla[:, 1])
        return found

    monkeypatch.setattr(gimbal, "navigate_platform", navigate)
    assert not gimbal.date_line()[0].passed


def test_a_loop_of_other_gains_is_found(monkeypatch):
    monkeypatch.setattr(gimbal, "DAMPING_TIME", 101.0)
    assert [check.passed for check in gimbal.vertical()] == [True, False]


@pytest.mark.parametrize("share", ["tilt", "drift", "bias"])
def test_a_day_with_other_errors_is_found_on_platform_and_strapdown(monkeypatch, share):
    """Ten percent more than the closed form is told of one of them."""
    told = strapdown_checks.ERRORS
    more = PlatformErrors(
        *(getattr(told, name) * (1.1 if name == share else 1.0) for name in ("tilt", "drift", "bias"))
    )
    theory = strapdown_checks.static_errors
    monkeypatch.setattr(
        strapdown_checks, "static_errors", lambda time, lat, height, errors: theory(time, lat, height, more)
    )
    for checks in (gimbal.day(), strapdown_checks.day(integrators()[:1])):
        assert [check.passed for check in checks] == [False, True, True, True]


def test_a_pendulum_of_another_latitude_is_found(monkeypatch):
    theory = strapdown_checks.periods
    monkeypatch.setattr(strapdown_checks, "periods", lambda lat, height: theory(lat - 0.01, height))
    assert [check.passed for check in gimbal.day()] == [True, True, False, True]


def test_what_is_no_number_is_no_period():
    time = np.arange(0.0, 86400.0, 60.0)
    checks = strapdown_checks.compared("day", [("lost", time, np.full((time.size, 2), np.nan))])
    assert all(check.error == np.inf and not check.passed for check in checks)
