"""Suggested columns are tried before they are printed: a hint that cannot be read is withdrawn."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

import insnav
from insnav.exceptions import InputError
from insnav.findings import Code, Severity, of_code
from tests.input.files import GPS_HEADER, IMU_HEADER, fixes, rolling, write
from tests.refusals import refused

ODD = re.sub(r"gyro_([xyz])_rad_s", r"gyro_\1axis", IMU_HEADER)


def _error(folder, imu, header):
    with refused(InputError, "columns.missing") as caught:
        insnav.load(write(folder / "imu.csv", imu, header), write(folder / "gps.csv", fixes(), GPS_HEADER))
    return caught.value


def test_columns_of_similar_names_are_suggested_if_they_can_be_read(tmp_path):
    error = _error(tmp_path, rolling(), ODD)
    assert error.gives == {"columns": {f"gyro_{axis}": f"gyro_{axis}axis" for axis in "xyz"}}
    assert "gyro_x=gyro_xaxis" in error.fix


def test_columns_that_cannot_be_read_are_withdrawn(tmp_path):
    """The similar columns hold a state that is -999 where unknown."""
    imu = rolling()
    imu[5:9, 1] = -999.0
    error = _error(tmp_path, imu, ODD)
    assert not error.gives
    assert "axis" not in error.fix
    assert "gyro_x" in error.fix


def test_columns_that_lead_to_another_question_stay(tmp_path):
    """Accelerometers in an unstated unit: the columns are right, and the next refusal asks for the unit."""
    imu = rolling()
    imu[:, 4:] /= 9.8
    error = _error(tmp_path, imu, ODD)
    assert set(error.gives) == {"columns"}


def test_a_known_name_is_not_suggested_as_another_quantity(tmp_path):
    rows = np.column_stack([fixes()[:, 0], fixes()[:, 2], fixes()[:, 2], fixes()[:, 3]])
    path = write(tmp_path / "gps.csv", rows, "time,Longitude,GPS Longitude,Altitude")
    with refused(InputError, "columns.missing") as caught:
        insnav.load(write(tmp_path / "imu.csv", rolling(), IMU_HEADER), path)
    assert not caught.value.gives


def test_headings_of_unknown_accuracy_are_named_as_unused():
    """Two antennas, but no --gps-heading-sd: nothing told that the headings were there."""
    drive = insnav.simulate("bends", imu="industrial", gps="dgps", seed=1)
    fixed = replace(drive.gps.data, heading=np.radians(np.linspace(10.0, 20.0, len(drive.gps.data.time))))
    (unused,) = of_code(insnav.load(drive.imu.data, fixed).notes, Code.GPS_HEADING_UNUSED)
    assert (unused.severity, unused["count"]) == (Severity.NOTE, len(fixed.time))
    assert not [*of_code(insnav.load(drive.imu.data, drive.gps.data).notes, Code.GPS_HEADING_UNUSED)]
