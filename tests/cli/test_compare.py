"""The table of `insnav compare`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import insnav
from insnav.findings import Code, Finding, of_families
from insnav.output.folder import read_facts
from insnav.units import DEG
from tests.cli.conftest import QUICK, Cli, findings_of, says
from tests.reversed_messages import as_shown


@pytest.fixture
def two_runs(drive: Path, cli: Cli) -> Path:
    assert cli("run", *QUICK, "--ref", "ref.csv", "--lever-arm", "0.8,-0.3,-1.2", "--out", "right").code == 0
    assert cli("run", *QUICK, "--ref", "ref.csv", "--lever-arm", "0.8,-0.3,8.8", "--out", "wrong").code == 0
    return drive


def test_one_line_a_run_with_the_figures_of_the_run_itself(two_runs: Path, cli: Cli):
    shown = cli("compare", "right", "wrong", "--ref", "ref.csv")
    assert shown.code == 0, shown.err

    def rows_of(text: str) -> list[str]:
        return [line for line in text.splitlines() if line.split()[:1] in (["right"], ["wrong"])]

    names = [("right", "filtered"), ("right", "smoothed"), ("wrong", "filtered"), ("wrong", "smoothed")]
    assert [tuple(line.split()[:2]) for line in rows_of(shown.out)] == names
    rows = rows_of(shown.out)[::2]
    for name in ("right", "wrong"):  # alone, each over its own epochs
        row = rows_of(cli("compare", name, "--ref", "ref.csv").out)[0]
        accuracy = read_facts(Path(row.split()[0]))["accuracy"]["all"]
        expected = [accuracy[name]["rms"] for name in ("north_m", "east_m", "down_m", "horizontal_m")]
        assert [float(cell) for cell in row.split()[2:6]] == pytest.approx(expected, rel=0.01)
    down = [float(row.split()[4]) for row in rows]
    assert down[1] == pytest.approx(down[0], abs=0.5)  # the arm was 10 m too low, and is not used


def test_a_reference_that_proves_nothing_or_is_wrong_is_said(two_runs: Path, cli: Cli):
    shown = cli("compare", "right", "--ref", "gps.csv")
    assert says(shown.out, Finding.of(Code.REF_SAME_AS_GPS, subject="ref"))
    head, *rows = Path("ref.csv").read_text().splitlines()
    cells = [row.rsplit(",", 1) for row in rows]
    Path("turned.csv").write_text("\n".join([head, *(f"{rest},{float(heading) + 40.0}" for rest, heading in cells)]))
    shown = cli("compare", "right", "--ref", "turned.csv", "--out", "page")
    (turned,) = findings_of(read_facts(Path("page")), *of_families("ref"))
    assert turned.code is Code.REF_HEADING_AXES
    assert turned["angle_rad"] == pytest.approx(40.0 * DEG, abs=DEG)
    assert says(shown.out, turned)
    assert {each.run for each in insnav.open_result("page").found.compared} == {"right"}
    assert cli("compare", "right", "--ref", "ref.csv", "--out", "plain").code == 0
    assert not findings_of(read_facts(Path("plain")), *of_families("ref"))


def test_a_constant_difference_is_said_as_a_run_says_it(two_runs: Path, cli: Cli):
    head, *rows = Path("ref.csv").read_text().splitlines()
    place = head.split(",").index(next(each for each in head.split(",") if each.startswith("lat")))
    cells = [row.split(",") for row in rows]
    moved = [[*row[:place], f"{float(row[place]) + 5.0 / 111_000.0:.9f}", *row[place + 1 :]] for row in cells]
    Path("moved.csv").write_text("\n".join([head, *map(",".join, moved)]))
    assert as_shown("warning") not in cli("compare", "right", "--ref", "ref.csv").out
    shown = cli("compare", "right", "--ref", "moved.csv", "--out", "page")
    assert shown.code == 0
    moved_by = findings_of(read_facts(Path("page")))[0]
    assert moved_by.code is Code.RUN_OVERCONFIDENT_OFFSET
    assert moved_by["north_m"] == pytest.approx(-5.0, abs=0.2)  # and what the run errs by
    assert as_shown("warning") in shown.out
    assert says(shown.out, moved_by)


def test_json_holds_the_same_figures(two_runs: Path, cli: Cli):
    shown = cli("compare", "right", "wrong", "--ref", "ref.csv", "--json")
    assert shown.err == ""
    alone = json.loads(cli("compare", "right", "--ref", "ref.csv", "--json").out)
    rows = json.loads(shown.out)
    assert [(row["run"], row["solution"]) for row in rows] == [
        (name, which) for name in ("right", "wrong") for which in ("filtered", "smoothed")
    ]
    assert rows[1]["accuracy"]["horizontal_m"]["rms"] < rows[0]["accuracy"]["horizontal_m"]["rms"]
    own = read_facts(Path("right"))["accuracy"]["all"]["horizontal_m"]["rms"]
    # the table rounds times to a microsecond, 20 um at 20 m/s
    assert alone[0]["accuracy"]["horizontal_m"]["rms"] == pytest.approx(own, abs=2e-5)


@pytest.mark.parametrize(
    ("arguments", "code", "word"),
    [
        (("none", "--ref", "ref.csv"), 3, "output.no_table"),
        (("right", "--ref", "none.csv"), 3, "format.no_file"),
        (("right",), 2, "--ref"),
        (("--ref", "ref.csv"), 2, "RUN"),
        (("right", "--ref", "ref.csv", "--ref-lever-arm", "1"), 2, "--ref-lever-arm"),
        (("right", "--ref", "ref.csv", "--ref-columns", "lat=zz"), 2, "--ref-columns"),
    ],
)
def test_what_cannot_be_compared_is_refused(two_runs: Path, cli: Cli, arguments: tuple[str, ...], code: int, word: str):
    shown = cli("compare", *arguments)
    assert shown.code == code
    assert shown.out == ""
    assert word in shown.err
    assert "Traceback" not in shown.err
