"""Every place of the source that makes an error, with the code and the values that it gives.

An error is made by a class of `insnav.exceptions`, or by a function whose first parameter is called ``code`` and which
hands it on to one, such as `insnav.exceptions.writing`.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from insnav import exceptions
from insnav.exceptions import InsnavError

ROOT = Path(exceptions.__file__).parent
CODE = re.compile(r"[a-z_]+(\.[a-z0-9_]+)+")


@dataclass(frozen=True)
class Maker:
    """What makes an error of a code."""

    kind: str  # of the error
    own: frozenset[str]  # names of its parameters that are no values
    adds: frozenset[str] = frozenset()  # values that it gives itself


@dataclass(frozen=True)
class Site:
    """A place that makes an error."""

    place: str
    kind: str
    code: str
    values: frozenset[str]
    more: bool  # values come from a mapping, too


CLASSES = {
    name: Maker(name, frozenset({"where", "gives"}))
    for name, each in vars(exceptions).items()
    if isinstance(each, type) and issubclass(each, InsnavError)
}


def error_sites() -> list[Site]:
    """Find all places that make an error with a code."""
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(ROOT.rglob("*.py"))}
    makers: dict[tuple[Path | None, str], Maker] = {(None, name): maker for name, maker in CLASSES.items()}
    count = 0
    while count != len(makers):  # one may call another
        count = len(makers)
        for path, tree in trees.items():
            for node in ast.walk(tree):
                if isinstance(node, ast.FunctionDef) and (maker := maker_of(node, path, makers)):
                    makers[path if node.name.startswith("_") else None, node.name] = maker
    return [site for path, tree in trees.items() for site in sites_of(tree, path, makers)]


def maker_of(function: ast.FunctionDef, path: Path, makers: dict[tuple[Path | None, str], Maker]) -> Maker | None:
    """What a function makes of a code that it is given; None if it makes no error of it."""
    names = [each.arg for each in (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs)]
    if "code" not in names:
        return None
    for call, maker in calls(function, path, makers):
        if call.args and isinstance(call.args[0], ast.Name) and call.args[0].id == "code":
            given = {each.arg for each in call.keywords if each.arg} - maker.own
            return Maker(maker.kind, frozenset(names), frozenset(given) | maker.adds)
    return None


def calls(tree: ast.AST, path: Path, makers: dict[tuple[Path | None, str], Maker]) -> Iterator[tuple[ast.Call, Maker]]:
    """Calls that make an error."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
            name = node.func.id if isinstance(node.func, ast.Name) else node.func.attr
            maker = makers.get((path, name)) or makers.get((None, name))
            if maker is not None:
                yield node, maker


def sites_of(tree: ast.AST, path: Path, makers: dict[tuple[Path | None, str], Maker]) -> Iterator[Site]:
    """Places of a module that make an error of a code."""
    for call, maker in calls(tree, path, makers):
        first = call.args[0] if call.args else None
        for node in (first.body, first.orelse) if isinstance(first, ast.IfExp) else (first,):
            place = f"{path.relative_to(ROOT)}:{call.lineno}"
            if isinstance(node, ast.Name) and node.id == "code":  # handed on; its callers are the sites
                continue
            assert isinstance(node, ast.Constant), f"{place}: the code of an error is a literal"
            assert CODE.fullmatch(str(node.value)), f"{place}: {node.value!r} is no code of an error"
            values = {each.arg for each in call.keywords if each.arg} - maker.own
            more = any(each.arg is None for each in call.keywords)
            yield Site(place, maker.kind, str(node.value), frozenset(values) | maker.adds, more)
