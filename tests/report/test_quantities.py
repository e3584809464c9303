"""Quantities said once: the same figure as text, on the page and in JSON."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from insnav.findings import Severity
from insnav.messages import phrase
from insnav.quantity import Quantity, key_suffix
from insnav.report.html import page_fragment, page_html
from insnav.report.page import FigureSpec, Page, Section, cell, section_tables
from insnav.report.save import page_facts
from insnav.report.terminal import page_text
from insnav.units import DEG, DEG_PER_H, PPM
from tests.report.conftest import stored

MIND = stored("mind <this>", Severity.WARNING)
BIAS = Quantity("bias", 12.34 * DEG_PER_H, "deg/h", sd=0.4 * DEG_PER_H)


def page() -> Page:
    rows = tuple((Quantity("axis", axis), Quantity("scale", k * 1e-4, "ppm")) for k, axis in enumerate("xyz", 1))
    mixed = ((Quantity("axis", "x"), Quantity("size", 2.0, "V")), (Quantity("axis", "y"), Quantity("size", 3.0, "m")))
    return Page(
        "A bench",
        ("It holds.",),
        (
            Section("gyro", "Gyro", items=(BIAS,), parts=(Section("axes", "Axes", rows=rows),)),
            Section("sizes", "Sizes", rows=mixed, figures=(FigureSpec("empty", "An empty figure", Figure),)),
            Section("raw", items=(Quantity("heading", np.array([1.0, 2.0]) * DEG, "deg"),), show="json"),
        ),
        (MIND,),
    )


def test_units_stand_in_every_key_and_values_are_in_them() -> None:
    facts = page_facts(page())
    assert np.isclose(facts["gyro"]["bias_deg_h"], 12.34)
    assert np.isclose(facts["gyro"]["bias_sd_deg_h"], 0.4)
    assert [row["axis"] for row in facts["gyro"]["axes"]] == ["x", "y", "z"]
    assert np.isclose(facts["gyro"]["axes"][2]["scale_ppm"], 3e-4 / PPM)
    assert facts["sizes"] == [{"axis": "x", "size_V": 2.0}, {"axis": "y", "size_m": 3.0}]
    assert np.allclose(facts["raw"]["heading_deg"], [1.0, 2.0])
    assert facts["findings"] == [MIND.as_dict()]


def test_text_and_page_show_the_same_figures() -> None:
    text = page_text(page())
    assert "bias [deg/h]  12.34 ± 0.40" in text
    assert "scale [ppm]" in text
    assert "2.00 V" in text
    assert "heading" not in text
    tables = [table for section in page().sections for table in section_tables(section, ("all", "page"))]
    assert [table.title for table in tables] == ["Gyro", "Axes", "Sizes"]
    assert tables[2].columns == ("axis", "size")


def test_a_page_escapes_and_needs_its_figures(tmp_path) -> None:
    file = tmp_path / "empty.png"
    file.write_bytes(b"\x89PNG")
    html = page_html(page(), {"empty": file})
    assert "mind &lt;this&gt;" in html
    assert "data:image/png" in html


def test_cells() -> None:
    assert cell(Quantity("a", None, "m")) == "–"
    assert cell(Quantity("a", float("nan"), "m")) == "–"
    assert cell(Quantity("a", True)) == phrase("page.yes")
    assert cell(Quantity("a", 8603.0, sd=4200.0)) == "8600 ± 4200"
    assert cell(Quantity("a", 0.0123456, sd=0.0001)) == "0.01235 ± 0.00010"
    assert cell(Quantity("a", 3)) == "3"
    assert cell(Quantity("a", [1.0, 2.0], "m")) == "1.00, 2.00"
    assert cell(Quantity("a", 1.0, "m", interval=(0.5, 1.5))) == "1.00 (0.500 … 1.50)"
    assert cell(Quantity("a", ("x", "y"))) == "x, y"
    assert cell(Quantity("a", {"rms": 1.0, "max": None, "b\x1b[0m": "c"}, "m")) == "RMS 1.00, max –, b c"
    assert cell(Quantity("a", 100001.04, "s", decimals=1)) == "100001.0"
    assert cell(Quantity("a", ())) == cell(Quantity("a", {})) == "–"


def test_a_mapping_is_columns_of_a_table_and_one_key_in_json() -> None:
    north, east = ({"rms": k * DEG, "max": None} for k in (1.0, 2.0))
    rows = tuple((Quantity("axis", name), Quantity("error", of, "deg")) for name, of in (("N", north), ("E", east)))
    section = Section("errors", "Errors", rows=rows, parts=(Section("", rows=rows[:1]),))
    whole, part = section_tables(section)
    assert whole.columns == ("axis", "error RMS [deg]", "error max [deg]")
    assert whole.rows == (("N", "1.00", "–"), ("E", "2.00", "–"))
    assert part.rows == whole.rows[:1]
    facts = page_facts(Page("", (), (section,), (MIND,), ("by hand",)))
    assert facts["errors"][0] == {"axis": "N", "error_deg": {"rms": 1.0, "max": None}}
    assert len(facts["errors"]) == 2
    assert facts["method"] == ["by hand"]
    assert facts["findings"] == [{"code": "stored.text", "severity": "warning", "values": {"text": "mind <this>"}}]


def test_figures_stand_with_their_section(tmp_path) -> None:
    file = tmp_path / "empty.png"
    file.write_bytes(b"\x89PNG")
    html = page_html(page(), {"empty": file})
    assert html.index("Axes") < html.index("Sizes") < html.index("<img")
    assert page_fragment(page()).count("<img") == 1  # a notebook shows the first figure
    assert "<head" not in page_fragment(page())


def test_suffixes_are_those_of_the_files() -> None:
    wanted = {"deg/sqrt(h)": "_deg_sqrt_h", "m/s^2": "_m_s2", "": "", "1": "", "deg/h": "_deg_h", "%": "_percent"}
    assert {unit: key_suffix(unit) for unit in wanted} == wanted


def test_rows_may_stand_under_their_names_and_a_table_without_rows_is_an_empty_list() -> None:
    rows = tuple((Quantity("axis", axis), Quantity("size", float(k), "m")) for k, axis in enumerate("xy"))
    keyed = Section("sizes", "Sizes", rows=rows, keyed=True)
    nested = Section("", parts=(Section("sizes", items=(Quantity("most", 1.0, "m"),), show="json"),))
    facts = page_facts(Page("A bench", (), (keyed, nested, Section("left_out"))))
    assert facts["sizes"] == {"x": {"size_m": 0.0}, "y": {"size_m": 1.0}, "most_m": 1.0}
    assert facts["left_out"] == []


def test_a_mark_follows_its_value_and_zero_is_exact() -> None:
    assert cell(Quantity("a", 16.2, digits=2, mark="!")) == "16 !"
    assert cell(Quantity("a", 0.0, "m")) == "0"
    assert cell(Quantity("a", 1.0, "m", interval=(0.0, 1.5))) == "1.00 (0 … 1.50)"


def test_an_interval_has_the_digits_of_its_standard_deviation() -> None:
    gain = Quantity("gain", 0.9901, "", sd=2e-4, interval=(0.98970, 0.99050))
    assert cell(gain) == "0.99010 ± 0.00020 (0.98970 … 0.99050)"
