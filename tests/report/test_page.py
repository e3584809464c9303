"""A page says the same on the terminal and in a browser, whatever is in its texts."""

from __future__ import annotations

import json
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from insnav.exceptions import ConfigError
from insnav.findings import Code, Finding, Severity
from insnav.messages import phrase, render, sentence
from insnav.output.folder import RunFolder
from insnav.quantity import Quantity
from insnav.report.figures import blank
from insnav.report.page import REPEATED, FigureSpec, Page, Section, Verdict, section_tables
from insnav.report.save import write_page
from insnav.report.terminal import brief_text, hanging, page_text, table_text
from tests.report.conftest import stored
from tests.shared import verify_folder

HOSTILE = '<script>alert(1)</script>"><img src=x onerror=y>\x1b[31m'


def a_page(text: str = "as it is", figures: int = 1) -> Page:
    residual = FigureSpec("residual", text, lambda: blank(4.0, 3.0, "Residual", "note"))
    rows = tuple(
        (Quantity("name", name), Quantity("value", value, "V", digits=4))
        for name, value in (("zero", 0.1957), (text, -12.5))
    )
    section = Section("parameters", "Parameters", rows=rows, figures=(residual,) * figures, note=text)
    return Page("A calibration", (text,), (section,), (stored(text, Severity.WARNING),), (text,))


class Elements(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.text: list[str] = []

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.tags.append(tag)

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def test_terminal_shows_every_text_and_lines_numbers_up() -> None:
    lines = page_text(a_page()).splitlines()
    assert lines[0] == "A calibration"
    rows = [line for line in lines if line.endswith(("0.1957", "-12.50"))]
    assert len(rows) == 2
    assert len({len(row) for row in rows}) == 1
    assert {phrase("page.warnings"), phrase("page.assumptions")} <= {*lines}


def test_a_table_that_is_too_wide_goes_on_below() -> None:
    rows = tuple(tuple(Quantity(f"column_{i}", float(10**i), "m") for i in range(12)) for _ in range(2))
    text = page_text(Page("Wide", ("word " * 40,), (Section("wide", "Wide", rows=rows),)), 60)
    assert max(map(len, text.splitlines())) <= 60
    assert text.count("column 0 [m]") >= 3  # every part names its rows
    assert all(f"column {i} [m]" in text for i in range(12))


@pytest.mark.parametrize(("width", "warnings"), [(80, 0), (160, 2), (60, 3)])
def test_a_short_report_has_whole_lines_and_counts_the_rows_left(width: int, warnings: int) -> None:
    rows = tuple((Quantity("name", f"source {i}"), Quantity("size", 1.0 + i, "m")) for i in range(30))
    table, last = Section("", "Sources", rows=rows, note="largest first"), ["files", "run"]
    found = tuple(Finding.of(code) for code in (Code.BUDGET_NORMAL_GRAVITY, Code.END_OF_RUN_LEVEL, Code.BUDGET_METHODS))
    found = tuple(replace(each, severity=Severity.WARNING) for each in found[:warnings])
    verdict = Verdict("good", "nothing is wrong", "The error is 3 m.")
    page = Page("A budget", ("All is at rest.",), (table, table), found, verdict=verdict)
    lines = brief_text(page, width, last).splitlines()
    assert len(lines) == 15
    assert lines[-2:] == last
    assert max(map(len, lines)) <= width
    head = [*page.summary, verdict.sentence, verdict.rating]
    said = [render(each).title for each in found] if warnings > 2 else [sentence(each) for each in found]
    assert all(each in " ".join(line.strip() for line in lines) for each in (*head, *said))
    long = replace(page, summary=("All is at rest.", "word " * 20 * width))  # it does not fit
    assert brief_text(long, width, last).splitlines() == lines
    shown = sum(line.startswith("  source ") for line in lines)
    assert shown >= 2
    assert phrase("terminal.more_rows", count=30 - shown) in lines[-3]
    assert brief_text(replace(page, sections=(replace(table, rows=rows[:2]),)), width).splitlines()[-1] == (
        "  largest first"
    )


def test_notes_of_one_title_are_listed_up_to_a_number_and_then_counted() -> None:
    code = Code.DEWEIGHTED_POSITION
    notes = tuple(Finding.of(code, float(i), nis=9.0, limit_nis=5.0) for i in range(500))
    page = replace(a_page(), findings=(*notes, Finding.of(Code.ALIGN_HEADING_GIVEN, 1.0, sd_rad=0.1)))
    assert len(page.notes) == REPEATED + 2
    assert page.notes[-1] == phrase("page.more_warnings", title=render(notes[0]).title, count=500 - REPEATED)


def test_terminal_gets_no_escape_codes() -> None:
    assert "\x1b" not in page_text(a_page(HOSTILE))


def test_page_holds_the_tables_and_nothing_foreign(tmp_path: Path) -> None:
    with RunFolder(tmp_path / "out", force=False) as folder:
        where = write_page(folder, a_page(HOSTILE), {"command": "x"}, {"calibration.toml": 'name = "x"\n'})
    page = Elements()
    page.feed((where / "report.html").read_text(encoding="utf-8"))
    assert page.tags.count("img") == 1
    assert "script" not in page.tags
    assert "0.1957" in page.text
    assert (where / "figures/residual.png").stat().st_size > 1000
    assert (where / "calibration.toml").read_text(encoding="utf-8") == 'name = "x"\n'
    facts = json.loads((where / "run.json").read_text(encoding="utf-8"))
    assert facts["command"] == "x"
    assert facts["parameters"][0]["value_V"] == 0.1957
    verify_folder(where)


def test_same_name_twice_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"report.same_name"), RunFolder(tmp_path / "out", force=False) as folder:
        write_page(folder, a_page(figures=2))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("width", [60, 80, 160])
def test_a_column_of_words_is_wrapped_under_itself_and_nothing_is_cut(width: int):
    words = "a reason that has more words than a narrow terminal has room for " * 2
    rows = tuple((Quantity("drive", name), Quantity("reason", words)) for name in ("monday", "tuesday"))
    (table,) = section_tables(Section("drives", "", rows=rows))
    lines = table_text(table, width).splitlines()
    assert max(map(len, lines)) <= width
    assert " ".join(lines).split().count("terminal") == 4
    begin = lines[0].index("reason")
    assert all(line[:begin].strip() in ("", "drive", "monday", "tuesday") for line in lines)


def test_rows_of_a_text_hang_under_its_first_and_words_are_whole():
    shown = hanging(["warning: " + "word " * 60, "  - " + "word " * 60], 80)
    assert max(map(len, shown)) <= 80
    assert {len(line) - len(line.lstrip()) for line in shown[1:4]} == {2}
    assert {len(line) - len(line.lstrip()) for line in shown[-3:]} == {4}
    assert " ".join(shown).split().count("word") == 120
