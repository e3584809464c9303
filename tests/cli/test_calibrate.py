"""`insnav calibrate gyro` and `accel`: what they print and leave behind, and that `run` takes it for raw volts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from insnav.findings import Code
from insnav.imu import load_calibration, load_imu
from insnav.output.folder import read_facts
from tests.cli.conftest import QUICK, Cli, findings_of, says, warnings_of
from tests.lab.published import lab_file
from tests.shared import verify_folder

RATES = np.arange(-80.0, 81.0, 20.0)
ANGLES = np.arange(0.0, 360.0, 30.0)


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    for i, axis in enumerate("xyz"):
        volts = 0.1 * (i + 1) + (0.05 + 0.001 * i) * RATES + 1e-5 * rng.normal(size=RATES.size)
        np.savetxt(
            f"g{axis}.csv", np.column_stack((RATES, volts)), "%.9g", ",", header="rate_deg_s,output_v", comments=""
        )
        volts = 0.02 * i + (2.0 + 0.1 * i) * np.sin(np.radians(ANGLES)) + 1e-5 * rng.normal(size=ANGLES.size)
        np.savetxt(
            f"a{axis}.csv", np.column_stack((ANGLES, volts)), "%.9g", ",", header="angle_deg,output_v", comments=""
        )
    return tmp_path


def estimates(facts: dict[str, Any]) -> list[float]:
    """Values of the parameters, without their uncertainties."""
    parameters = facts["parameters"]
    return [value for key, value in parameters.items() if "_sd_" not in key and "_interval_" not in key]


def test_published_rate_table_on_the_terminal(bench: Path, cli: Cli) -> None:
    shown = cli("calibrate", "gyro", lab_file("gyro_rate_table.csv"))
    assert shown.code == 0, shown.err
    assert "zero U0 0.2000" in shown.out
    assert "leaves out +80 deg/s (residual -0.0967 V, limit 0.021 V)" in shown.out
    assert shown.out.count("leaves out") == 2
    verify_folder(Path("calibration"))
    facts = read_facts(Path("calibration"))
    assert [(item["rate_deg_s"], item["code"]) for item in facts["dropped"]] == [
        (80.0, Code.BENCH_RATE_SATURATED),
        (90.0, Code.BENCH_RATE_BEYOND),
    ]
    warnings = warnings_of(facts)
    assert [each.code for each in warnings] == [Code.BENCH_LEFT_OUT, Code.BENCH_ONE_SENSOR]
    for warning in warnings:
        assert says(shown.out, warning)
    assert Path("calibration/figures/residuals.png").stat().st_size > 5000
    shown = cli("calibrate", "gyro", lab_file("gyro_rate_table.csv"), "--range", "-90:80", "--force", "--json")
    values = estimates(json.loads(shown.out))
    assert np.round(values, 4).tolist() == [0.1957, 0.0486]
    (one_sensor,) = warnings_of(json.loads(shown.out))
    assert one_sensor.code is Code.BENCH_ONE_SENSOR
    assert "insnav: warning: " in shown.err
    assert says(shown.err, one_sensor)


def test_published_tumble_on_the_terminal(bench: Path, cli: Cli) -> None:
    shown = cli("calibrate", "accel", lab_file("accel_tumble_12.csv"), "-v")
    assert shown.code == 0, shown.err
    facts = read_facts(Path("calibration"))
    assert np.round(estimates(facts), 4).tolist() == [-0.1847, -2.4121, 0.0113, -0.0211]
    assert round(facts["fits"][0]["rms_V"], 4) == 0.0260
    for printed in ("K0 -0.1847 ", "K1 -2.4121 ", "K2 0.01127 ", "K3 -0.02113 "):
        assert printed in shown.out
    assert "rms: root of the sum of squares over the number of points" in shown.out
    assert "Impact on navigation" in shown.out
    assert all(e["with_m"] < e["without_m"] for e in facts["navigation_impact"])


def test_run_takes_raw_volts_with_the_calibration(bench: Path, drive: Path, cli: Cli) -> None:
    for command in (
        ("gyro", *(bench / f"g{axis}.csv" for axis in "xyz"), "--out", "gyros"),
        ("accel", *(bench / f"a{axis}.csv" for axis in "xyz"), "--gravity", 9.81, "--add", "gyros/calibration.toml"),
    ):
        shown = cli("calibrate", *command)
        assert shown.code == 0, shown.err
    known = load_calibration("calibration/calibration.toml")
    assert known.gyro_raw is not None
    assert known.accel_raw is not None
    rows = np.genfromtxt("imu.csv", delimiter=",", skip_header=1)
    rows[:, 1:4] = known.gyro_raw.zero + rows[:, 1:4] * known.gyro_raw.scale
    rows[:, 4:7] = known.accel_raw.zero + rows[:, 4:7] * known.accel_raw.scale
    header = "time_s,gyro_x_v,gyro_y_v,gyro_z_v,accel_x_v,accel_y_v,accel_z_v"
    np.savetxt("raw.csv", rows[:, :7], "%.12g", ",", header=header, comments="")
    plain = cli("run", *QUICK, "--out", "plain")
    assert plain.code == 0, plain.err
    raw = cli("run", "raw.csv", *QUICK[1:], "--out", "raw", "--calibration", "calibration/calibration.toml", "-v")
    assert raw.code == 0, raw.err
    converted = findings_of({"findings": read_facts(Path("raw"))["input"]["imu"]["evidence"]}, Code.READ_IMU_RAW_SCALED)
    assert [(each.subject, each["si_unit"]) for each in converted] == [("gyro", "rad/s"), ("accel", "m/s^2")]
    for each in converted:
        assert says(raw.err, each)
    ends = [np.genfromtxt(f"{run}/solution.csv", delimiter=",", skip_header=1)[-1, :7] for run in ("plain", "raw")]
    np.testing.assert_allclose(ends[1], ends[0], rtol=1e-6, atol=1e-3)
    # and so does whatever else reads samples
    rest = ("--static", "100000:100060", "--taus", "octave")
    for name, more in (("imu.csv", ()), ("raw.csv", ("--calibration", "calibration/calibration.toml"))):
        shown = cli("allan", name, *rest, *more, "--out", f"allan-{name}")
        assert shown.code == 0, shown.err
    noise = [load_imu(f"allan-{name}/imu.toml").gyro.random_walk for name in ("imu.csv", "raw.csv")]
    np.testing.assert_allclose(noise[1], noise[0], rtol=1e-4)


@pytest.mark.parametrize(
    ("command", "code", "word"),
    [
        (("gyro", "gx.csv", "gy.csv"), 3, "lab.not_three_sensors"),
        (("gyro", "gx.csv", "--range", "80:-80"), 2, "cli.span_backward"),
        (("gyro", "gx.csv", "--range", "0:20"), 3, "lab.few_rates"),
        (("gyro", "gx.csv", "--spike-limit", "0"), 2, "--spike-limit"),
        (("gyro", "ax.csv"), 3, "columns.missing"),
        (("accel", "ax.csv", "--gravity", "1"), 2, "--gravity"),
        (("accel", "none.csv"), 3, "none.csv"),
        (("accel", "ax.csv", "--out", "ax.csv/such"), 4, "output.folder_unwritable"),
    ],
)
def test_what_cannot_be_is_refused(bench: Path, cli: Cli, command: tuple[str, ...], code: int, word: str) -> None:
    shown = cli("calibrate", *command)
    assert shown.code == code, shown.err
    assert shown.out == ""
    assert word in shown.err
    assert not Path("calibration").exists()
