"""What the panels of a page hold: thinned with its extremes, harmless in the page, on axes that no spike sets."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from insnav.messages import phrase
from insnav.report.figures import draw_drawings, drawing
from insnav.report.html import page_fragment, page_html
from insnav.report.panels import LINE_BINS, Curve, Panel, limits_of, modes, panel_data, robust_limits
from insnav.report.style import AXIS_COLOURS
from tests.report import drawn


def unpacked(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), "<f4")


def test_extremes_survive_the_thinning() -> None:
    error = panel_data(drawn.panels()[1])
    filtered = next(each for each in error["curves"] if each["mode"] == "filtered" and each["kind"] == "line")
    x, y = unpacked(filtered["x"]), unpacked(filtered["y"])
    assert len(x) <= 3 * LINE_BINS
    assert y.max() == 30.0
    assert np.isclose(x[np.argmax(y)], drawn.SPIKE * 3600.0 / 20000.0)
    assert (np.diff(x) >= 0.0).all()


def test_one_spike_does_not_set_the_axis() -> None:
    limits = panel_data(drawn.panels()[1])["limits"]
    assert set(limits) == {"smoothed", "filtered"}
    assert limits["filtered"][1] < 0.6
    assert limits["filtered"][0] > -0.6
    values = np.concatenate((np.zeros(1000), [20.0]))
    assert robust_limits([np.sin(np.arange(1000.0))])[1] > 1.0  # what is no outlier is all seen
    assert robust_limits([np.sin(np.arange(1000.0)), values[:1000]]) is not None
    low, high = robust_limits([np.full(5, 3.0)], least=2.0)
    assert (low, high) == (2.0, 4.0)
    assert robust_limits([np.array([np.nan])]) is None


@pytest.mark.parametrize("log", ["", "y"])
def test_the_axis_holds_99_percent_of_a_band(log: str) -> None:
    half = np.geomspace(50.0, 0.1, 1000)  # as at the start of a drive
    half[:4] = 1e6
    line = Curve("north", np.arange(1000.0), np.full(1000, 0.2), AXIS_COLOURS[0])
    band = Curve("north", np.arange(1000.0), half, AXIS_COLOURS[0], "band", -half if not log else 0.1 * half)
    low, high = limits_of(Panel("error", "", "", "", (line, band), log=log), "")
    inside = (half <= high) & (band.low >= low)
    assert inside.mean() >= 0.99
    assert high < 1e3


def test_the_switch_knows_its_positions() -> None:
    assert modes(drawn.panels()) == ("smoothed", "filtered")


def test_only_the_scripts_of_the_page_run_and_data_cannot_end_them() -> None:
    html = page_html(drawn.page(drawn.HOSTILE), {})
    scripts = re.findall(r"<script>(.*?)</script>", html, re.DOTALL)
    assert len(scripts) == 3
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', html).group(1)
    assert policy.startswith("default-src &#39;none&#39;")
    for each in scripts:
        digest = base64.b64encode(hashlib.sha256(each.encode()).digest()).decode()
        assert f"sha256-{digest}" in policy
    assert "unsafe-eval" not in policy
    data = re.search(r'<script type="application/json" id="panels-data">(.*?)</script>', html, re.DOTALL).group(1)
    assert "<" not in data
    assert json.loads(data)[1]["curves"][0]["name"] == drawn.HOSTILE


def test_verdict_first_then_warnings_then_figures_of_merit() -> None:
    html = page_html(drawn.page(), {})
    light = phrase("light.attention")
    order = [
        html.index(text)
        for text in (light, "Horizontal error 0.148", "was not given<", "merit 5", "Drawn", "<summary>")
    ]
    assert order == sorted(order)
    assert "panels-data" not in page_fragment(drawn.page())


def test_the_same_panels_are_a_figure_for_papers(tmp_path) -> None:
    _, error, nis, parts = drawn.panels()
    with drawing():
        figure = draw_drawings((error, nis, parts), "All", "a note")
        figure.savefig(tmp_path / "all.png")
        (track,) = draw_drawings(drawn.panels()[:1], "Track").axes[:1]
    first, second, third = figure.axes
    line = max((each for each in first.lines if each.get_label() == "north"), key=lambda each: len(each.get_xdata()))
    assert line.get_ydata().max() == pytest.approx(0.05, rel=1e-3)  # smoothed: the first position of the switch
    assert (first.get_ylabel(), first.get_xlabel()) == ("error [m]", "time [s]")
    assert second.get_yscale() == "log"
    assert "gate (16.3)" in second.get_legend_handles_labels()[1]
    assert [each.get_text() for each in third.get_yticklabels()] == ["gyro bias", "heading"]
    assert [bar.get_width() for bar in third.patches] == [60.0, 40.0]
    assert third.get_ylim()[0] > third.get_ylim()[1]  # the first row at the top
    assert track.get_aspect() == 1.0
    filtered = replace(error, curves=tuple(each for each in error.curves if each.mode == "filtered"))
    with drawing():
        (axes,) = draw_drawings((filtered,), "One").axes
    (mark,) = (each for each in axes.lines if each.get_marker() == "^")
    assert mark.get_xdata()[0] == pytest.approx(drawn.SPIKE * 3600.0 / 20000.0)
    assert max(axes.get_ylim()) < 0.6
