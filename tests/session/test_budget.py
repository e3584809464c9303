"""From the data of a drive to the recorded half of its budget."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from insnav.errors.budget.from_windows import RecordedBudget, WindowSettings
from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, Finding, Severity, of_code
from insnav.imu.specification import PRESETS
from insnav.messages import sentence
from insnav.output.folder import read_facts
from insnav.result import open_result
from insnav.session.drive import load
from tests.shared import verify_folder

WINDOWS = WindowSettings(spacing=15.0)


def recorded(
    imu: Any = "imu.csv",
    gps: Any = "gps.csv",
    ref: Any = None,
    *,
    windows: WindowSettings = WINDOWS,
    length: float = 20.0,
    imu_model: str | None = "automotive",
    **inputs: Any,
) -> RecordedBudget:
    """Windows of a short drive."""
    found = load(imu, gps, ref, imu=imu_model, **inputs).budget(times=(length,), windows=windows).found
    assert found.windows is not None
    return found.windows


def test_from_files_to_a_folder(drive: Path):
    result = load("imu.csv", "gps.csv", imu="automotive").budget(
        times=(10.0, 20.0), windows=replace(WINDOWS, uncalibrated=True)
    )
    assert set(result.inputs) == {"imu", "gps"}
    assert result.found.budget.recorded is not None
    assert result.found.windows is not None
    verify_folder(result.save("budget", figures="png"))
    facts = read_facts(Path("budget"))["recorded_windows"]
    assert facts["calibrated"]["times_s"] == [10.0, 20.0]
    assert facts["uncalibrated"]["windows"] == facts["calibrated"]["windows"] > 3
    again = open_result("budget")
    assert again.summary() == result.summary()
    assert (
        read_facts(again.save("again", figures="none"))["recorded_windows"]
        == read_facts(Path("budget"))["recorded_windows"]
    )
    for name in ("recorded_growth", "recorded_causes", "recorded_regression", "uncalibrated_growth"):
        assert Path(f"budget/figures/{name}.png").stat().st_size > 10_000


def test_a_reference_is_what_it_is_judged_by(drive: Path):
    budget = recorded(ref="ref.csv", ref_sd=(0.01, 0.01))
    assert budget.reference == "the positions of ref.csv (of the IMU)"
    assert not any("withheld" in sentence(note) for note in budget.notes)
    assert np.isfinite(budget.calibrated.windows.error[..., 3:]).all()
    positions = recorded(ref="ref.csv")
    assert np.isnan(positions.calibrated.windows.error[..., 3:]).all()


def test_without_an_imu_file_it_is_said_what_was_assumed(drive: Path):
    (model,) = of_code(recorded(imu_model=None).notes, Code.IMU_MODEL_FROM_REST)
    assert model["preset"] in PRESETS
    assert model.end - model.begin > 5.0
    assert model.severity is Severity.ASSUMPTION


def test_an_imu_file_with_missing_terms_says_which(drive: Path):
    Path("few.toml").write_text('[gyro]\nbias = "50 deg/h"\n[accel]\nrandom_walk = "0.1 m/s/sqrt(h)"\n')
    found = recorded(imu_model="few.toml")
    (absent,) = of_code((each for each in found.notes if isinstance(each, Finding)), Code.BUDGET_ABSENT)
    assert {"accel.bias", "gyro.random_walk"} <= set(absent["terms"])


def test_a_bench_needs_no_fixes(at_rest: Path):
    Path("place.csv").write_text(
        "time_s,lat_deg,lon_deg,height_m,vn_m_s,ve_m_s,vd_m_s\n0.0,48.0,11.0,500.0,0,0,0\n600.0,48.0,11.0,500.0,0,0,0\n"
    )
    found = recorded(at_rest, None, "place.csv", imu_model="tactical")
    assert (found.calibrated.windows.motion == "static").all()
    assert found.calibrated.growth.largest[-1, 5] < 1.0
    assert any(of_code(found.notes, Code.GPS_FROM_REFERENCE))
    with pytest.raises(ConfigError, match=r"align.no_position"):
        recorded(at_rest, None, imu_model="tactical")


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"length": 5.0}, ConfigError, "budget.window_length"),
        ({"length": 290.0}, InputError, "outage.drive_too_short"),
        ({"windows": replace(WINDOWS, spacing=-3.0)}, ConfigError, "budget.window_spacing"),
        ({"windows": replace(WINDOWS, spacing=1e-9)}, ConfigError, "budget.window_spacing"),
        ({"windows": replace(WINDOWS, first=-3.0)}, ConfigError, "budget.window_first"),
        ({"windows": replace(WINDOWS, replicas=1)}, ConfigError, "few_replicas"),
        ({"ref_sd": 0.0}, ConfigError, "input.bad_ref_sd"),
        ({"lever_arm": (1.0, 2.0)}, ConfigError, "input.not_a_vector"),
    ],
)
def test_what_cannot_be_meant_is_refused(drive: Path, change: dict[str, Any], error: type[Exception], words: str):
    with pytest.raises(error, match=words):
        recorded(**change)


def test_a_smoothed_start_is_said_not_to_be_independent(drive: Path):
    found = recorded(windows=replace(WINDOWS, start="smoothed"))
    assert any(of_code((each for each in found.notes if isinstance(each, Finding)), Code.BUDGET_SMOOTHED_START))
