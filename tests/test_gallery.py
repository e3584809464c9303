"""The gallery shows what a user can do: it imports public names only."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import insnav

GALLERY = sorted((Path(__file__).parents[1] / "docs" / "gallery").glob("*.py"))
THEORY = {"plot_faults.py"}  # a figure of the theory of the explanation


@pytest.mark.parametrize("file", [each for each in GALLERY if each.name not in THEORY], ids=lambda each: each.stem)
def test_an_example_uses_public_names_only(file: Path) -> None:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    imported = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module]
    names = {alias.name for node in imported if node.module == "insnav" for alias in node.names}
    assert not [node.module for node in imported if node.module.startswith("insnav.")]
    used = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "insnav"
    }
    assert names | used <= {*insnav.__all__}
