"""The first command of somebody who has no data."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

from tests.cli.conftest import Cli, cli

__all__ = ["cli"]


def test_the_demo_says_its_command_and_that_command_gives_the_same(cli: Cli) -> None:
    shown = cli("demo")
    assert shown.code == 0
    facts = json.loads(Path("demo", "run.json").read_text())
    assert facts["accuracy"]["all"]["horizontal_m"]["rms"] < 1.0
    (line,) = [line for line in shown.err.splitlines() if line.startswith("$ insnav run ")]
    again = cli(*shlex.split(line)[2:-1], "again")
    assert again.code == 0
    assert Path("demo", "smoothed.csv").read_bytes() == Path("again", "smoothed.csv").read_bytes()
    assert cli("demo").code == 4, "an existing result is not replaced unasked"
