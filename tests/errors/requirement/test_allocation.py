"""The budget backwards: limits that closed laws give, sets that simulated runs confirm."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insnav.errors.budget.sources import SampledMotion, at_rest, sampled
from insnav.errors.requirement.allocation import (
    FAMILIES,
    Requirement,
    allocate,
    binomial_interval,
    length_quantile,
    spec_of,
)
from insnav.errors.requirement.study import verify
from insnav.exceptions import ConfigError
from insnav.simulate.motion import load_profile
from insnav.units import DEG_PER_H, DEG_PER_SQRT_H, G0, UG

CIRCLE = math.sqrt(-2.0 * math.log(0.05))  # 95 % of two equal Gaussians: Rayleigh


@pytest.fixture(scope="module")
def rest() -> SampledMotion:
    return at_rest(60.0)


@pytest.fixture(scope="module")
def city() -> SampledMotion:
    return sampled(load_profile("city").truth((1, 0)), 300.0, 30.0)


@pytest.mark.parametrize(
    ("variances", "expected"),
    [([1.0], 1.959964), ([1.0, 1.0], CIRCLE), ([1.0, 0.0], 1.959964), ([4.0, 4.0, 4.0], 2.0 * 2.795483)],
)
def test_quantiles_of_known_distributions(variances: list[float], expected: float) -> None:
    # normal, Rayleigh, Maxwell: Abramowitz and Stegun, tables 26.1 and 26.8
    assert length_quantile(np.array(variances), 0.95) == pytest.approx(expected, rel=1e-6)


def test_quantiles_of_unequal_axes_are_those_of_samples() -> None:
    z = np.random.default_rng(3).standard_normal((1_000_000, 3)) ** 2
    for variances in ([1.0, 0.3, 0.0], [1.0, 0.5, 0.02]):
        seen = math.sqrt(float(np.quantile(z @ np.array(variances), 0.9)))
        assert length_quantile(np.array(variances), 0.9) == pytest.approx(seen, rel=4e-3)


def test_binomial_interval_of_a_textbook() -> None:
    # 10 of 20: Clopper and Pearson 1934
    assert binomial_interval(10, 20) == pytest.approx((0.27196, 0.72804), abs=1e-5)
    assert binomial_interval(500, 500)[1] == 1.0


def test_each_alone_is_what_the_closed_laws_say(rest: SampledMotion) -> None:
    alone = {share.family: share.alone for share in allocate(Requirement(1.0, 60.0), rest).shares}
    each = 1.0 / CIRCLE  # both level axes alike
    assert alone["accel bias"] == pytest.approx(2.0 * each / 60.0**2, rel=2e-3)
    assert alone["gyro bias"] == pytest.approx(6.0 * each / G0 / 60.0**3, rel=2e-3)
    assert alone["gyro white noise"] == pytest.approx(each / G0 / math.sqrt(60.0**5 / 20.0), rel=2e-3)
    assert alone["accel white noise"] == pytest.approx(each / math.sqrt(60.0**3 / 3.0), rel=2e-3)
    assert alone["initial velocity"] == pytest.approx(each / 60.0, rel=2e-3)


def test_without_weights_shares_are_equal_and_the_set_just_meets_the_limit(city: SampledMotion) -> None:
    found = allocate(Requirement(5.0, 30.0), city)
    assert found.error == pytest.approx(5.0, rel=1e-9)
    open_ = [share for share in found.shares if not share.capped]
    ratio = [share.size / share.alone for share in open_]
    assert np.ptp(ratio) < 1e-9
    assert sum(share.part for share in found.shares) == pytest.approx(1.0)


def test_a_weight_gives_the_share_of_the_reciprocal_cost_model(rest: SampledMotion) -> None:
    found = {s.family: s for s in allocate(Requirement(1.0, 60.0), rest, cost={"gyro bias": 8.0}).shares}
    part = found["gyro bias"].size / found["gyro bias"].alone
    assert part == pytest.approx(2.0 * found["accel bias"].size / found["accel bias"].alone, rel=1e-9)


def test_given_figures_are_kept_and_the_others_share_what_is_left(rest: SampledMotion) -> None:
    given = spec_of({"gyro bias": 0.1 * DEG_PER_H, "gyro white noise": 0.01 * DEG_PER_SQRT_H})
    found = allocate(Requirement(1.0, 60.0), rest, given=given)
    shares = {share.family: share for share in found.shares}
    assert shares["gyro bias"].given
    assert shares["gyro bias"].size == pytest.approx(0.1 * DEG_PER_H)
    assert found.error == pytest.approx(1.0, rel=1e-9)
    assert 0.0 < found.given < 1.0
    assert found.spec.gyro.bias[0] == pytest.approx(0.1 * DEG_PER_H)


def test_given_figures_that_are_too_large_leave_nothing(rest: SampledMotion) -> None:
    found = allocate(Requirement(1.0, 60.0), rest, given=spec_of({"accel bias": 1000.0 * UG}))
    assert not found.feasible
    assert found.given > 10.0


def test_what_hardly_acts_stops_where_the_model_ends(rest: SampledMotion) -> None:
    found = allocate(Requirement(1000.0, 60.0), rest)
    assert {share.family for share in found.shares if share.capped} >= {"gyro scale factor", "initial heading"}
    assert found.error == pytest.approx(1000.0, rel=1e-6)


def test_simulated_runs_confirm_the_set_and_refuse_a_larger_one(city: SampledMotion) -> None:
    required = Requirement(5.0, 30.0)
    found = allocate(required, city)
    one, more = (verify(required, found.spec, city, 500, 7, factor=factor) for factor in (1.0, 1.25))
    assert one.interval[0] <= 0.95 <= one.interval[1]
    assert not more.meets(0.95)


@pytest.mark.parametrize(
    "wrong", [(-1.0, 60.0, 0.95), (1.0, 0.0, 0.95), (1.0, 60.0, 1.5), (math.nan, 60.0, 0.95), (1.0, math.inf, 0.95)]
)
def test_nonsense_is_refused(wrong: tuple[float, float, float]) -> None:
    with pytest.raises(ConfigError):
        Requirement(*wrong)


def test_an_unknown_family_is_refused(rest: SampledMotion) -> None:
    with pytest.raises(ConfigError, match="gyro bais"):
        allocate(Requirement(1.0, 60.0), rest, cost={"gyro bais": 2.0})
    assert "gyro bias" in FAMILIES
