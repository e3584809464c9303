"""Many drives with one command: each as `run` has it, failures kept, finished ones not navigated again."""

from __future__ import annotations

import csv
import errno
import gzip
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from insnav.cli.batch import _absolute, run_drive
from insnav.exceptions import CheckError, InputError
from insnav.findings import Code, Finding, Severity, of_code, of_families
from insnav.fleet.batch import _alone, _with_broken, find_drives, name_of
from insnav.input.formats.registry import open_tables
from insnav.output.folder import RunFolder
from tests.cli.conftest import QUICK as RUN
from tests.cli.conftest import ROOT, Cli, findings_of, says
from tests.refusals import refused
from tests.reversed_messages import as_shown

QUICK = ("--imu", "automotive", "--figures", "none", "--engine", "1")


@pytest.fixture
def drives(drive: Path) -> Path:
    """Folder of two vehicles: a drive in a folder on another disk, two by their names, and one that is broken."""
    folder = drive.parent / "recordings"
    (drive.parent / "disk" / "monday").mkdir(parents=True)
    (folder / "car").mkdir(parents=True)
    (folder / "van").symlink_to(drive.parent / "disk")
    (folder / "car" / "again").symlink_to(folder)  # in a circle
    for name in ("imu", "gps", "ref"):
        shutil.copy(drive / f"{name}.csv", folder / "van" / "monday")
    for day in ("tuesday", "friday"):
        shutil.copy(drive / "imu.csv", folder / "car" / f"{day}_imu.csv")
        shutil.copy(drive / "gps.csv", folder / "car" / f"gnss-{day}.csv")
    (folder / "broken").mkdir()
    (folder / "broken" / "imu.csv").write_text("".join((drive / "imu.csv").read_text().splitlines(True)[:40]))
    (folder / "broken" / "gps.csv").write_text("\0\1 nothing\n")
    (folder / "broken" / "photo.dat").write_bytes(bytes(range(256)))
    return folder


def table(fleet: Path) -> dict[str, dict[str, str]]:
    with (fleet / "fleet.csv").open() as file:
        return {row["drive"]: row for row in csv.DictReader(file)}


def test_a_folder_of_drives(drives: Path, drive: Path, cli: Cli, monkeypatch):
    monkeypatch.setattr("insnav.cli.console.terminal_width", lambda: 120)
    shown = cli("batch", drives, "--out", drives / "fleet", *QUICK)
    assert shown.code == 1  # one failed
    assert "1 of 4 drives failed" in shown.err
    rows = table(drives / "fleet")
    assert next(iter(rows)) == "broken"
    assert rows.keys() == {"broken", "van-monday", "car-tuesday", "car-friday"}
    assert (rows["broken"]["result"], rows["broken"]["exit_code"]) == ("failed", "3")
    assert rows["broken"]["reason"][:30] in shown.err
    assert "align.no_position" not in rows["broken"]["reason"]  # but what is wrong with the file of its fixes
    lines = shown.out.partition("\nfiles ")[0].splitlines()
    rows_shown = [line for line in lines if line.split()[:1] and line.split()[0] in {"drive", *rows}]
    assert len(rows_shown) == 5
    assert max(map(len, rows_shown)) <= 120  # notes below have paths of any length
    assert not any("NIS" in line for line in lines)  # on the page, and in fleet.csv
    assert "NIS velocity" in (drives / "fleet" / "report.html").read_text(encoding="utf-8")
    assert [rows[name]["vehicle"] for name in ("van-monday", "car-tuesday")] == ["van", "car"]
    assert float(rows["van-monday"]["horizontal_error_m"]) > 0.0
    assert rows["car-friday"]["horizontal_error_m"] == ""  # no reference
    facts = json.loads((drives / "fleet" / "run.json").read_text())
    assert facts["kind"] == "fleet"
    assert [each["exit_code"] for each in facts["failures"]] == [3]
    assert any(each.subject.endswith("photo.dat") for each in findings_of(facts, *of_families("batch")))
    assert cli("run", *RUN, "--ref", "ref.csv", "--out", "alone").code == 0  # the same run, to the byte
    for name in ("solution.csv", "innovations.csv", "smoothed.csv"):
        assert (drives / "fleet" / "drives" / "van-monday" / name).read_bytes() == (drive / "alone" / name).read_bytes()

    again = cli("batch", drives, "--out", drives / "fleet", *QUICK)
    assert "4 of 4 were finished already" in again.out
    with (drives / "van" / "monday" / "gps.csv").open("a") as file:
        file.write("\n")
    assert "3 of 4 were finished already" in cli("batch", drives, "--out", drives / "fleet", *QUICK).out
    other = cli("batch", drives, "--out", drives / "fleet", *QUICK, "--states", 15, "--json")
    assert "0 of 4 were finished already" in json.loads(other.out)["summary"][0]


@pytest.mark.parametrize(("name", "left"), [("imu.csv", 0), ("drive.csv", 0), ("gps.csv", 0), ("imu.csv", 50_000)])
def test_a_drive_with_a_broken_file_is_one_that_failed(name: str, left: int, drive: Path, cli: Cli):
    for day in ("monday", "tuesday"):
        (drive.parent / "week" / day).mkdir(parents=True)
        for part in ("imu", "gps"):
            shutil.copy(drive / f"{part}.csv", drive.parent / "week" / day / f"{part}.csv")
    broken = drive.parent / "week" / "tuesday"
    whole = (broken / "imu.csv").read_bytes()
    if name == "drive.csv":
        (broken / "imu.csv").unlink()
    zipped = gzip.compress(whole)[:left] if left else b""
    (broken / name).unlink(missing_ok=True)
    (broken / (f"{name}.gz" if left else name)).write_bytes(zipped)
    shown = cli("batch", drive.parent / "week", *QUICK)
    assert (shown.code, shown.out.splitlines()[0]) == (1, "Fleet of 2 drives")
    rows = table(Path("fleet"))
    first = next(iter(rows.values()))
    assert (first["drive"], first["result"], first["exit_code"]) == ("tuesday", "failed", "3")
    assert ("gzip" if left else InputError("format.empty").reason) in first["reason"]
    assert "tuesday" not in str(json.loads(Path("fleet/run.json").read_text())["findings"])


def test_a_file_behind_an_equals_sign_is_known_as_one(tmp_path: Path):
    """A changed ``--imu=FILE`` left results of the old one."""
    imu = tmp_path / "m.toml"
    imu.touch()
    words = ["--imu=m.toml", "--imu", "m.toml", "--lever-arm=1,0,0", "--heading=", "--no-smooth", "x=y"]
    files = ["--imu", str(imu), "--imu", str(imu)]
    assert _absolute(words, tmp_path) == [*files, "--lever-arm=1,0,0", "--heading=", "--no-smooth", "x=y"]


@pytest.mark.parametrize(
    ("names", "drives", "left"),
    [
        (("imu.csv", "imu_2.csv", "gps.csv"), {"day": ""}, ["imu_2.csv"]),
        (("imu.csv", "gps.csv", "gps-old.csv"), {"day": ""}, ["gps-old.csv"]),
        (("imu.csv", "gps.csv", "photo.csv"), {"day": ""}, []),
        (("imu.csv", "first_gps.csv", "other.csv"), {"day-imu": "first_gps.csv, other.csv"}, None),
        (("imu.csv", "first_gps.csv"), {"day": ""}, []),
        (("imu.csv",), {"day": ""}, []),
        (("imu.csv", "gps.csv", "b_imu.csv", "b_gps.csv"), {"day-imu": "", "day-b": ""}, []),
    ],
)
def test_no_file_is_chosen_in_silence(
    names: tuple[str, ...], drives: dict[str, str], left: list[str] | None, drive: Path, tmp_path: Path
):
    (tmp_path / "week" / "day").mkdir(parents=True)
    for name in names:
        shutil.copy(drive / ("imu.csv" if "imu" in name else "gps.csv"), tmp_path / "week" / "day" / name)
    found, said = find_drives(tmp_path / "week", tmp_path / "fleet", 1)
    assert {each.name: each.unclear for each in found} == drives
    for each in found if any(drives.values()) else ():
        with refused(InputError, "batch.unclear_files"):
            each.files()
    if left is not None:
        assert [Path(each.subject).name for each in said] == left
        assert all(each.code is Code.BATCH_OTHER_NAMES for each in said)
    for name in left or ():
        notes = open_tables(tmp_path / "week" / "day")["imu"].notes
        (by_name,) = of_code(notes, Code.READ_FILES_BY_NAME)
        assert by_name.severity is Severity.ASSUMPTION
        assert (by_name["files"], by_name["unused"]) == (("gps.csv", "imu.csv"), (name,))


def test_what_could_not_be_written_ends_with_the_exit_code_for_it(drives: Path, cli: Cli, monkeypatch):
    commit = RunFolder.commit

    def full(folder: RunFolder, facts: dict) -> Path:
        if facts["kind"] == "run":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return commit(folder, facts)

    monkeypatch.setattr(RunFolder, "commit", full)
    shown = cli("batch", drives, "--out", drives / "fleet", *QUICK)
    assert shown.code == 4, shown.err
    assert "batch.unwritten" in shown.err
    assert {row["exit_code"] for row in table(drives / "fleet").values()} == {"3", "4"}


def test_two_runs_of_a_batch_have_the_same_bytes(drive: Path, cli: Cli):
    for name in ("first", "second"):
        cli("batch", drive, "--out", drive.parent / name, *QUICK)
    for file in ("run.json", "fleet.csv", "found.npz"):
        first, second = ((drive.parent / name / file).read_bytes() for name in ("first", "second"))
        assert first == second, file
    (note,) = (drive.parent / "first" / "drives").glob("*.json")
    assert json.loads(note.read_text())["seconds"] > 0.0


def test_names_of_run_folders_are_fit_for_all():
    assert name_of("a/b c.json") == "a_b_c"  # notes beside the folders end so
    assert name_of("..") == ""
    assert name_of("漢" * 300) == "漢" * 33  # file systems count bytes
    assert name_of("run.2") == "run.2"


def test_a_damaged_result_is_made_again_and_what_is_left_of_it_kept(drives: Path, cli: Cli):
    (drives / "car" / "again").unlink()
    assert cli("batch", drives / "car", "--out", "fleet", *QUICK, "--no-smooth").code == 0
    rows = table(Path("fleet"))
    assert float(rows["tuesday"]["horizontal_sd_m"]) > 0.0  # of the filter
    place = Path("fleet/drives/tuesday")
    whole = (place / "solution.csv").read_bytes()
    with (place / "solution.csv").open("r+b") as file:
        file.truncate(len(whole) // 2)
    (Path("fleet/drives/friday") / "run.json").write_bytes(b"\0" * 100)
    (Path("fleet/drives/friday") / "mine.txt").write_text("mine")
    again = cli("batch", drives / "car", "--out", "fleet", *QUICK, "--no-smooth")
    assert again.code == 0
    assert "0 of 2 were finished already" in again.out
    assert (place / "solution.csv").read_bytes() == whole
    (aside,) = Path("fleet/drives").glob("friday.aside-*")
    assert (aside / "mine.txt").read_text() == "mine"
    assert says(again.err, Finding.of(Code.BATCH_MOVED_ASIDE, subject=str(aside.absolute())))
    (place / "mine.txt").write_text("mine")  # what was added is no damage
    Path("fleet/notes.md").write_text("mine")
    assert "2 of 2" in cli("batch", drives / "car", "--out", "fleet", *QUICK, "--no-smooth").out
    assert cli("batch", drives / "car", "--out", "fleet", *QUICK, "--no-smooth", "--again").code == 0
    (aside,) = Path("fleet/drives").glob("tuesday.aside-*")
    assert (aside / "mine.txt").read_text() == Path("fleet/notes.md").read_text() == "mine"
    assert table(Path("fleet"))["tuesday"]["file"] == str(drives / "car" / "tuesday_imu.csv")


def test_names_that_are_not_utf_8_do_not_end_a_fleet(drive: Path, tmp_path: Path, cli: Cli):
    place = tmp_path / "week" / os.fsdecode(b"d\xff")
    try:
        place.mkdir(parents=True)
    except OSError:
        pytest.skip("this file system has UTF-8 names only")
    shutil.copy(drive / "imu.csv", place / "imu.csv")
    for name in (b"\xff.csv", b"\xff_gps.csv"):
        shutil.copy(drive / "gps.csv", place / os.fsdecode(name))
    shown = cli("batch", tmp_path / "week", "--out", tmp_path / "fleet", *QUICK)
    assert shown.code == 1
    (failure,) = json.loads((tmp_path / "fleet" / "run.json").read_text(encoding="utf-8"))["failures"]
    assert failure["code"] == "batch.unclear_files"
    assert failure["where"] == str(place / "imu.csv")


def test_two_batches_do_not_share_a_folder(drives: Path, cli: Cli):
    with _alone(Path("fleet").absolute()):
        shown = cli("batch", drives / "car", "--out", "fleet", *QUICK)
        assert shown.code == 4
        assert "batch.busy" in shown.err
        assert not list(Path("fleet/drives").glob("*.json"))
    with _alone(Path("fleet").absolute()):
        pass


def test_an_error_keeps_its_parts(drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    lost = Finding.of(Code.RUN_REJECTED, share=0.9, limit_share=0.5)
    monkeypatch.setattr("insnav.errors.evaluated_run.failure", lambda _: lost)
    out = tmp_path / "lost"
    files = str(drive / "imu.csv"), "--gps", str(drive / "gps.csv"), "--out", str(out)
    with pytest.raises(CheckError, match=r"cli.unusable") as raised:
        run_drive([*files, "--imu", "automotive", "--figures", "none"])
    assert raised.value.values["cause"] == lost
    assert raised.value.fix
    assert (out / "run.json").is_file()


def test_files_beside_a_drive_that_are_none_are_no_drives(tmp_path: Path):
    files = {name: tmp_path / name for name in ("imu.csv", "gps.csv", "imu_notes.txt", "photo.dat")}
    whole = {files["imu.csv"]: "imu", files["gps.csv"]: "gps"}
    others = {files["imu_notes.txt"]: "the file looks like text", files["photo.dat"]: "no table"}
    assert _with_broken({**whole, **others}) == {**whole, **others}
    assert _with_broken({files["gps.csv"]: "gps", **others})[files["photo.dat"]] == "no table"


def test_drives_of_a_file_with_options_of_their_own(drives: Path, cli: Cli):
    file = drives / "drives.toml"
    file.write_text(
        '[[drive]]\nfile = "van/monday/imu.csv"\ngps = "van/monday/gps.csv"\nvehicle = "van 7"\nstates = 15\n'
        "lever-arm = [0.1, 0.2, -0.3]\nsmooth = false\n"
        '[[drive]]\nname = "off road"\nfile = "car/friday_imu.csv"\ngps = "car/gone.csv"\n'
    )
    assert cli("batch", file, *QUICK, "--lever-arm", "9,9,9").code == 1
    facts = json.loads(Path("fleet/drives/monday/run.json").read_text())
    assert facts["configuration"]["states"] == 15
    assert facts["fixes"]["lever_arm_m"] == [0.1, 0.2, -0.3]  # its own, not that for all
    assert not Path("fleet/drives/monday/smoothed.csv").exists()
    rows = table(Path("fleet"))
    assert rows["off_road"]["exit_code"] == "3"
    assert rows["monday"]["vehicle"] == "van 7"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("drive = 3\n", "cli.no_drives"),
        ('[[drive]]\ngps = "gps.csv"\n', "cli.drive_without_file"),
        ('[[drive]]\nfile = "imu.csv"\nout = "there"\n', "cli.drive_with_folder"),
        ('[[drive]]\nfile = "imu.csv"\nlevr-arm = 1\n', as_shown("No such option: ") + "--levr-arm"),
        ('[[drive]]\nfile = "imu.csv"\nstates = "many"\n', "states"),
        ('[[drive]]\nfile = "a/imu.csv"\n[[drive]]\nfile = "b/../a/imu.csv"\n', "batch.same_name"),
    ],
)
def test_a_file_that_cannot_be_meant_is_refused(content: str, said: str, drive: Path, cli: Cli):
    Path("drives.toml").write_text(content)
    shown = cli("batch", "drives.toml")
    assert shown.code == 2
    assert said in shown.err
    assert "drives.toml" in shown.err or "imu.csv" in shown.err
    assert not Path("fleet").exists()


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("nowhere",), 3, "batch.unreadable_folder"),
        (("empty",), 3, "batch.no_drives"),
        (("imu.csv",), 3, "batch.unreadable_folder"),
        ((".", "--out", "."), 4, "batch.other_folder"),
        ((".", "--out", "no/../imu.csv"), 4, "batch.unwritable"),
        (("--states", "15", "."), 2, "cli.drives_first"),
        ((".", "--stats", "15"), 2, as_shown("No such option")),
        ((".", "--engine", "threads"), 2, "engine.unknown"),
    ],
)
def test_what_cannot_be_a_fleet_is_refused(words: tuple[str, ...], code: int, said: str, drive: Path, cli: Cli):
    Path("empty").mkdir()
    shown = cli("batch", *words)
    assert (shown.code, said in shown.err) == (code, True), shown.err
    assert "Traceback" not in shown.err


@pytest.mark.skipif(os.name == "nt", reason="needs signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_batch_that_was_stopped_goes_on(number: signal.Signals, drives: Path, cli: Cli):
    command = [sys.executable, "-m", "insnav", "batch", str(drives), *QUICK[:-1], "2"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)
    give_up = time.monotonic() + 120.0
    while not list(Path("fleet/drives").glob("*.json")) and process.poll() is None:
        assert time.monotonic() < give_up, "no drive was finished"
        time.sleep(0.02)
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert "Traceback" not in err
    assert "leaked" not in err or number == signal.SIGKILL
    kept = len(list(Path("fleet/drives").glob("*.json")))
    done = process.returncode == 1  # quicker than we are
    assert process.returncode in (128 + number, -number) or done
    shown = cli("batch", drives, *QUICK)
    assert f"{4 if done else kept} of 4 were finished already" in shown.out or number == signal.SIGKILL
    assert sorted(each.name for each in Path("fleet").iterdir()) == [
        "drives", "fleet.csv", "found.npz", "report.html", "run.json",
    ]  # fmt: skip
    assert not list(Path("fleet/drives").glob(".*")) or number == signal.SIGKILL  # a worker may have outlived it
