"""`insnav allan`, `acceptance` and `drift`: what they print and leave behind, and what they refuse."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import insnav
from insnav.findings import Code
from insnav.imu import load_calibration, load_imu
from insnav.output.folder import read_facts
from insnav.result import Result
from insnav.units import DEG
from tests.cli.conftest import Cli, says, warnings_of
from tests.lab.published import lab_file
from tests.reversed_messages import as_shown
from tests.shared import verify_folder

IMU = "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"
RATES = np.array([0.0, 10.0, 20.0, 40.0, 60.0, 80.0, -10.0, -20.0, -40.0, -60.0, -80.0])


def saved(name: str, header: str, *columns: object) -> None:
    rows = np.column_stack([np.broadcast_to(column, np.shape(columns[0])) for column in columns])
    np.savetxt(name, rows, "%.10g", ",", header=header, comments="")


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    n = 20_000
    force = np.array([0.0, 0.0, -9.8]) + 0.01 * rng.standard_normal((n, 3))
    saved("static.csv", IMU, 0.01 * np.arange(n), *(1e-3 * rng.standard_normal((3, n))), *force.T)
    saved("rates.csv", "rate_x_deg_s,gyro_x_deg_s", RATES, 0.9901 * RATES + 0.0358 + 0.002 * rng.standard_normal(11))
    powerup, sense = np.repeat(np.arange(1, 7), 2), np.tile([1.0, -1.0], 6)
    bias = np.repeat(0.03 + 0.01 * rng.standard_normal(6), 2)
    saved("powerups.csv", "powerup,rate_x_deg_s,gyro_x_deg_s", powerup, 40.0 * sense, bias + 39.6 * sense)
    saved("positions.csv", "force_x_g,accel_x_g", [1.0, -1.0, 0.0, 0.0], [1.012, -0.988, 0.011, 0.012])
    time = 0.1 * np.arange(1, 2501)
    rate = 60.0 * np.clip((time - 100.0) / 100.0, 0.0, 1.0)
    warm = 25.0 + 0.02 * time + np.sin(time / 20.0)
    output = 1.003 * rate + 0.4 + 0.1 * (warm - 25.0) + 0.05 * rng.standard_normal(time.size)
    saved("drift.csv", "time_s,gyro_z_deg_s,rate_z_deg_s,temperature_c", time, output, rate, warm)
    return tmp_path


def test_allan_writes_an_imu_file_that_can_be_used(bench: Path, cli: Cli) -> None:
    shown = cli("allan", "static.csv", "--taus", "octave")
    assert shown.code == 0, shown.err
    assert "Noise coefficients" in shown.out
    verify_folder(Path("allan"))
    np.testing.assert_allclose(load_imu("allan/imu.toml").gyro.random_walk, 1e-4, rtol=0.05)
    assert Path("allan/allan.csv").read_text().startswith("tau_s,gyro_x_deg_h")
    assert Path("allan/figures/allan.png").stat().st_size > 5000


def test_acceptance_on_one_page(bench: Path, cli: Cli) -> None:
    files = ("--rates", "rates.csv", "--positions", "positions.csv", "--static", "static.csv")
    shown = cli("acceptance", *files, "--powerups", "powerups.csv", "-v")
    assert shown.code == 0, shown.err
    for words in ("scale factor K", "K forward", "K reverse", "Bias stability of gyro x", "Bias repeatability"):
        assert words in shown.out
    verify_folder(Path("acceptance"))
    facts = read_facts(Path("acceptance"))["sensors"]
    assert facts["gyro_x"]["scale_factor"] == pytest.approx(0.9901, abs=5e-4)
    assert [each["n"] for each in facts["gyro_x"]["bias_stability"]] == [200, 20, 2]
    assert facts["accel_x"]["bias_ug"] == pytest.approx((12e3 + 12e3 + 11.5e3) / 3, rel=1e-6)
    assert facts["gyro_y"].keys() == {"output_unit", "bias_stability"}
    for name in ("residuals_gyro", "residuals_accel", "stability"):
        assert Path(f"acceptance/figures/{name}.png").stat().st_size > 5000


def test_acceptance_of_published_powerups_says_what_they_are(bench: Path, cli: Cli) -> None:
    named = ("--columns", "gyro_x_bias_deg_s=published_value_dps")
    shown = cli("acceptance", "--powerups", lab_file("gyro_bias_repeatability.csv"), *named, "--json")
    assert shown.code == 0, shown.err
    found = json.loads(shown.out)["sensors"]["gyro_x"]["bias_repeatability"]
    assert round(found["sd_deg_s"], 5) == 0.00931
    assert round(found["variance_deg_s_2"] * 1e5, 3) == 8.666
    (warning,) = warnings_of(json.loads(shown.out))
    text = cli("acceptance", "--powerups", lab_file("gyro_bias_repeatability.csv"), *named).out
    assert "[deg/h]          33.5 " in text
    assert "[deg/s]  0.00931 " in text
    assert warning.subject.startswith("gyro x")
    assert says(shown.err, warning)


def test_drift_before_and_after(bench: Path, cli: Cli) -> None:
    shown = cli("drift", "drift.csv", "-v")
    assert shown.code == 0, shown.err
    assert as_shown("It cannot remove bias instability") in " ".join(shown.out.split())
    assert "1.0 equivalent degrees of freedom" in shown.out
    left_out = read_facts(Path("drift"))["gyros"]["gyro_z"]["left_out"]
    assert left_out == {"c_g": Code.DRIFT_NO_COLUMN}
    assert says(shown.err, warnings_of(read_facts(Path("drift")))[0])
    verify_folder(Path("drift"))
    gyro = read_facts(Path("drift"))["gyros"]["gyro_z"]
    assert [row["tau_s"] for row in gyro["allan"]] == pytest.approx([0.1, 0.2, 0.4, 1.0, 2.0, 4.0, 10.0, 50.0])
    assert gyro["drift"]["c_T_deg_s_k"] == pytest.approx(0.1, abs=5 * gyro["drift"]["c_T_sd_deg_s_k"])
    recorded = next(row for row in gyro["ramps"] if row["ramp"] == "recorded")
    assert recorded["lag_s"] == pytest.approx(gyro["filter"]["lag_s"], rel=0.03)
    known = load_calibration("drift/calibration.toml")
    assert known.gyro_matrix[2, 2] == pytest.approx(1.003, abs=5e-4)
    assert known.gyro_bias[2] / DEG == pytest.approx(0.4, abs=0.03)
    assert np.genfromtxt("drift/rates.csv", delimiter=",", skip_header=1).shape == (2500, 3)
    for figure in ("drift", "rates"):
        assert Path(f"drift/figures/{figure}.png").stat().st_size > 5000


WRITTEN: dict[str, tuple[tuple[str, ...], Callable[[], Result[Any]]]] = {
    "acceptance": (("--rates", "rates.csv"), lambda: insnav.acceptance(["rates.csv"])),
    "drift": (("drift.csv",), lambda: insnav.drift("drift.csv")),
    "calibrate": (("gyro", "volts.csv", "--name", "a"), lambda: insnav.calibrate("gyro", "volts.csv", name="a")),
}


@pytest.mark.parametrize("command", WRITTEN)
def test_the_command_and_python_write_the_same_files(bench: Path, cli: Cli, command: str) -> None:
    saved("volts.csv", "rate_deg_s,output_v", RATES, 0.05 * RATES + 1e-4 * np.sin(RATES))
    words, make = WRITTEN[command]
    shown = cli(command, *words, "--out", "command")
    assert shown.code == 0, shown.err
    make().save("python", figures="png")
    contents = [
        {each.relative_to(folder): each.read_bytes() for each in Path(folder).rglob("*") if each.is_file()}
        for folder in ("command", "python")
    ]
    assert contents[0] == contents[1]


@pytest.mark.parametrize(
    ("command", "code", "word"),
    [
        (("allan", "static.csv", "--taus", "0.001"), 2, "lab.taus"),
        (("allan", "static.csv", "--workers", "0"), 2, "--workers"),
        (("allan", "none.csv"), 3, "none.csv"),
        (("acceptance",), 2, "session.nothing_to_accept"),
        (("acceptance", "--rates", "static.csv"), 3, "lab.no_setting"),
        (("acceptance", "--rates", "rates.csv", "--lengths", "0"), 2, "cli.not_positive"),
        (("acceptance", "--rates", "rates.csv", "--out", "rates.csv/such"), 4, "output.folder_unwritable"),
        (("drift", "rates.csv"), 3, "columns.missing"),
        (("drift", "positions.csv"), 3, "columns.missing"),
    ],
)
def test_what_cannot_be_is_refused(bench: Path, cli: Cli, command: tuple[str, ...], code: int, word: str) -> None:
    shown = cli(*command)
    assert shown.code == code, shown.err
    assert shown.out == ""
    assert word in shown.err
