"""`insnav calibrate imu`: what it prints and writes, and that `run` takes the file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from insnav.imu import load_calibration
from insnav.io.folder import verify_folder
from tests.cli.conftest import Cli
from tests.lab.sweeps import asymmetric, cubic, gyros, straight, write


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    write(tmp_path, gyros(rng, (cubic, straight, asymmetric)), 0.005, rng)
    return tmp_path


FILES = ("about_x.csv", "about_y.csv", "about_z.csv")


def test_sweeps_on_the_terminal_and_in_the_folder(bench: Path, cli: Cli) -> None:
    shown = cli("calibrate", "imu", *FILES)
    assert shown.code == 0, shown.err
    for words in (
        "gyro x senses y",
        "matrix and pieces",
        "Pieces: error = k rate + b'",
        "condition",
        "Effect of the calibration on navigation",
        "Corrected data",
        "times smaller",
    ):
        assert words in shown.out
    verify_folder(Path("calibration"))
    assert Path("calibration/figures/rate_errors.png").stat().st_size > 20_000
    known = load_calibration("calibration/calibration.toml")
    assert known.gyro_map is not None
    assert known.gyro_map.y is None
    facts = json.loads(Path("calibration/run.json").read_text())
    assert facts["rate_error_deg_s"]["map"] < 0.2 * facts["rate_error_deg_s"]["matrix"]
    assert set(facts["pieces"]) == {"x", "z"}
    assert all(item["with_m"] < 0.2 * item["without_m"] for item in facts["minute"])


def test_json_is_the_same_as_the_file(bench: Path, cli: Cli) -> None:
    shown = cli("calibrate", "imu", *FILES, "--json", "--out", "c")
    assert json.loads(shown.out) == json.loads(Path("c/run.json").read_text())


@pytest.mark.parametrize(
    ("arguments", "code", "word"),
    [
        (("about_x.csv",), 3, "no column for rate_x"),
        (("about_x.csv", "about_y.csv"), 3, "2 files are not three sweeps"),
        (("about_y.csv", "about_x.csv", "about_z.csv"), 3, "columns or files exchanged?"),
        ((*FILES, "--spike-limit", "-1"), 2, "--spike-limit"),
        ((*FILES, "--out", "no/such"), 4, "parent"),
    ],
)
def test_what_cannot_be_is_refused(bench: Path, cli: Cli, arguments: tuple[str, ...], code: int, word: str) -> None:
    shown = cli("calibrate", "imu", *arguments)
    assert shown.code == code, shown.err
    assert shown.out == ""
    assert word in shown.err
    assert not Path("calibration").exists()
