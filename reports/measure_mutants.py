"""Mutation testing: how many small faults in the code of kernels, filter and fault search the tests find.

``python reports/measure_mutants.py [--count 180] [--seed 1]`` draws mutants at random, each one change of the syntax
tree in one place: a comparison, an operator, a sign, a number, ``and`` or ``or``, ``break`` or ``continue``. For each
it runs the tests that ran the changed line, quickest first, and stops at the first failure; the data of
``measure_coverage.py`` tell which these are. A mutant that fails a test, or takes six times as long, is *killed*.

A process that has loaded the package and the tests forks for each mutant, so the mutant exists only in the memory of
the child. A mutant outside of functions, or in a kernel, is imported anew there.
Kernels meet uncompiled tests. An error there that is no failed assertion, such as an index outside of an array, counts
as *broken*: compiled code may go on. Kernels that no uncompiled test runs are compiled anew in the child, with all that
contain them.

``mutations.md`` is about mutated input files, this is about mutated code.
"""

from __future__ import annotations

import argparse
import ast
import importlib.abc
import importlib.util
import json
import os
import random
import signal
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from types import CodeType
from typing import Any

import coverage
from measure_coverage import FOLDER, ROOT
from scipy.stats import beta

sys.path.insert(0, str(ROOT))
from insnav.version import __version__
from tests.durations import TIERS, read_durations

REPORT = ROOT / "reports" / "mutation_testing.md"
JUDGED = ROOT / "reports" / "mutants_judged.json"  # what survivors are judged to be, by file and line
PACKAGES = ("kernels", "filter", "explain")
APART = ("insnav/kernels/ahead.py", "insnav/kernels/__init__.py")  # these start compilers and processes
MOST = 8.0  # duration of the tests of a mutant [s]
QUICK = 2.0  # largest duration of an uncompiled test [s]
SLOWER, START = 6.0, 60.0  # time limit: times the duration of the tests, plus the start and the compiling [s]
NOTES = f"""\
A third of the mutants is from each package, drawn at random. A mutant meets tests that ran its line, of {MOST:g} s
together, not the whole suite: other tests may kill some survivors. It is killed by a failed test or by its time limit.
*At first* is before tests were written against the survivors of this sample, which only *now* counts.
Mutated input files are in [mutations](mutations.md)."""
SWAPS: dict[type, tuple[type, ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
    ast.Add: (ast.Sub,),
    ast.Sub: (ast.Add,),
    ast.Mult: (ast.Div,),
    ast.Div: (ast.Mult,),
    ast.FloorDiv: (ast.Div,),
    ast.Mod: (ast.Mult,),
    ast.Pow: (ast.Mult,),
    ast.BitAnd: (ast.BitOr,),
    ast.BitOr: (ast.BitAnd,),
    ast.And: (ast.Or,),
    ast.Or: (ast.And,),
}


@dataclass(frozen=True)
class Mutant:
    """One change: the `choice`-th of the `place`-th node of a file, counted by `ast.walk`."""

    file: str
    line: int
    place: int
    choice: int
    change: str


def alternatives(node: ast.AST) -> list[ast.AST]:
    """List the nodes that may stand in the place of this one."""
    fields = dict(ast.iter_fields(node))
    kind = type(node)
    if isinstance(node, ast.Compare):
        first, *rest = node.ops
        return [kind(**fields | {"ops": [other(), *rest]}) for other in SWAPS[type(first)]]
    if isinstance(node, ast.BinOp | ast.AugAssign | ast.BoolOp):
        return [kind(**fields | {"op": other()}) for other in SWAPS.get(type(node.op), ())]
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
        return [node.operand]
    if isinstance(node, ast.Break):
        return [ast.Continue()]
    if isinstance(node, ast.Continue):
        return [ast.Break()]
    if isinstance(node, ast.Constant) and isinstance(node.value, bool):
        return [ast.Constant(not node.value)]
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return [ast.Constant(node.value + 1 if isinstance(node.value, int) else 2.0 * node.value or 1.0)]
    return []


def unseen(tree: ast.AST) -> set[int]:
    """Find nodes that do not run, such as annotations, and decorators, which choose the compiler and not the result."""
    found: set[int] = set()
    for node in ast.walk(tree):
        apart: list[Any] = [getattr(node, name, None) for name in ("annotation", "returns")]
        apart += getattr(node, "decorator_list", [])
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            apart += [node.test, *node.body]
        if isinstance(node, ast.Assert):  # for mypy; removed by -O
            apart.append(node)
        found |= {id(part) for each in apart if each is not None for part in ast.walk(each)}
    return found


def mutants(file: str) -> list[Mutant]:
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    apart = unseen(tree)
    return [
        Mutant(file, node.lineno, place, choice, f"{ast.unparse(node)} -> {ast.unparse(other)}".replace("\n", " "))
        for place, node in enumerate(ast.walk(tree))
        if id(node) not in apart and hasattr(node, "lineno")
        for choice, other in enumerate(alternatives(node))
    ]


def mutated(mutant: Mutant) -> ast.Module:
    tree = ast.parse((ROOT / mutant.file).read_text(encoding="utf-8"))
    old = next(node for place, node in enumerate(ast.walk(tree)) if place == mutant.place)
    new = ast.copy_location(alternatives(old)[mutant.choice], old)

    class Swap(ast.NodeTransformer):
        def visit(self, node: ast.AST) -> Any:
            return new if node is old else self.generic_visit(node)

    return ast.fix_missing_locations(Swap().visit(tree))


def module_of(file: str) -> str:
    return file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def owner(module: Any, qualname: str) -> Any:
    """Find a plain function of a module by its name, through properties, caches and class methods."""
    found = module
    for name in qualname.partition(".<locals>")[0].split("."):
        found = vars(found)[name]
    for _ in range(3):
        for inner in ("fget", "func", "__func__", "__wrapped__"):
            found = getattr(found, inner, None) or found
    return found


def swapped(mutant: Mutant) -> bool:
    """Give the changed code to the loaded function that contains the mutant; false if there is none."""
    if "kernels/" in mutant.file:
        return False
    tree, at = mutated(mutant), mutant.line
    heads = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    inside = [node for node in heads if node.body[0].lineno <= at <= (node.end_lineno or 0)]
    if not inside:
        return False
    line = min(min([each.lineno, *(part.lineno for part in each.decorator_list)]) for each in inside)
    codes = [compile(tree, str(ROOT / mutant.file), "exec", dont_inherit=True)]
    for code in codes:
        codes += [each for each in code.co_consts if isinstance(each, CodeType)]
        if code.co_firstlineno == line and code.co_name == min(inside, key=lambda node: node.lineno).name:
            try:
                owner(sys.modules[module_of(mutant.file)], code.co_qualname).__code__ = code
            except (AttributeError, KeyError, ValueError, TypeError):
                return False
            return True
    return False


def with_mutant(mutant: Mutant) -> None:
    """Let this process import the mutant, and compile each kernel that may contain it without the cache."""
    name = module_of(mutant.file)
    if swapped(mutant):
        return
    unload()

    class Loader(importlib.abc.InspectLoader):
        def get_source(self, fullname: str) -> str:
            return (ROOT / mutant.file).read_text(encoding="utf-8")

        def get_code(self, fullname: str) -> Any:
            return compile(mutated(mutant), str(ROOT / mutant.file), "exec", dont_inherit=True)

    class Finder(importlib.abc.MetaPathFinder):
        def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:
            if fullname != name:
                return None
            folder = str((ROOT / mutant.file).parent) if mutant.file.endswith("__init__.py") else None
            places = None if folder is None else [folder]
            at = str(ROOT / mutant.file)
            return importlib.util.spec_from_file_location(name, at, loader=Loader(), submodule_search_locations=places)

    sys.meta_path.insert(0, Finder())
    if "kernels/" in mutant.file:
        from insnav import kernels

        affected, kept = containing(name), kernels._Kept

        def keep(function: Any) -> Any:
            if function.__module__ in affected:
                raise RuntimeError  # which means: there is no cache
            return kept(function)

        kernels._Kept = keep  # type: ignore[assignment, misc]


def containing(name: str) -> set[str]:
    """Find the modules of kernels that import this one, directly or not, and itself."""
    imports = {}
    for path in (ROOT / "insnav" / "kernels").glob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        imports[f"insnav.kernels.{path.stem}"] = {
            node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module
        }
    found = {name}
    while more := {other for other, of in imports.items() if of & found} - found:
        found |= more
    return found


@cache
def durations(how: str) -> dict[str, float]:
    """Seconds of each test: compiled, as the tiers have it; uncompiled, if it passed when coverage was measured."""
    found: dict[str, float] = {}
    passed: dict[str, float] = {}
    for path in FOLDER.glob(f"*.{how}.passed.json"):
        passed |= json.loads(path.read_text(encoding="utf-8"))
    if how == "uncompiled":
        return passed
    known = read_durations()
    for path in FOLDER.glob(f"coverage.*.{how}"):
        data = coverage.CoverageData(str(path))
        data.read()
        for test in data.measured_contexts():
            file, _, name = test.partition("::")
            of_file = known.get(file, {})
            if name:
                seconds = of_file.get(name, of_file.get(name.partition("[")[0], TIERS["push"]))
                found[test] = passed.get(test, seconds)
    return found


@cache
def contexts(file: str) -> dict[int, set[str]]:
    """Tests, and files of tests whose fixtures, ran each line; the empty name if the line ran on import."""
    found: dict[int, set[str]] = defaultdict(set)
    for path in FOLDER.glob("coverage.*compiled"):
        data = coverage.CoverageData(str(path))
        data.read()
        for line, names in data.contexts_by_lineno(str(ROOT / file)).items():
            found[line].update(names)
    return found


def statement(file: str, line: int) -> int:
    """First line of the simple statement, or head of a block, that a line belongs to: there coverage counts it."""
    heads = [
        node.lineno
        for node in ast.walk(ast.parse((ROOT / file).read_text(encoding="utf-8")))
        if isinstance(node, ast.stmt) and node.lineno <= line <= (node.end_lineno or node.lineno)
    ]
    return max(heads, default=line)


def tests_of(mutant: Mutant, how: str) -> list[str]:
    """Choose the tests that ran the line, then the others of their files, up to the time of `MOST`.

    The folder of tests that has the name of the package comes first, and in it the quickest.
    """
    own = "tests/" + Path(mutant.file).parts[1]
    of_line = contexts(mutant.file)
    ran = of_line.get(mutant.line, set()) | of_line.get(statement(mutant.file, mutant.line), set())
    if not ran - {""}:  # a constant of the module, or nothing: whatever runs the module
        ran = set().union(*of_line.values())
    known = durations(how)
    files = {each.partition("::")[0] for each in ran if each}
    direct = [each for each in known if each in ran]
    if how == "uncompiled" and not direct:  # the compiled tests meet the line
        return []
    shared = [each for each in known if each not in ran and each.partition("::")[0] in files]
    chosen, total = [], 0.0
    for group in (direct, shared):
        for each in sorted(group, key=lambda test: (not test.startswith(own), known[test])):
            total += known[each]
            if total <= MOST and (how == "compiled" or known[each] <= QUICK):
                chosen.append(each)
    return chosen


class OnlyAssertions:
    """Plugin: remember whether a test failed by an assertion."""

    failed = False

    def pytest_exception_interact(self, call: Any) -> None:
        self.failed |= call.excinfo.errisinstance(AssertionError)


def in_child(mutant: Mutant | None, tests: Sequence[str], *, compiled: bool) -> str:
    """Run tests in a fork of this process; returns passed, failed or late."""
    child = os.fork()
    if child == 0:
        code = 3
        try:
            null = os.open(os.environ.get("INSNAV_MUTANT_LOG", os.devnull), os.O_RDWR | os.O_CREAT | os.O_TRUNC)
            for stream in (0, 1, 2):
                os.dup2(null, stream)
            if not compiled:
                unload()
                os.environ["NUMBA_DISABLE_JIT"] = "1"
                sys.modules["numba.core.config"].reload_config()
            if mutant is not None:
                with_mutant(mutant)
            import pytest

            plugin = OnlyAssertions()
            options = ["-x", "-q", "-p", "no:cacheprovider", "-m", "", "--no-header", "--tb=short"]
            ended = int(pytest.main([*options, *tests], plugins=[plugin]))
            code = 0 if ended == 0 else 1 if ended in (1, 2) and (compiled or plugin.failed) else 4
        except BaseException:
            code = 1 if mutant is not None and compiled else 4
        finally:
            os._exit(code)
    known = durations("compiled" if compiled else "uncompiled")
    end = time.monotonic() + SLOWER * sum(known[each] for each in tests) + (START if compiled else 30.0)
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return {0: "passed", 1: "failed"}.get(os.waitstatus_to_exitcode(status), "broken")
        time.sleep(0.05)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return "late"


def judge(mutant: Mutant | None, file: str, line: int) -> dict[str, Any]:
    """Run the tests of a mutant, or of its unchanged line."""
    place = mutant or Mutant(file, line, 0, 0, "")
    begin, outcome, count = time.monotonic(), "passed", 0
    for how in ("uncompiled", "compiled") if "kernels/" in file else ("compiled",):
        tests = tests_of(place, how)
        count += len(tests)
        if tests:
            outcome = in_child(mutant, tests, compiled=how == "compiled")
            break
    return {"outcome": outcome, "tests": count, "seconds": round(time.monotonic() - begin, 1)}


def drawn(count: int, seed: int) -> list[Mutant]:
    """Draw mutants, the same number from each package, in random order."""
    chosen: list[Mutant] = []
    generator = random.Random(seed)
    for package in PACKAGES:
        files = sorted(str(path.relative_to(ROOT)) for path in (ROOT / "insnav" / package).rglob("*.py"))
        chosen += generator.sample([each for file in files if file not in APART for each in mutants(file)], count // 3)
    generator.shuffle(chosen)
    return chosen


def interval(killed: int, total: int) -> tuple[float, float]:
    """Clopper-Pearson interval of a share, 95 %."""
    low = beta.ppf(0.025, killed, total - killed + 1) if killed else 0.0
    high = beta.ppf(0.975, killed + 1, total - killed) if killed < total else 1.0
    return float(low), float(high)


def preload() -> None:
    """Load what every child needs: libraries, the package, its tests."""
    for name in ("numba", "numpy.testing", "scipy.stats", "scipy.signal", "scipy.optimize", "pytest", "pymap3d"):
        importlib.import_module(name)
    for folder in ("insnav/kernels", "insnav/filter", "insnav/explain", "tests/filter", "tests/explain"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            importlib.import_module(module_of(str(path.relative_to(ROOT))))


def unload() -> None:
    """Forget the package and its tests."""
    for name in [each for each in sys.modules if each.partition(".")[0] in ("insnav", "tests")]:
        del sys.modules[name]


def records(log: Path) -> Iterator[dict[str, Any]]:
    if log.exists():
        yield from map(json.loads, log.read_text(encoding="utf-8").splitlines())


def report(log: Path, judged: dict[str, str]) -> str:
    """Write the shares that were killed, and the survivors with what they are judged to be."""
    found: dict[tuple[str, int, int], dict[str, Any]] = {}
    first: dict[tuple[str, int, int], bool] = {}
    for each in records(log):
        key = each["file"], each["place"], each["choice"]
        found[key] = each
        first.setdefault(key, each["outcome"] != "passed")
    rows, left = [], []
    for package in (*PACKAGES, ""):
        part = {key: each for key, each in found.items() if f"insnav/{package}" in each["file"]}
        before, killed = sum(map(first.__getitem__, part)), sum(each["outcome"] != "passed" for each in part.values())
        equal = sum(judged.get(f"{key[0]}:{each['line']}", "").startswith("equivalent") for key, each in part.items())
        low, high = (f"{100.0 * bound:.0f}" for bound in interval(before, len(part)))
        share = f"{100.0 * before / len(part):.0f} % | {low} to {high} % | {100.0 * killed / len(part):.0f} %"
        rows.append(f"| {package or 'all'} | {len(part)} | {share} | {equal} |")
    for each in sorted(found.values(), key=lambda each: (each["file"], each["line"])):
        if each["outcome"] == "passed":
            place = f"{each['file']}:{each['line']}"
            left.append(
                f"| `{place}` | `{each['change'].replace('|', '¦')[:90]}` | {judged.get(place, 'not killed')} |"
            )
    return "\n".join(
        [
            f"# Mutants of the code\n\nVersion {__version__}; made by `python reports/measure_mutants.py`.\n",
            *("| package | mutants | killed at first | 95 % interval | killed now | survivors that are equivalent |",),
            *("| --- | ---: | ---: | ---: | ---: | ---: |", *rows, "", NOTES, "", "## Survivors", ""),
            *("| place | change | judgement |", "| --- | --- | --- |", *left, ""),
        ]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=180, help="mutants, a third from each package")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--log", type=Path, default=FOLDER / "mutants.jsonl", help="to resume, and for the report")
    parser.add_argument("--packages", nargs="*", default=PACKAGES, help="judge only those of these packages")
    parser.add_argument("--again", action="store_true", help="test the survivors again, with the tests added since")
    parser.add_argument("--unchanged", type=int, default=0, help="run the tests of so many mutants on unchanged code")
    parser.add_argument("--report", action="store_true", help="only write the report")
    asked = parser.parse_args()
    if asked.report:
        judged = json.loads(JUDGED.read_text(encoding="utf-8"))
        REPORT.write_text(report(asked.log, judged), encoding="utf-8")
        return
    preload()
    os.chdir(ROOT)
    chosen = [each for each in drawn(asked.count, asked.seed) if Path(each.file).parts[1] in asked.packages]
    for mutant in chosen[: asked.unchanged]:
        print(judge(None, mutant.file, mutant.line), mutant.file, mutant.line, flush=True)
    if asked.unchanged:
        return
    known = {(each["file"], each["place"], each["choice"]): each for each in records(asked.log)}
    for mutant in chosen:
        key = (mutant.file, mutant.place, mutant.choice)
        if key in known and not (asked.again and known[key]["outcome"] == "passed"):
            continue
        found = asdict(mutant) | judge(mutant, mutant.file, mutant.line)
        with asked.log.open("a", encoding="utf-8") as out:
            out.write(json.dumps(found) + "\n")
        print(
            found["outcome"], found["tests"], found["seconds"], mutant.file, mutant.line, mutant.change[:80], flush=True
        )


if __name__ == "__main__":
    main()
