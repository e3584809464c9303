"""``insnav report``: a run is drawn again from its folder."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from insnav.findings import ASSUMED_POSITION_SD, Code, Severity
from insnav.output.folder import read_facts
from insnav.types import FloatArray
from insnav.units import DEG
from tests.cli.conftest import Cli, findings_of
from tests.shared import verify_folder

RUN = ("run", "imu.csv", "--gps", "gps.csv", "--imu", "automotive", "--ref", "ref.csv", "--lever-arm", "0.8,-0.3,-1.2")


def unlike(old: FloatArray, new: FloatArray) -> float:
    """Share of pixels that are none of those about them now: tables are rounded, a point may move by a pixel."""
    row, column = np.nonzero(np.abs(old - new) > 30.0)  # the others need no look at those about them
    height, width = new.shape
    moved = [
        np.abs(old[row, column] - new[(row + down) % height, (column + right) % width])
        for down in (-1, 0, 1)
        for right in (-1, 0, 1)
    ]
    return float(np.sum(np.min(moved, axis=0) > 30.0)) / old.size


@pytest.mark.parametrize("table_format", ["csv", "parquet"])
def test_figures_and_figures_of_merit_are_those_of_the_run(drive: Path, cli: Cli, table_format: str):
    made = cli(*RUN, "--format", table_format, "--figures", "png")
    assert made.code == 0, made.err
    shown = cli("report", "run", "--out", "again")
    assert shown.code == 0, shown.err
    first, again = verify_folder(Path("run")), verify_folder(Path("again"))
    png = [name for name in first["files"] if name.endswith(".png")]
    assert len(png) == 11
    for name in png:
        old, new = (np.asarray(Image.open(Path(folder, name)).convert("L"), dtype=float) for folder in ("run", "again"))
        assert old.shape == new.shape
        assert unlike(old, new) < 1e-3, name
    for facts in (first, again):
        assert facts["kind"] == "run"
    for keys in (
        ("accuracy", "all", "horizontal_m", "rms"),
        ("smoothed", "accuracy", "consistency", "position", "nees"),
        ("alignment", "heading_sd_deg"),
        ("fixes", "position", "nis_mean_per_axis"),
        ("imu_model", "gyro", "bias_deg_h"),
        ("solution", "distance_m"),
    ):
        old, new = first, again
        for key in keys:
            old, new = old[key], new[key]
        assert new == pytest.approx(old, rel=1e-3), keys
    for key in ("input", "configuration", "findings", "method", "verdict", "events", "aiding"):
        assert again[key] == first[key], key
    old, new = (text.splitlines()[:-1] for text in (made.out, shown.out))
    assert new == old  # all but paths and files
    assert (Path("again/report.html").read_text()) != ""


def test_vector_figures_and_json(drive: Path, cli: Cli):
    gps = pd.read_csv("gps.csv")
    gps[[name for name in gps if not name.startswith("sd")]].to_csv("gps.csv", index=False)
    assert cli(*RUN, "--figures", "none").code == 0
    shown = cli("report", "run", "--figures", "svg", "--json")
    (assumed,) = findings_of(read_facts(Path("run")), *ASSUMED_POSITION_SD)
    assert assumed.severity is Severity.ASSUMPTION
    assert read_facts(Path("run_report"))["findings"] == read_facts(Path("run"))["findings"]
    assert json.loads(shown.out) == read_facts(Path("run_report"))
    assert "figures/position_error.svg" in read_facts(Path("run_report"))["files"]


def test_what_is_no_run_is_refused(drive: Path, cli: Cli):
    shown = cli("report", ".")
    assert shown.code == 3
    assert "output.no_run_folder" in shown.err
    assert not Path("report").exists()


@pytest.mark.parametrize("wrong", [{"configuration": None}, {"fixes": "x"}, {"findings": 3}])
def test_facts_of_another_kind_are_refused(drive: Path, cli: Cli, wrong: dict[str, object]):
    assert cli(*RUN, "--out", "made").code == 0
    facts = read_facts(Path("made"))
    Path("made/run.json").write_text(json.dumps(facts | wrong))
    shown = cli("report", "made")
    assert (shown.code, "report.damaged" in shown.err) == (3, True)


def test_a_pdf_has_three_pages_and_leaves_the_run_as_it_is(drive: Path, cli: Cli):
    assert cli(*RUN, "--figures", "none").code == 0
    shown = cli("report", "run", "--pdf")
    assert shown.code == 0, shown.err
    file = Path("run.pdf").read_bytes()
    assert file.startswith(b"%PDF")
    assert file.count(b"/Type /Page ") == 3
    assert len(file) < 3e6
    assert cli("report", "run", "--figures", "svg").code == 0


def test_what_was_wrong_with_the_reference_is_said_again(drive: Path, cli: Cli):
    head, *rows = Path("ref.csv").read_text().splitlines()
    cells = [row.rsplit(",", 1) for row in rows]
    Path("ref.csv").write_text("\n".join([head, *(f"{rest},{float(heading) + 40.0}" for rest, heading in cells)]))
    assert cli(*RUN, "--figures", "none").code == 0
    assert cli("report", "run", "--out", "again").code == 0
    for folder in ("run", "again"):
        (turned,) = findings_of(read_facts(Path(folder)), Code.REF_HEADING_AXES)
        assert turned.severity is Severity.WARNING
        assert turned["angle_rad"] == pytest.approx(40.0 * DEG, abs=DEG)
