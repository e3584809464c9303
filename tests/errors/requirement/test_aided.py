"""GPS before an outage: one engine for all IMUs, against the budget's covariance and against the filter itself."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import insnav
from insnav.errors.budget.predicted import covariance
from insnav.errors.budget.sources import sampled, sources_of
from insnav.errors.requirement import study as aided
from insnav.errors.requirement.allocation import Requirement
from insnav.errors.requirement.study import (
    STOPS,
    Aiding,
    Propagation,
    aided_covariances,
    candidates,
    coasting,
    propagation,
    remedies,
)
from insnav.imu import ImuSpec, SensorSpec, load_imu
from insnav.imu.library import find_part, parts
from insnav.simulate.motion import load_profile
from insnav.simulate.sensor_errors import GpsErrors, GpsSpec
from insnav.simulate.truth import Truth

BARE = ImuSpec("none", SensorSpec(), SensorSpec())


@pytest.fixture(scope="module")
def city() -> Truth:
    return load_profile("city").truth((1, 0))


@pytest.fixture(scope="module")
def moved(city: Truth) -> Propagation:
    return propagation(city, [250.0, 300.0], 60.0)


def horizontal(P: np.ndarray) -> float:
    return math.sqrt(P[0, 0] + P[1, 1])


def test_without_gps_it_is_the_covariance_of_the_budget(city: Truth) -> None:
    spec = replace(load_imu("industrial"), gyro=replace(load_imu("industrial").gyro, g_sensitivity=np.full(3, 1e-6)))
    moved = propagation(city, [0.0], 110.0)
    with_errors, without = aided_covariances(moved, [spec, BARE])[1][0, :, -1]
    motion = sampled(city, 0.0, 110.0)
    expected = covariance(sources_of(spec), motion, np.array([len(motion.dt)]))[0].sum(axis=0)
    size = np.sqrt(np.diag(expected))
    assert np.abs((with_errors - without - expected) / np.outer(size, size)).max() < 5e-3


def test_gps_brings_every_state_below_its_start(moved: Propagation) -> None:
    spec = load_imu("industrial")
    at_end = aided_covariances(moved, [spec])[0][-1, 0]
    start = aided.start_covariance(spec)
    assert np.all(np.diag(at_end)[3:27] <= np.diag(start)[3:27] * (1.0 + 1e-9))
    assert horizontal(at_end) < aided.POSITION_SD * 2.0
    assert math.sqrt(at_end[8, 8]) < 0.01 * aided.START_HEADING
    assert np.linalg.eigvalsh(at_end / np.sqrt(np.outer(np.diag(at_end), np.diag(at_end)) + 1e-300)).min() > -1e-8


def test_several_at_once_are_each_alone(moved: Propagation) -> None:
    specs = [load_imu("consumer"), load_imu("tactical")]
    together = aided_covariances(moved, specs, Aiding(nhc=True))[1]
    alone = aided_covariances(moved, specs[1:], Aiding(nhc=True))[1]
    assert np.allclose(together[:, 1], alone[:, 0], rtol=1e-9, atol=1e-12)


def test_the_filter_itself_predicts_the_same() -> None:
    # the filter of a simulated drive with the same fixes, 30 s of outage in twelve places
    gps = GpsSpec("white", GpsErrors((0.02, 0.02, 0.04), (0.0, 0.0, 0.0), 60.0, (0.03, 0.03, 0.06)), fix=1)
    spec = load_imu("tactical")
    drive = insnav.simulate("city", imu=spec, gps=gps, seed=1)
    truth = load_profile("city").truth((1, 0))
    for aiding, mine in (("off", Aiding()), ("on", Aiding(nhc=True))):
        windows = drive.outage(lengths=(30,), first=150, spacing=20, aiding=aiding, workers=1).found.windows
        moved = propagation(truth, [window.start - truth.start for window in windows], 30.0)
        own = aided_covariances(moved, [spec], mine)[1][:, 0, 30]
        ratio = [math.hypot(*window.sd[-1, :2]) / horizontal(each) for window, each in zip(windows, own, strict=True)]
        assert 0.6 < float(np.median(ratio)) < 1.6, (aiding, ratio)


def test_candidates_are_in_order_and_answers_follow_from_the_figures(moved: Propagation) -> None:
    required = Requirement(5.0, 30.0)
    found = candidates(required, moved, [part for part in parts() if part.grade in ("tactical", "consumer")][:8])
    errors = [each.alone.error for each in found]
    assert errors == sorted(errors)
    for each in found:
        for one in (each.alone, each.nhc):
            assert one.least <= one.error * 1.02
            assert (one.answer in ("yes", "likely")) == (one.error <= 5.0)
            assert one.answer != "likely" or each.missing


def test_answer_and_times_of_a_curve(moved: Propagation) -> None:
    required, time = Requirement(5.0, 30.0), moved.after
    curve = 0.2 * time
    known = coasting(required, moved, curve, 0.1 * time, known=True)
    assert (known.error, known.answer) == (pytest.approx(6.0), "no")
    assert coasting(required, moved, curve, 0.1 * time, known=False).answer == "open"
    assert coasting(required, moved, 0.1 * time, 0.1 * time, known=False).answer == "likely"
    assert known.reaches == (pytest.approx(5.0), pytest.approx(50.0), math.inf)


def test_remedies_help_and_half_the_noise_is_better(moved: Propagation) -> None:
    part = find_part("ADIS16465-1")
    assert part is not None
    found, elasticities = remedies(Requirement(5.0, 30.0), moved, part.spec, part)
    ratio = {each.name: each.ratio for each in found}
    assert ratio["as it is"] == 1.0
    assert ratio["NHC and odometer"] < min(ratio["NHC"], ratio["odometer"]) < 1.0
    assert ratio[f"ZUPT: a stop every {STOPS:g} s"] < 0.5
    assert any(name.startswith("warm-up") for name in ratio)
    change = {each.family: each.halved for each in elasticities}
    assert change["gyro white noise"] < -0.02


def test_shapley_effects_of_two_correlated_inputs() -> None:
    # Y = b1 X1 + b2 X2: Iooss and Prieur, Int. J. Uncertainty Quantification 9 (2019) 493, equation 16
    b, s, rho = np.array([[2.0, -1.0]]), np.array([1.5, 0.7]), 0.6
    covariance_ = np.array([[s[0] ** 2, rho * s[0] * s[1]], [rho * s[0] * s[1], s[1] ** 2]])
    first, second = (b[0] * s) ** 2
    cross = rho * b[0, 0] * b[0, 1] * s[0] * s[1]
    expected = [
        first * (1 - rho**2 / 2) + cross + second * rho**2 / 2,
        second * (1 - rho**2 / 2) + cross + first * rho**2 / 2,
    ]
    assert aided.shapley_effects(b, covariance_, [[0], [1]]) == pytest.approx(expected, rel=1e-6)


def test_shares_of_the_start_add_up(moved: Propagation) -> None:
    spec = load_imu("industrial")
    at_end, through = aided_covariances(moved, [spec])
    shares = aided.start_shares(moved, at_end[:, 0], through[:, 0], (0, 1), 30)
    assert sum(shares.values()) == pytest.approx(1.0, abs=1e-6)
    assert all(value >= 0.0 for value in shares.values())
    # without noise in the outage the start makes everything that is left of the whole
    gain_only = 1.0 - shares[aided.NOISE]
    assert 0.2 < gain_only < 1.0
