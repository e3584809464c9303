"""The whole program as a user starts it, its imports apart, and its help."""

from __future__ import annotations

import sys
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


@dataclass(frozen=True)
class Processes:
    """Cost of the program aligning itself, with a given start, of its imports alone, and of its help."""

    aligned: Cost
    given_start: Cost
    imports: Cost
    help: Cost


def measure_processes(job: Job, out: Path, repeat: int) -> Processes:
    """Start each `repeat` times in turn after one run that compiles; leaves the self-aligned run in `out`."""
    modules = {"BENCH_MODULES": str(out.with_name(out.name + "-modules.txt"))}
    run_child([sys.executable, "-c", LIST, *job.command(out, given_start=False)], **modules)
    calls = {
        "given_start": ["-c", PROGRAM, *job.command(out, given_start=True)],
        "aligned": ["-c", PROGRAM, *job.command(out, given_start=False)],
        "imports": ["-W", "ignore", "-c", IMPORT],
        "help": ["-c", PROGRAM, "--help"],
    }
    rounds = [
        {name: run_child([sys.executable, *call], **modules) for name, call in calls.items()} for _ in range(repeat)
    ]
    return Processes(**{name: best([each[name] for each in rounds]) for name in calls})
