"""``insnav budget`` from an IMU file to a folder."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from insnav.messages import phrase
from insnav.output.folder import read_facts
from tests.cli.conftest import SAMPLE, Cli
from tests.shared import verify_folder

MEMS = """
name = "mems"
[gyro]
bias = "10 deg/h"
random_walk = "0.24 deg/sqrt(h)"
[accel]
bias = "1 mg"
random_walk = "0.1 m/s/sqrt(h)"
[initial]
tilt = "0.03 deg"
"""


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mems.toml").write_text(MEMS, encoding="utf-8")


def test_imu_alone(cli: Cli):
    shown = cli("budget", "--imu", "mems.toml", "--times", "10,60", "-v")
    assert shown.code == 0, shown.err
    verify_folder(Path("budget"))
    facts = read_facts(Path("budget"))
    parts = facts["budget"][-1]["analytic"]["sources"]
    assert parts["accel bias"]["position_m"][0] == pytest.approx(0.5 * 9.80665e-3 * 3600.0, rel=1e-6)
    assert parts["gyro bias"]["position_m"][1] == pytest.approx(9.806 * 4.8481e-5 * 60.0**3 / 6.0, rel=1e-4)
    paper = Path("budget/budget.pdf").read_bytes()
    assert paper.startswith(b"%PDF")
    assert len(re.findall(rb"/Type /Page\b", paper)) == 2
    assert "After 60 s without GPS:" in shown.out
    assert "at rest, level, heading north" in shown.out
    # what the file does not give is said, on the screen and in the folder
    assert "accel.scale_factor" in shown.err
    assert "initial.heading" in shown.out
    assert {"accel.scale_factor", "gyro.misalignment", "initial.velocity"} <= set(facts["not_given"])
    assert "-0.046 %" in shown.out
    assert facts["runs"] is None


@pytest.mark.parametrize("width", [80, 160])
def test_a_terminal_shows_fifteen_lines_and_the_largest_source(cli: Cli, monkeypatch, width: int):
    monkeypatch.setattr("insnav.cli.console.terminal_width", lambda: width)
    lines = cli("budget", "--imu", "consumer", "--times", "30,60").out.splitlines()
    assert len(lines) <= 15
    assert max(map(len, lines)) <= width
    assert "of gyro bias." in " ".join(map(str.strip, lines))
    assert lines[-1].endswith(phrase("terminal.details"))


def test_the_hand_calculation_of_the_laboratory(cli: Cli):
    """Bias 50 ug of 9.7803 m/s^2, tilt 0.003 deg, drift 0.00806 deg/h: 0.8802 + 0.9218 + 0.0138 = 1.816 m."""
    terms = {"gyro": 'bias = "0.00806 deg/h"', "accel": 'bias = "0.000489015 m/s^2"', "initial": 'tilt = "0.003 deg"'}
    text = "".join(f"[{table}]\n{line}\n" for table, line in terms.items())
    Path("lab.toml").write_text(f'name = "laboratory"\n{text}', encoding="utf-8")
    shown = cli("budget", "--imu", "lab.toml", "--lat", "0", "--gravity", "9.7803", "--heading", "90", "--json")
    assert shown.code == 0, shown.err
    facts = json.loads(shown.out)
    parts = facts["budget"][-1]["analytic"]["sources"]
    north = [parts[name]["position_m"][0] for name in ("accel bias", "initial tilt", "gyro bias")]
    assert [round(value, 4) for value in north] == [0.8802, 0.9218, 0.0138]
    assert round(sum(north), 3) == 1.816
    shown = cli("budget", "--imu", "lab.toml", "--lat", "0", "--gravity", "9.7803", "--sum", "worst")
    for name, text in (("accel bias", "0.880"), ("initial tilt", "0.922"), ("gyro bias", "0.0138"), ("worst", "1.816")):
        assert re.search(rf"^  {name}[a-z -]* +{re.escape(text)} ", shown.out, re.MULTILINE), shown.out
    assert facts["gravity_m_s2"] == pytest.approx(9.7803, abs=1e-8)
    assert "heading 90 deg, at a latitude of 0 deg, where gravity is 9.7803 m/s^2 (height 8 m)" in facts["motion"]


def test_the_end_of_a_recorded_minute_is_explained(cli: Cli):
    """-8.231 m with -0.2754 m/s: a pure square of time, 0.47 mrad, nine times the tilt assumed, or 0.47 mg."""
    Path("lab.toml").write_text('name = "lab"\n[gyro]\nbias = "1 deg/h"\n[initial]\ntilt = "0.003 deg"\n')
    end = ("--end=-2.668,-8.231,-0.0803,-0.2754", "--gravity", "9.7803", "--imu", "lab.toml")
    shown = cli("budget", *end, "--json")
    assert shown.code == 0, shown.err
    facts = json.loads(shown.out)
    assert facts["power_of_time"]["east"] == pytest.approx(2.01, abs=0.005)
    east = {row["cause"]: row for row in facts["causes"] if row["axis"] == "east"}
    assert [row["explains"] for row in east.values()] == [False, True, True, False]
    assert abs(east["tilt"]["value_si"]) == pytest.approx(0.47e-3, abs=0.005e-3)
    assert abs(east["accelerometer bias"]["value_si"]) / 9.80665 == pytest.approx(0.47e-3, abs=0.005e-3)
    assert east["tilt"]["by_specification"] == pytest.approx(9.0, abs=0.1)
    assert "0.468 mrad" in facts["summary"][1]
    shown = cli("budget", "--end", "1,1,0", "--out", "no")
    assert shown.code == 2


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (("--gravity", "9.0"), "budget.impossible_gravity"),
        (("--lat", "91"), "cli.bad_latitude"),
        (("--lat", "90"), "budget.near_pole"),
        (("--lat", "5", "--profile", "city"), "session.profile_has_place"),
    ],
)
def test_a_place_that_is_none_is_refused(cli: Cli, options, word):
    shown = cli("budget", "--imu", "mems.toml", *options)
    assert shown.code == 2, shown.err
    assert word in " ".join(shown.err.split())


def test_large_attitude_errors_are_simulated_unasked(cli: Cli):
    shown = cli("budget", "--imu", "consumer", "--times", "30,60", "--json")
    facts = json.loads(shown.out)
    last = facts["budget"][-1]
    assert facts["runs"]["count"] == 100
    sentence = facts["verdict"]["sentence"]
    assert float(re.search(r"([\d.]+) m horizontal", sentence)[1]) == pytest.approx(
        last["simulated"]["horizontal_m"], rel=2e-3
    )
    assert "beyond the linear model" in sentence


def test_profile_and_runs(cli: Cli):
    options = ("--profile", "city", "--runs", "20", "--times", "10,20", "--seed", "3")
    shown = cli("budget", "--imu", "mems.toml", *options, "--json")
    assert shown.code == 0, shown.err
    facts = json.loads(shown.out)
    assert facts == read_facts(Path("budget"))
    assert "city, from 60 s on" in facts["motion"]
    last = facts["budget"][-1]
    ratio = last["simulated"]["horizontal_m"] / last["covariance"]["horizontal_m"]
    assert 0.6 < ratio < 1.5
    again = cli("budget", "--imu", "mems.toml", *options, "--json", "--out", "again")
    assert json.loads(again.out)["budget"] == facts["budget"]
    assert Path("again/budget.pdf").read_bytes() == Path("budget/budget.pdf").read_bytes()


def test_long_budgets_hold_the_height_and_say_so(cli: Cli):
    for options, held in (
        (("--times", "30"), False),
        (("--times", "30", "--height", "held"), True),
        (("--times", "301"), True),
        (("--times", "301", "--height", "free"), False),
    ):
        shown = cli("budget", "--imu", "mems.toml", *options, "--force")
        assert shown.code == 0, shown.err
        assert read_facts(Path("budget"))["vertical_held"] is held
        assert ("held to the reference" in shown.out) is held


def test_a_recorded_drive_is_compared_with_the_prediction(cli: Cli):
    drive = (SAMPLE / "imu.csv.gz", "--gps", SAMPLE / "gps.csv", "--imu", SAMPLE / "imu.toml")
    options = ("--lever-arm", "0.8,-0.3,-1.2", "--times", "10,30", "--replicas", "0", "--runs", "100", "--uncalibrated")
    shown = cli("budget", *drive, *options, "--ref", SAMPLE / "ref.csv", "--ref-sd", "0.02", "-v")
    assert shown.code == 0, shown.err
    verify_folder(Path("budget"))
    facts = read_facts(Path("budget"))
    last, recorded = facts["budget"][-1], facts["recorded"]
    predicted = [recorded["predicted_m"][axis][-1] for axis in ("north", "east")]
    # one window by its sources, all of them by the filter
    assert last["covariance"]["position_m"][:2] == pytest.approx(predicted, rel=0.25)
    assert last["simulated"]["horizontal_m"] == pytest.approx(last["covariance"]["horizontal_m"], rel=0.2)
    assert facts["recorded_windows"]["uncalibrated"]["windows"] == recorded["windows"] > 20
    assert "rec. N" in shown.out
    assert "uncalibrated sensors" in shown.out
    again = cli("report", "budget", "--out", "again")  # drawn again from what was saved, with figures for papers
    assert again.code == 0, again.err
    names = {path.name for path in Path("again/figures").iterdir()}
    assert names >= {"recorded_growth.png", "recorded_causes.png", "recorded_regression.png"}


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        ((), 2, "--imu"),
        (("--imu", "nothing.toml"), 2, "imu.unknown"),
        (("--imu", "empty.toml"), 2, "budget.no_errors"),
        (("--imu", "mems.toml", "--times", "10,x"), 2, "--times"),
        (("--imu", "mems.toml", "--times", "5000"), 2, "--times"),
        (("--imu", "mems.toml", "--times", "0.01"), 2, "--times"),
        (("--imu", "mems.toml", "--runs", "1"), 2, "--runs"),
        (("--imu", "mems.toml", "--begin", "5"), 2, "session.begin_without_profile"),
        (("--imu", "mems.toml", "--profile", "town"), 2, "sim.unknown_profile"),
        (("--imu", "mems.toml", "--profile", "city", "--begin", "5000"), 2, "budget.motion_too_short"),
        (("--imu", "mems.toml", "--profile", "city", "--times", "3000"), 2, "budget.motion_too_short"),
        (("--imu", "mems.toml", "--deflection", "-1"), 2, "--deflection"),
        (("--imu", "mems.toml", "--gps", "gps.csv"), 2, "DRIVE"),
        (("--imu", "mems.toml", "--uncalibrated"), 2, "DRIVE"),
        (("imu.csv", "--profile", "city"), 2, "--profile"),
        (("imu.csv", "--imu", "mems.toml"), 3, "imu.csv"),
        ((SAMPLE / "imu.csv.gz", "--imu", "mems.toml"), 2, "--gps"),
    ],
)
def test_what_cannot_be_meant_is_refused(cli: Cli, options: tuple[str, ...], code: int, words: str):
    Path("empty.toml").write_text('name = "nothing"\n[gyro]\nbias = "0 deg/h"\n[accel]\n', encoding="utf-8")
    shown = cli("budget", *options)
    assert shown.code == code, shown.err
    assert words in shown.err
    assert not Path("budget").exists()
