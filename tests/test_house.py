"""The package has no import cycles, and two counts of it only go down."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import grimp

import insnav

ROOT = Path(insnav.__file__).parent
LINES = 64011  # of all Python files of the package
CONSTANTS = 430  # named numbers at the top of the modules in `TUNED`
TUNED = ("filter", "alignment", "session", "steps", "explain")


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
