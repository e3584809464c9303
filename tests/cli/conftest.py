"""The command line called in this process, a short drive, and a record at rest with known attitude."""

from __future__ import annotations

import gzip
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from insnav.findings import Code, Finding, Severity
from insnav.messages import sentence

ROOT = Path(__file__).parents[2]
SAMPLE = ROOT / "trajectories" / "sample"
DRIVE_S = 130  # 70 s at rest, then a minute of driving


@dataclass(frozen=True)
class Outcome:
    """What a command left behind."""

    code: int
    out: str
    err: str


Cli = Callable[..., Outcome]


def findings_of(facts: Mapping[str, Any], *codes: Code, least: Severity = Severity.NOTE) -> list[Finding]:
    """Findings of a ``run.json``: those of some codes, if any is given, and of at least a severity."""
    every = map(Finding.from_dict, facts["findings"])
    return [each for each in every if each.severity >= least and (not codes or each.code in codes)]


def warnings_of(facts: Mapping[str, Any]) -> list[Finding]:
    """What a user must not overlook."""
    return findings_of(facts, least=Severity.WARNING)


def says(text: str, finding: Finding) -> bool:
    """Whether a text holds a finding without times of its own, however its lines are wrapped."""
    return "".join(sentence(finding).split()) in "".join(text.split())


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No test works in the checkout, where a run of its owner may lie."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def cli(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Iterator[Cli]:
    """Call the command line as the console script does."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    hook = sys.unraisablehook

    def call(*arguments: object) -> Outcome:
        from insnav.cli import main

        monkeypatch.setattr(sys, "argv", ["insnav", *map(str, arguments)])
        capfd.readouterr()
        with monkeypatch.context() as own:
            own.setenv("INSNAV_LANG", os.environ.get("INSNAV_LANG", ""))  # --lang sets it for the rest of a process
            with pytest.raises(SystemExit) as end:
                main()
        out, err = capfd.readouterr()
        return Outcome(end.value.code, out, err)

    yield call
    sys.unraisablehook = hook
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first minutes of the sample drive, not compressed."""
    folder = tmp_path_factory.mktemp("drive")
    rows = {"imu.csv": 100 * DRIVE_S, "gps.csv": DRIVE_S, "ref.csv": 10 * DRIVE_S}
    for name, count in rows.items():
        source = SAMPLE / name
        text = source.read_text() if source.exists() else gzip.decompress((SAMPLE / f"{name}.gz").read_bytes()).decode()
        (folder / name).write_text("".join(text.splitlines(keepends=True)[: count + 1]))
    return folder


@pytest.fixture
def drive(files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with imu.csv, gps.csv and ref.csv of a short drive, free to be spoiled."""
    folder = tmp_path / "work"
    shutil.copytree(files, folder)
    monkeypatch.chdir(folder)
    return folder


QUICK = ("imu.csv", "--gps", "gps.csv", "--imu", "automotive", "--figures", "none")
AT_REST = {"lat": 48.0, "roll": 1.0, "pitch": -2.0, "heading": 40.0}  # [deg]


@pytest.fixture
def at_rest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Ten minutes at 20 Hz of a good IMU at rest on the turning Earth, its attitude known."""
    lat, roll, pitch, heading = np.deg2rad(list(AT_REST.values()))
    turns = [
        np.array([[1, 0, 0], [0, np.cos(roll), np.sin(roll)], [0, -np.sin(roll), np.cos(roll)]]),
        np.array([[np.cos(pitch), 0, -np.sin(pitch)], [0, 1, 0], [np.sin(pitch), 0, np.cos(pitch)]]),
        np.array([[np.cos(heading), np.sin(heading), 0], [-np.sin(heading), np.cos(heading), 0], [0, 0, 1]]),
    ]
    c_bn = turns[0] @ turns[1] @ turns[2]
    n = 12000
    rng = np.random.default_rng(5)
    rate = c_bn @ (7.292115e-5 * np.array([np.cos(lat), 0.0, -np.sin(lat)])) + 2e-6 * rng.normal(size=(n, 3))
    force = c_bn @ np.array([0.0, 0.0, -9.8088]) + 2e-4 * rng.normal(size=(n, 3))
    rows = np.column_stack((0.05 * np.arange(1, n + 1), rate, force))
    header = "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"
    np.savetxt(tmp_path / "static.csv", rows, "%.10g", ",", header=header, comments="")
    monkeypatch.chdir(tmp_path)
    return tmp_path / "static.csv"
