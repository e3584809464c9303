"""The table of the laboratory's figures (docs/howto/laboratory.md): every command is run, every test is there."""

from __future__ import annotations

import json
import re
import shlex
import shutil
from decimal import Decimal
from functools import reduce
from pathlib import Path

import pytest

from tests.cli.conftest import Cli
from tests.lab.published import lab_file

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "howto" / "laboratory.md"


def rows(columns: int) -> list[list[str]]:
    cells = [
        [cell.strip().strip("`") for cell in line.strip("|").split("|")]
        for line in PAGE.read_text(encoding="utf-8").splitlines()
        if line.startswith("|") and "---" not in line
    ]
    return [row for row in cells if len(row) == columns and row[0] != "row"]


def test_every_recorded_figure_comes_out_of_its_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Cli
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("gyro_rate_table.csv", "accel_tumble_12.csv", "gyro_bias_repeatability.csv"):
        shutil.copy(lab_file(name), name)
    (model,) = re.findall(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    Path("lab.toml").write_text(model)
    made: dict[str, object] = {}
    for _, command, key, recorded, ours in rows(5):
        if command not in made:
            done = cli(*shlex.split(command), "--out", f"out{len(made)}", "--json")
            assert done.code == 0, done.err
            made[command] = json.loads(done.out)
        found = reduce(
            lambda at, each: at[int(each)] if isinstance(at, list) else at[each], key.split("."), made[command]
        )
        for text, last in ((recorded, 0.5), (ours, 0.51)):
            digit = float(Decimal(1).scaleb(Decimal(text).as_tuple().exponent))
            assert abs(found - float(text)) <= last * digit * (1.0 + 1e-6), (command, key, found, text)


def test_every_test_that_is_named_is_there() -> None:
    named = [row[2].split("::") for row in rows(3)]
    assert len(named) >= 10
    for file, name in named:
        assert f"def {name}(" in (ROOT / file).read_text(encoding="utf-8"), name
