"""``insnav verify`` from the command to the folder, and its exit code if an integrator is broken."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insnav import strapdown
from insnav.certificate import certify, platform_checks, strapdown_checks
from insnav.certificate import integrators as peer
from insnav.findings import Code, Finding
from insnav.messages import phrase, sentence
from insnav.output.folder import read_facts
from tests.cli.conftest import Cli
from tests.shared import verify_folder


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Only what takes no time: the whole certificate is tested elsewhere."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(certify, "TOPICS", (strapdown_checks.coning, strapdown_checks.sculling, strapdown_checks.spin))
    monkeypatch.setattr(certify, "OTHERS", (platform_checks.gravity,))


@pytest.fixture
def broken(short: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Increments that have lost their sculling."""
    whole = strapdown.increments

    def increments(*arguments, **options):
        found = whole(*arguments, **options)
        return replace(found, sculling=np.zeros_like(found.sculling))

    monkeypatch.setattr(strapdown, "increments", increments)


def test_folder_and_tables(short: None, cli: Cli):
    shown = cli("verify")
    assert shown.code == 0, shown.err
    lines = shown.out.splitlines()
    assert lines[0] == "Numerical certificate: all checks passed"
    assert any(line.split() == ["case", "result", "limit", "polynomial", "rk4", "rotvec", "euler"] for line in lines)
    (coning,) = (line for line in lines if line.startswith("  1 deg, 10 Hz [deg/h]"))
    assert coning.split()[5:7] == ["passed", "0.1"]
    assert coning.count("!") == 3
    assert "FAILED" not in shown.out
    verify_folder(Path("certificate"))
    assert Path("certificate/figures/certificate.png").stat().st_size > 10_000
    facts = read_facts(Path("certificate"))
    assert facts["passed"] is True
    assert facts["failed"] == []
    (check,) = (c for c in facts["checks"] if (c["topic"], c["case"]) == ("coning", "1 deg, 5 Hz"))
    assert (check["limit"], check["unit"], check["required"]) == (0.02, "deg/h", ["polynomial"])
    assert check["errors"]["polynomial"] < 0.02 < check["errors"]["rk4"]


def test_a_broken_integrator_is_named_and_ends_with_1(broken: None, cli: Cli):
    shown, short = cli("verify", "-v"), cli("verify", "--out", "short").out.splitlines()
    assert shown.code == 1
    assert len(short) <= 15
    lines = shown.out.splitlines()
    assert lines[0] == "Numerical certificate: 2 FAILED"
    (row,) = (line for line in lines if line.startswith("  0.1 deg, 1 g, 10 Hz [ug]"))
    assert row.split()[7] == "FAILED"
    assert row.count("!") == 4
    failed = Finding.of(Code.CERTIFICATE_FAILED, subject="sculling: 0.1 deg, 1 g, 10 Hz")
    assert f"  - {sentence(failed)}" in lines
    assert phrase("terminal.line", name=phrase("run.warning"), text=sentence(failed)) in short
    assert "2 of 28 checks failed" in shown.err
    assert "Traceback" not in shown.err
    facts = read_facts(Path("certificate"))  # written all the same
    assert facts["passed"] is False
    assert "sculling: 0.1 deg, 1 g, 10 Hz" in facts["failed"]


def test_json_is_that_of_the_folder(broken: None, cli: Cli):
    shown = cli("verify", "--json", "--out", "here")
    assert shown.code == 1
    assert json.loads(shown.out) == read_facts(Path("here"))


def test_markdown_is_one_table(short: None, cli: Cli):
    shown = cli("verify", "--markdown")
    assert shown.code == 0, shown.err
    rows = [line.strip("|").split("|") for line in shown.out.splitlines()]
    assert {len(row) for row in rows} == {6}
    assert [name.strip() for name in rows[0]] == ["check", "limit", "insnav", "rk4", "rotvec", "euler"]
    assert len(rows) == 2 + 28


def test_peer_stands_beside(short: None, cli: Cli):
    pytest.importorskip("pyins", reason="python-ins is not installed")
    shown = cli("verify", "--peer", "--json")
    assert shown.code == 0, shown.err
    (check,) = (c for c in json.loads(shown.out)["checks"] if c["case"] == "1 deg, 10 Hz")
    assert check["errors"]["pyins"] == pytest.approx(9.8, rel=0.01)


def test_a_peer_that_is_absent_is_told(short: None, monkeypatch: pytest.MonkeyPatch, cli: Cli):
    monkeypatch.setattr(peer, "find_spec", lambda name: None)
    shown = cli("verify", "--peer")
    assert shown.code == 2
    assert "verify.no_pyins" in shown.err
    assert shown.out == ""
    assert not Path("certificate").exists()


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (("--json", "--markdown"), 2, "cli.json_or_markdown"),
        (("--out", "/dev/null/such"), 4, "output.folder_unwritable"),
        (("--pier",), 2, "--peer"),
    ],
)
def test_what_cannot_be_is_refused(short: None, cli: Cli, options: tuple[str, ...], code: int, words: str):
    shown = cli("verify", *options)
    assert shown.code == code
    assert words in shown.err
    assert shown.out == ""


def test_an_older_certificate_is_kept_unless_told(short: None, cli: Cli):
    assert cli("verify").code == 0
    assert cli("verify").code == 0
    assert Path("certificate~1", "run.json").exists()
    assert cli("verify", "--out", "certificate").code == 4
    assert cli("verify", "--out", "certificate", "--force").code == 0
