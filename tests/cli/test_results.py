"""Results of the commands beside navigation: Python and the command line write the same, which opens again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import insnav
from insnav.exceptions import ConfigError
from insnav.output.folder import read_facts
from insnav.result import Result
from tests.cli.conftest import Cli
from tests.shared import verify_folder

LEVER = (0.8, -0.3, -1.2)
GIVEN = ("--lever-arm", "0.8,-0.3,-1.2")
SAME = ("imu.toml", "horizontal_errors.csv")  # files that do not say by whom they were written
_OF_WRITING = ("configuration", "files")  # options as they were given, digests of the page with these


def run() -> Result[Any]:
    return insnav.load("imu.csv", gps="gps.csv", imu="automotive", lever_arm=LEVER).navigate()


# kind -> how Python and the command line make it, its figure, a column of its table
RESULTS: dict[str, tuple[Callable[[], Result[Any]], tuple[str, ...], str, str]] = {
    "tune": (
        lambda: insnav.tune("imu.csv", gps="gps.csv", lever_arm=LEVER),
        ("tune", "imu.csv", "--gps", "gps.csv", *GIVEN),
        "noise",
        "prior",
    ),
    "alignment": (
        lambda: insnav.align("imu.csv", imu="navigation", lat=np.radians(48.0)),
        ("align", "imu.csv", "--imu", "navigation", "--lat", "48"),
        "attitude",
        "heading_deg",
    ),
    "check": (
        lambda: insnav.check("imu.csv", "gps.csv", ref="ref.csv"),
        ("check", "imu.csv", "gps.csv", "--ref", "ref.csv"),
        "timeline",
        "what",
    ),
    "comparison": (
        lambda: insnav.compare(run().save("run", figures="none"), ref="ref.csv"),
        ("compare", "run", "--ref", "ref.csv"),
        "horizontal_error",
        "solution",
    ),
}


def check_result(result: Result[Any], folder: Path, figure: str, column: str) -> Result[Any]:
    """Save, open and show a result; that from the folder is the same, and is returned."""
    where = result.save(folder)
    verify_folder(where)
    assert {"found.npz", "report.html", "run.json"} <= {path.name for path in where.iterdir()}
    again = insnav.open_result(where)
    assert again.kind == result.kind == read_facts(where)["kind"]
    assert again.summary() == result.summary()
    for each in (result, again):
        assert len(each.to_frame()[column]) > 0
        assert each.page().title in each._repr_html_()
        assert isinstance(each.plot(), Figure)
        assert isinstance(each.plot(figure), Figure)
        with pytest.raises(ConfigError, match=r"report.no_figure"):
            each.plot("nothing")
    return again


@pytest.mark.parametrize("kind", RESULTS)
def test_python_and_the_command_line_write_the_same(kind: str, drive: Path, tmp_path: Path, cli: Cli) -> None:
    make, command, figure, column = RESULTS[kind]
    check_result(make(), tmp_path / "python", figure, column)
    assert cli(*command, "--out", tmp_path / "shell").code == 0
    both = [read_facts(tmp_path / name) for name in ("python", "shell")]
    assert [*both[0]] == [*both[1]]
    same = [{key: value for key, value in each.items() if key not in _OF_WRITING} for each in both]
    assert same[0] == same[1]
    assert both[0]["files"].keys() == both[1]["files"].keys()
    names = [name for name in SAME if (tmp_path / "shell" / name).exists()]
    for name in names:
        assert (tmp_path / "python" / name).read_bytes() == (tmp_path / "shell" / name).read_bytes()


@pytest.mark.parametrize(("name", "title"), [(None, "real IMUs"), ("stim 300", "STIM300")])
def test_real_imus(name: str | None, title: str, tmp_path: Path) -> None:
    again = check_result(insnav.imus(name), tmp_path / "out", "noise", "gyro_random_walk_deg_sqrt_h")
    assert title in again.page().title
