"""The table of the laboratory's figures (docs/howto/laboratory.md): every command is run, every test is there."""

from __future__ import annotations

import json
import re
import runpy
import shlex
import shutil
from decimal import Decimal
from functools import reduce
from pathlib import Path

import pytest

from tests.cli.conftest import Cli
from tests.lab.published import lab_file

ROOT = Path(__file__).parents[2]
TABLES = ROOT / "trajectories" / "laboratory"
PAGE = ROOT / "docs" / "howto" / "laboratory.md"


def rows(columns: int) -> list[list[str]]:
    cells = [
        [cell.strip().strip("`") for cell in line.strip("|").split("|")]
        for line in PAGE.read_text(encoding="utf-8").splitlines()
        if line.startswith("|") and "---" not in line
    ]
    return [row for row in cells if len(row) == columns and row[0] != "row"]


@pytest.mark.parametrize("simulated", [False, True])
def test_every_recorded_figure_comes_out_of_its_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Cli, *, simulated: bool
) -> None:
    """From the recorded tables to the last digit; from the simulated ones of the package as they were published."""
    monkeypatch.chdir(tmp_path)
    (model,) = re.findall(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    for name in ("gyro_rate_table.csv", "accel_tumble_12.csv", "gyro_bias_repeatability.csv", "lab.toml"):
        shutil.copy(TABLES / name if simulated or name == "lab.toml" else lab_file(name), name)
    assert Path("lab.toml").read_text() == model
    made: dict[str, object] = {}
    for _, command, key, recorded, ours in rows(5):
        if command not in made:
            done = cli(*shlex.split(command), "--out", f"out{len(made)}", "--json")
            assert done.code == 0, done.err
            made[command] = json.loads(done.out)
        found = reduce(
            lambda at, each: at[int(each)] if isinstance(at, list) else at[each], key.split("."), made[command]
        )
        for text, last in ((recorded, 0.5),) if simulated else ((recorded, 0.5), (ours, 0.51)):
            digit = float(Decimal(1).scaleb(Decimal(text).as_tuple().exponent))
            assert abs(found - float(text)) <= last * digit * (1.0 + 1e-6), (command, key, found, text)


def test_the_tables_of_the_package_are_made_again(tmp_path: Path) -> None:
    runpy.run_path(str(TABLES.parent / "make_laboratory.py"))["main"]([str(tmp_path)])
    for made in tmp_path.iterdir():
        assert made.read_text() == (TABLES / made.name).read_text()
    assert len(list(tmp_path.iterdir())) == len(list(TABLES.iterdir())) == 4


def test_every_test_that_is_named_is_there() -> None:
    named = [row[2].split("::") for row in rows(3)]
    assert len(named) >= 10
    for file, name in named:
        assert f"def {name}(" in (ROOT / file).read_text(encoding="utf-8"), name
