"""The package has no import cycles, one table of steps and few parameters. Two counts of it only go down."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import grimp

import insnav
from insnav.steps import STEPS

ROOT = Path(insnav.__file__).parent
LINES = 63103  # of all Python files of the package
CONSTANTS = 390  # named numbers at the top of the modules in `TUNED`
TUNED = ("filter", "alignment", "session", "steps", "explain")
MOST_PARAMETERS = 8


def test_no_import_cycles() -> None:
    """Imports under TYPE_CHECKING and inside functions count, too."""
    graph = grimp.build_graph("insnav", exclude_type_checking_imports=False, cache_dir=None)
    assert len(graph.modules) > 250
    cycles = {}
    for module in sorted(graph.modules):
        for imported in sorted(graph.find_modules_directly_imported_by(module)):
            back = graph.find_shortest_chain(imported, module)
            if back is not None:
                cycles.setdefault(frozenset(back), " -> ".join((module, *back)))
    assert not cycles, "move what two modules need from each other to a lower one:\n" + "\n".join(cycles.values())


def test_only_the_table_names_several_steps() -> None:
    """A step imports no other, and commands run a prefix of the table up to one step."""
    for path in ROOT.rglob("*.py"):
        named = {*steps_named(path.read_text(encoding="utf-8"))} - {path.stem if path.parent.name == "steps" else ""}
        assert len(named) <= (path.parent.name != "steps"), f"{path}: {sorted(named)}"


def test_steps_are_found_by_import_and_prefix() -> None:
    assert [*steps_named('from insnav.steps.align import align\ndrive.until("noise")\nknown = "explain"\n')] == [
        "align",
        "noise",
    ]


def test_functions_on_the_path_of_a_recording_have_few_parameters() -> None:
    rooms = [ROOT / name for name in ("input", "steps", "filter", "explain", "alignment")]
    paths = [*(path for room in rooms for path in room.rglob("*.py")), *(ROOT / "session").glob("[dr][re]*.py")]
    assert len(paths) > 50
    for path in paths:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef):
                names = [each.arg for each in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
                assert len({*names} - {"self", "cls"}) <= MOST_PARAMETERS, f"{path}:{node.lineno}: {names}"


def test_lines_only_go_down() -> None:
    check("LINES", LINES, sum(len(text.splitlines()) for text in sources(ROOT)))


def test_numeric_constants_only_go_down() -> None:
    check("CONSTANTS", CONSTANTS, sum(len([*constants(text)]) for name in TUNED for text in sources(ROOT / name)))


def test_constants_are_names_of_plain_numbers() -> None:
    counted = "A = 1\nB: float = -2.0 * A\nC, (D, E) = 1.0, (2, 3)\n"
    assert [*constants(counted + "F = {1: 'x'}\nG = float(1)\nH = True\nI = A\nJ: int\n")] == ["A", "B", "C", "D", "E"]


def check(name: str, limit: int, count: int) -> None:
    """Compare a count with the number that is committed in this file."""
    assert count <= limit, f"{name} rose from {limit} to {count}: remove as many elsewhere. Never raise the number."
    assert count == limit, f"{name} fell from {limit} to {count}: lower the number in tests/test_house.py to {count}."


def steps_named(source: str) -> Iterator[str]:
    """Yield the steps that a module imports, or runs a drive up to."""
    for node in ast.walk(ast.parse(source)):
        name = ""
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("insnav.steps."):
            name = str(node.module).rpartition(".")[2]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "until":
            name = node.args[0].value if isinstance(node.args[0], ast.Constant) else ""
        if name in STEPS:
            yield name


def sources(folder: Path) -> list[str]:
    return [path.read_text(encoding="utf-8") for path in folder.rglob("*.py")]


def constants(source: str) -> Iterator[str]:
    """Yield the names of a module whose values have a number in them and no string, mapping, call or lambda."""
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            parts = [*ast.walk(node.value)]
            kinds = {type(part.value) if isinstance(part, ast.Constant) else type(part) for part in parts}
            if kinds & {int, float} and not kinds & {str, ast.Call, ast.Lambda, ast.Dict}:
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                yield from (part.id for each in targets for part in ast.walk(each) if isinstance(part, ast.Name))
