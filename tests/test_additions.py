"""An addition touches few files: each one here is made in a copy of the package and used from end to end."""

from __future__ import annotations

import gzip
import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

import insnav

ROOT = Path(insnav.__file__).parent
MOTIONS = ROOT.parent / "trajectories"
SAMPLE = MOTIONS / "sample"
DRIVE_S = 130  # 70 s at rest, then a minute of driving


@dataclass(frozen=True)
class Addition:
    """Files that it adds, and texts that it adds to files: each after a line, or after the last one."""

    most: int  # files; the two languages of the catalogue of messages count as one
    new: dict[str, str] = field(default_factory=dict)
    more: dict[str, list[tuple[str, str]]] = field(default_factory=dict)

    @property
    def touched(self) -> int:
        """How many files it touches."""
        return len({name.replace("zh.toml", "en.toml") for name in (*self.new, *self.more)})

    def make(self, package: Path) -> None:
        """Make it in a copy of the package."""
        for name, text in self.new.items():
            file = package / name
            assert not file.exists()
            file.parent.mkdir(exist_ok=True)
            file.write_text(text, "utf-8")
        for name, texts in self.more.items():
            old = (package / name).read_text("utf-8")
            for after, text in texts:
                assert old.count(after) == 1 or not after
                old = old.replace(after, after + text) if after else old + text
            (package / name).write_text(old, "utf-8")


TERM = """
[flexure]
name = "flexure"
process = "constant"
spread = "diagonal"
accel = ["per acceleration", "ug/g^2", "force_squared", "the proof mass bends its support"]

[hiss]
name = "hiss"
process = "white"
spread = "vector"
gyro = ["angle random walk", "deg/sqrt(h)", "one", "hisses"]
accel = ["velocity random walk", "m/s/sqrt(h)", "one", "hisses"]
"""

FORMAT = '''
"""Fixes of a recorder that begins its files with a line of its own."""

import io

import numpy as np

from insnav.input.formats.table import column_table

name = "parcel of fixes"
suffixes = (".parcel",)


def recognise(source):
    return bytes(source.head).startswith(b"PARCEL")


def read(source):
    rows = np.loadtxt(io.BytesIO(bytes(source.data)), skiprows=1)
    return {"gps": column_table(source, dict(zip(("time_s", "lat_deg", "lon_deg", "height_m"), rows.T)))}
'''

STEP = '''
"""A kind of measurement that only looks at the drive."""

from insnav.filter.measurements.sensors import Heading
from insnav.findings import Code, Finding


class Drill(Heading):
    __slots__ = ()
    name = "drill"

    @classmethod
    def from_drive(cls, first):
        return None, Finding.of(Code.DRILL_LOOSE, wobble_rad=0.05)
'''
WORDS = {
    "en": 'severity = "warning"\ntitle = "Loose drill"\ntext = "The drill wobbles by {wobble_rad:.1f deg}."\n',
    "zh": 'title = "钻头松动"\ntext = "钻头摆动 {wobble_rad:.1f deg}。"\n',
}

SENSOR = '''
"""A compass that knows true north to two degrees."""

import numpy as np

from insnav.filter.measurements.sensors import Heading


class Compass(Heading):
    __slots__ = ()
    order = 55
    name = "compass"

    @classmethod
    def from_drive(cls, first):
        log = first.logs.get(cls.name)
        return None if log is None else cls(log.time, log.values["heading"], np.array([0.035])), None
'''
OPTION = """
[logs.compass]
option = "--compass"
metavar = "FILE"
meaning = "Log of a compass: time, heading."
group = "Other aiding"
kind = "file"
"""

PAGE = '''
"""The page of a parcel."""

from insnav.quantity import Quantity
from insnav.report.page import Page, Section


def page(result):
    weight = Quantity("weight", result.found, "kg", meaning="weight of the parcel")
    return Page("A parcel", ("It has arrived.",), (Section("", "Parcel", (weight,)),))
'''

ADDITIONS = {
    "term of the budget": Addition(1, more={"imu/error_terms.toml": [("", TERM)]}),
    "file format": Addition(1, {"input/formats/parcel.py": FORMAT}),
    "finding": Addition(
        2,
        {"filter/measurements/drill.py": STEP},
        {f"messages/{lang}.toml": [("", f'\n["drill.loose"]\n{text}')] for lang, text in WORDS.items()},
    ),
    "sensor": Addition(
        3,
        {"filter/measurements/compass.py": SENSOR},
        {
            "input/interpret/columns.toml": [
                ("[files]  # what a file of each kind may hold\n", 'compass = "time heading"\n'),
                ('magnetometer = ["mag_x mag_y mag_z", "heading"]\n', 'compass = ["heading"]\n'),
            ],
            "steps/inputs.toml": [("", OPTION)],
        },
    ),
    "page": Addition(1, {"report/parcel/page.py": PAGE}),
}


@pytest.mark.parametrize("name", ADDITIONS)
def test_an_addition_touches_few_files(name: str) -> None:
    assert ADDITIONS[name].touched <= ADDITIONS[name].most


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the package with all additions; its kernels are those of the original, which are compiled already."""
    copy = tmp_path_factory.mktemp("copy") / "insnav"
    shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns("__pycache__", "kernels"))
    for addition in ADDITIONS.values():
        addition.make(copy)
    return copy


def run_python(package: Path, folder: Path, code: str, *arguments: str) -> str:
    """Run code in a process of the copy; what it prints."""
    start = f"import sys; sys.path.insert(0, {str(package.parent)!r})\nimport insnav\n"
    start += f"insnav.__path__.append({str(ROOT)!r})\n"
    done = subprocess.run(
        [sys.executable, "-c", start + code, *arguments],
        cwd=folder,
        capture_output=True,
        encoding="utf-8",
        env={**os.environ, "COLUMNS": "200", "PYTHONUTF8": "1"},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


def run_command(package: Path, folder: Path, *arguments: str) -> str:
    return run_python(package, folder, "from insnav.cli import main\nmain()", *arguments)


def test_a_term_is_in_file_budget_and_simulation(package: Path, tmp_path: Path) -> None:
    """The new terms act as old ones do that have the same process and the same signal."""
    text = 'name = "{0}"\n[gyro]\n{2} = "0.3 deg/sqrt(h)"\n[accel]\n{1} = "900 ug/g^2"\n{2} = "0.02 m/s/sqrt(h)"\n'
    found = {}
    for name, *keys in (("new", "flexure", "hiss"), ("old", "quadratic", "random_walk")):
        (tmp_path / f"{name}.toml").write_text(text.format(name, *keys), "utf-8")
        options = (
            "--profile",
            str(MOTIONS / "city.toml"),
            "--begin",
            "100",
            "--times",
            "10",
            "--runs",
            "60",
            "--out",
            name,
        )
        run_command(package, tmp_path, "budget", "--imu", f"{name}.toml", *options)
        found[name] = json.loads((tmp_path / name / "run.json").read_text("utf-8"))["budget"][0]
    names = {"accel flexure": "accel non-linearity", "gyro hiss": "gyro white noise", "accel hiss": "accel white noise"}
    for way, tolerance in (("analytic", 1e-12), ("covariance", 1e-12), ("simulated", 0.5)):
        new, old = (found[name][way]["sources"] for name in ("new", "old"))
        assert set(new) == set(names)
        for family, same in names.items():
            assert new[family]["horizontal_m"] == pytest.approx(old[same]["horizontal_m"], rel=tolerance)
    assert 'flexure = "900 ug/g^2"' in (tmp_path / "new" / "imu.toml").read_text("utf-8")
    assert "the proof mass bends its support" in (tmp_path / "new" / "report.html").read_text("utf-8")


@pytest.fixture(scope="module")
def drive(package: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Folder of a drive with fixes of the new format and a log of the new sensor, run; and the text of the command."""
    folder = tmp_path_factory.mktemp("drive")
    samples = gzip.decompress((SAMPLE / "imu.csv.gz").read_bytes()).decode().splitlines()[: 100 * DRIVE_S]
    (folder / "imu.csv").write_text("\n".join(samples), "utf-8")
    fixes = np.loadtxt(SAMPLE / "gps.csv", delimiter=",", skiprows=1)[:DRIVE_S, :4]
    np.savetxt(folder / "gps.parcel", fixes, "%.12g", header="PARCEL", comments="")
    known = np.loadtxt(SAMPLE / "ref.csv", delimiter=",", skiprows=1)[: 10 * DRIVE_S, [0, 9]]
    np.savetxt(folder / "compass.csv", known, "%.10g", ",", header="time_s,heading_deg", comments="")
    options = ("--gps", "gps.parcel", "--compass", "compass.csv", "--imu", "automotive", "--out", "run")
    return folder, run_command(package, folder, "run", "imu.csv", *options)


def test_a_format_is_read(drive: tuple[Path, str]) -> None:
    read = json.loads((drive[0] / "run" / "run.json").read_text("utf-8"))["input"]["gps"]
    assert (Path(read["path"]).name, read["n_used"]) == ("gps.parcel", DRIVE_S)


def test_a_finding_is_shown_wherever_findings_are(drive: tuple[Path, str], package: Path) -> None:
    folder, printed = drive
    wanted = {"code": "drill.loose", "severity": "warning", "values": {"wobble_rad": 0.05}}
    assert wanted in json.loads((folder / "run" / "run.json").read_text("utf-8"))["findings"]
    for text in (printed, (folder / "run" / "report.html").read_text("utf-8")):
        assert "The drill wobbles by 2.9 deg." in text
    assert "钻头摆动 2.9" in run_command(package, folder, "--lang", "zh", "report", "run", "--out", "again")


def test_a_sensor_aids(drive: tuple[Path, str]) -> None:
    facts = json.loads((drive[0] / "run" / "run.json").read_text("utf-8"))
    (used,) = (each for each in facts["aiding"] if each["name"] == "compass")
    assert used["processed"] > DRIVE_S
    assert facts["input"]["compass"]["n_rows"] == 10 * DRIVE_S


def test_a_page_is_written(package: Path, tmp_path: Path) -> None:
    code = (
        "from insnav.result import Result\nfound = Result('parcel', 2.5)\nprint(found.summary())\nfound.save('parcel')"
    )
    assert "weight of the parcel" in run_python(package, tmp_path, code)
    assert json.loads((tmp_path / "parcel" / "run.json").read_text("utf-8"))["weight_kg"] == 2.5
    assert "weight of the parcel" in (tmp_path / "parcel" / "report.html").read_text("utf-8")
