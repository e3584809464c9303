"""The committed sample drive is what its generator makes, small, and fit to show a run."""

from __future__ import annotations

import gzip
import runpy
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parents[2] / "trajectories"
SAMPLE = FOLDER / "sample"
FILES = {"imu.csv.gz": 48000, "gps.csv": 460, "ref.csv": 4800}


def table(folder: Path, name: str) -> tuple[list[str], np.ndarray]:
    content = (folder / name).read_bytes()
    header, rest = (gzip.decompress(content) if name.endswith("gz") else content).decode().split("\n", 1)
    return header.split(","), np.loadtxt(rest.splitlines(), delimiter=",")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sample")
    runpy.run_path(str(FOLDER / "make_sample.py"))["main"](folder)
    return folder


@pytest.mark.parametrize("name", FILES)
def test_the_generator_makes_the_committed_numbers(made, name):
    # To one unit of the last digit: another mathematical library may round the other way.
    names, values = table(SAMPLE, name)
    names_made, values_made = table(made, name)
    last_digit = {"gyro": 1.1e-4, "accel": 1.1e-3, "lat": 2e-11, "lon": 2e-11, "time": 1e-9}
    assert names_made == names
    assert values.shape[0] == FILES[name]
    for i, column in enumerate(names):
        tolerance = last_digit.get(column.split("_")[0], 2e-6)
        np.testing.assert_allclose(values_made[:, i], values[:, i], rtol=0.0, atol=tolerance, err_msg=column)


def test_the_sample_is_small():
    assert sum((SAMPLE / name).stat().st_size for name in FILES) < 2.5e6


def test_it_starts_and_ends_at_rest_drives_between_and_has_one_outage():
    _, ref = table(SAMPLE, "ref.csv")
    _, gps = table(SAMPLE, "gps.csv")
    speed = np.linalg.norm(ref[:, 4:7], axis=1)
    t = ref[:, 0] - 100000.0
    assert np.all(speed[(t < 69.0) | (t > 471.0)] < 1e-4)
    assert speed.max() > 20.0
    assert np.ptp(ref[:, 3]) > 10.0
    pauses = np.diff(gps[:, 0])
    assert np.count_nonzero(pauses > 1.5) == 1
    assert pauses.max() == pytest.approx(21.0)
    silent = (t > 310.0) & (t <= 330.0)
    assert speed[silent].max() > 10.0
    assert np.ptp(np.unwrap(np.radians(ref[silent, 9]))) > 1.0


def test_the_fixes_are_off_by_what_they_say():
    _, ref = table(SAMPLE, "ref.csv")
    _, gps = table(SAMPLE, "gps.csv")
    at = ref[np.searchsorted(ref[:, 0], gps[:, 0] - 0.05)]
    metres = np.array([111_200.0, 74_600.0, 1.0])
    lever = 1.6  # the antenna is this far from the reference at most
    off = (gps[:, 1:4] - at[:, 1:4]) * metres
    sd = gps[0, 7:10]
    assert np.all(off.std(axis=0) < 1.5 * sd + lever / 2)
    assert np.all(off.std(axis=0) > 0.6 * sd)
    np.testing.assert_allclose((gps[:, 4:7] - at[:, 4:7]).std(axis=0), 0.1, atol=0.08)
