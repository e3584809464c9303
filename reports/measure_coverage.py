"""Measure which lines and branches of the package the tests run: ``python reports/measure_coverage.py``.

Each part of ``tests/`` runs in a process of its own, so a run can be resumed: ``--only PART …`` measures some parts,
``--report`` writes ``coverage.md`` from all that is measured. The tests that import kernels run twice, the second time
uncompiled (``NUMBA_DISABLE_JIT=1``), because coverage sees no compiled code. An uncompiled test has a time limit: what
it ran until then counts. Each test is a context of the data, which ``measure_mutants.py`` reads.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import coverage
import pytest

from insnav.version import __version__

ROOT = Path(__file__).parents[1]
REPORT = ROOT / "reports" / "coverage.md"
FOLDER = Path(os.environ.get("INSNAV_COVERAGE", str(Path(tempfile.gettempdir()) / "insnav_coverage")))
CLOSE = ("/physics/", "/test_strapdown", "/test_gimbal", "/test_allan")  # tests of functions that only call kernels
FEW = 2  # parameters of an uncompiled test
LIMITS = {"setup": 10.0, "call": 2.0}  # of an uncompiled test, processor time [s]
NOTES = """\
Lines and branches as coverage.py counts them, of packages whose own tests are in the list above. Not seen: processes
that tests start (parallel runs, the command line from outside), compilers and caches of kernels in them, and what slow
tests run of uncompiled kernels after two seconds (free inertial navigation, files of tracks, error budgets)."""


class TooSlow(BaseException):
    """An uncompiled test ran into its time limit."""


@contextmanager
def limit(phase: str) -> Iterator[None]:
    def stop(*_: Any) -> None:
        raise TooSlow(f"{LIMITS[phase]:g} s")

    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        signal.signal(signal.SIGPROF, stop)
        signal.setitimer(signal.ITIMER_PROF, LIMITS[phase])
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def switch(context: str) -> None:
    current = coverage.Coverage.current()
    if current is not None:
        current.switch_context(context)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":  # a few parameters of each test
        seen: Counter[str] = Counter()
        for item in [*items]:
            name = item.nodeid.partition("[")[0]
            seen[name] += 1
            if seen[name] > FEW:
                items.remove(item)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None, None, None]:
    switch(item.nodeid.partition("::")[0])  # what a fixture runs belongs to all tests of the file
    with limit("setup"):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, None, None]:
    switch(item.nodeid)
    with limit("call"):
        return (yield)


SECONDS: dict[str, float] = {}  # of each test that passed


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if report.when == "call" and report.passed:
        SECONDS[report.nodeid] = round(report.duration, 3)


def pytest_sessionfinish() -> None:
    Path(f"{os.environ['COVERAGE_FILE']}.passed.json").write_text(json.dumps(SECONDS), encoding="utf-8")


def parts() -> dict[str, list[str]]:
    """List the tests of each part: the folders of ``tests/``, and the files beside them."""
    found: dict[str, list[str]] = defaultdict(list)
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        inside = path.relative_to(ROOT / "tests").parts
        found[inside[0] if len(inside) > 1 else "other"].append(str(path.relative_to(ROOT)))
    return found


def of_kernels(files: list[str]) -> list[str]:
    """Return the test files that call kernels directly, or little else than kernels."""
    named = re.compile(r"from insnav\.kernels(\.\w+)? import [^\n]*\b[a-z]")  # functions
    return [
        each
        for each in files
        if any(name in each for name in CLOSE) or named.search((ROOT / each).read_text(encoding="utf-8"))
    ]


def measure(part: str, files: list[str], tier: str, *, compiled: bool) -> None:
    """Run the tests of a part, and keep what they ran in a file of its own."""
    data = FOLDER / f"coverage.{part}.{tier.replace(' ', '_')}.{'compiled' if compiled else 'uncompiled'}"
    places = [str(ROOT), str(ROOT / "reports"), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(places), "COVERAGE_FILE": str(data)}
    if not compiled:
        environment |= {"NUMBA_DISABLE_JIT": "1"}
    source = "insnav" if compiled else "insnav.kernels"
    command = [sys.executable, "-m", "coverage", "run", "--branch", f"--source={source}", "-m", "pytest", "-q"]
    command += ["-p", "measure_coverage", "-p", "no:cacheprovider", "-m", tier, *files]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    (FOLDER / f"{data.name}.log").write_text(done.stdout + done.stderr, encoding="utf-8")
    print(part, "compiled" if compiled else "uncompiled", (done.stdout.splitlines() or ["no output"])[-1], flush=True)


def combined() -> dict[str, dict[str, Any]]:
    """Join all that is measured: for each file, lines and branches that ran or did not, and its functions."""
    found = coverage.Coverage(data_file=str(FOLDER / "combined"), branch=True, source=[str(ROOT / "insnav")])
    found.combine([str(path) for path in FOLDER.glob("coverage.*compiled")], keep=True)
    with tempfile.NamedTemporaryFile(suffix=".json") as file:
        found.json_report(outfile=file.name)
        files: dict[str, dict[str, Any]] = json.loads(Path(file.name).read_text(encoding="utf-8"))["files"]
    return {str((ROOT / name).relative_to(ROOT)): each for name, each in files.items()}


def share(summaries: Iterable[dict[str, Any]]) -> str:
    """Row of a table: lines, percentage that ran, branches, percentage that was taken."""
    names = "num_statements", "covered_lines", "num_branches", "covered_branches"
    lines, ran, branches, taken = (sum(each[name] for each in summaries) for name in names)
    return f"{lines} | {100.0 * ran / max(lines, 1):.1f} % | {branches} | {100.0 * taken / max(branches, 1):.1f} % |"


def raising(file: str) -> set[int]:
    """Lines of statements that raise an error."""
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    found = (range(each.lineno, (each.end_lineno or 0) + 1) for each in ast.walk(tree) if isinstance(each, ast.Raise))
    return {line for lines in found for line in lines}


def report() -> str:
    """Write shares by package, the functions that no test runs, and the files with most lines that did not run."""
    measured = {path.name.split(".")[1] for path in FOLDER.glob("coverage.*.compiled")} | {"kernels"}
    every = combined()
    files = {name: each for name, each in every.items() if Path(name).parts[1] in measured}
    apart = {Path(name).parts[1] for name in every if name not in files and "/" in name.removeprefix("insnav/")}
    packages: dict[str, list[dict[str, Any]]] = defaultdict(list)
    missing: dict[str, tuple[list[int], int]] = {}
    idle: list[str] = []
    for name, each in sorted(files.items()):
        inside = Path(name).parts[1]
        packages[inside].append(each["summary"])
        lost = each["missing_lines"]
        missing[name] = lost, len(raising(name).intersection(lost))
        idle += [
            f"`{name}::{function}`"
            for function, part in each["functions"].items()
            if function and part["missing_lines"] and not part["executed_lines"]
        ]
    total, errors = (sum(map(int, each)) for each in zip(*((len(a), b) for a, b in missing.values()), strict=True))
    worst = sorted(missing, key=lambda name: -len(missing[name][0]))[:25]
    rows = [f"| {name} | {share(each)}" for name, each in packages.items()]
    whole = share([each["summary"] for each in files.values()])
    return "\n".join(
        [
            *(f"# Coverage\n\nVersion {__version__}; made by `python reports/measure_coverage.py`, with", ""),
            *(f"- `{path.name.removeprefix('coverage.')}`" for path in sorted(FOLDER.glob("coverage.*compiled"))),
            *("", "| package | lines | ran | branches | taken |", "| --- | ---: | ---: | ---: | ---: |", *rows),
            *(
                f"| all of these | {whole}",
                "",
                f"Not measured: {', '.join(sorted(apart))}, single modules.\n\n{NOTES}\n\n## Lines that did not run\n",
            ),
            f"{total} lines, {errors} of them in statements that raise an error. Files with most of them:\n",
            *("| file | lines | raise an error |", "| --- | ---: | ---: |"),
            *(f"| `{name}` | {len(missing[name][0])} | {missing[name][1]} |" for name in worst),
            "\n## Functions that none of these tests calls\n",
            *(f"- {each}" for each in idle or ["none"]),
        ]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", metavar="PART", help="measure only these parts of tests/")
    parser.add_argument(
        "--tier", default="fast", help="tests to run, as -m of pytest; with 'not nightly', all of a push"
    )
    parser.add_argument("--compiled", action=argparse.BooleanOptionalAction, help="only the one, or the other, run")
    parser.add_argument("--report", action="store_true", help="only write the report")
    asked = parser.parse_args()
    FOLDER.mkdir(parents=True, exist_ok=True)
    if asked.report:
        REPORT.write_text(report(), encoding="utf-8")
    else:
        for part, files in parts().items():
            if asked.only is None or part in asked.only:
                if asked.compiled is not False:
                    measure(part, files, asked.tier, compiled=True)
                if asked.compiled is not True and of_kernels(files):
                    measure(part, of_kernels(files), asked.tier, compiled=False)


if __name__ == "__main__":
    main()
