"""Accuracy baseline for later versions (``baseline.json``), and the origin of its figures."""

from __future__ import annotations

import json
import os
import platform
import subprocess
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from insnav.exceptions import InputError, reason_of
from insnav.output.folder import write_text
from insnav.regression.evaluate import BY_KEY, NOTHING, Accuracy, CaseResult
from insnav.types import FloatArray
from insnav.version import __version__

_PACKAGES = ("numpy", "scipy", "numba", "filterpy", "pandas", "pymap3d")
_CPUINFO = Path("/proc/cpuinfo")
BASELINE_FILE = "baseline.json"
FORMAT = 1
_DIGITS = 5  # significant digits of stored values: their rounding, 1e-5 at most, is far below any relevant change


@dataclass(frozen=True, slots=True)
class Origin:
    """Origin of stored accuracy figures: software, time and computer."""

    version: str  # version of insnav
    commit: str  # abbreviated git commit; a plus sign at its end means uncommitted changes
    date: str  # time of the run in UTC, to the minute
    packages: dict[str, str]  # versions of Python and of relevant packages
    computer: str  # number and model of its processors


def origin(folder: Path) -> Origin:
    """Determine version, commit, time and computer of this run."""
    packages = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            packages[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            packages[name] = ""
    commit = _git(folder, "rev-parse", "--short=10", "HEAD")  # no commit outside a git repository
    # only code and drives count as changes, because every run rewrites the reports
    changed = _git(folder, "status", "--porcelain", "--untracked-files=no", "--", ":/insnav", ":/trajectories")
    commit += "+" if commit and changed else ""
    date = datetime.now(UTC).strftime("%Y-%m-%dT%H:%MZ")
    return Origin(__version__, commit, date, packages, computer())


def computer() -> str:
    """Return number and model of this computer's processors."""
    model = platform.processor() or platform.machine()
    if _CPUINFO.is_file():
        lines = _CPUINFO.read_text(encoding="utf-8", errors="replace").splitlines()
        model = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), model)
    return f"{os.cpu_count()} x {' '.join(model.split())}"


def _git(folder: Path, *arguments: str) -> str:
    try:
        result = subprocess.run(
            ["git", "-C", str(folder), *arguments], capture_output=True, text=True, timeout=20.0, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return result.stdout.strip() if result.returncode == 0 else ""


@dataclass(frozen=True, slots=True)
class Baseline:
    """Stored accuracy of every case, and the origin of these figures."""

    origin: Origin
    cases: dict[str, CaseResult]  # by name; without `Measured.spread`, error messages and file digests


def renewed(old: Baseline | None, result: Accuracy, origin: Origin) -> Baseline:
    """Build a new baseline from a result; cases that were skipped keep their figures of the old baseline."""
    old_cases = {} if old is None else {name: case for name, case in old.cases.items() if name in result.skipped}
    new_cases = {name: case for name, case in result.cases.items() if case.measured.values}
    return Baseline(origin, old_cases | new_cases)


def read_baseline(path: Path) -> Baseline | None:
    """Read a baseline; None if the file does not exist. Raises: InputError: a damaged file, or another format."""
    text = kept_text("regress.unreadable_baseline", path)
    if text is None:
        return None
    try:
        content = json.loads(text)
        if content["format"] != FORMAT:
            raise InputError("regress.baseline_format", where=str(path), format=content["format"], known=FORMAT)
        cases = {name: _case(case) for name, case in content["cases"].items()}
        return Baseline(Origin(**content["origin"]), cases)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            "regress.damaged_baseline", where=str(path), kind=type(error).__name__, reason=str(error)
        ) from None


def kept_text(code: str, path: Path) -> str | None:
    """Read a text file; None if it does not exist. Raises: InputError with this code: the file cannot be read."""
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise InputError(code, where=str(path), reason=reason_of(error)) from None


def write_baseline(path: Path, baseline: Baseline) -> None:
    """Write a baseline with one metric per line, so that line-by-line comparisons of two files are readable.

    Raises: OutputError: the file cannot be written.
    """
    lines = ["{", f' "format": {FORMAT},', f' "origin": {json.dumps(asdict(baseline.origin))},', ' "cases": {']
    for number, (name, case) in enumerate(baseline.cases.items(), start=1):
        head = {"digest": case.digest, "pieces": case.pieces, "failed": sorted(case.failures)}
        rows = [f"   {json.dumps(key)}: {json.dumps(value)}" for key, value in head.items()]
        rows.append(f'   "growth": {json.dumps(short(case.measured.growth))}')
        figures = case.measured.values.items()
        values = ",\n".join(f"    {json.dumps(key)}: {json.dumps(short(value))}" for key, value in figures)
        rows.append(f'   "values": {{\n{values}\n   }}')
        comma = "," if number < len(baseline.cases) else ""
        lines.append(f"  {json.dumps(name)}: {{\n" + ",\n".join(rows) + f"\n  }}{comma}")
    write_text(path, "\n".join([*lines, " }", "}"]) + "\n")


def short(value: FloatArray, digits: int = _DIGITS) -> Any:
    """Round an array to significant digits, as nested lists for JSON; NaN becomes None."""
    if value.ndim:
        return [short(row, digits) for row in value]
    return float(f"{value:.{digits}g}") if np.isfinite(value) else None


def _case(content: Mapping[str, Any]) -> CaseResult:
    # null in the file becomes NaN in the array: an unknown value
    values = {key: np.array([*value], dtype=np.float64) for key, value in content["values"].items() if key in BY_KEY}
    measured = replace(NOTHING, values=values, growth=np.array(content["growth"], dtype=np.float64))
    return CaseResult(content["digest"], content["pieces"], measured, dict.fromkeys(content["failed"]), {})
