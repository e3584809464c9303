"""The first command of somebody who has no data."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import Cli, cli

__all__ = ["cli"]


def test_the_demo_says_its_command_and_that_command_gives_the_same(cli: Cli) -> None:
    shown = cli("demo")
    assert shown.code == 0
    facts = json.loads(Path("demo", "run.json").read_text())
    assert facts["accuracy"]["all"]["horizontal_m"]["rms"] < 1.0
    (line,) = [line for line in shown.err.splitlines() if line.startswith("$ insnav run ")]
    again = cli(*shlex.split(line)[2:-1], "again")
    assert again.code == 0
    assert Path("demo", "smoothed.csv").read_bytes() == Path("again", "smoothed.csv").read_bytes()
    kept = Path("demo", "run.json").read_bytes()
    assert cli("demo").code == 0
    assert Path("demo~1", "run.json").read_bytes() == kept


COMPARE = """
import sys
from insnav.cli import main
sys.argv = ["insnav", "demo", "--out", "demo", "--quiet"]
try:
    main()
except SystemExit as end:
    assert not end.code
print("what compiles kernels is left out", "numba.np.arraymath" not in sys.modules)
from insnav.kernels import ahead
given = {}
for kernel, *types in sum(ahead._kernels(), ()):
    given.setdefault(kernel, set()).add(tuple(map(ahead._type, types)))
for kernel, types in given.items():
    print(kernel.py_func.__name__, set(kernel.signatures) == types)
entered = {name for name, module in sys.modules.items() if name.startswith("insnav.kernels.")}
for name in entered:
    for kernel in vars(sys.modules[name]).values():
        if getattr(kernel, "signatures", ()) and kernel not in given:
            print(kernel.py_func.__name__, "is not compiled ahead")
"""


def test_what_a_first_run_compiles_ahead_is_what_a_run_needs(tmp_path: Path) -> None:
    # what this process compiled itself has signatures of all kernels within, too
    first = "from insnav.kernels import ahead; ahead.needed() and ahead.compile_ahead()"
    subprocess.run([sys.executable, "-c", first], check=True)
    shown = subprocess.run([sys.executable, "-c", COMPARE], cwd=tmp_path, capture_output=True, text=True, check=True)
    lines = shown.stdout.splitlines()
    assert len(lines) > 20
    assert [line for line in lines if not line.endswith("True")] == []


def test_kernels_are_compiled_ahead_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from insnav.kernels import ahead, errorstate

    monkeypatch.setattr(errorstate.propagate.stats.__class__, "cache_path", str(tmp_path), raising=False)
    monkeypatch.setattr(ahead, "_kernels", tuple)
    monkeypatch.setattr(ahead, "MOST", 1)
    assert ahead.needed()
    ahead.compile_ahead()
    assert not ahead.needed()
    monkeypatch.setattr(ahead, "numba_version", "another")
    assert ahead.needed()
