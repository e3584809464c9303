"""A result shows itself through the room of its kind."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import pandas as pd
import pytest
from matplotlib.figure import Figure

import insnav
import insnav.steps.inputs  # adds its names to those of errors
from insnav.exceptions import ConfigError, as_keywords
from insnav.findings import Code, Finding
from insnav.output.folder import RunFolder, read_facts
from insnav.quantity import Quantity
from insnav.report.page import FigureSpec, Page, Section
from insnav.result import Result, open_result
from tests.refusals import refused


@pytest.fixture
def room(monkeypatch: pytest.MonkeyPatch) -> None:
    """A kind of result that is one number."""
    module = ModuleType("insnav.report.answer.page")

    def page(result: Result[float]) -> Page:
        figures = (FigureSpec("curve", "A curve", Figure),)
        number = Quantity("drift", result.found, "m")
        return Page("The <answer>", ("It is here.",), (Section("main", "Main", (number,), figures=figures),))

    def write_files(result: Result[float], folder: RunFolder, table_format: str) -> None:
        folder.path(f"answer.{table_format}").write_text(str(result.found))

    def read_found(folder: Path, findings: Sequence[Finding]) -> float:
        return float((folder / "answer.csv").read_text())

    def frame(result: Result[float]) -> Any:
        return pd.DataFrame({"drift_m": [result.found]})

    for function in (page, write_files, read_found, frame):
        setattr(module, function.__name__, function)
    monkeypatch.setitem(sys.modules, "insnav.report.answer", ModuleType("insnav.report.answer"))
    monkeypatch.setitem(sys.modules, "insnav.report.answer.page", module)


@pytest.mark.usefixtures("room")
def test_a_result_is_saved_and_opened_again(tmp_path: Path) -> None:
    assumed = Finding.of(Code.RUN_LEVER_ZERO)
    limited = Finding.of(Code.CHECK_CLIPPED, 12.25, subject="imu", count=3, sensor="gyro x")
    given = Result("answer", 42.0, options={"times": (10, 60)}, findings=(assumed, limited))
    where = given.save(tmp_path / "out")
    assert {path.relative_to(where).as_posix() for path in where.rglob("*.*")} == {
        "answer.csv", "figures/curve.png", "report.html", "run.json",
    }  # fmt: skip
    facts = read_facts(where)
    assert facts["kind"] == "answer"
    assert facts["main"] == {"drift_m": 42.0}
    assert facts["versions"]["insnav"] == insnav.__version__
    again = open_result(where)
    assert (again.kind, again.found, again.options) == ("answer", 42.0, {"times": [10, 60]})
    assert again.findings == again.page().findings == (assumed, limited)


@pytest.mark.parametrize("name", ["notes", "events"])
def test_a_name_of_version_0_2_names_its_successor(name: str) -> None:
    with pytest.raises(AttributeError, match=r"use Result\.findings"):
        getattr(Result("answer", 42.0), name)
    with pytest.raises(AttributeError, match="no attribute 'notices'"):
        _ = Result("answer", 42.0).notices


@pytest.mark.usefixtures("room")
def test_a_result_shows_itself() -> None:
    result = Result("answer", 42.0)
    assert isinstance(result.plot("curve"), Figure)
    with refused(ConfigError, "report.no_figure") as caught:
        result.plot("corve")
    assert caught.value.values == {"name": "corve", "known": ("curve",)}
    assert list(result.to_frame()["drift_m"]) == [42.0]
    assert "42" in result.summary()
    assert "The &lt;answer&gt;" in result._repr_html_()
    assert "<html" not in result._repr_html_()


@pytest.mark.usefixtures("room")
def test_without_figures_there_is_no_page(tmp_path: Path) -> None:
    where = Result("answer", 1.0).save(tmp_path / "out", figures="none", table_format="parquet")
    assert sorted(path.name for path in where.iterdir()) == ["answer.parquet", "run.json"]


def test_an_error_names_keywords_in_python_and_options_on_the_command_line():
    text = "say --imu-axes FLU, leave --resume out, --sample-rate or give another --out"
    assert as_keywords(text) == "say axes FLU, leave resume out, sample_rate or give another folder"
    error = ConfigError("sim.other_series")
    assert error.fix in dict(error.details()).values()
