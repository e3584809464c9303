"""The page is one file that shows everything, runs its own scripts only, fetches nothing and obeys no name."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from scipy import stats

from insnav.earth import ned_offset
from insnav.messages import phrase
from insnav.plain_text import plain_text
from insnav.report.html import page_html
from insnav.report.page import Section
from insnav.report.run.panels import run_panels
from insnav.report.run.quantities import mean_nis
from insnav.report.style import number
from tests.report.conftest import result_of, stored

HOSTILE = [
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "' onload='alert(1)",
    "</title></style><svg/onload=alert(1)>",
    "{{ 7 * 7 }}{% raw %}",
    "\x1b[31mred\x00",
]
VOID = {"meta", "img", "br", "link"}


class Dom(HTMLParser):
    """Every element with its attributes, and the text."""

    def __init__(self, html):
        super().__init__(convert_charrefs=True)
        self.elements, self.open, self.text = [], [], []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def html_of(result, tmp_path):
    """Its page, with a picture of one dot for every figure."""
    picture = tmp_path / "track.png"
    picture.write_bytes(b"\x89PNG")
    page = result.page()
    return page_html(page, dict.fromkeys((each.name for each in page.embedded), picture))


def skeleton(dom):
    """Elements and their attributes; the class of a cell says whether its text is long."""
    return [(tag, sorted(set(attrs) - {"class"} if tag == "td" else attrs)) for tag, attrs in dom.elements]


def test_the_page_shows_accuracy_figures_and_every_section(navigated, tmp_path):
    dom = Dom(html_of(navigated, tmp_path))
    assert dom.open == []
    text = " ".join(" ".join(dom.text).split())
    size = navigated.found.errors.horizontal
    cep50, r95, most = (number(np.percentile(size, share)) for share in (50.0, 95.0, 100.0))
    values = {"mode": phrase("run.filtered"), "reference": navigated.inputs["reference"].path, "count": len(size)}
    circles = phrase("run.circles", cep50=cep50, r95=r95, most=most, **values)
    for words in (
        " ".join(circles.split()),
        "horizontal [m]",
        "drive.csv",
        "gravity is 9.81 at rest",
        "heading is not observable",
    ):
        assert words in text
    assert "gyro bias [deg/h]" in text
    assert not [attrs for tag, attrs in dom.elements if tag == "img"]  # figures for papers are no part of it
    drawn = [attrs["id"] for tag, attrs in dom.elements if tag == "figure"]
    assert drawn[:4] == ["track", "position_error", "velocity_error", "attitude_error"]
    assert {"position_sd", "velocity_sd", "attitude_sd", "error_distribution"} <= set(drawn)
    assert {"innovations_position", "nis", "gyro_bias", "speed", "height", "heading", "events"} <= set(drawn)
    first = " ".join(navigated.page().verdict.sentence.split())
    order = [text.index(words) for words in (first, "Track", "all RMS", "GPS fixes", "Inputs", "Options")]
    assert order == sorted(order)


def test_no_number_of_the_page_has_more_digits_than_it_means(navigated, tmp_path):
    cells = [text for text in Dom(html_of(navigated, tmp_path)).text if re.fullmatch(r"-?[0-9.]+", text)]
    assert len(cells) > 50
    assert not [text for text in cells if "." in text and len(text.split(".")[-1].lstrip("0")) > 7]


def test_what_is_in_json_only_is_on_the_page_in_another_shape(navigated):
    def hidden(section: Section):
        if section.show == "json":
            yield section.key or section.items[0].key
        else:
            yield from (key for part in section.parts for key in hidden(part))

    assert {key for section in navigated.page().sections for key in hidden(section)} == {
        *("reference", "all", "static", "moving", "imu", "gps", "configuration", "smoothed"),
    }


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_name_anywhere_adds_no_element(navigated, tmp_path, name):
    harmless, hostile = (html_of(planted(navigated, text), tmp_path) for text in ("name", name))
    assert skeleton(Dom(hostile)) == skeleton(Dom(harmless))
    assert "\x1b" not in hostile
    shown = plain_text(name).strip()
    assert sum(shown in text for text in Dom(hostile).text) >= 8  # as text, as it is


def planted(result, name):
    imu = replace(result.inputs["imu"], path=name, columns={name: name}, evidence=(stored(name),))
    run = replace(result.found.run, events=(stored(name, time=1.0),))
    return replace(
        result,
        found=replace(result.found, run=run),
        inputs={"imu": imu, f"{name}2": imu},
        options={"list": [1.0, name], name: name},
        findings=(stored(name),),
    )


def test_nothing_is_fetched_and_no_foreign_script_runs(navigated, tmp_path):
    html = html_of(navigated, tmp_path)
    dom = Dom(html)
    assert not {"link", "iframe", "object", "form"} & {tag for tag, _ in dom.elements}
    assert not [attrs for tag, attrs in dom.elements if "src" in attrs or "href" in attrs]
    policy = next(a["content"] for t, a in dom.elements if a.get("http-equiv") == "Content-Security-Policy")
    assert re.fullmatch(
        r"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src( 'sha256-[\w+/=]{44}'){3}", policy
    )


def test_a_page_of_the_shortest_run_says_so(bare, tmp_path):
    dom = Dom(html_of(result_of(bare), tmp_path))
    assert phrase("run.no_sd") in " ".join(dom.text)


def test_satellites_and_dop_have_a_panel_where_the_log_has_them(navigated):
    found = navigated.found
    panels = {panel.key for panel in navigated.page().panels}
    assert "reception" not in panels
    count = np.full(found.gps.time.size, 9.0)
    seen = replace(navigated, found=replace(found, gps=replace(found.gps, satellites=count)))
    (panel,) = [each for each in seen.page().panels if each.key == "reception"]
    (curve,) = panel.curves
    assert (curve.name, set(curve.y)) == ("satellites", {9.0})


def test_the_map_shows_the_reference(driven, navigated):
    _, _, true = driven
    track = run_panels(navigated.found)[0]
    (drawn,) = [each for each in track.behind if each.name == "reference"]
    north, east, _ = ned_offset(true.lla, navigated.found.best.lla[0]).T
    rows = np.unique(np.linspace(0, len(true.time) - 1, len(drawn.x)).round().astype(int))
    np.testing.assert_allclose(np.column_stack((drawn.x, drawn.y)), np.column_stack((east, north))[rows], atol=0.01)
    blind = replace(navigated.found, errors=None, smoothed_errors=None)
    assert "reference" not in {each.name for each in run_panels(blind)[0].behind}


def test_the_ideal_nis_is_one_in_the_panel_as_in_the_tables(driven, navigated):
    run, _, _ = driven
    (shown,) = [each for each in run_panels(navigated.found) if getattr(each, "key", "") == "nis"]
    drawn = np.concatenate([each.y for each in shown.curves if each.name == "position"])
    assert float(drawn.mean()) == pytest.approx(mean_nis(run, "position"), rel=0.02)
    assert shown.levels[0][0] == pytest.approx(stats.chi2.ppf(0.95, 3) / 3.0, rel=1e-3)
    assert "1 on average" in shown.note
