"""From files and options to the recorded half of a budget."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from insnav.cli.budget_recorded import RecordedOptions, StartFrom, recorded

from insnav.exceptions import ConfigError, InputError
from insnav.output.folder import RunFolder, read_facts, verify_folder
from insnav.report.budget.windows import recorded_sheet
from insnav.report.budget.windows_quantities import recorded_facts
from insnav.report.sheet import write_sheet

QUICK = RecordedOptions(
    Path("imu.csv"), Path("gps.csv"), imu="automotive", window=20.0, spacing=15.0, twins=0, workers=1
)


def silent(name: str, fraction: float | None = None) -> None:
    pass


def test_from_files_to_a_folder(drive: Path):
    stages: list[str] = []

    def stage(name: str, fraction: float | None = None) -> None:
        if name not in stages:
            stages.append(name)

    found = recorded(replace(QUICK, raw=True), stage)
    assert stages == ["reading", "aligning", "navigating"]
    assert found.name == "imu.csv"
    assert set(found.readings) == {"imu", "gps"}
    with RunFolder(Path("budget"), force=False) as folder:
        write_sheet(folder, recorded_sheet(found.budget, found.name), recorded_facts(found.budget))
    verify_folder(Path("budget"))
    facts = read_facts(Path("budget"))
    assert facts["calibrated"]["times_s"] == [10.0, 20.0]
    assert facts["raw"]["windows"] == facts["calibrated"]["windows"] > 3
    for name in ("recorded_growth", "recorded_causes", "recorded_regression", "raw_growth"):
        assert Path(f"budget/figures/{name}.png").stat().st_size > 10_000


def test_a_reference_is_what_it_is_judged_by(drive: Path):
    found = recorded(replace(QUICK, ref=Path("ref.csv"), ref_sd="0.01,0.01"), silent)
    assert found.budget.reference == "the positions of ref.csv"
    assert not any("withheld" in note for note in found.budget.notes)
    assert np.isfinite(found.budget.calibrated.windows.error[..., 3:]).all()
    positions = recorded(replace(QUICK, ref=Path("ref.csv")), silent)
    assert np.isnan(positions.budget.calibrated.windows.error[..., 3:]).all()


def test_without_an_imu_file_it_is_said_what_was_assumed(drive: Path):
    found = recorded(replace(QUICK, imu=None), silent)
    assert any("IMU file: none was given" in note for note in found.budget.notes)


def test_an_imu_file_with_missing_terms_says_which(drive: Path):
    Path("few.toml").write_text('[gyro]\nbias = "50 deg/h"\n[accel]\nrandom_walk = "0.1 m/s/sqrt(h)"\n')
    found = recorded(replace(QUICK, imu="few.toml"), silent)
    (note,) = [text for text in found.budget.notes if text.startswith("The IMU file does not give")]
    assert "accel.bias" in note
    assert "gyro.random_walk" in note
    assert "taken as zero" in note


def test_a_bench_needs_no_fixes(at_rest: Path):
    Path("place.csv").write_text(
        "time_s,lat_deg,lon_deg,height_m,vn_m_s,ve_m_s,vd_m_s\n0.0,48.0,11.0,500.0,0,0,0\n600.0,48.0,11.0,500.0,0,0,0\n"
    )
    options = replace(QUICK, imu_file=at_rest, gps=None, ref=Path("place.csv"), imu="tactical")
    found = recorded(options, silent)
    assert (found.budget.calibrated.windows.motion == "static").all()
    assert found.budget.calibrated.growth.largest[-1, 5] < 1.0
    assert any("never moves" in note for note in found.budget.notes)
    with pytest.raises(ConfigError, match="nothing tells where the vehicle was"):
        recorded(replace(options, ref=None), silent)


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"window": 5.0}, ConfigError, "make no budget"),
        ({"window": 290.0}, InputError, "too short for windows"),
        ({"spacing": -3.0}, ConfigError, "apart"),
        ({"spacing": 1e-9}, ConfigError, "apart"),
        ({"first": -3.0}, ConfigError, "first window"),
        ({"workers": 0}, ConfigError, "processes"),
        ({"twins": 1}, ConfigError, "make no band"),
        ({"ref_sd": "0"}, ConfigError, "above zero"),
        ({"lever_arm": "1,2"}, ConfigError, "3 numbers"),
    ],
)
def test_what_cannot_be_meant_is_refused(drive: Path, change: dict[str, object], error: type[Exception], words: str):
    with pytest.raises(error, match=words):
        recorded(replace(QUICK, **change), silent)


def test_a_smoothed_start_is_said_not_to_be_independent(drive: Path):
    found = recorded(replace(QUICK, start=StartFrom.smoothed), silent)
    assert any(note.startswith("Not independent") for note in found.budget.notes)
