"""Formats: found as modules, chosen by content, and a new one is one file."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import zipfile

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

import insnav
from insnav.exceptions import ConfigError, InputError
from insnav.input import formats, read_gps, read_imu
from insnav.input.formats import registry
from tests.input.files import GPS_HEADER, IMU_HEADER, as_text, fixes, rolling
from tests.refusals import refused

NEW_FORMAT = """
import numpy as np
from insnav.input.formats.table import ArrayCells, Table

name, suffixes, extra = "two tables", (".two",), ""

def recognise(source):
    return source.head.startswith(b"TWO")

def read(source):
    rows = np.frombuffer(source.data[4:]).reshape(-1, 17)
    def table(header, columns):
        return Table(source.name, source.sha256, header, ArrayCells(tuple(columns.T), str))
    return {"imu": table(IMU, rows[:, :7]), "gps": table(GPS, rows[:, 7:])}
"""


@pytest.fixture
def new_format(tmp_path, monkeypatch):
    folder = tmp_path / "formats"
    folder.mkdir()
    headers = f"IMU, GPS = {tuple(IMU_HEADER.split(','))!r}, {tuple(GPS_HEADER.split(','))!r}"
    (folder / "two_tables.py").write_text(NEW_FORMAT + headers)
    monkeypatch.setattr(formats, "__path__", [*formats.__path__, str(folder)])
    registry.formats.cache_clear()
    yield
    registry.formats.cache_clear()


def test_a_new_format_is_one_file(new_format, tmp_path):
    path = tmp_path / "drive.log"
    path.write_bytes(b"TWO\n" + np.hstack([rolling(300), fixes(300)]).tobytes())
    assert np.array_equal(read_imu(path).data.gyro, rolling(300)[:, 1:4])
    assert np.array_equal(read_gps(path).data.time, fixes(300)[:, 0])
    assert ".two" in registry.suffixes()


def test_text_is_asked_last():
    names = [each.name for each in registry.formats()]
    assert names[-1] == "delimited text"
    assert {"parquet", "RTKLIB solution"} < set(names)


@pytest.mark.parametrize("name", ["imu.csv", "imu.parquet", "imu"])
def test_the_content_decides_not_the_name(tmp_path, name):
    rows, header = rolling(), IMU_HEADER.split(",")
    path = tmp_path / name
    parquet.write_table(pa.table(dict(zip(header, rows.T, strict=True))), path)
    assert np.array_equal(read_imu(path).data.time, rows[:, 0])
    path.write_text(as_text(rows, IMU_HEADER))
    assert np.allclose(read_imu(path).data.time, rows[:, 0])


def test_the_supported_formats_are_named_where_nothing_reads_a_file(tmp_path):
    path = tmp_path / "picture.csv"
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)))
    with refused(InputError, "format.unknown") as caught:
        read_imu(path)
    assert caught.value.values["kind"] == "a PNG picture"
    assert caught.value.values["suffixes"] == registry.suffixes()


def test_an_empty_folder_is_said_to_be_one(tmp_path):
    with refused(InputError, "format.empty_folder"):
        read_imu(tmp_path)


def test_a_folder_names_the_data_files_in_it(tmp_path):
    for name in ("drive.csv.gz", "rover.pos", "notes.md"):
        (tmp_path / name).write_text("x")
    with refused(InputError, "format.folder_of_data") as caught:
        read_imu(tmp_path)
    assert caught.value.values["shown"] == ("drive.csv.gz", "rover.pos")


def _zip(**files):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return buffer.getvalue()


PACKED = {
    "gzip": gzip.compress,
    "xz": lzma.compress,
    "two xz": lambda data: lzma.compress(data[:999]) + lzma.compress(data[999:]),
    "bzip2": bz2.compress,
    "zstd": lambda data: pa.compress(data, codec="zstd", asbytes=True),
    "zip": lambda data: _zip(drive=data),
    "zip of gzip": lambda data: _zip(drive=gzip.compress(data)),
    "zip with what macOS adds": lambda data: _zip(**{"drive": data, "__MACOSX/._drive": b"x", ".DS_Store": b"x"}),
}


@pytest.mark.parametrize("pack", PACKED.values(), ids=PACKED.keys())
def test_compressed_files_are_as_what_is_in_them(tmp_path, pack):
    rows = rolling(600)
    path = tmp_path / "drive"
    path.write_bytes(pack(as_text(rows, IMU_HEADER).encode()))
    assert np.allclose(read_imu(path).data.accel, rows[:, 4:])


@pytest.mark.parametrize("pack", PACKED.values(), ids=PACKED.keys())
def test_compressed_files_that_are_cut_or_damaged_are_refused(tmp_path, pack):
    rng = np.random.default_rng(1)
    packed = pack(as_text(rolling(600), IMU_HEADER).encode())
    path = tmp_path / "drive"
    for case in range(30):
        data = bytearray(packed[: rng.integers(30, len(packed))] if case % 2 else packed)
        data[rng.integers(6, len(data))] ^= 1 << rng.integers(8)
        path.write_bytes(data)
        try:
            read = read_imu(path).data
        except InputError:
            continue
        assert np.isfinite(read.accel).all()


@pytest.mark.parametrize("pack", [lzma.compress, bz2.compress, PACKED["zstd"], PACKED["zip"]])
def test_what_unpacks_to_too_much_is_refused(tmp_path, monkeypatch, pack):
    monkeypatch.setattr("insnav.input.formats.source.RATIO_FROM", 1 << 20)
    path = tmp_path / "bomb"
    path.write_bytes(pack(b"0," * (1 << 22)))
    with refused(InputError, "format.bomb"):
        read_imu(path)


def test_a_missing_package_says_how_to_install_it(new_format, tmp_path, monkeypatch):
    def fails(source):
        raise ImportError("No module named 'theirs'")

    two = next(each for each in registry.formats() if each.name == "two tables")
    monkeypatch.setattr(two, "extra", "theirs")
    monkeypatch.setattr(two, "read", fails)
    (tmp_path / "drive.log").write_bytes(b"TWO\n")
    with refused(ConfigError, "format.no_package") as caught:
        read_imu(tmp_path / "drive.log")
    assert caught.value.values["extra"] == "theirs"


def test_several_sensors_of_a_kind_are_asked_for(new_format, tmp_path, monkeypatch):
    path = tmp_path / "drive.log"
    path.write_bytes(b"TWO\n" + np.hstack([rolling(300), fixes(300)]).tobytes())
    tables = registry.open_tables(path)
    several = {"imu:/a": tables["imu"], "imu:/b": tables["imu"], "gps:/fix": tables["gps"]}
    assert registry.choose_table(several, "gps", (), "log") is tables["gps"]
    assert registry.choose_table(several, "imu", ("/b",), "log") is tables["imu"]
    with refused(ConfigError, "format.several_sensors") as caught:
        registry.choose_table(several, "imu", (), "log")
    assert caught.value.values["topics"] == ("/a", "/b")


def test_a_log_with_fixes_needs_no_gps_file(new_format, tmp_path):
    path = tmp_path / "drive.log"
    path.write_bytes(b"TWO\n" + np.hstack([rolling(3000), fixes(3000)]).tobytes())
    drive = insnav.load(path)
    assert drive.gps is not None
    assert len(drive.gps.data.time) == 3000
    with refused(ConfigError, "session.no_topic") as caught:
        insnav.load(path, topic="/odd")
    assert caught.value.values["value"] == "/odd"
