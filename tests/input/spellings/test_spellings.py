"""A drive spelled in many ways: each understood, or refused with the hint that leads to the answer; none silent."""

from __future__ import annotations

import numpy as np
import pytest

import insnav
from insnav.exceptions import InputError, InsnavError
from insnav.findings import Code
from insnav.input.interpret.overlap import epoch_offset, overlap
from insnav.messages import sentence
from insnav.session.read import read as readings
from tests.input.spellings import gps_files, imu_files
from tests.input.spellings.recorded import DEG, GPS_HEADERS, IMU_HEADERS, drive, fixes, samples, table
from tests.refusals import refused

SHARE = 0.85  # of the spellings that must be understood without an option


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """Files that need no understanding."""
    folder = tmp_path_factory.mktemp("plain")
    return table(folder / "imu.csv", samples(IMU_HEADERS)), table(folder / "gps.csv", fixes(GPS_HEADERS))


def _read(imu, gps):
    """Read, and the offset that calendars explain; nothing else is looked at, so that it is fast."""
    read = readings(imu, gps, None, {})
    if overlap(read.imu.data, read.gps.data):
        return read, 0.0
    return read, epoch_offset(read.imu.data, read.gps.data)


def _samples_are_those_of_the_drive(data, *, tolerance=2e-6):
    made = drive()
    assert len(data.time) >= len(made.t) - 1
    first = len(made.t) - len(data.time)
    scale = 50.0 if data.sampling == "increment" else 1.0
    np.testing.assert_allclose(data.gyro * scale, made.gyro[first:], atol=tolerance)
    np.testing.assert_allclose(data.accel * scale, made.accel[first:], atol=10 * tolerance)
    np.testing.assert_allclose(np.diff(data.time), np.diff(made.t[first:]), atol=1e-4)
    return first


@pytest.mark.parametrize("name", imu_files.UNDERSTOOD)
def test_imu(name, tmp_path, plain):
    read, offset = _read(imu_files.UNDERSTOOD[name](tmp_path), plain[1])
    first = _samples_are_those_of_the_drive(read.imu.data, tolerance=2e-5 if "increments" in name else 2e-6)
    assert read.imu.data.time[0] + offset == pytest.approx(drive().t[first], abs=2e-3)


def test_rostopic(tmp_path, plain):
    _samples_are_those_of_the_drive(insnav.load(imu_files.rostopic(tmp_path), plain[1]).imu.data)


@pytest.mark.parametrize("name", imu_files.CLOCKS)
def test_clocks(name, tmp_path):
    imu, time = imu_files.CLOCKS[name]
    gps = table(tmp_path / "gps.csv", fixes(GPS_HEADERS.replace("time_s", "time"), time))
    read, offset = _read(imu(tmp_path), gps)
    assert offset == 0.0
    _samples_are_those_of_the_drive(read.imu.data)
    apart = read.imu.data.time[0] - read.gps.data.time[0]
    assert apart == pytest.approx(drive().t[0] - drive().gps_t[0], abs=2e-3)


@pytest.mark.parametrize("name", imu_files.TURNED)
def test_turned_sensors(name, tmp_path, plain):
    imu = table(tmp_path / "imu.csv", samples(imu_files.SHORT, matrix=imu_files.TURNED[name]))
    read = insnav.load(imu, plain[1])
    *_, note = (note for note in read.notes if note.get("axes"))  # the last says what to give in all
    assert note["axes"] in sentence(note)
    _samples_are_those_of_the_drive(insnav.load(imu, plain[1], axes=note["axes"]).imu.data, tolerance=0.15)


def test_accelerometers_with_the_opposite_sign_of_the_specific_force(tmp_path, plain):
    imu = table(tmp_path / "imu.csv", samples(imu_files.SHORT, accel=-1.0))
    read = insnav.load(imu, plain[1])
    (changed,) = (note for note in read.notes if note.code is Code.AXES_ACCEL_REVERSED)
    assert changed["windows"] > 20
    _samples_are_those_of_the_drive(read.imu.data)
    _samples_are_those_of_the_drive(insnav.load(imu, plain[1], accel_sign="minus-force").imu.data)
    with refused(InputError, "mounting.accelerometers_inverted") as caught:
        insnav.load(imu, plain[1], accel_sign="force")
    assert caught.value.gives == {"accel_sign": "minus-force"}


@pytest.mark.parametrize("name", gps_files.UNDERSTOOD)
def test_gps(name, tmp_path, plain):
    write, there = gps_files.UNDERSTOOD[name]
    read, offset = _read(plain[0], write(tmp_path))
    data, made = read.gps.data, drive()
    time = data.time - offset
    assert time[-1] == pytest.approx(made.gps_t[-1], abs=2e-3)
    rows = np.searchsorted(made.gps_t, time - 0.05)
    np.testing.assert_allclose(data.lla[:, :2] / DEG, made.lla[rows, :2], atol=2e-7)
    np.testing.assert_allclose(data.lla[:, 2], made.lla[rows, 2], atol=2e-3)
    if "v" in there:
        np.testing.assert_allclose(data.v_n[:, :2], made.v[rows, :2], atol=5e-3)
    if "s" in there:
        np.testing.assert_allclose(data.position_sd, made.sd[rows, :3], rtol=1e-2)


@pytest.mark.parametrize("name", imu_files.REFUSED)
def test_imu_that_is_refused(name, tmp_path, plain):
    write, code, values, given = imu_files.REFUSED[name]
    imu = write(tmp_path)
    _refused(lambda: insnav.load(imu, plain[1]), code, values)
    if given is not None:
        _samples_are_those_of_the_drive(readings(imu, None, None, given).imu.data, tolerance=2e-5)


@pytest.mark.parametrize("name", gps_files.REFUSED)
def test_gps_that_is_refused(name, tmp_path, plain):
    write, code, values, given = gps_files.REFUSED[name]
    gps = write(tmp_path)
    _refused(lambda: insnav.load(plain[0], gps), code, values)
    if given is not None:
        read = readings(plain[0], gps, None, given)
        np.testing.assert_allclose(read.gps.data.lla[:, :2] / DEG, drive().lla[:, :2], atol=2e-7)


def _refused(load, code, values):
    with refused(InsnavError, code) as caught:
        load()
    assert {name: caught.value.values[name] for name in values} == values
    assert caught.value.fix


def test_most_are_understood():
    understood = [imu_files.UNDERSTOOD, imu_files.CLOCKS, imu_files.TURNED, gps_files.UNDERSTOOD]
    refused = [imu_files.REFUSED, gps_files.REFUSED]
    n, others = sum(map(len, understood)), sum(map(len, refused))
    assert n + others >= 120
    assert n / (n + others) >= SHARE
