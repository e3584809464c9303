"""The whole program as a user starts it, its imports apart, and its help."""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from tests.bench.child import Cost, best, run_child
from tests.bench.job import PROGRAM, Job

# what a run has imported at its end, wherever in the program that happens
LIST = f"""import atexit, os, sys
atexit.register(lambda: open(os.environ["BENCH_MODULES"], "w").write("\\n".join(list(sys.modules))))
{PROGRAM}"""
IMPORT = """import importlib, os
for name in open(os.environ["BENCH_MODULES"]).read().split():
    if name != "__main__":
        try: importlib.import_module(name)
        except ImportError: pass"""
LOOP = "s = 0\nfor i in range(20_000_000): s += i * i"  # at module level: what the figures are told in, on any machine


@dataclass(frozen=True)
class Processes:
    """Cost of the program: noise and lever arm given; the start, too; nothing given, with page; with 200 Hz as text;
    of the sample drive, of that with all to be compiled, of imports alone, of the help, and of the calibration loop.
    """

    aligned: Cost
    given_start: Cost
    nothing_given: Cost
    text: Cost
    sample: Cost
    first: Cost
    imports: Cost
    help: Cost
    loop: Cost


def measure_processes(job: Job, out: Path, repeat: int) -> Processes:
    """Start each `repeat` times in turn after one run that compiles; leaves the self-aligned run in `out`."""
    modules = {"BENCH_MODULES": str(out.with_name(out.name + "-modules.txt"))}
    run_child([sys.executable, "-c", LIST, *job.command(out, given_start=False)], **modules)
    calls = {
        "given_start": ["-c", PROGRAM, *job.command(out, given_start=True)],
        "aligned": ["-c", PROGRAM, *job.command(out, given_start=False)],
        "nothing_given": ["-c", PROGRAM, *job.plain(out.with_name(out.name + "-plain"))],
        "text": ["-c", PROGRAM, *job.plain(out.with_name(out.name + "-text")), "--rate", "full", "--figures", "none"],
        "sample": ["-c", PROGRAM, "demo", "--force", "--out", str(out.with_name(out.name + "-sample"))],
        "imports": ["-W", "ignore", "-c", IMPORT],
        "help": ["-c", PROGRAM, "--help"],
        "loop": ["-c", LOOP],
    }
    rounds = [
        {name: run_child([sys.executable, *call], **modules) for name, call in calls.items()} for _ in range(repeat)
    ]
    with tempfile.TemporaryDirectory() as empty:
        first = run_child([sys.executable, *calls["sample"]], NUMBA_CACHE_DIR=empty)
    return Processes(**{name: best([each[name] for each in rounds]) for name in calls}, first=first)
