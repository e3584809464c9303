"""Compiled kernels that cannot be read or written cost time, and no run."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

SOURCE = """
from insnav.kernels import njit

@njit(cache=True)
def kernel(x):
    return 2.0 * x

print(kernel(21.0), kernel.stats.cache_path is not None, sum(kernel.stats.cache_hits.values()))
"""


def ran(script: Path, **environment: str) -> list[str]:
    paths = {"PYTHONPATH": str(Path(__file__).parents[1]), **environment}
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, check=True, env={**os.environ, **paths}
    )
    return done.stdout.split()


@pytest.mark.parametrize("ending", ["nbc", "nbi"])
@pytest.mark.parametrize("size", [0, 40])
def test_a_file_that_was_cut_short_is_written_anew(tmp_path, ending, size):
    script, cache = tmp_path / "script.py", tmp_path / "cache"
    script.write_text(SOURCE, encoding="utf-8")
    assert ran(script, NUMBA_CACHE_DIR=str(cache)) == ["42.0", "True", "0"]
    assert ran(script, NUMBA_CACHE_DIR=str(cache)) == ["42.0", "True", "1"]
    for file in cache.rglob(f"script.kernel*.{ending}"):
        file.write_bytes(file.read_bytes()[:size])
    assert ran(script, NUMBA_CACHE_DIR=str(cache)) == ["42.0", "True", "0"]
    assert ran(script, NUMBA_CACHE_DIR=str(cache)) == ["42.0", "True", "1"]


@pytest.mark.skipif(sys.platform != "linux", reason="needs folders that nobody can write, /proc")
def test_without_a_folder_every_run_compiles(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(f"exec(compile({SOURCE!r}, '/proc/kernel.py', 'exec'))", encoding="utf-8")
    nowhere = {"NUMBA_CACHE_DIR": "/proc/cache", "HOME": "/proc", "XDG_CACHE_HOME": "/proc"}
    assert ran(script, **nowhere) == ["42.0", "False", "0"]
