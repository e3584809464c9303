"""``--explain`` and ``--faults`` on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from insnav.messages import phrase
from tests.cli.conftest import QUICK, Cli


def test_off_says_nothing_of_faults_and_on_says_it_in_one_line(drive: Path, cli: Cli):
    on, off = (cli("run", *QUICK, "--explain", each, "--out", each, "-v") for each in ("on", "off"))
    assert (on.code, off.code) == (0, 0)
    start = phrase("explanation.none", count=0, passes=0).partition("0")[0]
    assert [each.err.count(f"        {start}") for each in (on, off)] == [1, 0]
    tables = [each.out.count("faults considered") for each in (on, off)]
    assert tables == [1, 0]
    facts = [json.loads(Path(each, "run.json").read_text()) for each in ("on", "off")]
    assert ["explanation" in each for each in facts] == [True, False]
    assert facts[1]["configuration"]["explain"] == "off"
    for name in ("outage", "budget"):
        more = ("--lengths", "5", "--workers", "1") if name == "outage" else ("--times", "10", "--runs", "20")
        done = cli(name, *QUICK[:3], "--explain", "off", "--out", name, "-q", "--json", *more)
        assert done.code == 0, done.err
        assert "explanation" not in json.loads(done.out)


@pytest.mark.parametrize(
    ("content", "code"),
    [
        ('[faults.ofset]\nsize = "1 m"', "config.unknown_key"),
        ('[faults.offset]\nsize = "-1 m"', "config.negative"),
        ("[faults.offset]\nsize = 1.0", "config.no_quantity"),
        ("[faults.offset\n", "config.no_toml"),
        (None, "config.unreadable"),
    ],
)
def test_a_file_that_makes_no_sense_is_refused(drive: Path, cli: Cli, content: str | None, code: str):
    if content is not None:
        Path("faults.toml").write_text(content)
    shown = cli("run", *QUICK, "--faults", "faults.toml")
    assert shown.code == 2
    assert code in shown.err
    assert "faults.toml" in shown.err
    assert not Path("run").exists()
