"""History and plots: with one version, and with fifty."""

from __future__ import annotations

import warnings
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from peers import PeerRow, section_lines, with_section, write_peers

from insnav.exceptions import InputError
from insnav.regression.baseline import Baseline, origin
from insnav.regression.evaluate import BY_KEY, Accuracy
from insnav.regression.regress import Entry, Regression, entry, read_history, with_entry, write_history
from insnav.regression.verdict import compare
from insnav.report.figures import draw_drawings, drawing
from insnav.report.regression.page import PAGE, PEERS, SECTION, markdown, peers_of, write_pages
from insnav.report.regression.panels import COLUMNS, fitted, history_panels
from insnav.report.style import VERMILLION
from insnav.result import Result
from tests.regression.conftest import LIBRARY, THEN


def versions(result: Accuracy, baseline: Baseline, count: int) -> list[Entry]:
    """A history in which errors halve, and the heading gets worse for a while from version 30 on."""
    rng = np.random.default_rng(1)
    history: list[Entry] = []
    for k in range(count):
        cases = {}
        for name, case in result.cases.items():
            worse = 1.5 if 30 <= k < 36 else 1.0
            values = {
                key: value * (1.0 + np.exp(-k / 8)) * (worse if key == "heading_rms_deg" else 1.0)
                * np.exp(0.01 * rng.standard_normal(len(value)))
                for key, value in case.measured.values.items()
            }  # fmt: skip
            cases[name] = replace(case, measured=replace(case.measured, values=values))
        now = replace(result, cases=cases)
        made = entry(now, compare(now, baseline), replace(THEN, version=f"0.{k // 4}.{k % 4}", commit=f"c{k}"))
        if k < 20:
            made.digests["sculling"] = "an older one"
        if 0 < k < 10:
            made.metrics.pop("short drive")
        history = with_entry(history, made)
    return history


@pytest.mark.parametrize("count", [1, 50])
def test_everything_is_drawn(count: int, result: Accuracy, baseline: Baseline, tmp_path: Path):
    history = versions(result, baseline, count)
    peer = PeerRow("sculling", "another", (0.1, 0.2, None), (0.01, 0.02), 12.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = Regression(result, baseline, THEN, tuple(history))
        files = write_pages(tmp_path, Result("regression", found))
        write_peers(tmp_path, (peer,), THEN)
    assert len([file for file in files if file.suffix == ".png"]) == 8
    page = (tmp_path / PAGE).read_text()
    assert page.count("data:image/png;base64,") == 8
    assert "0.0.9" in page
    text = (tmp_path / SECTION).read_text()
    assert "| sculling | another | 0.100 | 0.200 | – |" in text
    assert "another" in (tmp_path / "peers.html").read_text()
    assert THEN.computer in text
    assert all((tmp_path / name).is_file() for name in ("accuracy_cep50_m.png", "accuracy_growth.png"))


def test_without_other_programs_their_table_stays_with_its_version(result: Accuracy, baseline: Baseline):
    peer = PeerRow("sculling", "another", (0.1, 0.2, None), (0.01, 0.02), 12.0)
    later = Regression(result, baseline, replace(THEN, version="0.9.9"))
    section = section_lines((peer,), THEN)
    first = with_section(markdown(Regression(result, baseline, THEN), ()), section)
    kept = peers_of(first)
    again = markdown(later, (), kept)
    assert "| sculling | another | 0.100 | 0.200 | – |" in again
    assert again.count(f"Version {THEN.version}") == again.count("Version 0.9.9") == 1
    assert again.index("Version 0.9.9") < again.index(PEERS) < again.index(f"Version {THEN.version}")
    assert peers_of(again) == kept == section
    assert with_section(again, section) == again
    assert PEERS not in markdown(later, (), peers_of("# nothing"))


def test_fifty_versions_can_be_read(result: Accuracy, baseline: Baseline):
    history = versions(result, baseline, 50)
    panels = tuple(history_panels(history, baseline, BY_KEY["heading_rms_deg"]))
    with drawing():
        figure = draw_drawings(panels, "heading", columns=COLUMNS)
        figure.canvas.draw()
        named = 0
        for axes in [axes for axes in figure.axes if axes.get_title(loc="left")]:
            texts = [label for label in axes.get_xticklabels() if label.get_text() and label.get_visible()]
            labels = [label.get_window_extent() for label in texts]
            assert not labels or 2 <= len(labels) <= 6
            assert all(a.x1 < b.x0 for a, b in pairwise(labels))
            named += bool(labels)
    assert named >= 2
    for panel in panels:
        begun = [each.x for each in panel.curves if each.kind == "crosses" and each.colour == VERMILLION]
        marked = set(np.concatenate(begun).tolist())
        # where the change begins, or a little before by chance, and not again while it lasts
        assert marked & {28.0, 29.0, 30.0}
        assert not marked & {31.0, 32.0, 33.0, 34.0, 35.0}


def test_a_line_a_version_and_commit(result: Accuracy, baseline: Baseline, tmp_path: Path):
    history = versions(result, baseline, 3)
    path = tmp_path / "history.jsonl"
    write_history(path, history)
    assert len(path.read_text().splitlines()) == 3
    again = with_entry(read_history(path), replace(history[1], data={"sculling": {"imu.csv": "00"}}))
    assert [each.origin.commit for each in again] == ["c0", "c1", "c2"]
    assert again[1].data == {"sculling": {"imu.csv": "00"}}
    value, low, high = again[0].metrics["sculling"]["velocity_rms_m_s"]
    assert low < value < high
    assert value == pytest.approx(history[0].metrics["sculling"]["velocity_rms_m_s"][0], rel=1e-3)


def test_a_damaged_line_is_named(tmp_path: Path):
    (tmp_path / "h.jsonl").write_text('\n{"origin": 3}\n')
    with pytest.raises(InputError) as error:
        read_history(tmp_path / "h.jsonl")
    assert error.value.where.endswith("h.jsonl:2")


def test_the_regression_line_is_that_of_least_squares():
    rng = np.random.default_rng(2)
    predicted = np.exp(rng.standard_normal(200))
    actual = 1.3 * predicted**0.8 * np.exp(0.2 * rng.standard_normal(200))
    line, half = fitted(predicted, actual)
    slope, offset = np.polyfit(np.log10(predicted), np.log10(actual), 1)
    assert (line.slope, line.intercept) == pytest.approx((slope, offset))
    assert line.slope - half < 0.8 < line.slope + half
    assert line.rvalue**2 == pytest.approx(np.corrcoef(np.log(predicted), np.log(actual))[0, 1] ** 2)
    assert fitted(predicted[:2], actual[:2]) is None


def test_where_figures_are_from_is_told():
    here = origin(LIBRARY)
    assert here.computer.split(" x ")[0].isdigit()
    assert here.packages["numpy"]
    assert here.date.endswith("Z")
