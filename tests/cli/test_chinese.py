"""``--lang zh``: commands, pages and help hold no English but names, units, options and quotations of documents."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from insnav.certificate.faults import fault_matrix, matrix_lines
from insnav.cli import COMMANDS
from insnav.messages import catalogue, speaking, translated
from tests.cli.conftest import QUICK, ROOT, Cli
from tests.cli.test_calibrate import bench as volts
from tests.cli.test_calibrate_imu import bench as sweeps
from tests.cli.test_calibrate_nine import NINE, UPRIGHT, table
from tests.cli.test_calibrate_poses import bench as poses
from tests.cli.test_calibrate_poses import six_measured
from tests.cli.test_calibrate_poses import write as write_poses
from tests.cli.test_calibrate_rotor import bench as rotor
from tests.cli.test_lab_noise import bench as noise
from tests.cli.test_live import folder, mixed
from tests.cli.test_platform import flight
from tests.cli.test_verify import short
from tests.lab.test_positions import table as triad
from tests.regression.conftest import CORPUS, LIBRARY, SHORT

pytestmark = pytest.mark.skipif("INSNAV_REVERSED" in os.environ, reason="names would be reversed, too")
__all__ = ["flight", "folder", "noise", "poses", "rotor", "short", "sweeps", "volts"]  # fixtures
DRIVE = "imu.csv --gps gps.csv --imu automotive"
WORK = [
    ("drive", f"run {DRIVE} --heading 220 --mechanization short --out out"),
    ("drive", f"run {DRIVE} --ref ref.csv --out out"),
    ("drive", f"outage {DRIVE} --ref ref.csv --lengths 5,10 --out out"),
    ("drive", "check imu.csv gps.csv ref.csv --out out"),
    ("drive", f"align {DRIVE} --out out"),
    ("drive", "tune imu.csv --gps gps.csv --out out"),
    ("drive", "batch .. --engine 1 --imu automotive --figures none --out out"),
    ("drive", "budget --imu LN-200 --times 10,60 --runs 3 --out out"),
    ("drive", "budget --end=-2.668,-8.231,-0.0803,-0.2754 --times 60 --imu LN-200 --out out"),
    ("drive", "simulate laboratory_slide --fault gps-jump:60m@20s+8s --out out"),
    ("drive", "simulate laboratory_slide --runs 2 --engine 1 --imu tactical --out out"),
    ("drive", "simulate --list"),
    ("drive", "imus"),
    ("noise", "allan static.csv --taus octave --out out"),
    (
        "noise",
        "acceptance --rates rates.csv --positions positions.csv --static static.csv --powerups powerups.csv --out out",
    ),
    ("noise", "drift drift.csv --out out"),
    ("volts", "calibrate gyro gx.csv gy.csv gz.csv --out out"),
    ("volts", "calibrate accel ax.csv ay.csv az.csv --out out"),
    ("sweeps", "calibrate imu about_x.csv about_y.csv about_z.csv --out out"),
    ("poses", "calibrate poses imu.csv --gravity 9.81 --out out"),
    ("rotor", "calibrate rotor fall.csv turn.csv --fall-mass 0.06 --radius 0.0225 --mass 0.05 --arm 0.25 --out out"),
    ("six", "calibrate poses six.csv --method six --gravity 9.81 --out out"),
    ("poses", "calibrate poses counts.csv --counts --gravity 9.81 --out out"),
    ("bench9", "calibrate nine nine.csv --gravity 9.81 --out out"),
    ("bench9", "calibrate nine upright.csv --gravity 9.81 --out out"),
    ("bench9", "calibrate accel triad.csv --out out"),
    ("sweeps", "calibrate imu about_x.csv about_y.csv about_z.csv --intercept x2=0.41 --out out"),
    ("log", "live log.csv --imu automotive --lever-arm 0,0,0 --gps-delay 0"),
    ("result", "report first --out out"),
    ("result", "export first --to csv --rate 2"),
    ("result", "compare first --ref ref.csv --out out"),
    ("short", "verify --out out"),
    ("flight", "platform fw.csv --lat 48 --lon 11 --height 1000 --ref ref.csv --misalignment 0.1,0,0 --out out"),
    ("drive", f"outage {DRIVE} --lengths 5,10 --out out"),
    ("drive", f"budget {DRIVE} --ref ref.csv --times 10 --uncalibrated --runs 3 --out out"),
    pytest.param(
        "corpus", "regress --corpus trajectories/corpus.toml --engine 1 --quick --plot", marks=pytest.mark.nightly
    ),
    pytest.param("corpus", "regress --corpus trajectories/corpus.toml --power", marks=pytest.mark.nightly),
    pytest.param("drive", "demo --out out", marks=pytest.mark.nightly),
    pytest.param("drive", "verify --out out", marks=pytest.mark.nightly),
    pytest.param("drive", "platform --demo --out out", marks=pytest.mark.nightly),
    pytest.param("drive", "require --error 5m --after 30s --runs 20 --engine 1 --out out", marks=pytest.mark.nightly),
]
PAGES = ("out/report.html", "reports/accuracy.html")
_WORD = re.compile(r"[A-Za-z][a-z']{2,}")
_ALLOWED = """
insnav Allan Greenhall Riley Harvey Owen Song Nelson Staum Shapley Kalibr Tedaldi Pretto Menegatti Markdown Unix
Ferraris Euler EuRoC GeoJSON deg arcsec arcmin min ppm rad mrad sin cos single Std
states smooth format csv figures page drives out imu gps msl first counts work
"""  # people, programs, units; names of options, folders and inputs
NAMES = set(_ALLOWED.split())
for part in (ROOT / "insnav" / "imu" / "parts").glob("*.toml"):
    NAMES |= set(_WORD.findall(part.read_text(encoding="utf-8").partition("grade =")[0]))  # name and maker
NAMES |= {word for path in (ROOT / "trajectories").glob("*.toml") for word in path.stem.split("_")}
_NAME = re.compile(  # commands, options, quotations, units in brackets, files, identifiers
    r"^ +insnav .*?(?:  |$)|insnav \w+|--[\w-]+|`[^`]*`|\[[^\]]*\]|\S*[\w~][_./=~:][\w/]\S*|\b[a-z]+(?=: \S+\.\w)"
    r"|\w*\d\w*"
)
_CHINESE = re.compile(r"[\u4e00-\u9fff]")


@pytest.fixture
def result(drive: Path, cli: Cli) -> None:
    """A run folder."""
    assert cli("run", *QUICK, "--ref", "ref.csv", "--out", "first").code == 0


@pytest.fixture
def log(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Samples and fixes in one file."""
    monkeypatch.chdir(tmp_path)
    Path("log.csv").write_text("\n".join(mixed(folder)))


@pytest.fixture
def six(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_poses("six.csv", six_measured(0.003))


@pytest.fixture
def bench9(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    triad(Path("triad.csv"))
    table(Path("nine.csv"), NINE)
    table(Path("upright.csv"), np.vstack((NINE, UPRIGHT)), 20)


@pytest.fixture
def corpus(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Cli) -> None:
    """A baseline of two short drives."""
    monkeypatch.chdir(tmp_path)
    Path("trajectories").mkdir()
    Path("trajectories/corpus.toml").write_text(CORPUS.replace("short drive", "bends"))
    Path("trajectories/short.toml").write_text(SHORT)
    Path("trajectories/sculling.toml").write_text((LIBRARY / "sculling.toml").read_text())
    made = cli("regress", "--corpus", "trajectories/corpus.toml", "--engine", 1, "--update-baseline")
    assert made.code == 0, made.err


class _Texts(HTMLParser):
    """Texts of a page, and the data of its drawings."""

    def __init__(self) -> None:
        super().__init__()
        self.within: list[str] = []
        self.found: list[str] = []
        self.data: dict[str, Any] = {}

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.found += [found[name] or "" for name in ("title", "alt", "aria-label") if found.get(name)]
        if tag in ("script", "style", "code"):
            self.within.append(found.get("id") or tag)

    def handle_endtag(self, tag: str) -> None:
        if tag in ("script", "style", "code"):
            self.within.pop()

    def handle_data(self, data: str) -> None:
        if not self.within:
            self.found.append(data)
        elif self.within[-1] in ("words", "panels-data"):
            self.data[self.within[-1]] = json.loads(data)


def strings(value: Any, *keys: str) -> Iterator[str]:
    """Yield the strings of JSON, or those below some keys."""
    if isinstance(value, dict):
        for name, each in value.items():
            yield from strings(each) if name in keys else strings(each, *keys)
    elif isinstance(value, list):
        for each in value:
            yield from strings(each, *keys)
    elif isinstance(value, str) and not keys:
        yield value


def page_texts(page: Path) -> Iterator[str]:
    texts = _Texts()
    texts.feed(page.read_text(encoding="utf-8"))
    yield from texts.found
    words = texts.data.get("words", {})
    for text in strings(texts.data.get("panels-data", []), "title", "note", "label", "name", "text", "rows", "x_label"):
        yield words.get(text) or translated(text)


def english(text: str) -> list[str]:
    """English words of a text, or of a Chinese text two in a row."""
    text = _NAME.sub("0", text)
    words = re.findall(r"[A-Za-z][a-z']{2,} [a-z]{2,}" if _CHINESE.search(text) else _WORD, text)
    return [each for each in words if each.split()[0] not in NAMES]


@pytest.mark.parametrize(("place", "words"), WORK)
def test_terminal_and_page_are_chinese(place: str, words: str, request: pytest.FixtureRequest, cli: Cli) -> None:
    request.getfixturevalue(place)
    shown = cli("--lang", "zh", "-v", *words.split())
    assert shown.code == 0, shown.err
    page, quoted = next((each for each in map(Path, PAGES) if each.exists()), Path("none")), set()
    with speaking("zh"):
        texts = [*shown.out.splitlines(), *shown.err.splitlines(), *(page_texts(page) if page.exists() else ())]
    if Path("out/run.json").exists():
        quoted = set(strings(json.loads(Path("out/run.json").read_text(encoding="utf-8")), "source", "provenance"))
    parts = [part for text in texts for part in re.split(r" {2,}|\n", text.strip())]
    left = {part: english(part) for part in parts if not any(part in each for each in quoted)}
    assert not {text: found for text, found in left.items() if found}


def test_faults_have_chinese_names() -> None:
    """The cells of the matrix quote its specification."""
    with speaking("zh"):
        names = [translated(row.fault) for row in fault_matrix() if row.fault != "SIGINT / SIGTERM"]
        lines = matrix_lines(())
    assert not [each for each in names if not _CHINESE.search(each)]
    assert lines == ["0 种故障：0 种满足，0 种部分满足，0 种未定"]


@pytest.mark.parametrize("words", ["", *COMMANDS, "calibrate", "calibrate gyro", "calibrate nine"])
def test_help_is_chinese(words: str) -> None:
    """In a process of its own, as the help of `calibrate` is made when it is imported."""
    asked = (sys.executable, "-m", "insnav", "--lang", "zh", *words.split(), "--help")
    lines = subprocess.run(asked, capture_output=True, check=True, encoding="utf-8").stdout.splitlines()
    assert any(map(_CHINESE.search, lines))
    assert not [line for line in lines if re.search(r"(?:\b[A-Za-z][a-z']+ ){2}[a-z]{2,}", _NAME.sub("0", line))]


def test_words_of_pages_hold_the_numbers_and_parts_of_their_text() -> None:
    for text, wanted in catalogue("page.zh")["words"].items():
        parts = [f"<{i}>" for i in range(text.count("{}"))]
        assert wanted.count("#") == text.count("#"), text
        assert all(part in wanted.format(*parts) for part in parts), text


def test_the_command_after_a_simulation_is_no_word_of_the_language(drive: Path, cli: Cli) -> None:
    last = cli("--lang", "zh", "simulate", "laboratory_slide", "--out", "out").out.splitlines()[-1]
    assert last.split()[1:5] == ["insnav", "run", "out/imu.csv", "--gps"]
