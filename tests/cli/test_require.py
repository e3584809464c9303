"""``insnav require``: from a limit to figures, in one command."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import insnav
from insnav.report.save import page_facts
from tests.cli.conftest import Cli


def test_a_requirement_at_rest(cli: Cli, tmp_path: Path) -> None:
    shown = cli("require", "--error", "1 m", "--after", "60s", "--runs", "0", "--out", str(tmp_path / "r"), "--json")
    assert shown.code == 0, shown.err
    facts = json.loads(shown.out)
    assert facts["requirement"]["error_m"] == 1.0
    same = page_facts(insnav.require("1 m", "60 s", runs=0).page())  # a notebook gives the same numbers
    assert {key: facts[key] for key in ("allocation", "parts")} == {key: same[key] for key in ("allocation", "parts")}
    row = next(each for each in facts["allocation"] if each["family"] == "gyro bias")
    assert row["alone_deg_h"] == pytest.approx(0.239, rel=5e-3)
    assert (tmp_path / "r" / "report.html").is_file()
    assert (tmp_path / "r" / "figures" / "allocation.png").is_file()
    assert page_facts(insnav.open_result(tmp_path / "r").page())["allocation"] == facts["allocation"]


def test_which_parts_keep_a_car_within_5_m_for_30_s(cli: Cli, tmp_path: Path) -> None:
    out = tmp_path / "r"
    shown = cli("require", "--error", "5 m", "--after", "30 s", "--profile", "city", "--runs", "0", "--out", str(out))
    assert shown.code == 0, shown.err
    assert "IMUs stay within 5 m for 30 s alone" in (out / "report.html").read_text()
    facts = json.loads((out / "run.json").read_text())
    rows = {row["part"]: row for row in facts["parts"]}
    assert len(rows) >= 40
    assert rows["STIM300"]["alone_meets"] == "yes"
    assert rows["ADIS16405"]["alone_meets"] == "no"
    assert rows["STIM300"]["nhc_error_m"] < rows["STIM300"]["alone_error_m"]
    assert {row["remedy"] for row in facts["remedies"]} >= {"NHC", "odometer", "barometer"}
    assert sum(row["share_percent"] for row in facts["shapley"]) == pytest.approx(100.0, abs=0.01)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--error", "1", "--after", "60 s"), "unit.missing"),
        (("--error", "1 s", "--after", "60 s"), "unit.of_other_dimension"),
        (("--error", "1 m", "--after", "9000 s"), "require.not_sensible"),
        (("--error", "1 m", "--after", "60 s", "--profile", "city", "--begin", "450"), "require.motion_too_short"),
        (("--error", "1 m", "--after", "60 s", "--cost", "gyro bias=x"), "--cost"),
        (("--error", "1 m", "--after", "60 s", "--imu", "STIM3000"), "stim300"),
        (("--error", "1 m", "--after", "400 s", "--component", "vertical"), "unstable"),
    ],
)
def test_nonsense_ends_in_one_block(cli: Cli, tmp_path: Path, options: tuple[str, ...], said: str) -> None:
    shown = cli("require", *options, "--out", str(tmp_path / "r"))
    assert shown.code == 2
    assert said in shown.err
    assert "Traceback" not in shown.err
    assert not (tmp_path / "r").exists()


def test_runs_refute_a_probability_and_never_prove_it(cli: Cli, tmp_path: Path) -> None:
    shown = cli("require", "--error", "1 m", "--after", "60 s", "--runs", "400", "--out", str(tmp_path / "r"), "-v")
    assert shown.code == 0
    text = " ".join(shown.out.split())
    assert "1 x the set, 400 simulated runs" in text
    assert "%): agrees with 95 %." in text
    assert "%): less than 95 %." in text
    assert "meets 95" not in text
