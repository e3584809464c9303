"""Logs of every format damaged at random: each is read, with finite numbers in order of time, or refused in words."""

from __future__ import annotations

import json
import random
import re

import numpy as np
import pytest

from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code
from insnav.input import read_gps, read_imu, read_reference
from tests.input import written_logs as logs
from tests.input.files import noted
from tests.input.recordings import FIXES, PLACE, SAMPLES, Motion
from tests.input.test_folders import as_zip, kitti, phyphox, sensor_logger
from tests.input.test_nmea_ubx import nmea, ubx
from tests.input.test_text_logs import kf_gins, vectornav
from tests.refusals import refused

SHORT, FEW = Motion(SAMPLES.t[:300]), Motion(FIXES.t[:14])
LOGS: dict[str, bytes | dict[str, bytes]] = {
    "NMEA": nmea(FEW),
    "UBX": ubx(FEW, samples=SHORT),
    "UBX and NMEA": nmea(FEW) + ubx(FEW),
    "KITTI": kitti(SHORT),
    "phyphox": phyphox(SHORT, FEW),
    "Sensor Logger": sensor_logger(SHORT, FEW),
    "KF-GINS fixes": kf_gins("gps with velocity").encode(),
    "KF-GINS samples": kf_gins("imu").encode(),
    "VectorNav": vectornav()[:60_000].encode(),
    "ULog": logs.ulog(SHORT, FEW),
    "dataflash": logs.dataflash(SHORT, FEW),
    "dataflash text": logs.dataflash_text(SHORT, FEW),
    "NovAtel": logs.novatel(SHORT, FEW),
    "NovAtel text": logs.novatel_ascii(FEW),
    "SBF": logs.sbf(SHORT, FEW),
    "SBF Cartesian": logs.sbf(SHORT, FEW, cartesian=True),
    "NovAtel RAWIMUS": logs.novatel(SHORT, FEW, typed=False),
    "GPX": logs.gpx(FEW),
    "Inertial Explorer": logs.inertial_explorer(FEW),
    "Inertial Explorer, degrees and minutes": logs.inertial_explorer(FEW, kind="dms", attitude=False),
    "GnssLogger": logs.gnss_logger(SHORT, FEW),
}
CHECKED = ("NMEA", "UBX", "NovAtel", "NovAtel text", "SBF")  # by checksums: what is read is right
WORDS = [b"", b",", b"\n", b"*", b"$", b"\xb5b", b"\xaa\x44\x12", b"$@", b"\xa3\x95", b"nan", b"inf", b"-", b"9" * 20]
WORDS += [b"\0" * 8, b"\xff" * 8, b"<", b"1e308", b'"', b"\xed\xa0\x80"]


def damaged(data: bytes | dict[str, bytes], rng: random.Random) -> bytes:
    """Bytes changed, words put in, parts cut out, doubled or moved, the end cut off; of an archive, in one file."""
    if isinstance(data, dict):
        if rng.random() < 0.1:
            return damaged(as_zip(data), rng)
        name = rng.choice([*data])
        return as_zip(data | {name: damaged(data[name], rng)})
    for _ in range(rng.choice([1, 1, 2, 5, 30])):
        what, at = rng.random(), rng.randrange(len(data))
        if rng.random() < 0.2:
            at = rng.randrange(min(len(data), 400))  # headers are worth more
        size = rng.choice([1, 3, 20, 400])
        if what < 0.35:
            data = data[:at] + bytes([rng.randrange(256)]) + data[at + 1 :]
        elif what < 0.6:
            data = data[:at] + rng.choice(WORDS) + data[at + rng.choice([0, 1, 3, 8]) :]
        elif what < 0.75:
            data = data[:at] + data[at + size :]
        elif what < 0.9:
            data = data[:at] + data[at : at + size] + data[at:]
        else:
            data = data[: max(at, 1)]
        data = data or b"x"
    return data


def read_all(path) -> int:
    """Read every part of a file; how many could be read, all of them fit to be used."""
    read_well = 0
    for reader in (read_imu, read_gps, read_reference):
        try:
            reading = reader(path)
        except (InputError, ConfigError):
            continue
        read_well += 1
        data = reading.data
        assert (np.diff(data.time) > 0.0).all()
        for array in (data.gyro, data.accel) if reader is read_imu else (data.time, data.lla):
            assert np.isfinite(array).all()
        if reader is read_gps:
            assert not (data.position_sd <= 0.0).any()
        json.dumps(reading.facts.as_dict(), allow_nan=False)
    return read_well


@pytest.mark.parametrize("name", LOGS)
def test_damaged_logs_are_read_or_refused_in_words(tmp_path, name):
    rng = random.Random(name)
    path = tmp_path / "log"
    read_well = 0
    for _ in range(25):
        path.write_bytes(damaged(LOGS[name], rng))
        read_well += read_all(path)
    assert read_well > 0


@pytest.mark.parametrize("name", CHECKED)
def test_what_has_checksums_is_right_or_left_out(tmp_path, name):
    rng = random.Random(name)
    path = tmp_path / "log"
    for _ in range(15):
        path.write_bytes(damaged(LOGS[name], rng))
        try:
            data = read_gps(path).data
        except InputError:
            continue
        away = np.abs(np.degrees(data.lla[:, :2]) - PLACE[:2]).max()
        assert away < 1e-3


@pytest.mark.parametrize("name", LOGS)
def test_empty_cut_and_foreign_parts(tmp_path, name):
    data, path = LOGS[name], tmp_path / "log"
    data = as_zip(data) if isinstance(data, dict) else data
    for part in (b"", data[:1], data[:20], data[:200], data[: len(data) // 2], data + LOGS["UBX"], data + b"\0" * 999):
        path.write_bytes(part)
        read_all(path)
    path.write_bytes(b"")
    with refused(InputError, "format.empty"):
        read_gps(path)


def test_damage_is_said(tmp_path):
    path = tmp_path / "log"
    for name, subject in (("UBX", "NAV-PVT"), ("NovAtel", "NovAtel"), ("SBF", "SBF")):
        data = bytearray(LOGS[name])
        start = {"UBX": rb"\xb5b\x01\x07", "NovAtel": rb"\xaaD\x12\x1c\x2a", "SBF": rb"\$@..\xa7\x0f"}[name]
        found = re.search(start, bytes(data), re.S)
        assert found is not None
        data[found.start() + 40] ^= 1
        path.write_bytes(data)
        reading = read_gps(path)
        assert len(reading.data.time) == len(FEW.t) - 1
        (damaged,) = noted(reading, Code.READ_ROWS_DAMAGED)
        assert (damaged.subject, damaged["count"]) == (subject, 1)
