"""What was detected in a run is the same when the run is saved and opened again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insnav.errors.evaluated_run import judged
from insnav.findings import Code, Finding, Severity, is_shown
from insnav.imu import load_imu
from insnav.messages import sentence
from insnav.output import solution_tables
from insnav.output.folder import read_facts
from insnav.report.page import Page
from insnav.result import Result, open_result
from tests.report.conftest import READING

FROM_REST = Finding.of(Code.IMU_MODEL_FROM_REST, 0.1, 299.9, gyro_noise_rad_sqrt_s=9e-5, preset="consumer")
OF_DRIVE = (
    Finding.of(Code.REF_NOT_FIXED, subject="ref", count=3),
    Finding.of(Code.IMU_MODEL_KEPT, subject="imu", model="consumer"),
    replace(FROM_REST, severity=Severity.NOTE),
)
OF_RUN = (
    Finding.of(Code.ROWS_CUT, 9.0, subject="imu", file="imu.csv", line=77),
    Finding.of(Code.ROWS_GAP, 70.0, subject="imu", gap_s=2.5, limit_s=0.01, missing=250),
    Finding.of(Code.IMU_STUCK, 12.3456789, 15.4, subject="gyro x", duration_s=3.0543211),
    Finding.of(Code.IMU_STUCK, 112.0, 114.0, subject="gyro x", duration_s=2.0),
    Finding.of(Code.CHANGE_GYRO_BIAS, 200.0, subject="gyro z", rate_rad_s=0.01, sd_rad_s=np.nan),
    Finding.of(Code.FILTER_PART, 0.0, 300.0, gap_s=np.nan, limit_s=3.0, number=1),
    Finding.of(Code.ALIGN_HEADING_COURSE, 5.0, sd_rad=np.inf),
    Finding.of(Code.RECORD_DRIFT, 139.0, 199.0, subject="gps", distance_m=58.14),
    Finding.of(Code.REF_GEOID, subject="ref", height_m=47.0),
    Finding.of(Code.FILTER_DIVERGED, 60.0, 120.0, subject="position", nis=6.0, limit_nis=3.0),
    Finding.of(Code.STORED_TEXT, 130.0, subject="=a formula", text="-1 or +1"),
    Finding.of(Code.MOUNTING_DOUBTED, 1.0, subject="imu", count=2),
)


def known(findings: tuple[Finding, ...]) -> set[tuple[object, ...]]:
    """Findings without their times, which are rounded; infinite numbers are unknown ones in files."""
    return {
        (each.code, each.subject, each.severity, str([(n, None if v == np.inf else v) for n, v in each.values])
         .replace("nan", "None"))
        for each in findings
    }  # fmt: skip


@pytest.fixture
def warned(navigated: Result) -> Result:
    """A run of which there is something to say of every severity, timed and not."""
    solution = navigated.found.run.solution
    lost = replace(solution, sd=solution.sd + np.r_[2000.0, 1500.0, np.zeros(7)])
    run = replace(navigated.found.run, solution=lost, events=(*navigated.found.run.events, *OF_RUN))
    chosen = Finding.of(Code.IMU_MODEL_ESTIMATED, prior="consumer")
    result = replace(
        navigated,
        found=replace(navigated.found, run=run),
        inputs=READING,
        options={},
        imu_model=(load_imu("consumer"), chosen),
        findings=(*OF_DRIVE, *run.events, chosen),
    )
    return judged(result, result.found)


def lists(page: Page) -> tuple[tuple[str, ...], ...]:
    return page.warnings, page.assumptions, page.notes


@pytest.mark.parametrize("table_format", ["csv", "parquet"])
def test_a_run_with_warnings_has_the_same_findings_again(warned: Result, tmp_path: Path, table_format: str):
    assert {each.severity for each in warned.findings} == set(Severity)
    again = open_result(warned.save(tmp_path / "run", figures="none", table_format=table_format))
    assert known(again.findings) == known(warned.findings)
    assert len(again.findings) == len(warned.findings)
    assert known(again.found.run.events) == known(warned.found.run.events)
    assert lists(again.page()) == lists(warned.page())
    assert again.page().verdict == warned.page().verdict
    assert again.imu_model is not None
    assert again.imu_model[1].code is Code.IMU_MODEL_ESTIMATED
    twice = open_result(again.save(tmp_path / "twice", figures="none"))
    assert twice.findings == again.findings


def test_the_page_and_its_facts_list_the_same_and_the_table_of_events_the_rest(warned: Result, tmp_path: Path):
    facts = read_facts(warned.save(tmp_path / "run", figures="none"))
    assert [Finding.from_dict(each) for each in facts["findings"]] == [
        Finding.from_dict(each.as_dict()) for each in warned.findings if is_shown(each)
    ]
    shown = {each["code"] for each in facts["findings"]}
    assert {"run.unknown", "run.stuck", "run.gaps", "run.diverged", "rows.cut", "filter.part"} <= shown
    assert not {"imu.stuck", "rows.gap", "filter.diverged", "gate.position"} & shown
    assert facts["events"]["gate.position"] == 3
    severities = [each["severity"] for each in facts["findings"]]
    assert severities[0] == "unusable"
    assert severities == sorted(severities, key=["unusable", "warning", "assumption", "note"].index)


def test_a_file_that_is_cut_off_is_a_warning_of_the_page(warned: Result):
    (cut,) = [each for each in warned.page().findings if each.code is Code.ROWS_CUT]
    assert sentence(cut) in warned.page().warnings


def test_the_table_of_events_is_read_once(warned: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    where, reads = warned.save(tmp_path / "run", figures="none"), []
    read = solution_tables.pa.csv.read_csv
    monkeypatch.setattr(solution_tables.pa.csv, "read_csv", lambda path, **how: reads.append(path) or read(path, **how))
    open_result(where)
    assert reads.count(where / "events.csv") == 1
