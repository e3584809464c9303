"""`insnav simulate`: files that run as printed, the same bytes every time, and series that can be stopped."""

from __future__ import annotations

import csv
import hashlib
import json
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from insnav.imu import load_calibration, load_imu
from insnav.io import read_gps, read_imu, read_reference
from insnav.io.folder import read_facts, verify_folder
from insnav.simulate.motion import library, load_profile
from tests.cli.conftest import ROOT, Cli


def short_drives() -> list[str]:
    """Names of the two shortest profiles of the library that start at rest and then drive."""
    found = []
    for path in library():
        profile = load_profile(path)
        if 60.0 <= profile.duration <= 900.0:
            truth = profile.truth(0)
            time = truth.start + np.arange(0.0, truth.duration, 0.5)
            speed = np.linalg.norm(truth.evaluate(time).v_n, axis=1)
            if speed[:10].max() < 0.01 and speed.max() > 5.0:
                found.append((profile.duration, path.stem))
    return [name for _, name in sorted(found)[:2]]


DRIVES = short_drives()
MOTION = DRIVES[0]
COMMAND = [sys.executable, "-c", "from insnav.cli import main; main()", "simulate"]
posix = pytest.mark.skipif(sys.platform == "win32", reason="signals are different there")


def digests(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def white(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A receiver whose errors are white, as the filter takes them unless the drive is long enough to tell."""
    path = tmp_path_factory.mktemp("receiver") / "white.toml"
    path.write_text('[position]\nwhite = ["1.5 m", "1.5 m", "3 m"]\n[velocity]\nwhite = "0.1 m/s"\n')
    return path


@pytest.mark.parametrize(
    "options",
    [
        (),
        ("--sampling", "increment", "--rate", "50", "--imu", "tactical", "--seed", "7"),
        ("--sampling", "instant", "--imu", "ideal", "--gps", "ideal"),
    ],
)
def test_the_printed_command_navigates_what_was_simulated(here: Path, cli: Cli, white: Path, options: tuple[str, ...]):
    shown = cli("simulate", MOTION, *(options if "--gps" in options else (*options, "--gps", white)))
    assert shown.code == 0, shown.err
    verify_folder(here / "sim")
    command = shlex.split(shown.out.splitlines()[-1].removeprefix("next"))
    assert command[:3] == ["insnav", "run", "sim/imu.csv"]
    done = cli(*command[1:], "--figures", "none")
    assert done.code == 0, done.err
    found = read_facts(here / "run")["accuracy"]
    assert found["all"]["horizontal_m"]["rms"] < 5.0
    assert found["consistency"]["position"]["inside_3_sd"] > 0.9


@pytest.mark.parametrize("motion", DRIVES)
def test_errors_are_of_the_size_that_the_filter_states(here: Path, cli: Cli, white: Path, motion: str):
    shown = cli(
        *("simulate", motion, "--imu", "automotive", "--gps", white, "--runs", 10, "--rate", 50, "--workers", 1)
    )
    assert shown.code == 0, shown.err
    found = read_facts(here / "sim")["ensemble"]
    print(motion, found["nees_per_axis"], found["nees_inside_band"])
    assert 0.6 < found["nees_per_axis"]["position"] < 1.6
    assert 0.6 < found["nees_per_axis"]["velocity"] < 1.6
    assert 0.3 < found["nees_per_axis"]["attitude"] < 1.6
    assert found["failed"] == []


def test_every_file_is_there_and_can_be_read_again(here: Path, cli: Cli):
    assert cli("simulate", MOTION, "--rate", "20").code == 0
    facts = read_facts(here / "sim")
    imu, gps, ref = read_imu("sim/imu.csv").data, read_gps("sim/gps.csv").data, read_reference("sim/ref.csv").data
    assert len(imu.time) == facts["imu_samples"] == round(facts["motion"]["duration_s"] * 20)
    assert len(gps.time) == facts["gps_fixes"]
    assert ref.time[0] == facts["motion"]["start_s"]
    assert load_imu("sim/imu.toml").name == "consumer"
    drawn = load_calibration(Path("sim/specimen.toml"))
    np.testing.assert_allclose(np.degrees(drawn.gyro_bias) * 3600.0, facts["specimen"]["gyro_bias_deg_h"], rtol=1e-9)
    assert load_profile("sim/profile.toml").duration == load_profile(MOTION).duration
    for name in ("gps.toml", "report.html", "figures/way.png", "figures/motion.png"):
        assert (here / "sim" / name).stat().st_size > 0


def test_the_same_options_give_the_same_bytes(here: Path, cli: Cli):
    for out in ("one", "two"):
        assert cli("simulate", MOTION, "--rate", "20", "--out", out).code == 0
    assert digests(here / "one") == digests(here / "two")
    assert cli("simulate", MOTION, "--rate", "20", "--seed", "2", "--out", "three").code == 0
    assert digests(here / "three")["imu.csv"] != digests(here / "one")["imu.csv"]
    # the profile that was written makes the same files again
    assert (
        cli(
            "simulate",
            "one/profile.toml",
            "--imu",
            "one/imu.toml",
            "--gps",
            "one/gps.toml",
            "--rate",
            "20",
            "--out",
            "four",
        ).code
        == 0
    )
    for name in ("imu.csv", "gps.csv", "ref.csv"):
        assert digests(here / "four")[name] == digests(here / "one")[name]


def test_faults_are_applied_and_told(here: Path, cli: Cli):
    assert cli("simulate", MOTION, "--rate", "20", "--out", "clean").code == 0
    shown = cli("simulate", MOTION, "--rate", "20", "--fault", "gps-outage@30s+10s", "--fault", "imu-gap@50s+1s")
    assert shown.code == 0, shown.err
    assert shown.out.count("\nfault ") == 2
    assert len(read_facts(here / "sim")["faults"]) == 2
    gaps = [
        np.diff(read(f"{name}.csv").data.time).max()
        for read, name in ((read_gps, "sim/gps"), (read_imu, "sim/imu"), (read_imu, "clean/imu"))
    ]
    assert gaps[0] > 9.0
    assert gaps[1] > 0.9 > gaps[2]


def test_a_run_and_a_reference_have_twins(drive: Path, cli: Cli):
    done = cli("run", "imu.csv", "--gps", "gps.csv", "--imu", "automotive", "--figures", "none")
    assert done.code == 0, done.err
    for source in ("run", "ref.csv"):
        shown = cli("simulate", "--from", source, "--imu", "ideal", "--rate", "50", "--force")
        assert shown.code == 0, shown.err
        twin, original = read_reference("sim/ref.csv").data, read_reference("ref.csv").data
        at = np.searchsorted(twin.time, original.time[50:-50])
        difference = np.degrees(twin.lla[at, :2] - original.lla[50:-50, :2]) * 111e3
        assert np.abs(difference).max() < 5.0
        assert "profile.toml" not in read_facts(drive / "sim")["files"]


def test_the_library_is_listed_and_drawn(here: Path, cli: Cli):
    shown = cli("simulate", "--list", "--out", "sketches")
    assert shown.code == 0, shown.err
    assert len(shown.out.splitlines()) == len(library()) >= 10
    for each in json.loads(cli("simulate", "--list", "--json").out):
        assert each["purpose"]
        assert f"{each['name']} " in shown.out
        assert (here / "sketches" / "figures" / f"{each['name']}.png").exists()


def test_json_is_run_json(here: Path, cli: Cli):
    shown = cli("simulate", MOTION, "--rate", "20", "--json")
    assert shown.out == (here / "sim" / "run.json").read_text()
    assert {"seed", "versions", "motion", "specimen", "faults", "command", "files"} <= set(json.loads(shown.out))


@pytest.mark.parametrize(
    ("options", "code", "word"),
    [
        ((), 2, "a motion is needed"),
        ((MOTION, "--from", "x.csv"), 2, "two motions"),
        (("nowhere",), 2, "nowhere"),
        ((MOTION, "--imu", "nobody"), 2, "neither an IMU preset nor a file"),
        ((MOTION, "--gps", "nobody"), 2, "nobody"),
        ((MOTION, "--rate", "0"), 2, "sampling rate"),
        ((MOTION, "--fault", "gps-jmp:3m@10s"), 2, "gps-jmp"),
        ((MOTION, "--temperature", "warm"), 2, "not a temperature"),
        ((MOTION, "--resume"), 2, "--runs"),
        ((MOTION, "--runs", "3", "--run", "2"), 2, "either all runs or one"),
        ((MOTION, "--runs", "3", "--imu", "ideal"), 2, "all the same"),
        ((MOTION, "--seed", "-1"), 2, "--seed"),
        (("--from", "none.csv"), 3, "none.csv"),
        (("--from", "."), 3, "no solution"),
        ((MOTION, "--out", "no/such"), 4, "parent of the output folder"),
    ],
)
def test_what_cannot_be_is_refused(here: Path, cli: Cli, options: tuple[str, ...], code: int, word: str):
    shown = cli("simulate", *options)
    assert shown.code == code, shown.err
    assert shown.out == ""
    assert word in shown.err
    assert not list(here.iterdir())


def test_many_runs_give_the_same_bytes_for_any_number_of_workers(here: Path, cli: Cli):
    for workers in (1, 2):
        shown = cli("simulate", MOTION, "--runs", 6, "--rate", "20", "--workers", workers, "--out", f"by{workers}")
        assert shown.code == 0, shown.err
    assert digests(here / "by1") == digests(here / "by2")
    assert not list(here.glob(".*"))
    facts = read_facts(here / "by1")["ensemble"]
    table, epochs = rows(here / "by1" / "runs.csv"), rows(here / "by1" / "ensemble.csv")
    assert [int(row["run"]) for row in table] == [1, 2, 3, 4, 5, 6]
    north = [float(row["rms_north_m"]) for row in table]
    assert facts["rms"]["north_m"] == pytest.approx(np.sqrt(np.mean(np.square(north))), rel=0.02)
    assert {int(row["runs"]) for row in epochs} <= set(range(1, 7))
    assert all(float(row["sd_north_m"]) > 0.0 for row in epochs)


def test_one_run_of_many_can_be_had_alone(here: Path, cli: Cli):
    assert cli("simulate", MOTION, "--runs", 3, "--rate", "20", "--workers", 1, "--out", "all").code == 0
    assert cli("simulate", MOTION, "--run", 3, "--rate", "20").code == 0
    table = rows(here / "all" / "runs.csv")
    assert read_facts(here / "sim")["seed"] == int(table[2]["seed"])
    command = shlex.split(read_facts(here / "sim")["command"])
    os.chdir(here / "sim")
    done = cli(*command[1:], "--figures", "none", "--no-smooth", "--out", "../run")
    assert done.code == 0, done.err
    accuracy = read_facts(here / "run")["accuracy"]["all"]
    assert accuracy["north_m"]["rms"] == pytest.approx(float(table[2]["rms_north_m"]), rel=0.02)


@posix
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_series_is_kept_for_the_same_command(here: Path, cli: Cli, number: signal.Signals):
    options = (MOTION, "--runs", "40", "--rate", "20")
    begin = time.perf_counter()
    assert cli("simulate", *options, "--out", "whole", "--workers", 2).code == 0
    whole = time.perf_counter() - begin
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
    more = (MOTION, "--runs", "4000", "--rate", "20", "--out", "stopped", "--workers", "2")
    process = subprocess.Popen([*COMMAND, *more], stderr=subprocess.PIPE, text=True, env=environment)
    give_up = time.monotonic() + 120.0
    while not list(here.glob(".stopped.unfinished")):
        assert time.monotonic() < give_up, "nothing was kept"
        time.sleep(0.05)
    process.send_signal(number)
    begin = time.perf_counter()
    _, err = process.communicate(timeout=60)
    assert time.perf_counter() - begin < whole
    assert process.returncode == 128 + number
    assert "--resume" in err
    assert "Traceback" not in err
    assert sorted(path.name for path in here.iterdir()) == [".stopped.unfinished", "whole"]
    other = cli("simulate", *options, "--out", "stopped", "--resume")
    assert other.code == 2  # another number of runs is another series
    assert "another one" in other.err


def test_a_series_that_ended_early_is_gone_on_with(here: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch):
    options = ("simulate", MOTION, "--runs", 6, "--rate", "20", "--workers", 1)
    assert cli(*options, "--out", "whole").code == 0
    from insnav.errors import ensemble

    made, whole = [], ensemble.reduced

    def counted(*arguments: object) -> object:
        made.append(1)
        if len(made) == 4:
            raise KeyboardInterrupt
        return whole(*arguments)

    monkeypatch.setattr(ensemble, "reduced", counted)
    assert cli(*options).code != 0
    assert (here / ".sim.unfinished").exists()
    shown = cli(*options, "--resume")
    assert shown.code == 0, shown.err
    assert len(made) == 4 + 3
    assert digests(here / "sim") == digests(here / "whole")
    assert not (here / ".sim.unfinished").exists()


def test_a_run_that_fails_is_named(here: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch):
    from insnav.errors import ensemble

    whole, made = ensemble.reduced, []

    def failing(*arguments: object) -> object:
        made.append(1)
        if len(made) == 2:
            raise ValueError("made to fail")
        return whole(*arguments)

    monkeypatch.setattr(ensemble, "reduced", failing)
    shown = cli("simulate", MOTION, "--runs", 3, "--rate", "20", "--workers", 1)
    assert shown.code == 0, shown.err
    assert "run 2 (seed " in shown.out
    assert "made to fail" in shown.out
    assert [row["run"] for row in rows(here / "sim" / "runs.csv")] == ["1", "3"]
