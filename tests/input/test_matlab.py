"""MATLAB files, written by scipy (version 5) and h5py (7.3) as NaveGo and PSINS have their data, and real ones."""

from __future__ import annotations

import io
import itertools
import random
import struct
import tracemalloc

import h5py
import numpy as np
import pytest
from scipy.io import savemat

import insnav
from insnav.exceptions import InputError
from insnav.input import read_gps, read_imu, read_reference
from tests.input.recordings import FIXES, REAL, SAMPLES, TOW, real, same_places
from tests.input.test_log_mutations import damaged, read_all
from tests.refusals import refused

RAD = np.array([np.pi / 180.0, np.pi / 180.0, 1.0])


def navego() -> dict:
    lla, turn = FIXES.lla * RAD, np.radians(FIXES.heading)
    place = {"t": TOW + FIXES.t, "lat": lla[:, 0], "lon": lla[:, 1], "h": lla[:, 2], "vel": FIXES.v_n}
    zero = np.zeros(len(turn))
    return {
        "imu1": {
            "t": TOW + SAMPLES.t,
            "wb": SAMPLES.gyro,
            "fb": SAMPLES.accel,
            "freq": 100.0,
            "ini_align": [0.0, 0, 0],
        },
        "gnss": {**place, "stdm": [1.0, 2.0, 3.0], "stdv": [0.1, 0.2, 0.3], "larm": [0.0, 0, 0]},
        "ref": {**place, "roll": zero, "pitch": zero, "yaw": turn},
    }


def psins() -> dict:
    rfu = np.array([1.0, 1.0, -1.0])
    w, f = SAMPLES.gyro[:, [1, 0, 2]] * rfu * 0.01, SAMPLES.accel[:, [1, 0, 2]] * rfu * 0.01
    enu, lla = FIXES.v_n[:, [1, 0, 2]] * rfu, FIXES.lla * RAD
    n, yaw = len(FIXES.t), -np.radians(FIXES.heading)[:, None]
    attitude = np.hstack([np.full((n, 1), 0.01), np.full((n, 1), 0.02), yaw])
    return {
        "imu": np.column_stack([w, f, TOW + SAMPLES.t]),
        "gps": np.column_stack([enu, lla, TOW + FIXES.t]),
        "avp": np.column_stack([attitude, enu, lla, TOW + FIXES.t]),
        "glv": {"Re": 6378137.0},
    }


def version_5(data: dict) -> bytes:
    buffer = io.BytesIO()
    savemat(buffer, data)
    return buffer.getvalue()


def version_7(data: dict) -> bytes:
    """HDF5 behind the 512 bytes of MATLAB; arrays are stored by columns, so transposed."""

    def put(group, values: dict) -> None:
        for key, value in values.items():
            if isinstance(value, dict):
                put(group.create_group(key), value)
            else:
                group[key] = np.atleast_2d(np.asarray(value, dtype=float)).T if np.ndim(value) == 2 else value

    buffer = io.BytesIO()
    with h5py.File(buffer, "w", userblock_size=512) as file:
        put(file, data)
    content = bytearray(buffer.getvalue())
    content[:19] = b"MATLAB 7.3 MAT-file"
    return bytes(content)


@pytest.mark.parametrize("version", [version_5, version_7])
@pytest.mark.parametrize("data", [navego(), psins()], ids=["NaveGo", "PSINS"])
def test_arrays_are_read_by_their_names(save, version, data):
    path = save(version(data))
    imu, gps, reference = read_imu(path).data, read_gps(path).data, read_reference(path).data
    size = 0.01 if imu.sampling == "increment" else 1.0
    assert np.allclose(imu.time, TOW + SAMPLES.t)
    assert np.allclose(imu.accel, SAMPLES.accel * size)
    assert np.allclose(imu.gyro, SAMPLES.gyro * size)
    assert same_places(gps, metres=1e-6)
    assert np.allclose(gps.v_n, FIXES.v_n)
    assert np.allclose((np.degrees(reference.rph[:, 2]) - FIXES.heading + 180.0) % 360.0, 180.0)
    if size == 1.0:
        assert np.allclose(gps.position_sd, [1.0, 2.0, 3.0])
    else:
        assert np.allclose(reference.rph[:, :2], [0.02, 0.01])
    assert insnav.load(path).gps is not None


def test_other_variables_are_named(save):
    with refused(InputError, "format.matlab_no_data") as caught:
        read_imu(save(version_5({"speed": np.arange(9.0)})))
    assert caught.value.values["variables"] == "speed"


@pytest.mark.parametrize("version", [version_5, version_7])
def test_damaged_files_are_read_or_refused(save, version):
    rng, data = random.Random(3), version(navego())
    for _ in range(12):
        read_all(save(damaged(data, rng)))


def test_arrays_that_do_not_fit_into_the_file_are_refused(save):
    data = version_5(navego())
    structure = struct.pack("<IIII", 5, 8, 1, 1)  # dimensions of a structure
    assert structure in data
    with refused(InputError, "format.matlab_cut"):
        read_imu(save(data.replace(structure, struct.pack("<IIII", 5, 8, 1, 1 << 30), 1)))


def zeros_5() -> bytes:
    buffer = io.BytesIO()
    savemat(buffer, {"imu": {"t": np.zeros(1 << 20), "wb": np.zeros((1 << 20, 3))}}, do_compression=True)
    return buffer.getvalue()


def zeros_7() -> bytes:
    """Zeros that are stored nowhere, which is how HDF5 has a data set to which nothing was written."""
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file.create_dataset("imu", (7, 1 << 22), dtype=float, chunks=(7, 1 << 10))
    return buffer.getvalue()


def links_7() -> bytes:
    """Twenty structures, each of which holds the next one twice: a million arrays."""
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        groups = [file.create_group(f"g{level}") for level in range(20)]
        for outer, inner in itertools.pairwise(groups):
            outer["a"], outer["b"] = inner, inner
    return buffer.getvalue()


@pytest.mark.parametrize("content", [zeros_5, zeros_7, links_7])
def test_what_becomes_too_large_is_refused_before_memory_is_taken(save, monkeypatch, content):
    path = save(content())
    monkeypatch.setattr("insnav.input.formats.source.RATIO_FROM", 1 << 24)
    tracemalloc.start()
    with refused(InputError, "format.bomb"):
        read_imu(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 40e6


@real
def test_real_navego():
    gps = read_gps(REAL / "matlab" / "navego_ekinox_gnss.mat").data
    assert (len(gps.time), gps.time[0], gps.time[-1]) == (
        6295,
        pytest.approx(138_001.0, abs=0.1),
        pytest.approx(139_260, abs=1),
    )
    assert np.nanmax(np.abs(gps.v_n)) == pytest.approx(18.5, abs=0.5)
    reference = read_reference(REAL / "matlab" / "navego_ref.mat").data
    assert len(reference.time) == 1260
    assert np.isfinite(reference.rph).all()


@pytest.mark.parametrize("array", ["imu", "gps", "gps4"])
def test_psins_arrays_as_text_are_read_as_from_the_mat_file(tmp_path, array):
    rows = psins()[array.rstrip("4")]
    path = tmp_path / "array.txt"
    path.write_text(
        "".join("  ".join(f"{x: .14e}" for x in row) + "\n" for row in (rows[:, 3:] if array == "gps4" else rows))
    )
    if array == "imu":
        data = read_imu(path).data
        assert data.sampling == "increment"
        assert np.allclose(data.gyro, SAMPLES.gyro * 0.01)
        assert np.allclose(data.accel, SAMPLES.accel * 0.01)
        return
    data = read_gps(path).data
    assert np.allclose(data.time, TOW + FIXES.t)
    assert same_places(data)
    if array == "gps":
        assert np.allclose(data.v_n, FIXES.v_n)
