"""Formats: found as modules, chosen by content, and a new one is one file."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from insnav.exceptions import InputError
from insnav.input import formats, read_gps, read_imu
from insnav.input.formats import registry
from tests.input.files import GPS_HEADER, IMU_HEADER, as_text, fixes, rolling

NEW_FORMAT = """
import numpy as np
from insnav.input.formats.table import ArrayCells, Table

name, suffixes, extra = "two tables", (".two",), ""

def recognise(head, name):
    return head.startswith(b"TWO")

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
    with pytest.raises(InputError) as caught:
        read_imu(path)
    for suffix in registry.suffixes():
        assert suffix in caught.value.fix


def test_a_folder_names_the_data_files_in_it(tmp_path):
    for name in ("drive.csv.gz", "rover.pos", "notes.md"):
        (tmp_path / name).write_text("x")
    with pytest.raises(InputError, match="folder") as caught:
        read_imu(tmp_path)
    assert "drive.csv.gz, rover.pos" in caught.value.fix
    assert "notes.md" not in caught.value.fix
