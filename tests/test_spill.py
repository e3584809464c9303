"""Arrays of long drives: in files that leave nothing behind, by blocks that change nothing."""

import bz2
import errno
import gzip
import lzma
import mmap
import os
import subprocess
import sys
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import insnav
from insnav import spill
from insnav.exceptions import OutputError
from insnav.filter import run_recorder, smoother
from insnav.filter.navigator import rates_at, turned
from insnav.imu.health import inspect
from insnav.input import read_imu
from insnav.input.formats.source import open_source
from insnav.input.interpret.clean import IMU_KINDS, find_gaps
from insnav.output.data_files import write_data
from insnav.strapdown import intervals, joined, pieces
from insnav.types import ImuData
from tests.refusals import refused


@pytest.fixture
def small(monkeypatch, tmp_path):
    """Nearly everything is large, blocks are tiny, and the files are made in a folder of their own."""
    monkeypatch.setattr(spill, "LARGE", 1 << 12)
    monkeypatch.setattr(spill, "ROWS", 777)
    monkeypatch.setattr(smoother, "ROWS", 50)
    monkeypatch.setattr(run_recorder, "ROOM", 100)
    monkeypatch.setattr(spill.tempfile, "tempdir", str(tmp_path))
    return tmp_path


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drive")
    made = insnav.simulate("city", imu="industrial", gps="single", seed=3, rate=100.0)
    write_data(folder / "imu.csv", made.imu.data)
    write_data(folder / "gps.csv", made.gps.data)
    return folder / "imu.csv", folder / "gps.csv"


def tables(files, folder, **how):
    """Bytes of every table of a run."""
    insnav.load(files[0], gps=files[1]).navigate(**how).save(folder, figures="none")
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix == ".csv"}


def test_blocks_and_files_do_not_change_a_byte(files, small, tmp_path_factory, monkeypatch):
    place = tmp_path_factory.mktemp("runs")
    by_blocks = tables(files, place / "blocks", output_interval=0.0)
    monkeypatch.undo()
    assert by_blocks == tables(files, place / "whole", output_interval=0.0)
    assert list(small.iterdir()) == []


def test_rates_about_fixes_are_alike_wherever_the_samples_begin():
    rng = np.random.default_rng(6)
    imu = ImuData(np.arange(40_000) * 0.01, rng.normal(0.3, 1.0, (40_000, 3)), np.zeros((40_000, 3)))
    fixes = np.sort(rng.uniform(310.0, 390.0, 50))
    whole = intervals(imu)
    rates = rates_at(fixes, whole.end, turned(whole))
    for begin in (1, 777, 30_001):
        part = intervals(imu.rows(slice(begin, None)), 0.01)
        np.testing.assert_array_equal(rates_at(fixes, part.end, turned(part)), rates)
    k = np.searchsorted(imu.time, fixes[7])
    assert rates[7] == pytest.approx(imu.gyro[k - 10 : k + 10].mean(axis=0), abs=0.15)


@pytest.mark.parametrize("sampling", ["mean", "instant", "increment"])
@pytest.mark.parametrize("stamp", ["start", "mid", "end"])
def test_intervals_by_blocks_are_those_of_the_whole_record(small, sampling, stamp):
    rng = np.random.default_rng(5)
    time = np.cumsum(rng.normal(0.01, 0.0005, 5000))
    kept = np.ones(5000, dtype=bool)
    for first, count in (
        (770, 12),
        (1554, 3),
        (1700, 400),
        (2330, 2),
        (4990, 4),
    ):  # gaps at and beside the ends of blocks
        kept[first : first + count] = False
    imu = ImuData(time[kept], rng.normal(size=(5000, 3))[kept], rng.normal(size=(5000, 3))[kept], sampling, stamp)
    whole, parts = intervals(imu), list(pieces(imu))
    assert len(parts) > 5
    for name in ("end", "dt", "gyro", "accel", "gap"):
        np.testing.assert_array_equal(np.concatenate([getattr(part, name) for part in parts]), getattr(whole, name))
    one, many = joined([whole]), joined(parts)
    for name in ("end", "dt", "gyro", "accel", "gap", "segment"):
        np.testing.assert_array_equal(getattr(many, name), getattr(one, name))


def test_helpers_give_what_numpy_gives(small):
    rng = np.random.default_rng(1)
    values, mask = rng.normal(size=(5000, 3)), rng.random(5000) < 0.7
    np.testing.assert_array_equal(spill.chosen(values, mask), values[mask])
    np.testing.assert_array_equal(spill.chosen(values, np.arange(4999, -1, -1)), values[::-1])
    np.testing.assert_array_equal(spill.steps(values[:, 0]), np.diff(values[:, 0]))
    np.testing.assert_array_equal(spill.mean(values), values.mean(axis=0))
    np.testing.assert_array_equal(spill.joined([values, values[:10]]), np.concatenate([values, values[:10]]))
    np.testing.assert_array_equal(spill.by_blocks(np.multiply, values, values), values * values)
    time = np.cumsum(np.where(rng.random(5000) < 0.01, 0.2, 0.01))
    np.testing.assert_array_equal(find_gaps(spill.steps(time), 0.01, IMU_KINDS), np.flatnonzero(np.diff(time) > 0.1))


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress, lzma.compress, bytes])
def test_a_compressed_file_is_unpacked_onto_the_disk(small, tmp_path, pack):
    text = np.random.default_rng(3).bytes(20_000).hex().encode()
    (tmp_path / "imu").write_bytes(pack(text))
    source = open_source(tmp_path / "imu")
    spill.release()
    assert isinstance(source.data, mmap.mmap)
    assert source.data[:] == text
    assert spill.together([text[:100], text[100:200]]) == text[:200]
    assert [path.name for path in small.iterdir()] == ["imu"]


def test_what_was_written_stays_when_the_memory_is_let_go(small):
    array = spill.empty((3000, 2))
    array[:] = np.arange(6000).reshape(3000, 2)
    for block in spill.blocks(3000):
        assert array[block][0, 0] == 2 * block.start
    spill.release()
    np.testing.assert_array_equal(array, np.arange(6000).reshape(3000, 2))
    assert list(small.iterdir()) == []  # nameless even while it is used: nothing can be left behind


@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="room is taken by writing there")
def test_a_full_disk_is_said(small, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", full)
    with refused(OutputError, "engine.no_room") as told:
        spill.empty((10_000, 3))
    assert str(small) in told.value.where
    assert told.value.values["reason"] == os.strerror(errno.ENOSPC)
    with Path("/dev/full").open("wb") as file:
        monkeypatch.setattr(spill.tempfile, "SpooledTemporaryFile", lambda *_, **__: file)
        with refused(OutputError, "engine.no_room"):
            spill.together([b"1", b"2"])


def test_memory_does_not_grow_with_the_drive(monkeypatch, tmp_path):
    monkeypatch.setattr(spill.tempfile, "tempdir", str(tmp_path))
    rng, rows = np.random.default_rng(2), 150_000
    level = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -9.8])
    text = np.column_stack([0.005 * np.arange(rows), rng.normal(0.0, 0.01, (rows, 6)) + level])
    header = "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"
    np.savetxt(tmp_path / "imu.csv", text, fmt="%.6g", delimiter=",", header=header, comments="")
    peaks = []
    for large in (1 << 30, 1 << 30, 1 << 16):  # the first time imports count, too
        monkeypatch.setattr(spill, "LARGE", large)
        monkeypatch.setattr(spill, "ROWS", large >> 4)
        tracemalloc.start()
        samples, events = inspect(read_imu(tmp_path / "imu.csv").data)
        less = joined(pieces(samples))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert not events
        assert less.end.shape == (rows / 8,)
    assert peaks[1] > 150 * rows  # bytes a sample
    assert peaks[2] < 0.35 * peaks[1]


def test_faults_of_samples_are_found_by_blocks_as_in_the_whole(files, small, monkeypatch):
    samples = read_imu(files[0]).data
    gyro, accel = samples.gyro.copy(), samples.accel.copy()
    gyro[1000, 1] += 5.0  # spikes, a stuck sensor, one at the end of its range
    accel[spill.ROWS * 4] += 40.0
    gyro[8000:8200, 2] = gyro[8000, 2]
    samples = replace(samples, gyro=gyro, accel=np.clip(accel, None, 1.5))
    found, events = inspect(samples)
    monkeypatch.undo()
    whole, expected = inspect(samples)
    assert len(events) > 3
    assert [repr(each) for each in events] == [repr(each) for each in expected]
    for name in ("time", "gyro", "accel"):
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name))


@pytest.mark.skipif(sys.platform != "linux", reason="limits of addresses are kept on Linux")
@pytest.mark.parametrize("megabytes", [350, 600])
def test_a_limit_that_the_libraries_do_not_fit_into_is_said(megabytes):
    resource = pytest.importorskip("resource")

    def limited():
        resource.setrlimit(resource.RLIMIT_AS, (megabytes << 20, megabytes << 20))

    command = [sys.executable, "-c", "from insnav.cli import main; main()", "verify"]
    done = subprocess.run(command, preexec_fn=limited, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 3
    assert f"{megabytes} MB" in done.stderr
    assert "ulimit -v unlimited" in done.stderr


def test_small_blocks_do_not_pay_for_mapped_files(monkeypatch):
    class Mapped:
        releases = 0

        def madvise(self, _):
            self.releases += 1

    memory = Mapped()
    monkeypatch.setattr(spill, "_mapped", {memory})
    spill.release()
    array = np.zeros((spill.ROWS, 3))
    for _ in range(100):
        spill.chosen(array, np.arange(10))
        assert [*spill.blocks(10)] == [slice(0, 10)]
    assert memory.releases == 1
    spill.chosen(array, np.arange(spill.ROWS))
    assert memory.releases == 2
