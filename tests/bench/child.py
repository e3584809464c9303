"""What a process of its own costs: CPU, wall clock and peak memory, imports included."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

PROJECT = Path(__file__).parents[2]
BYTECODE = str(Path(tempfile.gettempdir()) / "insnav_bench" / "bytecode")


@dataclass(frozen=True)
class Cost:
    """Cost of one process, and what it said."""

    cpu_s: float
    wall_s: float
    peak_mb: float
    stdout: str = ""


def run_child(arguments: Sequence[str], **environment: str) -> Cost:
    """Run a process to its end and measure it.

    The kernel counts the memory of the process that starts a child into the child's peak: measure memory
    before this process has grown.
    """
    search = os.pathsep.join(filter(None, [str(PROJECT), os.environ.get("PYTHONPATH")]))
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as log:
        begin = time.perf_counter()
        process = subprocess.Popen(
            arguments,
            stdout=output,
            stderr=log,
            stdin=subprocess.DEVNULL,
            # an installation compiles the sources to bytecode, a checkout does not always
            env={**os.environ, "PYTHONPATH": search, "PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": BYTECODE}
            | environment,
        )
        _, status, usage = os.wait4(process.pid, 0)
        wall = time.perf_counter() - begin
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            log.seek(0)
            text = log.read().decode(errors="replace")[-3000:]
            raise RuntimeError(f"{' '.join(arguments)} ended with {process.returncode}:\n{text}")
        output.seek(0)
        said = output.read().decode()
    kilobytes = usage.ru_maxrss / (1024 if sys.platform == "darwin" else 1)
    return Cost(usage.ru_utime + usage.ru_stime, wall, kilobytes / 1e3, said)


def best(costs: Sequence[Cost]) -> Cost:
    """Smallest CPU and wall clock, as anything else running can only add to them; largest memory."""
    return Cost(min(c.cpu_s for c in costs), min(c.wall_s for c in costs), max(c.peak_mb for c in costs))
