"""``--lang``: findings in the language of the reader, the same numbers and files in all."""

from __future__ import annotations

import json
import re
import textwrap
import unicodedata
from pathlib import Path
from typing import Any

import pytest

from insnav import messages
from insnav.messages import LANGUAGES, PARTS
from insnav.output.folder import read_facts
from insnav.plain_text import wrapped
from tests.cli.conftest import QUICK, SAMPLE, Cli
from tests.reversed_messages import as_shown

FILES, REFERENCE = QUICK[:3], ("--ref", str(SAMPLE / "ref.csv"))
WRONG_HEADING = ("--heading", "220")  # so that there is a warning, and assumptions
_SENTENCE = re.compile(r"(?:\b[A-Za-z]+(?:[,;:]? |$)){5}")
_NAME = re.compile(r"insnav \w+ --help|--[\w-]+|[\w'-]*(?:[./_=][\w'-]*)+")
_GAP = re.compile(r"\{[^}]*\}|\[\[|\]\]")


def english_in(shown: str) -> list[str]:
    """Texts of the English catalogue that stand in an output: by their longest part without numbers."""
    found = []
    for entry in messages.catalogue("en").values():
        for text in (entry[part] for part in PARTS if part in entry):
            longest = max(_GAP.split(text), key=len).strip()
            if longest.count(" ") > 2 and longest in shown:
                found.append(longest)
    return found


def english_lines(shown: str) -> list[str]:
    """Lines with five words of Latin letters in a row: names of files, options, codes and commands are none."""
    kept = (line for line in shown.splitlines() if not line.startswith("$ insnav "))
    return [line for line in kept if _SENTENCE.search(_NAME.sub("0", line))]


def lines_of(shown: str, *names: str) -> list[str]:
    return [line for line in shown.splitlines() if line.startswith(names)]


def without_digests(folder: str) -> dict[str, Any]:
    return {name: value for name, value in read_facts(Path(folder)).items() if name != "files"}


def test_a_run_warns_in_the_language_that_is_asked_for(drive: Path, cli: Cli):
    plain = cli("run", *QUICK, *WRONG_HEADING, "--out", "plain")
    assert english_in(plain.out)  # such a text would be noticed
    for name, words in {"after": ("run", *QUICK, "--lang", "zh"), "before": ("--lang=zh", "run", *QUICK)}.items():
        shown = cli(*words, *WRONG_HEADING, "--out", name)
        assert shown.code == 0, shown.err
        for line in (told := lines_of(shown.out, as_shown("警告"), as_shown("假定"))):
            assert "。" in line
        assert len(told) == len(lines_of(plain.out, as_shown("warning"), as_shown("assumed"))) > 1
        assert english_in(shown.out) == []
        assert "--lang" not in (Path(name) / "run.json").read_text(encoding="utf-8")
        assert without_digests(name) == without_digests("plain")
        for table in ("solution.csv", "smoothed.csv", "innovations.csv", "events.csv"):
            assert (Path(name) / table).read_bytes() == Path("plain", table).read_bytes()
    assert Path("before/run.json").read_bytes() == Path("after/run.json").read_bytes()
    assert cli("run", *QUICK, *WRONG_HEADING, "--out", "again").out == plain.out.replace("plain", "again")


def test_nothing_on_the_terminal_is_an_english_sentence(drive: Path, cli: Cli):
    assert english_lines("insnav: error: The file has no times, fixes or samples.")
    plain, shown = (cli(*lang, "run", *QUICK, *REFERENCE, "--out", "run", "--force") for lang in ((), ("--lang=zh",)))
    assert len(english_lines(plain.out)) >= 3
    assert english_lines(shown.out) == []
    assert english_lines(shown.err) == []
    assert shown.code == 0


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("run", "none.csv"), "format.no_file"),
        (("run", "imu.csv"), "align.no_position"),
        (("run", "imu.csv", "--gp", "x"), "cli.no_such_option"),
        (("compare", "run"), "cli.missing_option"),
        (("run", *FILES, "--lever-arm", "1,2"), "cli.not_numbers"),
        (("run", *FILES, "--imu-time-offset", "1e5"), "columns.no_overlap"),
        (("run", *FILES, "--imu", "nothing"), "imu.unknown"),
        (("run", "gps.csv", "--gps", "imu.csv"), "columns"),
        (("run", *FILES, "--imu", "bad.toml"), "config.several_errors"),
        (("run", *FILES, "--columns", "gyro_x=nothing"), "columns.no_such_column"),
        (("require", "--error", "-1", "--after", "60 s"), ""),
        (("outage", *FILES, "--durations", "-3"), ""),
        (("simulate", "bad.toml"), "config"),
        (("report", "nowhere"), "output"),
    ],
)
def test_no_refusal_is_an_english_sentence(words: tuple[str, ...], code: str, drive: Path, cli: Cli):
    Path("bad.toml").write_text('name = 3\nsegment = 4\nvehicle = "ship"\n[gyro]\nbias = "-1 deg/h"\nrandom = 2\n')
    shown = cli("--lang=zh", *words)
    assert shown.code in (2, 3), shown.err
    assert code in shown.err
    assert "。" in shown.err
    assert english_lines(shown.out + shown.err) == []


@pytest.mark.parametrize(
    "words",
    [
        ("align", "imu.csv", "--lat", "48"),
        ("check", "imu.csv", "gps.csv"),
        ("budget", "--imu", "LN-200", "--times", "10"),
        ("imus", "HG9900"),
    ],
)
def test_files_for_programs_are_in_english(words: tuple[str, ...], drive: Path, cli: Cli):
    out = () if words[0] == "imus" else ("--out", "out", "--force")
    printed = [json.loads(cli(*words, "--json", *out, "--lang", lang).out) for lang in LANGUAGES]
    assert printed[0] | {"files": {}} == printed[1] | {"files": {}}


def test_what_is_drawn_is_in_english(drive: Path, cli: Cli):
    assert cli("run", *QUICK, *WRONG_HEADING, "--lang", "zh").code == 0
    shown = cli(
        "report", "run", "--pdf", "--lang", "zh"
    )  # its font has no Chinese; matplotlib would warn, and fail here
    assert shown.code == 0, shown.err
    assert Path("run.pdf").read_bytes().startswith(b"%PDF")
    assert cli("budget", "--imu", "LN-200", "--times", "10", "--lang", "zh", "--out", "budget").code == 0
    assert "。" in Path("budget/report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("--lang", "xx"), "cli.unknown_language"),
        (("--lang=de",), "cli.unknown_language"),
        (("--lang",), "cli.no_language"),
        (("--lang", ""), "cli.no_language"),
    ],
)
def test_an_unknown_language_is_refused_with_those_there_are(cli: Cli, words: tuple[str, ...], code: str):
    shown = cli("run", "imu.csv", *words)
    assert shown.code == 2
    assert shown.out == ""
    assert shown.err.startswith("insnav: error: ")
    assert code in shown.err
    assert ", ".join(LANGUAGES) in shown.err


def test_errors_are_in_the_language_of_the_command(cli: Cli):
    shown = cli("require", "--error", "1", "--after", "60 s", "--lang", "zh")
    assert shown.code == 2
    assert shown.err.startswith("insnav: 错误：")
    assert "unit.missing" in shown.err
    assert "。" in shown.err


def test_the_environment_chooses_the_language_and_english_is_taken_for_an_unknown_one(
    drive: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
):
    shown = {}
    for lang in ("", "xx", "zh_CN.UTF-8"):
        monkeypatch.setenv("INSNAV_LANG", lang)
        said = cli("align", "imu.csv", "--lat", "48", "--imu", "automotive", "-v", "--force").err
        shown[lang] = re.sub(r"\d\.\d\d s\b", "", said)  # times of the steps
    assert shown["xx"] == shown[""]
    assert "。" not in shown[""]
    assert "。" in shown["zh_CN.UTF-8"]
    monkeypatch.setenv("INSNAV_LANG", "zh")
    assert "。" not in cli("align", "imu.csv", "--lat", "48", "--force", "-v", "--lang", "en").err


def test_what_follows_two_dashes_is_no_language(cli: Cli):
    assert "unexpected extra argument(s) (--lang)" in cli("run", "--", "imu.csv", "gps.csv", "--lang").err


def test_the_help_shows_the_languages(cli: Cli):
    assert "--lang en|zh" in cli("--help").out


@pytest.mark.parametrize("width", [20, 79, 80])
def test_rows_of_chinese_fit_the_columns_of_a_terminal(width: int):
    text = "insnav 采用行驶记录的航向，此时定位结果的似然更大。请改正或省略 --heading。" * 3
    rows = wrapped(text, width, subsequent_indent="  ")
    columns = [sum(2 if unicodedata.east_asian_width(c) in "WF" else 1 for c in row) for row in rows]
    assert max(columns) <= width
    assert len(rows) < 3 * sum(columns) / width
    assert "".join("".join(rows).split()) == "".join(text.split())
    plain = "one path/that/is/longer/than/its/row and two"
    assert wrapped(plain, 12, break_long_words=False) == textwrap.wrap(plain, 12, break_long_words=False)
