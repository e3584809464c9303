"""The words that a user reads are those of the glossary: `docs/glossary.md` says which, and which not."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
GLOSSARY = ROOT / "docs" / "glossary.md"
MANUAL = (str(path.relative_to(ROOT)) for path in sorted((ROOT / "docs").rglob("*.md")) if path != GLOSSARY)
HELP = (str(path.relative_to(ROOT)) for path in sorted((ROOT / "insnav" / "cli" / "texts").rglob("*.txt")))
DOCUMENTS = ("README.md", "trajectories/README.md", "reports/accuracy.md", *MANUAL, *HELP)


def avoided() -> dict[str, str]:
    """Expression that is not used any more -> the term to use instead."""
    rows = [line.strip("| \n").split(" | ") for line in GLOSSARY.read_text().splitlines() if line.startswith("| ")]
    found = {}
    for row in rows[1:]:
        if len(row) == 3:
            found |= {word.strip().lower(): row[0] for word in row[2].strip(" |").split(",") if word.strip()}
    return found


WORDS = avoided()
PATTERN = re.compile(
    r"(?<![-\w.`/])(" + "|".join(map(re.escape, sorted(WORDS, key=len, reverse=True))) + r")(?![-\w`(=])", re.I
)


def texts(path: Path) -> Iterator[tuple[int, str]]:
    """Every string of a module that a user may come to read: messages, help, labels, docstrings of public names."""
    tree = ast.parse(path.read_text())
    private = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
        and node.name.startswith("_")
        and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and id(node) not in private
            and " " in node.value
        ):
            yield node.lineno, node.value


def test_the_glossary_is_read() -> None:
    assert len(WORDS) > 40
    assert WORDS["twin"] == "simulated replica"
    assert PATTERN.search("what the twins show")
    assert not PATTERN.search("see `twin` and --imu-stamp")


@pytest.mark.parametrize(
    "room", sorted(p.name for p in (ROOT / "insnav").iterdir() if p.suffix in ("", ".py") and p.name != "__pycache__")
)
def test_messages_labels_and_public_docstrings(room: str) -> None:
    place = ROOT / "insnav" / room
    files = [place] if place.is_file() else sorted(place.rglob("*.py"))
    found = [
        f"{path.relative_to(ROOT)}:{line}: {match[0]!r}: say {WORDS[match[0].lower()]!r}"
        for path in files
        if path.suffix == ".py"
        for line, text in texts(path)
        for match in PATTERN.finditer(text)
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("name", DOCUMENTS)
def test_documents(name: str) -> None:
    lines = (ROOT / name).read_text().splitlines()
    found = [
        f"{name}:{number}: {match[0]!r}: say {WORDS[match[0].lower()]!r}"
        for number, line in enumerate(lines, 1)
        for match in PATTERN.finditer(line)
    ]
    assert not found, "\n".join(found)
