"""What stands out in a fleet, and the noise of its vehicles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.fleet.batch import Navigated
from insnav.messages import render, sentence
from insnav.report.fleet.page import OUTLIER, modified_z, page, rows_of, vehicle_noise
from insnav.result import Result, open_result

HALF = 1.3  # factor of the ends of the intervals
FALSE = Finding.of(Code.RUN_MANY_REJECTED, subject="gps", share=0.2)


def drive(number: int, error: float, noise: float = 0.2, *, vehicle: str = "", light: str = "good") -> Navigated:
    facts = {
        "verdict": {"light": light, "reason": "1 warning"},
        "findings": [Finding.of(Code.GPS_DETECTABLE).as_dict(), FALSE.as_dict()],
        "accuracy": {"all": {"horizontal_m": {"rms": error}}},
        "fixes": {"position": {"processed": 100, "rejected": 1, "nis_mean_per_axis": 1.0 + 0.01 * number}},
        "noise": {
            "gyro_random_walk_deg_sqrt_h": noise,
            "gyro_random_walk_interval_deg_sqrt_h": [noise / HALF, noise * HALF],
            "mean_square": 1.0,
        },
    }
    return Navigated(f"d{number}", vehicle, "", None, facts)


def test_modified_z_is_that_of_the_book():
    # Iglewicz and Hoaglin 1993: 0.6745 (x - median) / MAD; normal numbers have a deviation of one
    values = np.array([2.1, 2.6, 2.4, 2.5, 2.3, 2.1, 2.3, 2.6, 8.2, 8.3]) * 10.0
    median = np.median(values)
    mad = np.median(np.abs(values - median))
    np.testing.assert_allclose(modified_z(values), 0.6745 * (values - median) / mad)
    normal = modified_z(np.random.default_rng(1).normal(5.0, 2.0, 20_000))
    assert np.std(normal) == pytest.approx(1.0, abs=0.03)
    assert np.mean(np.abs(normal) > OUTLIER) < 2e-3
    assert not modified_z(np.array([1.0, 1.0, 50.0])).any()  # a few have no median worth the name


def test_failures_and_outliers_come_first():
    rng = np.random.default_rng(2)
    drives = [drive(n, float(np.exp(0.3 * rng.normal()))) for n in range(12)]
    drives += [drive(12, 30.0), drive(13, 1.0, light="attention")]
    drives.append(Navigated("lost", "", "", InputError("format.empty")))
    rows = rows_of(drives)
    assert [row.drive.name for row in rows[:3]] == ["lost", "d13", "d12"]
    assert [row.drive.name for row in rows if row.stands_out] == ["d12"]
    assert rows[1].reason == f"1 warning ({render(FALSE).title})"
    assert rows[2].stands_out == "horizontal error RMS"
    left_out = Finding.of(Code.BATCH_NO_RECORDING, subject="photo.dat", cause=InputError("format.empty").facts)
    shown = page(Result("fleet", tuple(drives), findings=(left_out,)))
    assert shown.verdict is not None
    assert shown.verdict.light == "bad"
    assert shown.verdict.reason == "1 of 15 drives failed or are not to be relied on"
    assert shown.findings == (left_out,)
    assert shown.notes == (sentence(left_out),)
    assert "photo.dat" in shown.notes[0]


def test_noise_of_a_vehicle_is_the_weighted_mean_of_its_drives():
    rows = rows_of(
        [drive(1, 1.0, 0.2, vehicle="van"), drive(2, 1.0, 0.21, vehicle="van"), drive(3, 1.0, 0.9), drive(4, 1.0, 0.1)]
    )
    found = vehicle_noise(rows)
    assert found.keys() == {"van", "d3", "d4"}
    (van,) = found["van"]
    degrees = np.deg2rad(1.0) / 60.0
    assert van.value == pytest.approx(np.sqrt(0.2 * 0.21) * degrees)
    assert van.interval[1] / van.value == pytest.approx(HALF ** (1.0 / np.sqrt(2.0)), rel=1e-6)


def test_the_interval_of_a_vehicle_covers_the_truth_also_where_drives_differ_more_than_stated():
    rng = np.random.default_rng(3)
    inside = 0
    for _ in range(300):
        noise = 0.2 * np.exp(0.5 * rng.normal(size=8))  # scattered by much more than the intervals of 0.13
        drives = [drive(n, 1.0, float(each), vehicle="van") for n, each in enumerate(noise)]
        ((mean,),) = vehicle_noise(rows_of(drives)).values()
        low, high = mean.interval
        inside += low < 0.2 * np.deg2rad(1.0) / 60.0 < high
    assert 0.85 < inside / 300 < 0.98  # 0.95 of a normal mean, less for a deviation from eight drives


def test_a_fleet_is_opened_again(tmp_path: Path):
    """With a drive that failed, whose error comes back."""
    lost = Navigated("lost", "", "", InputError("format.empty"))
    left_out = Finding.of(Code.BATCH_NO_RECORDING, subject="photo.dat", cause=InputError("format.empty").facts)
    result = Result("fleet", (drive(1, 2.0), lost), options={"drives": "."}, findings=(left_out,))
    again = open_result(result.save(tmp_path / "fleet"))
    assert again.summary() == result.summary()
    assert again.findings == (left_out,)
    assert str(again.found[1].failed) == str(lost.failed)
    assert list(again.to_frame()["drive"]) == ["lost", "d1"]
    assert "Fleet of 2 drives" in again._repr_html_()
