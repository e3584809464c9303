"""Prose in the package, its help, its messages and its manual has no more defects than `debts.toml` allows."""

from __future__ import annotations

import re
import tomllib
from collections import Counter
from pathlib import Path

import pytest

from tests.language.prose import LONGEST_BULLET, Text, comments, defects, docstrings, labels, paragraphs, texts

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "insnav"
DEBTS = tomllib.loads(Path(__file__).with_name("debts.toml").read_text(encoding="utf-8"))
FOLDERS = sorted(path for path in PACKAGE.iterdir() if any(path.rglob("*.py")) and path.name != "messages")
ROOMS = {f"insnav/{path.name}": sorted(path.rglob("*.py")) for path in FOLDERS if path.is_dir()} | {
    "insnav": sorted(PACKAGE.glob("*.py")),
    "messages": sorted({*(PACKAGE / "messages").rglob("*.en.toml"), *(PACKAGE / "messages").rglob("en.toml")})
    + sorted((PACKAGE / "messages").rglob("*.py")),
    "help": [
        *sorted((PACKAGE / "cli" / "texts").rglob("*.txt")),
        PACKAGE / "steps" / "inputs.toml",
        PACKAGE / "cli" / "options.toml",
    ],
    "manual": [*sorted((ROOT / "docs").rglob("*.md")), ROOT / "README.md", ROOT / "reports" / "accuracy.md"],
    "changelog": [ROOT / "CHANGELOG.md"],
}


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_has_the_defects_that_it_had(room: str):
    """A new defect fails; a mended defect lowers the number of its room and rule in `debts.toml`."""
    found = [(path.relative_to(ROOT), each) for path in ROOMS[room] for text in texts(path) for each in defects(text)]
    counts, known = Counter(defect.rule for _, defect in found), Counter(DEBTS.get(room, {}))
    lines = [
        f"{path}:{each.line}: {each.rule}: {each.text}" for path, each in found if counts[each.rule] > known[each.rule]
    ]
    assert counts == known, "\n".join([f"{room}: {dict(counts)}, not {dict(known)} as in debts.toml", *lines])


def test_debts_are_of_rooms_that_there_are():
    assert set(DEBTS) <= set(ROOMS)


def test_entries_of_the_changelog_are_short():
    bullets = re.findall(
        r"^- ((?:.+\n?)(?:^ +.+\n?)*)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert bullets
    assert not [bullet for bullet in bullets if len(bullet.split()) > LONGEST_BULLET]


@pytest.mark.parametrize(
    ("words", "rules"),
    [
        ("Return what the fixes add.", ["free relative"]),
        ("Errors, those of the reference too.", ["free relative"]),
        ("Noise differs from that of the other gyros.", []),
        ("Answers: what is the mounting?", []),
        ("Return the delay if the fixes told it.", ["private verb"]),
        ("Set the week (else --week).", ["else option"]),
        ("How much the fixes scatter.", ["opening"]),
        ("Whether a fix is used", ["opening"]),
        ("Return the bias [rad/s]; the scale factor; the drift.", []),
        ("word " * 9 + "one; " + "word " * 9 + "two; three.", ["semicolons"]),
        ("word " * 25 + ".", []),
        ("word " * 26 + ".", ["long sentence"]),
        ("word " * 13 + ".\n\n" + "word " * 13, []),
        ("word " * 24 + "``a b c`` (Groves, 2013, section 5.7).", []),
        (">>> insnav.load(what, told) # " + "word " * 26, []),
    ],
)
def test_a_rule_finds_its_defect(words: str, rules: list[str]):
    assert [defect.rule for defect in defects(Text(1, words, opening=True))] == rules


def test_texts_are_read_from_code_and_pages():
    source = '"""Module."""\n# A comment\n# of two lines.\nx = 1  # value [m]  # noqa: E501\n'
    assert [text.words for text in docstrings(source)] == ["Module."]
    assert [text.words.strip() for text in comments(source)] == ["A comment\nof two lines.", "value [m]  #"]
    source = '"""Not a label at all."""\nx = f"error of {name} only", "two words", "a label of \\"s\\""\n'
    assert [text.words for text in labels(source)] == ["error of 1 only", 'a label of "s"']
    page = "# Title\n\nA [link](a.md) in text.\n\n```\ncode\n```\n\n| a | table |\n"
    assert [(text.line, text.words.strip()) for text in paragraphs(page) if text.words.strip()] == [
        (3, "A link in text.")
    ]
