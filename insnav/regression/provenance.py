"""Where and with what figures were made: version, commit, date, packages, computer."""

from __future__ import annotations

import os
import platform
import subprocess
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

from insnav.version import __version__

_PACKAGES = ("numpy", "scipy", "numba", "filterpy", "pandas", "pymap3d")
_CPUINFO = Path("/proc/cpuinfo")


@dataclass(frozen=True, slots=True)
class Origin:
    """What belongs to figures that are kept."""

    # of insnav; a plus sign after the commit says that files had changed since; UTC, to the minute
    version: str
    commit: str
    date: str
    packages: dict[str, str]  # releases of Python and of what results depend on
    computer: str  # number of processors, and their model


def origin(folder: Path) -> Origin:
    """Find out where and with what this is running."""
    packages = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            packages[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            packages[name] = ""
    date = datetime.now(UTC).strftime("%Y-%m-%dT%H:%MZ")
    return Origin(__version__, _commit(folder), date, packages, computer())


def computer() -> str:
    """Number of processors of this computer, and their model."""
    model = platform.processor() or platform.machine()
    if _CPUINFO.is_file():
        lines = _CPUINFO.read_text(encoding="utf-8", errors="replace").splitlines()
        model = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), model)
    return f"{os.cpu_count()} x {' '.join(model.split())}"


def _commit(folder: Path) -> str:
    """Short commit; empty without one."""
    name = _git(folder, "rev-parse", "--short=10", "HEAD")
    # the reports themselves change with every run
    changed = _git(folder, "status", "--porcelain", "--untracked-files=no", "--", ":/insnav", ":/trajectories")
    return name + ("+" if name and changed else "")


def _git(folder: Path, *arguments: str) -> str:
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *arguments], capture_output=True, text=True, timeout=20.0, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
