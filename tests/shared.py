"""The folder beside the project with recorded data and the standard job, and why a test does without it."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from insnav.output.folder import damage, files_in, read_facts

SHARED = Path(__file__).parents[1].parent / "shared"
DATA = SHARED / "data"
STANDARD_JOB = SHARED / "bench" / "standard_job.py"
GENERATION_LIMIT = 300.0  # [s]


def recorded(name: str) -> Path:
    """Folder of a recorded data set; the test is skipped where it is absent."""
    folder = DATA / name
    if not folder.is_dir():
        pytest.skip(f"recorded data {name} are not beside the project (../shared/data)")
    return folder


def standard_job(factory: pytest.TempPathFactory, scenario: str, *, hours: float = 1.0, rate: int = 200) -> Path:
    """Folder with imu.csv, gps.csv, ref.csv and start.json of the standard job; made once for all test processes.

    The test is skipped where the generator, or the package it takes its truth from, is absent.
    """
    if not STANDARD_JOB.is_file():
        pytest.skip("the standard job is not beside the project (../shared/bench)")
    if importlib.util.find_spec("pyins") is None:
        pytest.skip("python-ins, which makes the truth of the standard job, is not installed")
    root = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        root = root.parent  # common to all workers
    folder = root / f"standard_job_{scenario}_{hours:g}h_{rate}hz"
    lock, done = folder.with_suffix(".lock"), folder.with_suffix(".done")
    try:
        lock.mkdir()
    except FileExistsError:
        end = time.monotonic() + GENERATION_LIMIT
        while not done.exists():
            if time.monotonic() > end:
                pytest.fail(f"the standard job was not made within {GENERATION_LIMIT:g} s")
            time.sleep(0.2)
    else:
        command = [sys.executable, str(STANDARD_JOB), str(folder)]
        command += ["--scenario", scenario, "--hours", str(hours), "--rate", str(rate)]
        made = subprocess.run(command, capture_output=True, text=True, timeout=GENERATION_LIMIT, check=False)
        done.write_text(made.stderr if made.returncode else "")
    fault = done.read_text()
    if fault:
        pytest.fail(f"the standard job could not be made:\n{fault}")
    return folder


def verify_folder(folder: Path) -> dict[str, Any]:
    """Check that a run folder holds exactly the files it was written with; its ``run.json``."""
    facts = read_facts(folder)
    missing, changed = damage(folder)
    added = [name for name in files_in(folder) if name not in facts["files"]]
    assert (missing, changed, added) == ((), (), []), folder
    return facts
