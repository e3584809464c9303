"""The commands that the README shows are run as they stand; those that install are checked for their form."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest

from tests.cli.conftest import ROOT, Cli

README = ROOT / "README.md"
INSTALL = re.compile(
    r"(\S*/)?(python[\d.]*|pip[\d.]*) (-m )?(pip )?(-q |--quiet )*install (-\S+ )*['\"]?\.(\[\w+\])?['\"]?"
)
VENV = re.compile(r"(python[\d.]*|py) -m venv \S+")


def commands() -> list[str]:
    """Single commands of all code blocks, in order, continued lines joined."""
    text = README.read_text(encoding="utf-8").replace("\\\n", " ")
    fenced = re.findall(r"^```(?:\w*)\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    indented = re.findall(
        r"(?:^    .*\n)+", re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL), re.MULTILINE
    )
    lines = [line.strip().removeprefix("$ ") for block in (*fenced, *indented) for line in block.splitlines()]
    parts = [part.split("#")[0].strip() for line in lines for part in re.split(r"&&|;", line)]
    return [part for part in parts if part]


def of_insnav() -> list[list[str]]:
    """Arguments of the commands of insnav, wherever it is installed, without what they are piped into."""
    found = [shlex.split(command.split("|")[0]) for command in commands() if "insnav" in command.split()[0]]
    return [words[1:] for words in found if Path(words[0]).name == "insnav"]


def test_the_readme_shows_how_to_navigate_the_sample_drive():
    runs = [words for words in of_insnav() if words[0] == "run"]
    assert any("trajectories/sample/" in word for words in runs for word in words)


def test_installing_needs_only_python_and_this_folder():
    for command in commands():
        if " -m venv" in command:
            assert VENV.fullmatch(command), command
        elif "install" in command:
            assert INSTALL.fullmatch(command), command


@pytest.fixture
def checkout(files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the sample drive where the README expects it, and files of the names it uses as examples."""
    shutil.copytree(ROOT / "trajectories", tmp_path / "trajectories")
    for name in ("imu.csv", "gps.csv", "ref.csv"):
        shutil.copy(files / name, tmp_path / name)
    text = (files / "imu.csv").read_text().splitlines(keepends=True)
    (tmp_path / "drive.csv").write_text("".join(text))
    (tmp_path / "static.csv").write_text("".join(text[:6001]))
    shutil.copy(ROOT / "trajectories" / "sample" / "imu.toml", tmp_path / "mems.toml")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_command_of_the_readme_works(checkout: Path, cli: Cli):
    for words in of_insnav():
        if words[0] == "compare":  # an example may compare runs that no other example makes
            for name in (word for word in words[1:] if not word.startswith("-") and "." not in word):
                if not Path(name).exists():
                    made = cli("run", "drive.csv", "--gps", "gps.csv", "--figures", "none", "--out", name)
                    assert made.code == 0, made.err
        out = Path(words[words.index("--out") + 1]) if "--out" in words else Path("run")
        again = ["--force"] if out.exists() and words[0] == "run" and "--force" not in words else []
        shown = cli(*words, *again)
        assert shown.code == 0, f"insnav {shlex.join(words)}\n{shown.err}"
        assert shown.out


def test_chinese_pages_use_one_word_for_a_delay():
    for page in (ROOT / "README.zh-CN.md", ROOT / "docs" / "howto" / "laboratory.zh-CN.md"):
        assert "延迟" not in page.read_text(encoding="utf-8")  # the messages say 时延
