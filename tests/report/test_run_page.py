"""The page is one file that shows everything, runs nothing, fetches nothing and obeys no name."""

from __future__ import annotations

from html.parser import HTMLParser

import pytest

from insnav.plain_text import plain_text
from insnav.report.run.page import page_html, write_page
from insnav.report.run.quantities import run_facts

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


@pytest.fixture
def figure(tmp_path):
    path = tmp_path / "track.png"
    path.write_bytes(b"\x89PNG")
    return path


def skeleton(dom):
    return [(tag, sorted(attrs)) for tag, attrs in dom.elements]


def test_the_page_shows_accuracy_figures_and_every_section(facts, figure):
    dom = Dom(page_html(facts, [figure], title="drive.csv"))
    assert dom.open == []
    text = " ".join(" ".join(dom.text).split())
    for words in (
        "CEP50",
        "horizontal [m]",
        "drive.csv",
        "gravity is 9.81 at rest",
        "heading is not observable",
    ):
        assert words in text
    assert "gyro bias [deg/h]" in text
    (image,) = [attrs for tag, attrs in dom.elements if tag == "img"]
    assert image["src"] == "data:image/png;base64,iVBORw=="
    assert image["alt"]


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_name_anywhere_adds_no_element(driven, facts, figure, name):
    harmless = page_html({**facts, **planted("name")}, [figure], title="name")
    hostile = page_html({**facts, **planted(name)}, [figure], title=name)
    assert skeleton(Dom(hostile)) == skeleton(Dom(harmless))
    assert "\x1b" not in hostile
    shown = plain_text(name).strip()
    assert sum(shown in text for text in Dom(hostile).text) >= 8  # as text, as it is


def planted(name):
    return {
        "input": {name: {"path": name, "columns": {name: name}, "evidence": [name]}},
        "configuration": {"list": [1.0, name], name: name},
        "warnings": [name],
        "events": {name: 1},
    }


def test_nothing_is_fetched_and_nothing_runs(facts, figure):
    html = page_html(facts, [figure], title="x")
    dom = Dom(html)
    assert not {"script", "link", "iframe", "object", "form"} & {tag for tag, _ in dom.elements}
    assert all(attrs.get("src", "data:").startswith("data:") for _, attrs in dom.elements)
    assert "http://" not in html
    assert "https://" not in html
    policy = next(a["content"] for t, a in dom.elements if a.get("http-equiv") == "Content-Security-Policy")
    assert policy == "default-src 'none'; style-src 'unsafe-inline'; img-src data:"


def test_a_page_of_the_shortest_run_says_so(bare, tmp_path):
    path = write_page(tmp_path / "report.html", run_facts(bare, reading={}, configuration={}), [], title="short")
    dom = Dom(path.read_text(encoding="utf-8"))
    assert "No reference was given." in dom.text
