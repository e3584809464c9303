"""``insnav outage`` from files to a folder."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from insnav.findings import Code, Finding
from insnav.messages import phrase, sentence
from insnav.output.folder import read_facts
from tests.cli.conftest import Cli, findings_of
from tests.shared import verify_folder

QUICK = ("outage", "imu.csv", "--gps", "gps.csv", "--imu", "automotive", "--lengths", "3,6", "--first", "80")


def test_folder_and_table(drive: Path, cli: Cli):
    shown = cli(*QUICK, "--engine", "1", "--aiding", "off")
    assert shown.code == 0, shown.err
    verify_folder(Path("outage"))
    facts = read_facts(Path("outage"))
    assert [each["length_s"] for each in facts["outages"]] == [3.0, 6.0]
    assert facts["outages"][1]["horizontal_m"]["rms"] < 20.0
    assert 'id="outage_horizontal"' in Path("outage/report.html").read_text(encoding="utf-8")
    assert "predicted" in shown.out
    judged = facts["verdict"]
    said = phrase("terminal.line", name=phrase(f"light.{judged['light']}"), text=judged["reason"])
    assert said in shown.out
    again = cli("report", "outage")
    assert said in again.out
    assert "workers" not in facts["configuration"]


@pytest.mark.parametrize("command", ["outage", "budget"])
def test_a_lost_filter_ends_with_the_exit_code_of_run(command: str, drive: Path, cli: Cli, monkeypatch):
    lost = Finding.of(Code.RUN_REJECTED, share=0.9, limit_share=0.5)
    for place in ("evaluated_run", "budget.from_windows"):
        monkeypatch.setattr(f"insnav.errors.{place}.failure", lambda _: lost)
    own = {"outage": QUICK[-4:], "budget": ("--times", "10", "--replicas", "0")}
    shown = cli(command, *QUICK[1:-4], *own[command], "--engine", "1")
    assert (shown.code, "cli.unusable" in shown.err) == (1, True), shown.err
    facts = read_facts(Path(command))
    assert facts["verdict"]["light"] == "bad"
    assert [*findings_of(facts, Code.RUN_REJECTED)] == [lost]


def test_a_length_that_does_not_fit_is_named(drive: Path, cli: Cli):
    shown = cli(*QUICK[:-3], "3,999", "--first", "80", "--spacing", "60", "--engine", "1", "--aiding", "off", "-v")
    assert sentence(Finding.of(Code.OUTAGE_NO_WINDOW, lengths_s=(999.0,))) in " ".join(shown.out.split())


def test_json_is_that_of_the_folder(drive: Path, cli: Cli):
    shown = cli(*QUICK, "--json", "--engine", "1")
    assert json.loads(shown.out) == read_facts(Path("outage"))


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (("--lengths", "5,x"), 2, "--lengths"),
        (("--lengths", "0"), 2, "cli.not_positive"),
        (("--lengths", "4000"), 3, "outage.drive_too_short"),
        (("--spacing", "-3"), 2, "outage.bad_windows"),
        (("--engine", "0"), 2, "--engine"),
    ],
)
def test_what_cannot_be_meant_is_refused(drive: Path, cli: Cli, options: tuple[str, ...], code: int, words: str):
    shown = cli("outage", "imu.csv", "--gps", "gps.csv", "--imu", "automotive", *options)
    assert shown.code == code
    assert words in shown.err
    assert not Path("outage").exists()
