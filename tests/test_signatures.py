"""From file to page no function takes so many parameters that its calls cannot be read."""

from __future__ import annotations

import ast
from pathlib import Path

import insnav

MOST = 10
ROOMS = ("input", "session", "filter", "errors", "report", "output")


def test_no_function_takes_more_than_ten_parameters() -> None:
    root = Path(insnav.__file__).parent
    files = [path for room in ROOMS for path in sorted((root / room).rglob("*.py"))]
    assert len(files) > 100
    many = []
    for path in files:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef):
                names = [each.arg for each in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
                if len([name for name in names if name not in ("self", "cls")]) > MOST:
                    many.append(f"{path.relative_to(root)}: {node.name}")
    assert many == []
