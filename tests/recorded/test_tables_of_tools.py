"""Tables as the tools of practitioners write them: what is read of each, beside what its author wanted."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import insnav
from insnav.findings import Code
from insnav.imu import load_imu
from insnav.session.read import read
from insnav.steps import Recording
from insnav.steps.inputs import Inputs
from insnav.units import DEG
from tests.shared import SHARED

CASES = SHARED / "cases"
PER_H = 60.0  # rad/sqrt(s) to rad/sqrt(h)


class Case(NamedTuple):
    """One input: what is made of it, what its author wanted, and why it fails, if it does."""

    name: str
    found: Callable[[Path], Any]
    wanted: Any
    fails: str = ""


def _drive(imu: str, gps: str | None = None) -> Callable[[Path], Recording]:
    return lambda folder: read(folder / imu, None if gps is None else folder / gps, None, Inputs())


def _clocks(imu: str, gps: str | None = None) -> Callable[[Path], list[float]]:
    """First time and rate of the samples; first time and number of the fixes."""

    def found(folder: Path) -> list[float]:
        drive = _drive(imu, gps)(folder)
        assert drive.gps is not None
        samples, fixes = drive.imu.facts, drive.gps.facts
        return [samples.start_s, samples.rate_hz, fixes.start_s, float(fixes.n_used)]

    return found


def _height(imu: str, gps: str | None = None) -> Callable[[Path], float]:
    def found(folder: Path) -> float:
        drive = _drive(imu, gps)(folder)
        assert drive.gps is not None
        assert drive.gps.facts.height == "ellipsoidal"
        return float(drive.gps.data.lla[0, 2])

    return found


def _noise(file: str, column: int, **inputs: Any) -> Callable[[Path], float]:
    """Random walk of a gyro [deg/sqrt(h)]."""

    def found(folder: Path) -> float:
        model = insnav.allan(folder / file, **inputs).found.models[column]
        assert model is not None
        return float(model.coefficients["N"].value) * PER_H / DEG

    return found


def _has_velocities(folder: Path) -> bool:
    drive = _drive("drive.bag")(folder)
    assert drive.gps is not None
    return bool(np.isfinite(drive.gps.data.v_n).any())


def _heading_offset(folder: Path) -> float:
    """By how much headings that count counter-clockwise are off north [deg]."""
    drive = insnav.load(folder / "imu.csv", folder / "gps.csv", gps_heading_sd=0.5 * DEG, lever_arm=(0.8, -0.3, -1.2))
    (turned,) = (note for note in drive.notes if note.code is Code.GPS_HEADING_COUNTER_CLOCKWISE)
    return float(turned["offset_rad"]) / DEG


def _sign_is_changed(folder: Path) -> bool:
    notes = insnav.load(folder / "sensorlog.csv").notes
    return any(note.code is Code.AXES_ACCEL_REVERSED for note in notes)


def _kalibr(folder: Path) -> list[float]:
    spec = load_imu(str(folder / "imu.yaml"))
    return [spec.accel.random_walk[0], spec.accel.rate_random_walk[0], spec.gyro.random_walk[0]]


def _calibrated(folder: Path) -> float:
    errors = insnav.calibrate("accel", folder / "positions.csv").found.errors
    assert errors is not None
    return float(errors.accel_matrix[2, 2])


COUNTS = {"units": "counts/(deg/s)=131,counts/g=16384"}
TABLES = (
    Case("01_gps_secs_nsecs", _clocks("imu.csv", "gps.csv"), [1711483461.504, 40.58, 1711483462.0, 95]),
    Case("02_bagpy_time_and_nsecs", _clocks("imu.csv", "gps.csv"), [1711483461.504, 40.58, 1711483462.24, 95]),
    Case("04_ios_accel_sign", _sign_is_changed, True),
    Case("06_bag_body_velocity", _has_velocities, False),
    Case("07_one_file_no_height", _clocks("log.csv"), [100000.04, 25.0, 100000.04, 100]),
    Case("08_gnss_ins_sim_folder", _clocks("data"), [0.04, 25.0, 1.0, 90]),
    Case("10_allan_one_axis", _noise("fog.csv", 2), 0.0050),
    Case("12_allan_z_up", _noise("static.csv", 0), 0.69),
    Case("14_gopro_tables", _clocks("."), [0.0, 100.0, 0.99, 21]),
    Case("16_two_antenna_heading_enu", _heading_offset, -90.0),
    Case("18_six_positions_matrix", _calibrated, 1.02195),
    Case("f01_allan_deg_s_unlabelled", _noise("static.csv", 0), 0.30),
    Case("f03_ulog_alt_ellipsoid", _height("log_sensor_combined_0.csv", "log_vehicle_gps_position_0.csv"), 1.141),
    Case("f05_androsensor", _clocks("Sensor_record.csv"), [0.1, 10.0, 0.1, 70]),
    Case("f07_movella_dot", _clocks("DOT_1.csv", "gps.csv"), [300.1, 10.0, 301.0, 258]),
    Case("f08_mavlogdump_instances", _clocks("IMU.csv", "GPS.csv"), [60.1, 10.0, 61.0, 258]),
    Case("f10_gopro_csv", _clocks("."), [0.1, 10.0, 1.0, 258]),
    Case("f13_mip_monitor", _clocks("imu.csv", "gnss.csv"), [252818.1, 10.0, 252819.0, 258]),
    Case("f16_raw_counts_allan", _noise("raw.csv", 0, **COUNTS), 0.30),
    Case("f17_kalibr_yaml", _kalibr, [0.002, 0.0002, 0.00017]),
    Case("unit_empty_list", _clocks("imu.csv.gz", "gps.csv"), [0.01, 100.0, 1.0, 258]),
)


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=case.name, marks=pytest.mark.xfail(strict=True, reason=case.fails) if case.fails else ())
        for case in TABLES
    ],
)
def test_a_table_is_read_as_its_author_wanted(case: Case) -> None:
    if not (CASES / case.name).is_dir():
        pytest.skip("the tables are not beside the project (../shared/cases)")
    found = case.found(CASES / case.name)
    assert found == pytest.approx(case.wanted, rel=1e-9 if isinstance(found, bool) else 0.05, abs=1e-9)
