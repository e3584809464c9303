"""A run that version 0.2 saved opens: what it said in texts are findings, its figures are those it had."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insnav.findings import Code, Severity, of_code
from insnav.messages import phrase, render, word
from insnav.output.folder import read_facts
from insnav.report.save import _of_version_0_2
from insnav.result import open_result

FOLDER = Path(__file__).parent / "stored_0_2"
TEXTS = {"warnings": Severity.WARNING, "assumptions": Severity.ASSUMPTION, "notes": Severity.NOTE}


def test_its_texts_are_findings_of_their_severity():
    facts, result = read_facts(FOLDER), open_result(FOLDER)
    said = [(each.severity, each["text"]) for each in of_code(result.findings, Code.STORED_TEXT) if not each.timed]
    assert said == [(severity, text) for name, severity in TEXTS.items() for text in facts[name]]
    assert [len(facts[name]) for name in TEXTS] == [4, 2, 9]
    page = result.page()
    for name in TEXTS:
        assert getattr(replace(page, method=()), name) == tuple(facts[name])
    assert page.verdict is not None
    assert (page.verdict.light, page.verdict.reason) == ("attention", "4 warnings")
    assert result.imu_model is not None
    spec, chosen = result.imu_model
    assert (spec.name, chosen["text"]) == (facts["imu_model"]["name"], facts["imu_model"]["chosen"])
    assert [each["text"] for each in result.inputs["imu"].evidence] == facts["input"]["imu"]["evidence"]


def test_its_events_keep_their_kind_number_and_text():
    events = open_result(FOLDER).found.run.events
    assert [each.severity for each in events] == [Severity.NOTE] * 11
    (stuck,) = of_code(events, Code.IMU_STUCK)
    assert (stuck.begin, stuck.value) == (300.0, 2.99)
    assert render(stuck).text == "gyro z does not change: taken out, bridged like a data gap"
    assert len(list(of_code(events, Code.GATE_RECORD_POSITION))) == 5
    unknown = [each for each in of_code(events, Code.STORED_TEXT) if each.begin == 140.0]
    assert [each.value for each in unknown] == [58.141456346]
    assert render(unknown[0]).text.startswith("positions drift from t = 140.0 to 200.0 s")


def test_its_figures_of_merit_are_those_of_its_tables():
    result = open_result(FOLDER)
    found, page = result.found, result.page()
    assert list(found.known_errors) == ["smoothed", "filtered"]
    values = {each.key: each.value for each in page.merits}
    errors = found.smoothed_errors
    assert values["horizontal"] == pytest.approx(np.sqrt(np.mean(errors.horizontal**2)), rel=1e-12)
    assert values["vertical"] == pytest.approx(np.sqrt(np.mean(errors.position[:, 2] ** 2)), rel=1e-12)
    assert values["horizontal"] == pytest.approx(44.7, rel=0.2)  # every 150th row of what it was
    assert values["inside_3_sd"] == 1.0
    assert f"{phrase('run.error_of', part=word('horizontal'))} [m]" in result.summary()


def test_pages_that_make_their_assumptions_again_do_not_say_them_twice():
    facts = {name: [name] for name in TEXTS}
    for kind, kept in (("run", [*TEXTS]), ("outage", ["warnings", "notes"]), ("budget", ["notes"])):
        found = _of_version_0_2(kind, facts)
        assert [(each["text"], each.severity) for each in found] == [(name, TEXTS[name]) for name in kept]


def test_it_is_saved_and_opened_again(tmp_path: Path):
    once = open_result(FOLDER)
    again = open_result(once.save(tmp_path / "again", figures="none"))
    assert again.findings == once.findings
    assert again.found.run.events == once.found.run.events
    assert again.imu_model[1] == once.imu_model[1]
    assert again.inputs == once.inputs
    assert again.page().merits == once.page().merits
    facts = read_facts(tmp_path / "again")
    assert facts["schema"] == "2.0"
    assert len(facts["findings"]) == 15
    assert not TEXTS.keys() & facts.keys()
