from __future__ import annotations

import gzip
import io
import sys
import tracemalloc

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from insnav.exceptions import InputError
from insnav.findings import Code
from insnav.input import read_imu
from insnav.input.formats import delimited_text
from insnav.input.formats.source import Source
from insnav.input.formats.text_dialect import Dialect
from tests.input.files import IMU_HEADER, as_text, rolling, write
from tests.refusals import refused

ROWS = rolling(400)
TEXT = as_text(ROWS, IMU_HEADER)
NAMES = IMU_HEADER.split(",")


def _read(path, content: bytes | str):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_imu(path)


def _same(reading, rows=ROWS):
    # Nine decimals are written.
    np.testing.assert_allclose(reading.data.time, rows[:, 0], atol=1e-9)
    np.testing.assert_allclose(reading.data.gyro, rows[:, 1:4], atol=1e-9)
    np.testing.assert_allclose(reading.data.accel, rows[:, 4:7], atol=1e-9)
    for array in (reading.data.time, reading.data.gyro, reading.data.accel):
        assert array.dtype == np.float64
        assert array.flags.writeable


WAYS = {
    "plain": TEXT,
    "no final newline": TEXT.rstrip("\n"),
    "byte order mark": b"\xef\xbb\xbf" + TEXT.encode(),
    "CRLF": TEXT.replace("\n", "\r\n"),
    "CR": TEXT.replace("\n", "\r"),
    "mixed line ends": TEXT.replace("\n", "\r\n", 200),
    "UTF-16": TEXT.encode("utf-16"),
    "UTF-16 big endian with mark": b"\xfe\xff" + TEXT.encode("utf-16-be"),
    "UTF-16 without mark": TEXT.encode("utf-16-le"),
    "tab": as_text(ROWS, IMU_HEADER, delimiter="\t"),
    "semicolon": as_text(ROWS, IMU_HEADER, delimiter=";"),
    "semicolon and decimal comma": as_text(ROWS, IMU_HEADER, delimiter=";", decimal=","),
    "tab and decimal comma": as_text(ROWS, IMU_HEADER, delimiter="\t", decimal=","),
    "blanks": as_text(ROWS, IMU_HEADER, delimiter="   "),
    "blanks around": "\n".join("  " + line + " " for line in TEXT.replace(",", "  ").splitlines()) + "\n",
    "comma and blank": TEXT.replace(",", ", "),
    "bar": as_text(ROWS, IMU_HEADER, delimiter="|"),
    "comments": "# made by a logger\n% and more, with, commas\n\n" + TEXT,
    "lines of text before the header": "Logger v2\nDate: 2025-07-08, noon\nOperator;none\n\n" + TEXT,
    "those and a row of units": "Logger v2\n\n" + TEXT.replace("\n", "\ns,rad/s,rad/s,rad/s,m/s^2,m/s^2,m/s^2\n", 1),
    "comments after a byte order mark": b"\xef\xbb\xbf# made by a logger\n" + TEXT.encode(),
    "short units row": TEXT.replace("\n", "\ns,rad/s,rad/s\n", 1),
    "header in a comment": "# a log\n# " + TEXT,
    "ROS header": "%" + TEXT,
    "units row": TEXT.replace("\n", "\ns,rad/s,rad/s,rad/s,m/s^2,m/s^2,m/s^2\n", 1),
    "quoted header": ",".join(f'"{n}"' for n in NAMES) + TEXT[len(IMU_HEADER) :],
    "latin-1 header": ("n°," + IMU_HEADER).encode("latin-1")
    + "".join(f"\n1,{line}" for line in TEXT.splitlines()[1:]).encode()
    + b"\n",
    "comma at the end of rows": "\n".join([IMU_HEADER, *(line + "," for line in TEXT.splitlines()[1:])]) + "\n",
    "blank lines": TEXT.replace("\n", "\n\n", 50),
    "remark between rows": TEXT.replace("\n", "\n# button pressed\n", 9).replace("# button pressed\n", "", 1),
    "text in a column that is not used": "\n".join(
        [IMU_HEADER + ",note", *(line + ",hello" for line in TEXT.splitlines()[1:])]
    ),
    "gzip": gzip.compress(TEXT.encode()),
    "two gzip members": gzip.compress(TEXT[:5000].encode()) + gzip.compress(TEXT[5000:].encode()),
}


@pytest.mark.parametrize("content", WAYS.values(), ids=WAYS.keys())
def test_the_same_numbers_however_written(tmp_path, content):
    reading = _read(tmp_path / "imu.csv", content)
    _same(reading)
    assert reading.events == ()
    assert reading.facts.n_rows == 400


def test_a_units_row_counts(tmp_path):
    rows = ROWS.copy()
    rows[:, 1:4] = np.degrees(rows[:, 1:4])
    rows[:, 0] *= 1e3
    text = as_text(rows, "time,gx,gy,gz,ax,ay,az").replace("\n", "\n[ms],[deg/s],[deg/s],[deg/s],m/s2,m/s2,m/s2\n", 1)
    np.testing.assert_allclose(_read(tmp_path / "a.csv", text).data.gyro, ROWS[:, 1:4], atol=1e-10)


def test_parquet(tmp_path):
    path = tmp_path / "imu.parquet"
    columns = {name: ROWS[:, i] for i, name in enumerate(NAMES)}
    pq.write_table(pa.table({"note": ["x"] * len(ROWS), **columns}), path)
    _same(read_imu(path))
    columns["gyro_x_rad_s"] = [str(x) for x in ROWS[:, 1]]
    pq.write_table(pa.table(columns), path)
    with refused(InputError, "format.parquet_type") as caught:
        read_imu(path)
    assert caught.value.values["column"] == "gyro_x_rad_s"


def test_standard_input(monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(TEXT.encode())))
    reading = read_imu("-")
    _same(reading)
    assert reading.facts.path == "standard input"


def test_many_blocks_with_empty_cells(tmp_path):
    # More than one block of the quick reader; empty cells must not shift or invent numbers.
    rows = rolling(30000)
    lines = as_text(rows, IMU_HEADER).splitlines()
    for i in (0, 7, 20011, 29999):
        lines[i + 1] = lines[i + 1].rsplit(",", 2)[0] + ",,1.0"
    reading = _read(tmp_path / "imu.csv", "\n".join(lines) + "\n")
    _same(reading, np.delete(rows, [0, 7, 20011, 29999], axis=0))


def test_rows_that_get_shorter_are_all_read(tmp_path):
    # The memory is sized by the first rows; here the file has four times as many as they promise.
    long, short = rolling(1000), rolling(20000, start=200.0).round(2)
    text = "\n".join([IMU_HEADER, *(",".join(f"{x:.15e}" for x in row) for row in long)]) + "\n"
    text += "".join(",".join(f"{x:g}" for x in row) + "\n" for row in short)
    data = _read(tmp_path / "imu.csv", text).data
    assert len(data.time) == 21000
    np.testing.assert_allclose(data.accel, np.vstack((long, short))[:, 4:7], atol=1e-9)


LAST = TEXT.rstrip("\n").rfind(",")
CUT = {
    "within the row": (TEXT[: LAST - 20], {"line": 401, "cells": 5, "columns": 7}),
    "after a comma": (TEXT[:LAST].rsplit(",", 2)[0] + ",", {"line": 401, "cells": 5, "columns": 7}),
    "within the last number": (TEXT[: LAST + 4], {"characters": 3, "limit_characters": 12}),
    "after a sign": (TEXT[: LAST + 2], {"line": 401}),
}


@pytest.mark.parametrize(("content", "values"), CUT.values(), ids=CUT.keys())
def test_a_cut_last_row_is_left_out_and_said(tmp_path, content, values):
    reading = _read(tmp_path / "imu.csv", content)
    _same(reading, ROWS[:-1])
    (cut,) = reading.events
    assert (cut.code, cut.subject, cut.begin) == (Code.ROWS_CUT, "imu", reading.data.time[-1])
    assert dict(cut.values) == {"file": "imu.csv", **values}
    assert reading.facts.n_rows == 400
    assert reading.facts.n_used == 399


def test_zeros_at_the_end_are_said(tmp_path):
    reading = _read(tmp_path / "imu.csv", TEXT.encode() + bytes(5000))
    _same(reading)
    (cut,) = reading.events
    assert (cut.code, cut["zeros"]) == (Code.ROWS_CUT, 5000)


def test_zeros_within_a_number_are_said(tmp_path):
    """They are not printed, so that the number looked like one."""
    with refused(InputError, "format.cell_with_zeros"):
        _read(tmp_path / "imu.csv", _with_cell(TEXT, 200, 5, "0.14" + "\0" * 40 + "9"))


def _with_cell(text: str, line: int, column: int, cell: str) -> str:
    lines = text.splitlines()
    cells = lines[line - 1].split(",")
    cells[column] = cell
    lines[line - 1] = ",".join(cells)
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("cell", ["N/A", "#", "1e", "--", "1.2.3", "0x10", "1_000", "2024-01-01T00:00:00", "null"])
def test_text_in_a_number_column_names_the_first_bad_cell(tmp_path, cell):
    text = "# remark\n" + TEXT
    bad = _with_cell(_with_cell(text, 60, 5, cell), 300, 2, "later")
    with pytest.raises(InputError) as caught:
        _read(tmp_path / "imu.csv", bad)
    assert caught.value.where.endswith("imu.csv:60:accel_y_m_s2")
    assert caught.value.values["text"] == cell


def test_row_numbers_count_blank_lines_and_blanks_as_delimiter(tmp_path):
    text = as_text(ROWS, IMU_HEADER, delimiter=" ").replace("\n", "\n\n", 10).splitlines()
    text[49] = "x " + text[49].split(" ", 1)[1]
    with pytest.raises(InputError) as caught:
        _read(tmp_path / "imu.csv", "\n".join(text) + "\n")
    assert ":50:time_s" in caught.value.where


@pytest.mark.parametrize(
    ("change", "cells"),
    [
        (lambda lines: [*lines[:9], lines[9] + ",7", *lines[10:]], 8),
        (lambda lines: [*lines[:9], lines[9].rsplit(",", 3)[0], *lines[10:]], 4),
    ],
)
def test_a_row_of_another_width_is_named(tmp_path, change, cells):
    with refused(InputError, "format.row_too_long" if cells > 7 else "format.row_width") as caught:
        _read(tmp_path / "imu.csv", "\n".join(change(TEXT.splitlines())) + "\n")
    assert caught.value.where.endswith(":10")
    assert (caught.value.values["cells"], caught.value.values["names"]) == (cells, 7)


USELESS = {
    "empty": (b"", "format.empty"),
    "blank lines": (b"\n\n \n", "format.only_comments"),
    "header only": (IMU_HEADER.encode() + b"\n", "columns.too_few_rows"),
    "header without line end": (IMU_HEADER.encode(), "columns.too_few_rows"),
    "one row": ("\n".join(TEXT.splitlines()[:2]).encode(), "columns.too_few_rows"),
    "two rows": ("\n".join(TEXT.splitlines()[:3]).encode(), "columns.too_few_rows"),
    "one column": (b"a\n1\n2\n3\n", "format.one_column"),
    "decimal commas between commas": (b"a,b\n1,5,2,5\n3,5,4,5\n", "format.commas_within_numbers"),
    "header does not fit": (b"time gyro x\n1 2 3 4\n1 2 3 4\n", "format.header_width"),
    "prose": (b"Dear reader,\nthis is a letter.\nIt has no numbers.\nNone at all.\n", "format.header_width"),
    "PNG": (b"\x89PNG\r\n\x1a\n" + bytes(range(256)), "format.unknown"),
    "ELF": (b"\x7fELF\x02\x01\x01" + bytes(200), "format.unknown"),
    "UBX": (b"\xb5\x62\x01\x07\x5c\x00" + bytes(range(92)), "format.ubx_no_data"),
    "ZIP": (b"PK\x03\x04\x14\x00" + bytes(50) + b"x", "format.zip_damaged"),
    "HDF5": (b"\x89HDF\r\n\x1a\n" + bytes(50) + b"x", "format.matlab_damaged"),
    "MAT": (b"MATLAB 5.0 MAT-file, Platform: GLNXA64" + bytes(90) + b"x", "format.matlab_damaged"),
    "parquet named csv": (b"PAR1\x15\x04\x15" + bytes(50) + b"PAR1", "format.parquet_damaged"),
    "NMEA": (b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\n", "format.fixes_for_samples"),
    "noise": (np.random.default_rng(1).bytes(4000), "format.unknown"),
    "zeros": (bytes(10000), "format.begins_with_zeros"),
    "damaged gzip": (gzip.compress(TEXT.encode())[:40] + bytes(500), "format.compressed_damaged"),
    "cut gzip": (gzip.compress(TEXT.encode())[:3000], "format.compressed_cut"),
}


@pytest.mark.parametrize(("content", "code"), USELESS.values(), ids=USELESS.keys())
def test_useless_files_are_refused_by_name(tmp_path, content, code):
    with refused(InputError, code) as caught:
        _read(tmp_path / "imu.csv", content)
    assert "imu.csv" in caught.value.where


def test_too_few_rows_say_how_many_are_needed(tmp_path):
    with refused(InputError, "columns.too_few_rows") as caught:
        _read(tmp_path / "imu.csv", "\n".join(TEXT.splitlines()[:3]))
    assert (caught.value.values["read"], caught.value.values["least"]) == (2, 3)


def test_missing_file_and_folder(tmp_path):
    write(tmp_path / "drive.csv", ROWS, IMU_HEADER)
    with refused(InputError, "format.no_file") as caught:
        read_imu(tmp_path / "drvie.csv")
    assert caught.value.values["close"] == str(tmp_path / "drive.csv")
    with refused(InputError, "format.folder_of_data") as caught:
        read_imu(tmp_path)
    assert caught.value.values["shown"] == ("drive.csv",)


def test_escape_codes_do_not_reach_the_terminal(tmp_path):
    with pytest.raises(InputError) as caught:
        _read(tmp_path / "imu.csv", "\x1b[31mtime\x1b[0m,gyro_y,cc\n1,2,3\n2,3,4\n3,4,5\n")
    assert "\x1b" not in str(caught.value)


def test_a_gzip_bomb_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("insnav.input.formats.source.RATIO_FROM", 1 << 20)
    with refused(InputError, "format.bomb"):
        _read(tmp_path / "imu.csv.gz", gzip.compress(b"0," * (1 << 22)))


def test_reading_needs_neither_pandas_nor_matplotlib(tmp_path):
    import subprocess

    path = write(tmp_path / "imu.csv", ROWS, IMU_HEADER)
    code = (
        "import sys; from insnav.input import read_imu; read_imu(sys.argv[1]); "
        "sys.exit(any(m in sys.modules for m in ('pandas', 'matplotlib')))"
    )
    assert subprocess.run([sys.executable, "-c", code, str(path)], check=False).returncode == 0


def test_arrow_has_let_go_of_the_data_when_a_file_was_read():
    """Its thread needs the interpreter to let go: a process that ends by then is aborted."""
    good = b"".join(b"%d,1.0,2.0\n" % i for i in range(20_000))
    dialect = Dialect(",", ".", ("a", "b", "c"), None, 0, 1)
    for text in (good, good[:50_000] + b"\n1,2,x\n" + good):
        held = sys.getrefcount(text)
        for _ in range(100):
            delimited_text._if_valid(delimited_text._read_fast, text, dialect, [0, 1, 2])
            assert sys.getrefcount(text) == held


def test_a_line_of_a_large_file_is_found_in_little_memory():
    """A file of 1.7 GB took 6.8 GB to say in which line its time jumps back."""
    row = ",".join(["0.123456789"] * 9).encode() + b"\n"
    text = b"a,b,c,d,e,f,g,h,i\n" + 200_000 * row
    cells = delimited_text.read(Source("large.csv", "", text))[""].cells
    tracemalloc.start()
    try:
        assert cells.line(190_000) == "190002"
        assert tracemalloc.get_traced_memory()[1] < len(text) / 2
    finally:
        tracemalloc.stop()
