"""What would take memory or time without end is refused early, with a reason."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

import insnav.input.formats.source as source
from insnav.exceptions import InputError, OutputError
from insnav.input.formats.registry import open_table
from insnav.output.folder import RunFolder


def test_f8_a_stream_that_does_not_end(monkeypatch):
    monkeypatch.setattr(source, "_MAX_STREAM", 1 << 16)
    with pytest.raises(InputError, match="does not end"):
        source.open_source("/dev/zero")

    class Endless(io.RawIOBase):
        taken = 0

        def readable(self) -> bool:
            return True

        def readinto(self, buffer) -> int:
            self.taken += len(buffer)
            buffer[:] = b"1" * len(buffer)
            return len(buffer)

    endless = Endless()
    with pytest.raises(InputError, match="does not end"):
        source._stream(io.BufferedReader(endless), "standard input")
    assert endless.taken < 1 << 20


def test_f9_a_parquet_file_that_is_mostly_nothing(tmp_path: Path):
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    rows = 4_000_000
    table = pa.table({name: pa.array(np.zeros(rows)) for name in ("time_s", "gyro_x_rad_s", "a", "b", "c")})
    parquet.write_table(table, tmp_path / "bomb.parquet", compression="zstd")
    assert (tmp_path / "bomb.parquet").stat().st_size < 1 << 20
    with pytest.raises(InputError, match="more than is sensible"):
        open_table(tmp_path / "bomb.parquet").cells.read(range(5))


def test_p3_a_name_that_no_file_system_takes(tmp_path: Path):
    with pytest.raises(OutputError, match="too long"), RunFolder(tmp_path / ("x" * 256), force=False):
        pass
    with RunFolder(tmp_path / ("x" * 230), force=False) as folder:
        folder.commit({})


def test_n30_without_a_compiler_it_is_only_slower(monkeypatch, capsys):
    from insnav.cli import data_options
    from insnav.kernels import errorstate

    monkeypatch.setattr(errorstate, "propagate", lambda: None)
    data_options._say_if_compiling()
    assert "interpreted" in capsys.readouterr().err
