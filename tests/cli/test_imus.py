"""``insnav imus``: a table of all parts, or one with its sources."""

from __future__ import annotations

import json

from insnav.findings import Code, Finding, Severity
from insnav.imu.library import find_part
from tests.cli.conftest import Cli, findings_of, says


def test_all_parts_and_their_json(cli: Cli) -> None:
    shown = cli("imus", "--json")
    assert shown.code == 0
    facts = json.loads(shown.out)
    assert len(facts["imus"]) >= 40
    assert {"part": "STIM300", "class": "tactical"}.items() <= next(
        each for each in facts["imus"] if each["part"] == "STIM300"
    ).items()
    assert "STIM300" in facts["classes"]["tactical"]["parts"]


def test_a_part_shows_its_documents_and_what_is_missing(cli: Cli) -> None:
    shown = cli("imus", "hg 9900")
    assert shown.code == 0
    assert "N61-1638-000-000" in shown.out
    part = find_part("HG9900")
    assert part is not None
    assert says(shown.out, Finding.of(Code.IMUS_MISSING, subject="HG9900", terms=part.missing))
    assert "gyro.bias_instability" in part.missing


def test_an_unknown_part_is_refused(cli: Cli) -> None:
    shown = cli("imus", "ADIS16505")
    assert shown.code == 2
    assert "adis16505-3" in shown.err


def test_a_budget_of_a_part(cli: Cli, tmp_path) -> None:
    shown = cli("budget", "--imu", "LN-200", "--times", "10", "--out", str(tmp_path / "b"), "--json")
    assert shown.code == 0
    (absent,) = findings_of(json.loads(shown.out), Code.BUDGET_ABSENT)
    assert absent.severity is Severity.WARNING
    assert "gyro.misalignment" in absent["terms"]
