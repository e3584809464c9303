"""The standard job on the disk: a drive with its truth, its IMU model, and the arguments to navigate it."""

from __future__ import annotations

import importlib.util
import json
import sys
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any

from tests.bench.child import run_child

PROJECT = Path(__file__).parents[2]
GENERATOR = PROJECT.parent / "shared" / "bench" / "standard_job.py"
SCENARIOS = ("mems", "mems_outage", "tactical")
PROGRAM = "from insnav.cli import main; main()"


@dataclass(frozen=True)
class Job:
    """Folder with ``imu.csv``, ``gps.csv``, ``ref.csv``, ``start.json`` and ``imu.toml``."""

    folder: Path
    scenario: str

    def path(self, name: str) -> Path:
        return self.folder / name

    @cached_property
    def start(self) -> dict[str, Any]:
        """Start state, lever arm and sensor figures as the generator wrote them."""
        content: dict[str, Any] = json.loads(self.path("start.json").read_text(encoding="utf-8"))
        return content

    def command(self, out: Path, *, given_start: bool) -> list[str]:
        """Arguments of the program for the whole job: full rate, parquet, no figures."""
        files = [
            str(self.path("imu.csv")),
            "--gps",
            str(self.path("gps.csv")),
            "--imu",
            str(self.path("imu.toml")),
            "--noise",
            "model",
        ]
        lever = "--lever-arm=" + ",".join(f"{x:g}" for x in self.start["lever_b_m"])
        start = ["--initial", str(self.path("start.json"))] if given_start else []
        output = ["--rate", "full", "--format", "parquet", "--figures", "none", "--force", "--out", str(out)]
        return ["run", *files, lever, *start, *output]

    def plain(self, out: Path) -> list[str]:
        """Arguments of the program with nothing but the files."""
        return ["run", str(self.path("imu.csv")), "--gps", str(self.path("gps.csv")), "--force", "--out", str(out)]


def standard_job(work: Path, scenario: str, seed: int, hours: float) -> Job:
    """Job in `work`, generated if it is not there."""
    folder = work / f"{scenario}-seed{seed}-{hours:g}h"
    if not (folder / "start.json").exists():  # written last
        options = ["--scenario", scenario, "--seed", str(seed), "--hours", f"{hours:g}"]
        run_child([sys.executable, str(GENERATOR), str(folder), *options])
    job = Job(folder, scenario)
    job.path("imu.toml").write_text(imu_toml(scenario, job.start["imu"]), encoding="utf-8")
    return job


def imu_toml(name: str, figures: dict[str, Any]) -> str:
    """IMU file of the generator's figures: every sensor error is a Gauss-Markov process, none a constant."""
    return f"""name = "standard job, {name}"
[gyro]
bias_instability = "{figures["gb"]:g} deg/h"
correlation_time = "{figures["corr_h"]:g} h"
random_walk = "{figures["arw"]:g} deg/sqrt(h)"
scale_factor = "{figures["gs"]:g} ppm"
[accel]
bias_instability = "{figures["ab"]:g} mGal"
correlation_time = "{figures["corr_h"]:g} h"
random_walk = "{figures["vrw"]:g} m/s/sqrt(h)"
scale_factor = "{figures["as_"]:g} ppm"
"""


def generator() -> ModuleType:
    """Import the generator, which also sets the Earth constants of pyins to those of the truth."""
    spec = importlib.util.spec_from_file_location("standard_job", GENERATOR)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
