"""The manual and the code agree: examples run, commands have the options they are shown with, links lead somewhere."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest

import insnav
from insnav.cli import RENAMED, commands
from insnav.findings import Code
from tests.cli.conftest import ROOT

PAGES = sorted(p for p in (ROOT / "docs").rglob("*.md") if "auto_gallery" not in p.parts)
DOCUMENTS = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / ".github").glob("*.md")), *PAGES]
FENCED = re.compile(r"^```(\S*)[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
MESSAGES = sorted((ROOT / "insnav" / "messages").rglob("*en.toml"))
OF_OTHERS = {"--csv", "--dist", "--file", "--nthreads", "--nworkers", "--scope"}  # of other programs
LINK = re.compile(r"\]\(([^)\s]+)\)|^```\{(?:image|include)\} (\S+)", re.MULTILINE)


def blocks(page: Path, language: str) -> Iterator[str]:
    yield from (text for name, text in FENCED.findall(page.read_text(encoding="utf-8")) if name == language)


def named(page: Path) -> str:
    return str(page.relative_to(ROOT))


def anchors(page: Path) -> set[str]:
    """Names of the headings, as the hosts of such files make them."""
    heads = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", DOCUMENTS, ids=named)
def test_every_link_leads_somewhere(page: Path):
    for link in ("".join(found) for found in LINK.findall(page.read_text(encoding="utf-8"))):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = unquote(link).partition("#")
        target = (page.parent / path).resolve() if path else page
        if "auto_gallery" in target.parts:  # made by the build, from this
            target = ROOT / "docs" / "gallery" / "README.txt"
        assert target.exists() or target.with_suffix(".md").exists(), f"{link} in {named(page)}"
        if anchor:
            assert anchor in anchors(target), f"{link} in {named(page)}"


@pytest.mark.parametrize("page", [page for page in DOCUMENTS if any(blocks(page, "sh"))], ids=named)
def test_every_command_has_the_options_it_is_shown_with(page: Path):
    for block in blocks(page, "sh"):
        for line in block.replace("\\\n", " ").splitlines():
            for part in re.split(r"&&|;|\|", line.split(" #")[0]):
                words = shlex.split(part)
                if words and words[0] == "insnav" and len(words) > 1:
                    understood(words[1:])


def understood(words: list[str]) -> None:
    """The words of a command line are a command, its options and as many arguments as it takes."""
    command = commands()
    while hasattr(command, "commands"):
        assert words[0] in command.commands, f"there is no command {words[0]}"
        command, words = command.commands[words[0]], words[1:]
    with command.make_context("insnav", [], resilient_parsing=True) as context:
        context.resilient_parsing = False  # which was for making it without arguments: an unknown option is an error
        command.make_parser(context).parse_args(list(words))


def options_of(command: Any) -> set[str]:
    """Options of a command and of the commands below it."""
    below = getattr(command, "commands", {}).values()
    return {name for each in command.params for name in (*each.opts, *each.secondary_opts)}.union(
        *map(options_of, below)
    )


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES, *MESSAGES], ids=named)
def test_an_option_in_a_sentence_is_one_of_a_command(page: Path):
    words = set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", page.read_text(encoding="utf-8")))
    assert words <= options_of(commands()) | {"--help", *OF_OTHERS, *RENAMED}


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_a_code_in_a_sentence_is_one_of_a_finding(page: Path):
    codes = {each.value for each in Code}
    families = {code.partition(".")[0] for code in codes}
    words = set(re.findall(r"`([a-z_]+\.[a-z_.]+)`", page.read_text(encoding="utf-8")))
    files = {each for each in words if re.search(r"\.(csv|html|json|py|toml|txt|yaml)$", each)}
    assert {each for each in words - files if each.partition(".")[0] in families} <= codes


@pytest.fixture
def sample(files: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    for name in ("imu.csv", "gps.csv", "ref.csv"):
        (tmp_path / name).symlink_to(files / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("page", [page for page in PAGES if any(blocks(page, "python"))], ids=named)
def test_every_example_runs(page: Path, sample: Path):
    namespace: dict[str, object] = {}
    for text in blocks(page, "python"):
        exec(compile(text, named(page), "exec"), namespace)


def test_every_public_name_has_an_example():
    shown = "\n".join(text for page in PAGES for text in blocks(page, "python"))
    assert not [name for name in insnav.__all__ if f"insnav.{name}" not in shown]
