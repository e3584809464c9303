"""`insnav calibrate rotor`: both results and the verdict; nonsense is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insnav.findings import Code
from insnav.messages import sentence
from insnav.output.folder import read_facts
from tests.cli.conftest import Cli, says, warnings_of

GIVEN = ("--fall-mass", 0.06, "--radius", 0.0225, "--mass", 0.05, "--arm", 0.25)


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    rng, inertia, g = np.random.default_rng(1), 8e-3, 9.80665
    height, rate = np.arange(0.3, 1.05, 0.1), np.arange(30.0, 70.0, 6.0)
    squared = 2.0 * height * (inertia + 0.06 * 0.0225**2) / (0.06 * g * 0.0225**2) + 0.05 * rng.normal(size=height.size)
    period = 2.0 * np.pi * inertia * rate / (0.05 * g * 0.25) * (1.0 + 0.003 * rng.normal(size=rate.size))
    for name, header, columns in (
        ("fall.csv", "height_m,fall_time_s", (height, np.sqrt(squared))),
        ("turn.csv", "precession_period_s,rotor_rate_rad_s", (period, rate)),
    ):
        np.savetxt(name, np.column_stack(columns), "%.9g", ",", header=header, comments="")
    return tmp_path


def test_both_results_and_their_agreement(bench: Path, cli: Cli) -> None:
    shown = cli("calibrate", "rotor", "fall.csv", "turn.csv", *GIVEN)
    assert shown.code == 0, shown.err
    assert "The methods agree" in shown.out
    facts = read_facts(Path("calibration"))
    assert facts["agree"] is True
    for method in ("falling_weight", "precession"):
        value, sd = (facts["parameters"][f"moment_of_inertia_{method}_{end}"] for end in ("kg_m2", "sd_kg_m2"))
        assert value == pytest.approx(8e-3, abs=4.0 * sd)
    assert not Path("calibration/calibration.toml").exists()


def test_weights_of_a_column_are_one_regression_over_spin_and_torque(bench: Path, cli: Cli) -> None:
    period, rate = np.loadtxt("turn.csv", delimiter=",", skiprows=1, unpack=True)
    mass = 0.05 * (1.0 + np.arange(period.size) % 3)  # one to three weights of 50 g
    columns = np.column_stack((period * 0.05 / mass, rate, mass))
    np.savetxt("turn.csv", columns, "%.9g", ",", header="precession_period_s,rotor_rate_rad_s,mass_kg", comments="")
    shown = cli("calibrate", "rotor", "fall.csv", "turn.csv", *GIVEN[:4], *GIVEN[6:])
    assert shown.code == 0, shown.err
    facts = read_facts(Path("calibration"))
    assert facts["agree"] is True
    powers = facts["powers"]
    assert powers["power_of_the_torque"] == pytest.approx(1.0, abs=4.0 * powers["power_of_the_torque_sd"])
    assert powers["power_of_the_spin"] == pytest.approx(-1.0, abs=4.0 * powers["power_of_the_spin_sd"])
    assert facts["given"]["mass_kg"] == [0.05, 0.1, 0.15]


def test_a_wrong_mass_shows_as_disagreement(bench: Path, cli: Cli) -> None:
    shown = cli("calibrate", "rotor", "fall.csv", "turn.csv", *GIVEN[:5], 0.055, *GIVEN[6:])
    assert shown.code == 0, shown.err
    facts = read_facts(Path("calibration"))
    assert facts["agree"] is False
    assert facts["mean_kg_m2"] is None
    disagree = warnings_of(facts)[0]
    assert disagree.code is Code.ROTOR_DISAGREE
    assert sentence(disagree) in facts["summary"]
    assert says(shown.out, disagree)


@pytest.mark.parametrize(
    ("arguments", "code", "word"),
    [
        (("fall.csv", "fall.csv", *GIVEN), 3, "columns.missing"),
        (("fall.csv", "turn.csv", *GIVEN[:7], 0), 2, "--arm"),
        (("turn.csv", "turn.csv", *GIVEN), 3, "columns.missing"),
    ],
)
def test_nonsense_is_refused(bench: Path, cli: Cli, arguments: tuple, code: int, word: str) -> None:
    shown = cli("calibrate", "rotor", *arguments)
    assert shown.code == code, shown.out
    assert word in shown.err
    assert not Path("calibration").exists()
