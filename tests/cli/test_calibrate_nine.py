"""`insnav calibrate nine`: the modules are recovered in the file, its limits are printed, bad positions are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insnav.imu import load_calibration
from insnav.lab.nine_position import SENSORS
from insnav.output.folder import read_facts
from tests.cli.conftest import Cli
from tests.lab.modules import NINE, UPRIGHT, Modules, make
from tests.reversed_messages import as_shown

HEADER = "roll_deg,pitch_deg,x_ay_m_s2,x_az_m_s2,y_az_m_s2,y_ax_m_s2,z_ax_m_s2,z_ay_m_s2"


def table(path: Path, positions: np.ndarray, samples: int = 1) -> Modules:
    rng = np.random.default_rng(1)
    modules = make(rng, 0.004, 0.003)
    positions = np.repeat(positions, samples, axis=0)
    rows = np.column_stack((np.degrees(positions), modules.measure(positions, 0.003, rng)))
    np.savetxt(path, rows, "%.9g", ",", header=HEADER, comments="")
    return modules


@pytest.mark.parametrize(("positions", "samples"), [(NINE, 1), (np.vstack((NINE, UPRIGHT)), 200)])
def test_modules_are_recovered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Cli, positions: np.ndarray, samples: int
) -> None:
    monkeypatch.chdir(tmp_path)
    modules = table(Path("p.csv"), positions, samples)
    shown = cli("calibrate", "nine", "p.csv", "--gravity", 9.81, "-v")
    assert shown.code == 0, shown.err
    errors = load_calibration("calibration/calibration.toml")
    truth = modules.gyro / np.diag(modules.gyro)[:, None]
    facts = read_facts(Path("calibration"))
    printed = facts["parameters"]
    for i, j in np.argwhere(~np.eye(3, dtype=bool)):
        low, high = printed[f"gyro_{'xyz'[i]}_senses_{'xyz'[j]}_interval_mrad"]
        half_width = high - low
        assert 1e3 * errors.gyro_matrix[i, j] == pytest.approx(1e3 * truth[i, j], abs=half_width)
    for name, true in zip(SENSORS, modules.bias, strict=True):
        bias, sd = (printed[f"{name.replace(' ', '_')}_{key}"] for key in ("bias_mg", "bias_sd_mg"))
        assert bias * 9.80665e-3 == pytest.approx(true, abs=5.0 * sd * 9.80665e-3)
    for words in (
        "first order",
        "symmetric",
        "contains the scale of the accelerometers",
        "itself would double",
    ):
        assert as_shown(words) in " ".join(shown.out.split())
    assert "Uncertainty of corrected data" in shown.out
    assert ("extreme positions" in shown.out) == (samples > 1)


def test_a_missing_position_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Cli) -> None:
    monkeypatch.chdir(tmp_path)
    table(Path("p.csv"), NINE[:-1])
    shown = cli("calibrate", "nine", "p.csv", "--gravity", 9.81, "-v")
    assert shown.code == 3
    assert "lab.positions_asymmetric" in shown.err
    assert "-35°/-40°" in shown.err
    assert not Path("calibration").exists()
