"""Moment of inertia of a simulated rotor, two ways."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from insnav.exceptions import InputError
from insnav.findings import Code, of_code
from insnav.lab.calibration import BenchOptions
from insnav.lab.rotor_inertia import agreement, inertia_from_fall, inertia_from_precession, read
from tests.refusals import refused

INERTIA, G = 8.0e-3, 9.81
FALL = {"mass": 0.06, "radius": 0.0225, "gravity": G}
ARM = {"mass": 0.05, "arm": 0.25, "gravity": G}
HEIGHT = np.array([0.3, 0.5, 0.7, 0.9, 1.1])
RATE = np.array([30.0, 40.0, 50.0, 60.0, 70.0])


def fall_time(height: float) -> float:
    """Time of fall by Newton's equations of weight and drum, the tension of the cord eliminated."""
    acceleration = FALL["mass"] * G / (FALL["mass"] + INERTIA / FALL["radius"] ** 2)
    return float(np.sqrt(2.0 * height / acceleration))


TIME = np.array([fall_time(h) for h in HEIGHT])
PERIOD = 2.0 * np.pi * INERTIA * RATE / (ARM["mass"] * G * ARM["arm"])


def test_both_ways_give_the_inertia_of_a_perfect_rotor() -> None:
    assert inertia_from_fall(HEIGHT, TIME, **FALL).value == pytest.approx(INERTIA, rel=1e-12)
    assert inertia_from_precession(PERIOD, RATE, **ARM).value == pytest.approx(INERTIA, rel=1e-12)


def test_several_weights_are_one_regression_over_spin_and_torque() -> None:
    mass = np.repeat([0.05, 0.10, 0.15], RATE.size)
    rate = np.tile(RATE, 3)
    period = 2.0 * np.pi * INERTIA * rate / (mass * G * ARM["arm"])
    found = inertia_from_precession(period, rate, mass, ARM["arm"], G)
    assert found.value == pytest.approx(INERTIA, rel=1e-12)
    assert found.powers is not None
    np.testing.assert_allclose(found.powers.value[1:], [1.0, -1.0], atol=1e-9)
    rng = np.random.default_rng(4)
    rough = period * (1.0 + 0.003 * rng.normal(size=period.size))
    assert not inertia_from_precession(rough, rate, mass, ARM["arm"], G).warnings
    # weights that are not what they say they are
    wrong = inertia_from_precession(rough, rate, mass + 0.02, ARM["arm"], G)
    (powers,) = of_code(wrong.warnings, Code.ROTOR_POWERS)
    assert powers["torque"] == pytest.approx(wrong.powers.value[1])
    assert powers["spin"] == pytest.approx(wrong.powers.value[2])


def noisy(rng: np.random.Generator) -> tuple:
    squared = TIME**2 + 0.05 * rng.normal(size=5)
    first = inertia_from_fall(HEIGHT, np.sqrt(squared), **FALL)
    return first, inertia_from_precession(PERIOD, RATE + 0.5 * rng.normal(size=5), **ARM)


def test_intervals_hold_the_truth_and_agreement_is_as_likely_as_stated() -> None:
    rng, trials = np.random.default_rng(3), 2000
    inside, agree = np.zeros(2), 0
    for _ in range(trials):
        both = noisy(rng)
        inside += [abs(item.value - INERTIA) < item.half_width for item in both]
        agree += agreement(*both).agree
    np.testing.assert_allclose(inside / trials, 0.95, atol=0.02)
    assert agree / trials == pytest.approx(0.95, abs=0.025)


def test_a_wrong_arm_shows_as_disagreement() -> None:
    first = inertia_from_fall(HEIGHT, TIME * (1.0 + 1e-4 * np.array([1, -1, 1, -1, 1])), **FALL)
    wrong = inertia_from_precession(PERIOD * (1.0 + 1e-4 * np.array([1, -1, 1, -1, 1])), RATE, 0.05, 0.26, G)
    found = agreement(first, wrong)
    assert not found.agree
    assert found.difference == pytest.approx(INERTIA - INERTIA * 0.26 / 0.25, rel=1e-2)


def test_a_late_release_is_pointed_out() -> None:
    rng = np.random.default_rng(4)
    late = inertia_from_fall(HEIGHT, np.sqrt(TIME**2 + 3.0 + 0.01 * rng.normal(size=5)), **FALL)
    assert Code.ROTOR_FALL_ORIGIN in {each.code for each in late.warnings}


def test_files_in_other_units(tmp_path: Path) -> None:
    (tmp_path / "fall.csv").write_text("height_cm,time_s\n30,5.1\n50,6.2\n70,7.3\n")
    (tmp_path / "turn.csv").write_text("period_s,rotor_rate_rpm\n12,300\n16,400\n20,500\n")
    weights = BenchOptions(fall_mass=0.06, radius=0.0225, mass=0.05, arm=0.25)
    fall, turn = read((tmp_path / "fall.csv", tmp_path / "turn.csv"), weights)
    np.testing.assert_allclose(fall.columns["height"], [0.3, 0.5, 0.7])
    np.testing.assert_allclose(turn.columns["rotor_rate"], np.array([300.0, 400.0, 500.0]) * np.pi / 30.0)


@pytest.mark.parametrize(
    ("call", "code"),
    [
        (lambda: inertia_from_fall(TIME, HEIGHT, **FALL), "lab.faster_than_free"),
        (lambda: inertia_from_fall(-HEIGHT, TIME, **FALL), "lab.not_positive"),
        (lambda: inertia_from_fall(HEIGHT[:2], TIME[:2], **FALL), "lab.few_values"),
        (lambda: inertia_from_precession(PERIOD, RATE / 60.0, **ARM), "lab.slow_rotor"),
        (lambda: inertia_from_precession(PERIOD, RATE[[4, 0, 2, 3, 1]], **ARM), "lab.precession_slope"),
    ],
)
def test_nonsense_is_refused(call: Callable[[], object], code: str) -> None:
    with refused(InputError, code):
        call()
