"""VBOX files, written by Racelogic's specification: minutes, positive west, sections and units."""

from __future__ import annotations

import numpy as np
import pytest

from insnav.exceptions import InputError
from insnav.findings import Code, of_code
from insnav.input import read_gps, read_imu
from tests.input.files import noted
from tests.input.recordings import FIXES, SAMPLES, TOW, WEEK, same_places
from tests.input.written_logs import vbox
from tests.refusals import refused

# the example in Racelogic's support centre, at 51 deg 59.09973 min N, 0 deg 58.49277 min W
EXAMPLE = b"""File created on 31/07/2006 at 09:55:20

[header]
satellites
time
latitude
longitude
velocity kmh
heading
height
vertical velocity kmh
trigger event time in clock counts

[channel units]

[comments]
(c) 2001 2003 Racelogic
Log Rate (Hz) : 02.00

[column names]
sats time lat long velocity heading height vertvel event1

[data]
137 162235.40 +03119.09973 +00058.49277 000.140 321.85 +00152.58 +000.000 00000
137 162235.90 +03119.09973 +00058.49277 000.220 065.93 +00152.58 +000.000 00000
137 162236.40 +03119.09973 +00058.49277 000.250 356.43 +00152.59 000.072 00000
"""


def test_the_example_of_the_specification(save):
    reading = read_gps(save(EXAMPLE))
    lat, lon, height = reading.data.lla[0]
    assert np.degrees([lat, lon]) == pytest.approx([51.0 + 59.09973 / 60.0, -58.49277 / 60.0], abs=1e-9)
    assert height == 152.58
    assert reading.facts.height == "msl"
    assert np.diff(reading.data.time) == pytest.approx(0.5, abs=1e-6)
    assert np.hypot(*reading.data.v_n[0, :2]) == pytest.approx(0.140 / 3.6)
    assert reading.data.v_n[2, 2] == pytest.approx(-0.072 / 3.6)


def test_fixes_of_a_motion_with_units_of_the_header(save):
    reading = read_gps(save(vbox()))
    assert same_places(reading.data)
    assert np.allclose(reading.data.v_n, FIXES.v_n, atol=2e-3)
    assert np.allclose(reading.data.time, TOW + FIXES.t, atol=1e-6)
    assert reading.facts.gps_week == WEEK
    assert set(reading.data.fix) == {4}  # the 128 in the number of satellites: with corrections


def test_units_of_the_velocities_come_from_the_header(save):
    data = read_gps(save(EXAMPLE.replace(b"velocity kmh", b"velocity knots", 1))).data
    assert np.hypot(*data.v_n[0, :2]) == pytest.approx(0.140 * 1852.0 / 3600.0)
    assert data.v_n[2, 2] == pytest.approx(-0.072 / 3.6)


def test_rows_without_satellites_are_no_fixes(save):
    lines = vbox().split(b"\r\n")
    lines[-3] = lines[-3].replace(b"137 ", b"128 ", 1)
    reading = read_gps(save(b"\r\n".join(lines)))
    assert len(reading.data.time) == len(FIXES.t) - 1
    (lost,) = noted(reading, Code.READ_ROWS_NO_FIX)
    assert lost["count"] == 1


def test_midnight_and_a_cut_last_row(save):
    late = EXAMPLE.replace(b"162235.40", b"235959.50").replace(b"162235.90", b"000000.00")
    late = late.replace(b"162236.40", b"000000.50")
    assert np.diff(read_gps(save(late)).data.time) == pytest.approx(0.5, abs=1e-6)
    reading = read_gps(save(vbox()[:-60]))
    assert len(reading.data.time) == len(FIXES.t) - 1
    assert [*of_code(reading.events, Code.ROWS_CUT)]


def test_samples_of_an_imu_module_with_their_units(save):
    """An IMU04: rates and accelerations as further channels, in the units of their section, without a date."""
    names = "YawRate X_Accel Y_Accel Z_Accel PitchRate RollRate"
    units = ["deg/s", "g", "g", "g", "deg/s", "deg/s"]
    head = "[header]\r\nsatellites\r\ntime\r\nlatitude\r\nlongitude\r\n"
    head += "".join(f"{name}\r\n" for name in names.split()) + "\r\n[channel units]\r\n" + "\r\n".join(units)
    rows = [head + f"\r\n\r\n[column names]\r\nsats time lat long {names}\r\n\r\n[data]"]
    for t, w, f in zip(SAMPLES.t, np.degrees(SAMPLES.gyro), SAMPLES.accel / 9.80665, strict=True):
        channels = [w[2], *f, w[1], w[0]]
        rows.append(f"009 1200{t:05.2f} +3119.0 +0058.0 " + " ".join(f"{each:.9E}" for each in channels))
    path = save("\r\n".join([*rows, ""]).encode())
    reading = read_imu(path)
    assert np.allclose(reading.data.gyro, SAMPLES.gyro, atol=1e-8)
    assert np.allclose(reading.data.accel, SAMPLES.accel, atol=1e-7)
    assert np.allclose(np.diff(reading.data.time), 0.01, atol=1e-6)


@pytest.mark.parametrize("names", ["time lat long", "sats time lat lat", ""])
def test_a_file_that_lacks_columns_is_refused_by_their_names(save, names):
    with refused(InputError, "format.vbox_columns"):
        read_gps(save(EXAMPLE.replace(b"sats time lat long velocity heading height vertvel event1", names.encode())))
