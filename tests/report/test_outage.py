"""The page of an outage test: its sentence, its light, its drawings."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insnav.errors.evaluated_run import EvaluatedRun, judged
from insnav.errors.outage.gnss_outage import OutageStudy, outage_growth
from insnav.findings import Code, Finding, Severity
from insnav.messages import phrase, render, sentence
from insnav.report.page import Page, section_tables
from insnav.report.save import page_facts
from insnav.report.style import number
from insnav.report.terminal import table_text
from insnav.result import Result, open_result
from tests.errors.outage.test_statistics import outage_windows


def page_of(sd: float = 3.0, reference_sd: float = 0.1) -> Page:
    error = np.random.default_rng(1).standard_normal((60, 6)) * 3.0
    windows = outage_windows(error, sd, reference_sd, 60)
    short = [replace(each, length=5.0) for each in windows]
    study = OutageStudy((*short, *windows), tuple(outage_growth([*short, *windows])), "the truth")
    return Result("outage", study).page()


@pytest.mark.parametrize(("sd", "light"), [(3.0, "good"), (1.3, "attention"), (0.5, "bad")])
def test_the_light_is_that_of_the_stated_sd(sd: float, light: str):
    said = page_of(sd).verdict
    assert said.light == light
    assert said.sentence.startswith("After 10 s without GPS, the horizontal error is ")
    assert f"The filter predicts {number(sd * np.sqrt(2.0))} m." in said.sentence
    for sentence_of_it in said.sentence.replace("GPS, ", "GPS ").split(". "):
        assert len(re.findall(r"[\d.]+ m\b", sentence_of_it)) == 1


def test_windows_of_every_length_are_judged():
    error = np.random.default_rng(1).standard_normal((60, 6)) * 3.0
    short, long = outage_windows(error, 3.0, 0.1, 60), outage_windows(error, 1.9, 0.1, 60)
    growth = (*outage_growth(short), *(replace(each, times=6.0 * each.times) for each in outage_growth(long)))
    said = Result("outage", OutageStudy((*short, *long), growth, "the truth")).page().verdict
    ratio = growth[-1].rms[-1, :2] / np.hypot(growth[-1].predicted[-1, :2], growth[-1].reference[-1, :2])
    which = ("horizontal", "vertical")[np.argmax(ratio)]
    assert said.light == "attention"
    assert said.reason.startswith(f"after 60 s the {which} errors are {max(ratio):.2f} times as large as predicted")


def test_the_vertical_is_judged_too():
    error = np.random.default_rng(1).standard_normal((60, 6)) * [3.0, 3.0, 5.4, 3.0, 3.0, 5.4]
    windows = outage_windows(error, 3.0, 0.1, 60)
    said = Result("outage", OutageStudy(windows, tuple(outage_growth(windows)), "the truth")).page().verdict
    assert said.light == "attention"
    assert "s the vertical errors are 1." in said.reason


def test_raw_and_corrected_stand_side_by_side():
    page = page_of(reference_sd=2.0)
    (table,) = (t for s in page.sections for t in section_tables(s, ("all", "page")) if t.title.startswith("Vert"))
    assert table.title == "Vertical error [m]; reference 2.00 m, 1 sd"
    row = dict(zip(table.columns, table.rows[-1], strict=True))
    assert float(row["RMS"]) ** 2 - 2.0**2 == pytest.approx(float(row["corrected (95 %)"].split()[0]) ** 2, rel=0.02)
    assert "Without the error of the reference, it is" in page.verdict.sentence
    assert all(len(line) <= 80 for table in section_tables(page.sections[3]) for line in table_text(table).splitlines())
    facts = page_facts(page_of(reference_sd=2.0))["outages"][-1]["vertical_m"]
    assert facts["rms"] > facts["rms_corrected"] > facts["rms_corrected_low"]


def test_the_spread_of_the_windows_is_drawn_behind_the_sums():
    panels = page_of().panels
    assert [panel.key for panel in panels] == ["outage_horizontal", "outage_vertical"]
    kinds = [curve.kind for curve in panels[0].curves]
    assert kinds[:3] == ["band", "band", "line"]
    # the errors of 60 windows are Rayleigh with 3 m: their median is 3 sqrt(2 ln 2)
    wide, narrow, median = panels[0].curves[:3]
    assert median.y[-1] == pytest.approx(3.0 * np.sqrt(2.0 * np.log(2.0)), rel=0.25)
    for band, share in ((wide, 0.95), (narrow, 0.75)):
        assert band.y[-1] == pytest.approx(3.0 * np.sqrt(-2.0 * np.log(1.0 - share)), rel=0.25)
    assert panels[0].curves[-1].text[-1].startswith("smoothed, 10 s: ")


@pytest.mark.parametrize("table_format", ["csv", "parquet"])
def test_a_saved_outage_test_is_opened_again(tmp_path: Path, table_format: str):
    error = np.random.default_rng(1).standard_normal((30, 6)) * 3.0
    windows = outage_windows(error, 3.0, 0.1, 30)
    unknown = replace(windows[3], error=np.where(np.arange(6) == 4, np.nan, windows[3].error))
    windows[3] = unknown
    made = Result("outage", OutageStudy(tuple(windows), tuple(outage_growth(windows)), "the truth"))
    again = open_result(made.save(tmp_path / "outage", table_format=table_format))
    assert again.found.reference == "the truth"
    assert len(again.found.windows) == 30
    np.testing.assert_allclose(again.found.windows[3].error, unknown.error, atol=1e-5)
    # the arch of these smoothed errors has two epochs of the same sd: either may be the largest
    before, after = (each.found.growth[0].corrected[:, :4] for each in (made, again))
    np.testing.assert_allclose(after, before, rtol=1e-4)
    assert again.page().verdict.light == made.page().verdict.light


def test_smoothed_errors_larger_than_stated_are_no_green_light():
    error = np.random.default_rng(1).standard_normal((60, 6)) * 3.0
    windows = [replace(each, smoothed_sd=0.5 * each.smoothed_sd) for each in outage_windows(error, 3.0, 0.001, 60)]
    said = Result("outage", OutageStudy(tuple(windows), tuple(outage_growth(windows)), "the truth")).page().verdict
    assert said.light != "good"
    assert "smoothed errors" in said.reason


def test_aiding_that_continues_without_gps_is_named():
    made = page_of()
    assert not [line for line in made.summary if "continue" in line]
    error = np.random.default_rng(1).standard_normal((60, 6))
    windows = outage_windows(error, 1.0, 0.1, 60)
    study, used = OutageStudy(tuple(windows), tuple(outage_growth(windows)), "it"), (Code.NHC_USED, Code.ZUPT_USED)
    notes = tuple(Finding(each, Severity.NOTE) for each in used)
    assert "Without GPS, NHC and ZUPT continue to aid." in Result("outage", study, findings=notes).page().summary


def test_what_a_run_warns_of_is_said(tmp_path: Path, bare):
    error = np.random.default_rng(1).standard_normal((60, 6)) * 3.0
    windows = outage_windows(error, 3.0, 0.1, 60)
    gyro = Finding.of(Code.STORED_TEXT, 3.0, severity=Severity.WARNING, text="gyro z is off by +1.9 deg/s")
    lost = Finding.of(Code.ROWS_CUT, 9.0, subject="imu", file="imu.csv")
    run = EvaluatedRun(replace(bare, events=(gyro,), gps_delay=0.34, gps_delay_sd=0.01))
    study = OutageStudy(tuple(windows), tuple(outage_growth(windows)), "the truth", run)
    made = judged(Result("outage", study, findings=(gyro, lost)), run)
    again = open_result(made.save(tmp_path / "outage"))
    assert set(again.findings) == set(made.findings)
    for page in (made.page(), again.page()):
        late = Finding.of(Code.RUN_LATE_FIXES, subject="gps", delay_s=0.34)
        assert [each for each in page.findings if each.severity is Severity.WARNING] == [gyro, late, lost]
        assert page.warnings == tuple(map(sentence, (gyro, late, lost)))
        assert page.verdict.light == "attention"
        assert page.verdict.reason == phrase("page.more_warnings", title=render(gyro).title, count=2)


def test_shares_inside_stand_in_order():
    error = np.random.default_rng(1).standard_normal((60, 6)) * 3.0
    short, long = outage_windows(error, 3.0, 0.1, 60), outage_windows(error, 1.3, 0.1, 60)
    long = [replace(each, length=20.0) for each in long]
    windows = (*short, *long)
    first, *_ = Result("outage", OutageStudy(windows, tuple(outage_growth(windows)), "the truth")).page().summary
    least, most = (int(each) for each in first.split(": ")[1].split(" %")[0].split(" to "))
    assert least < most
