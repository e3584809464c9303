"""A log in pieces of any size holds what the readers of whole files find in it."""

from __future__ import annotations

import io

import numpy as np
import pytest

from insnav.exceptions import InputError
from insnav.input import read_gps
from insnav.input.stream import Stream
from insnav.types import FloatArray, GpsData
from insnav.units import DEG
from tests.shared import recorded

IMU = "time_s,gyro_x_deg_s,gyro_y_deg_s,gyro_z_deg_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"
GPS = "time_s,lat_deg,lon_deg,height_m,vn_m_s,ve_m_s,vd_m_s,sd_n_m"
FORM = "0.01,1,2,3,0.1,0.2,-9.8"
FIX = "0.01,48,11,500,1,2,-0.5,3"


def taken(data: bytes, size: int) -> tuple[FloatArray, list[GpsData], Stream]:
    """Samples and fixes of a log that comes in pieces of a size."""
    log, samples, fixes, pieces = Stream(), [np.empty((0, 7))], list[GpsData](), io.BytesIO(data)
    while piece := pieces.read(size):
        for each in log.take(piece):
            if isinstance(each, GpsData):
                fixes.append(each)
            else:
                samples.append(each)
    return np.concatenate(samples), fixes, log


@pytest.mark.parametrize("size", [1, 7, 1000])
@pytest.mark.parametrize("tags", [("", ""), ("imu,", "gps,")], ids=["plain", "tagged"])
def test_lines_say_what_they_are_by_their_header(size: int, tags: tuple[str, str]) -> None:
    imu, gps = tags
    text = f"{imu}{IMU}\n{gps}{GPS}\n\n{imu}{FORM}\r\n{gps}{FIX}\n{imu}0.02,4,5,6,0,0,-9.7\n{imu}0.03,4"
    samples, fixes, log = taken(text.encode(), size)
    assert samples == pytest.approx(
        np.array([[0.01, DEG, 2 * DEG, 3 * DEG, 0.1, 0.2, -9.8], [0.02, 4 * DEG, 5 * DEG, 6 * DEG, 0.0, 0.0, -9.7]])
    )
    (fix,) = fixes
    assert fix.time == pytest.approx([0.01])
    assert fix.lla == pytest.approx(np.array([[48 * DEG, 11 * DEG, 500.0]]))
    assert fix.v_n == pytest.approx(np.array([[1.0, 2.0, -0.5]]))
    assert fix.position_sd[0, 0] == 3.0
    assert np.isnan(fix.velocity_sd).all()
    assert log.skipped == 0


def test_damaged_lines_are_counted_and_left_out() -> None:
    samples, _, log = taken(f"{IMU}\n0.01,1,2,x,0,0,-9.8\n{FORM}\n0.02,1,nan,3,0,0,-9.8\n".encode(), 9)
    assert len(samples) == 1
    assert log.skipped == 2


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("0.01,1,2,3,0,0,-9.8\n", "online.no_header"),
        ("time,gx,gy,gz,ax,ay,az\n", "online.units_missing"),
        ("time_s,gyro_x_rad_s,gyro_y_rad_s,accel_x_m_s2,accel_y_m_s2\n", "online.columns_missing"),
        (f"{IMU}\n{GPS.removesuffix(',sd_n_m')}\n", "online.columns_alike"),
    ],
)
def test_a_log_that_does_not_say_what_it_holds_is_refused(text: str, code: str) -> None:
    with pytest.raises(InputError) as refused:
        taken(text.encode(), 1000)
    assert refused.value.code == code
    assert str(refused.value)


@pytest.mark.parametrize("size", [100, 65536])
@pytest.mark.parametrize(
    "file",
    [
        "ublox/zed_f9r_esf_status_nav_pvat.ubx",
        "ublox/walk_f9p_rawx_pvt.ubx",
        "nmea/f9k_drive_4min.nmea",
        "nmea/netr9_static_putty.nmea",
    ],
)
def test_fixes_of_a_receiver_are_those_of_the_whole_file(file: str, size: int) -> None:
    path = recorded("formats") / file
    whole = read_gps(path).data
    fixes = taken(path.read_bytes(), size)[1]
    time = np.array([each.time[0] for each in fixes])
    row = np.searchsorted(whole.time, time - 1e-4).clip(max=whole.time.size - 1)
    same = np.abs(whole.time[row] - time) < 1e-4
    assert np.unique(row[same]).size >= whole.time.size - 2  # the last epoch of a log has no end
    # sentences before the first message of u-blox have no velocities
    last = {int(row[k]): fixes[k] for k in np.flatnonzero(same)}
    for of_file, fix in last.items():
        # a whole file adds the tenths of a millimetre of NAV-HPPOSLLH, and its accuracy
        assert fix.lla[0, :2] == pytest.approx(whole.lla[of_file, :2], abs=1e-9)
        assert fix.v_n[0, :2] == pytest.approx(whole.v_n[of_file, :2], abs=1e-9, nan_ok=True)
        assert fix.position_sd[0] == pytest.approx(whole.position_sd[of_file], abs=1e-3, nan_ok=True)
