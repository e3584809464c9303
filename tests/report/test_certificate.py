"""The certificate on paper says what the checks say, also where a figure is no number."""

from __future__ import annotations

import json

import numpy as np
import pytest

from insnav.certificate.certify import Certificate
from insnav.certificate.integrators import Check
from insnav.report.certificate.page import certificate_markdown, certificate_panel, page
from insnav.report.figures import draw_drawings, drawing
from insnav.report.page import Page, Table, section_tables
from insnav.report.save import page_facts
from insnav.report.terminal import page_text
from insnav.result import Result

CHECKS = (
    Check("coning", "1 deg, 5 Hz", "deg/h", 0.02, (("polynomial", 0.0145), ("euler", 16.2))),
    Check("poles", "latitude beyond 90 deg", "deg", 0.0, (("polynomial", 0.0), ("euler", np.nan))),
    Check("poles", "rest", "m", 0.01, (("polynomial", np.nan), ("euler", np.inf))),
    Check("platform", "order of convergence", "1", 0.1, (("fourth order", 0.2), ("forward", 0.01))),
    Check("gravity", "equator", "m/s^2", 1e-8, (("insnav", 5.9e-11),)),
)
CERTIFICATE = Certificate(CHECKS, 1.25)


def certificate_page(certificate: Certificate) -> Page:
    return page(Result("certificate", certificate, findings=certificate.findings))


def tables_of(certificate: Certificate) -> list[Table]:
    return [table for section in certificate_page(certificate).sections for table in section_tables(section)]


def test_tables_have_the_columns_of_their_topic():
    tables = {table.title: table for table in tables_of(CERTIFICATE)}
    assert list(tables) == ["coning", "poles", "platform", "gravity"]
    assert tables["coning"].columns == ("case", "result", "limit", "polynomial", "euler")
    assert tables["coning"].rows == (("1 deg, 5 Hz [deg/h]", "passed", "0.02", "0.015", "16 !"),)
    assert tables["poles"].rows[0] == ("latitude beyond 90 deg [deg]", "passed", "0", "0", "– !")
    assert tables["poles"].rows[1] == ("rest [m]", "FAILED", "0.01", "– !", "– !")
    assert tables["platform"].rows == (("order of convergence", "FAILED", "0.1", "0.20 !", "0.010"),)
    assert tables["gravity"].columns == ("case", "result", "limit", "error")


def test_text_begins_with_the_verdict_and_names_what_failed():
    lines = page_text(certificate_page(CERTIFICATE)).splitlines()
    assert lines[0] == "Numerical certificate: 2 FAILED"
    assert "3 of 5 checks passed in 1.2 s" in lines[1]
    for name in ("poles: rest", "platform: order of convergence"):
        assert any(line.startswith("  - ") and name in line for line in lines)


def test_facts_are_json_without_nan():
    facts = page_facts(certificate_page(CERTIFICATE))
    json.dumps(facts, allow_nan=False)
    assert facts["failed"] == ["poles: rest", "platform: order of convergence"]
    assert facts["checks"][2]["errors"] == {"polynomial": None, "euler": None}
    assert facts["checks"][3]["required"] == ["fourth order"]


def test_markdown_has_a_cell_for_everyone():
    lines = certificate_markdown(CERTIFICATE).splitlines()
    assert lines[0] == "| check | limit | insnav | euler | forward |"
    assert lines[1] == "|---|--:|--:|--:|--:|"
    assert lines[2] == "| coning: 1 deg, 5 Hz | 0.02 deg/h | 0.015 | 16 ! |  |"
    assert lines[5] == "| platform: order of convergence | 0.1 | 0.20 ! |  | 0.010 |"


def test_the_panel_has_every_figure_and_reddens_what_failed():
    panel = certificate_panel(CHECKS)
    curves = {curve.name: curve for curve in panel.curves}
    assert curves["insnav: passed"].y.tolist() == [0, 1, 4]
    assert curves["insnav: FAILED"].y.tolist() == [2, 3]
    assert curves["insnav: FAILED"].x[1] == pytest.approx(2.0)
    assert curves["euler"].x[0] == pytest.approx(810.0)
    assert curves["euler"].text[0] == "1 deg, 5 Hz, euler: 16.2 of 0.02 deg/h"
    assert all(np.isfinite(curve.x).all() and (curve.x > 0.0).all() for curve in panel.curves)
    assert panel.rows[4] == "gravity: equator"
    with drawing():
        (axes,) = draw_drawings([panel], "certificate").axes
    assert [label.get_text() for label in axes.get_yticklabels()][4] == "gravity: equator"
    low, high = axes.get_xlim()
    assert all((low < curve.x).all() and (curve.x < high).all() for curve in panel.curves)


def test_where_all_are_judged_the_worst_counts():
    check = Check("platform", "order", "1", 0.1, (("fourth", 0.01), ("mean", 0.3)), required=2)
    facts = page_facts(certificate_page(Certificate((check,), 1.0)))
    assert facts["failed"] == ["platform: order"]
    assert facts["checks"][0]["required"] == ["fourth", "mean"]
    (red,) = (curve for curve in certificate_panel((check,)).curves if curve.name == "insnav: FAILED")
    assert red.x.tolist() == pytest.approx([3.0])


def test_a_certificate_that_passes_has_nothing_red():
    assert "insnav: FAILED" not in {curve.name for curve in certificate_panel(CHECKS[:2]).curves}
    assert certificate_page(Certificate(CHECKS[:2], 1.0)).warnings == ()
