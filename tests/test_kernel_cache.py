"""Compiled kernels that cannot be read or written cost time, and no run."""

from __future__ import annotations

import os
import pkgutil
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from numba.core.dispatcher import Dispatcher

from insnav import kernels

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


def test_a_kernel_from_the_cache_is_compiled_into_another(tmp_path):
    script, cache = tmp_path / "script.py", {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    kept = SOURCE.partition("print")[0]
    (tmp_path / "kept.py").write_text(kept, encoding="utf-8")
    caller = kept.replace("@njit", "from kept import kernel\n\n@njit").replace("def kernel", "def caller")
    (tmp_path / "further.py").write_text(caller.replace("2.0 * x", "1.0 + kernel(x)"), encoding="utf-8")
    script.write_text("from kept import kernel\nprint(kernel(21.0))\n", encoding="utf-8")
    assert ran(script, **cache) == ["42.0"]
    hits = "print(caller(21.0), *(sum(each.stats.cache_hits.values()) for each in (kernel, caller)))\n"
    further = "from further import caller, kernel\n"
    script.write_text(further + "kernel(21.0)\n" + hits, encoding="utf-8")
    assert ran(script, **cache) == ["43.0", "1", "0"]
    script.write_text(further + hits, encoding="utf-8")
    assert ran(script, **cache) == ["43.0", "0", "1"]


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


def test_options_of_python_do_not_compile_kernels_again(tmp_path):
    script, cache = tmp_path / "script.py", tmp_path / "cache"
    script.write_text(
        SOURCE.replace("    return", '    """Twice."""\n    assert x > 0.0\n    return'), encoding="utf-8"
    )
    assert ran(script, NUMBA_CACHE_DIR=str(cache)) == ["42.0", "True", "0"]
    assert ran(script, NUMBA_CACHE_DIR=str(cache), PYTHONOPTIMIZE="2") == ["42.0", "True", "1"]


@pytest.mark.skipif(sys.platform != "linux", reason="needs folders that nobody can write, /proc")
def test_without_a_folder_every_run_compiles(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(f"exec(compile({SOURCE!r}, '/proc/kernel.py', 'exec'))", encoding="utf-8")
    nowhere = {"NUMBA_CACHE_DIR": "/proc/cache", "HOME": "/proc", "XDG_CACHE_HOME": "/proc"}
    assert ran(script, **nowhere) == ["42.0", "False", "0"]


def test_a_kernel_is_compiled_anew_when_one_of_another_file_changes(tmp_path):
    """It has that one's code in it, and numba looks at the kernel's own file alone."""
    package, script = Path(__file__).parents[1] / "insnav", tmp_path / "script.py"
    shutil.copytree(package, tmp_path / "insnav", ignore=shutil.ignore_patterns("__pycache__"))
    script.write_text(
        "import numpy as np\n"
        "from insnav.kernels.errorstate import move_along\n"
        "state = np.zeros((1, 10))\n"
        "state[0, 3] = 1.0\n"
        "move_along(state, np.ones(1))\n"
        "print(1.0 / state[0, 0], sum(move_along.stats.cache_hits.values()))\n",
        encoding="utf-8",
    )
    places = {"PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    meridian = 6378137.0 * (1.0 - 6.69437999014e-3)  # radius at the equator [m]: WGS 84
    radius, hits = ran(script, **places)
    assert float(radius) == pytest.approx(meridian, abs=1e-3)
    assert hits == "0"
    assert ran(script, **places) == [radius, "1"]
    earth = tmp_path / "insnav" / "kernels" / "earth.py"
    earth.write_text(earth.read_text("utf-8").replace("6378137.0", "3000000.0"), "utf-8")
    radius, hits = ran(script, **places)
    assert float(radius) == pytest.approx(meridian * 3000000.0 / 6378137.0, abs=1e-3)
    assert hits == "0"


def test_all_kernels_take_the_same_liberties():
    """One that reordered sums changed others: the flight had 0.872 or 0.874 m, by what was compiled first."""
    modules = [import_module(f"insnav.kernels.{each.name}") for each in pkgutil.iter_modules(kernels.__path__)]
    found = {id(each): each for module in modules for each in vars(module).values() if isinstance(each, Dispatcher)}
    assert len(found) > 50
    other = [each.__name__ for each in found.values() if each.targetoptions["fastmath"] != {"contract"}]
    assert sorted(other) == ["_square_sum", "inner_product"]  # which call nothing of numpy
