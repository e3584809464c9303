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

from insnav.findings import Code
from insnav.imu import load_calibration, load_imu
from insnav.input import read_gps, read_imu, read_reference
from insnav.output.folder import read_facts
from insnav.simulate.motion import library, load_profile
from tests.cli.conftest import ROOT, Cli, findings_of, says
from tests.shared import verify_folder

MOTION = "drive.toml"  # two minutes
PROFILE = """
purpose = "Rest, two bends, a stop"

[start]
lat = "45 deg"
lon = "9 deg"
heading = "20 deg"

[[segment]]
kind = "repeat"
count = 2
segment = [
  { kind = "static", duration = "20 s" },
  { kind = "accelerate", to = "15 m/s", acceleration = "3 m/s^2" },
  { kind = "turn", angle = "100 deg", rate = "20 deg/s" },
  { kind = "cruise", duration = "12 s" },
  { kind = "turn", angle = "-60 deg", rate = "15 deg/s" },
  { kind = "stop", acceleration = "3 m/s^2" },
]
"""
QUICK = (MOTION, "--rate", "20")
COMMAND = [sys.executable, "-c", "from insnav.cli import main; main()", "simulate"]
posix = pytest.mark.skipif(sys.platform == "win32", reason="signals are different there")


def digests(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="session")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a motion profile and a receiver, and ``sim``, what a process of its own has made of the profile.

    The errors of the receiver are white, as the filter takes them unless the drive is long enough to tell.
    """
    folder = tmp_path_factory.mktemp("prepared")
    (folder / MOTION).write_text(PROFILE)
    white = 'rate = "2 Hz"\n[position]\nwhite = ["1.5 m", "1.5 m", "3 m"]\n[velocity]\nwhite = "0.1 m/s"\n'
    (folder / "white.toml").write_text(white)
    subprocess.run([*COMMAND, *QUICK], cwd=folder, env=environment(), check=True, capture_output=True)
    return folder


@pytest.fixture
def here(prepared: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with the profile and the receiver."""
    for name in (MOTION, "white.toml"):
        (tmp_path / name).write_bytes((prepared / name).read_bytes())
    monkeypatch.chdir(tmp_path)
    return tmp_path


def made(folder: Path) -> list[str]:
    """What has been made in a working directory."""
    return sorted(path.name for path in folder.iterdir() if path.suffix != ".toml")


@pytest.mark.parametrize(
    "options",
    [
        ("--imu", "tactical", "--sampling", "increment", "--seed", "7"),
        ("--imu", "ideal", "--gps", "ideal", "--sampling", "instant"),
    ],
)
def test_the_printed_command_navigates_what_was_simulated(here: Path, cli: Cli, options: tuple[str, ...]):
    shown = cli("simulate", MOTION, "--rate", "50", "--gps", "white.toml", *options)
    assert shown.code == 0, shown.err
    verify_folder(here / "sim")
    command = shlex.split(shown.out.splitlines()[-1].removeprefix("next"))
    assert command[:3] == ["insnav", "run", "sim/imu.csv"]
    done = cli(*command[1:], "--figures", "none")
    assert done.code == 0, done.err
    found = read_facts(here / "run")["accuracy"]
    assert found["all"]["horizontal_m"]["rms"] < 2.0
    assert found["consistency"]["position"]["inside_3_sd"] > 0.9


def test_where_nothing_tells_the_heading_the_printed_command_does(here: Path, cli: Cli):
    shown = cli("simulate", "laboratory_slide", "--rate", "20", "--gps", "white.toml")
    command = shlex.split(shown.out.splitlines()[-1].removeprefix("next"))
    assert command[command.index("--heading") + 1] == "90.0"
    done = cli(*command[1:], "--figures", "none", "--no-smooth")
    assert done.code == 0, done.err


def test_errors_are_of_the_size_that_the_filter_states(here: Path, cli: Cli):
    models = ("--imu", "automotive", "--gps", "white.toml")
    shown = cli("simulate", MOTION, *models, "--runs", 16, "--rate", 50, "--engine", 1)
    assert shown.code == 0, shown.err
    found = read_facts(here / "sim")["ensemble"]
    print(found["nees_per_axis"], found["nees_inside_band"])
    assert 0.6 < found["nees_per_axis"]["position"] < 1.6
    assert 0.6 < found["nees_per_axis"]["velocity"] < 1.6
    assert 0.3 < found["nees_per_axis"]["attitude"] < 1.6
    assert found["failed"] == []


def test_every_file_is_there_and_can_be_read_again(prepared: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(prepared)
    facts = read_facts(prepared / "sim")
    imu, gps, ref = read_imu("sim/imu.csv").data, read_gps("sim/gps.csv").data, read_reference("sim/ref.csv").data
    assert len(imu.time) == facts["imu_samples"] == int(facts["motion"]["duration_s"] * 20)
    assert len(gps.time) == facts["gps_fixes"]
    assert ref.time[0] == facts["motion"]["start_s"]
    assert load_imu("sim/imu.toml").name == "consumer"
    drawn = load_calibration(Path("sim/sensor_realisation.toml"))
    np.testing.assert_allclose(
        np.degrees(drawn.gyro_bias) * 3600.0, facts["sensor_realisation"]["gyro_bias_deg_h"], rtol=1e-9
    )
    assert load_profile("sim/profile.toml").duration == load_profile(Path(MOTION)).duration
    for name in ("gps.toml", "report.html"):
        assert (prepared / "sim" / name).stat().st_size > 0


@pytest.mark.skipif("INSNAV_REVERSED" in os.environ, reason="another process has the words as they are")
def test_the_same_options_give_the_same_bytes(prepared: Path, here: Path, cli: Cli):
    shown = cli("simulate", *QUICK, "--json")
    assert shown.code == 0, shown.err
    once = digests(prepared / "sim")
    assert digests(here / "sim") == once  # in another process
    assert shown.out == (here / "sim" / "run.json").read_text()
    assert {"seed", "versions", "motion", "sensor_realisation", "faults", "command", "files"} <= set(
        json.loads(shown.out)
    )
    # the models that were written make the same files again
    models = ("--imu", "sim/imu.toml", "--gps", "sim/gps.toml")
    assert cli("simulate", "sim/profile.toml", *models, "--rate", "20", "--out", "again").code == 0
    assert cli("simulate", *QUICK, "--seed", "2", "--out", "other").code == 0
    for name in ("imu.csv", "gps.csv"):
        assert digests(here / "again")[name] == once[name] != digests(here / "other")[name]
    assert digests(here / "again")["ref.csv"] == once["ref.csv"]


def test_faults_are_applied_and_told(prepared: Path, here: Path, cli: Cli):
    shown = cli("simulate", *QUICK, "--fault", "gps-outage@30s+10s", "--fault", "imu-gap@50s+1s")
    assert shown.code == 0, shown.err
    assert shown.out.count("\nfault ") == 2
    assert len(read_facts(here / "sim")["faults"]) == 2
    gaps = [
        np.diff(read(folder / f"sim/{name}.csv").data.time).max()
        for read, folder, name in ((read_gps, here, "gps"), (read_imu, here, "imu"), (read_imu, prepared, "imu"))
    ]
    assert gaps[0] > 9.0
    assert gaps[1] > 0.9 > gaps[2]


def test_every_fault_is_named_in_the_help_and_in_the_readme():
    from insnav.cli.help import help_of
    from insnav.simulate.recording import VERBS

    readme = (ROOT / "trajectories" / "README.md").read_text()
    for name, verb in VERBS.items():
        assert name in help_of("simulate")["help"]
        assert f"`{verb.example}`" in readme


def test_the_profile_of_the_readme_can_be_driven_and_every_segment_is_told(here: Path):
    from insnav.simulate.motion.segments import SEGMENTS
    from insnav.simulate.recording import load_gps

    readme = (ROOT / "trajectories" / "README.md").read_text()
    drive, receiver = (block.split("```")[0] for block in readme.split("```toml\n")[1:])
    for name, text in (("bridge.toml", drive), ("gps.toml", receiver)):
        (here / name).write_text(text)
    assert load_profile("bridge.toml").truth(0).duration > 100.0
    assert load_gps("gps.toml").outages == ((120.0, 30.0),)
    table = readme.split("| kind | keys")[1].split("\n\n")[0].splitlines()
    for kind, segment in SEGMENTS.items():
        (row,) = [line for line in table if f"`{kind}`" in line.split("|")[1]]
        for key in set(segment.model_fields) - {"kind"} - ({"to"} if kind == "stop" else set()):
            if (kind, key) != ("arc", "rate"):
                assert f"`{key}`" in row


def test_gravity_can_be_that_of_other_packages(prepared: Path, here: Path, cli: Cli):
    shown = cli("simulate", *QUICK, "--gravity", "linear", "--imu", "ideal")
    assert shown.code == 0, shown.err
    assert "gravity     without its north component, and linear in height" in shown.out
    assert "gravity" not in cli("simulate", *QUICK, "--imu", "ideal", "--out", "full").out
    linear, full = (read_imu(folder).data.accel for folder in ("sim/imu.csv", "full/imu.csv"))
    # on the ellipsoid, where the drive starts, both are the same
    assert 0.0 < np.abs(linear - full).max() < 1e-7


def test_a_run_and_a_reference_have_simulated_replicas(drive: Path, cli: Cli):
    done = cli("run", "imu.csv", "--gps", "gps.csv", "--imu", "automotive", "--figures", "none")
    assert done.code == 0, done.err
    for source in ("run", "ref.csv"):
        shown = cli("simulate", "--from", source, "--imu", "ideal", "--rate", "20", "--force")
        assert shown.code == 0, shown.err
        (told,) = [line for line in shown.out.splitlines() if line.startswith("replica")]
        assert "m/s RMS from its track, at most " in told
        facts = read_facts(drive / "sim")
        assert facts["motion"]["replica"]["position_rms_m"] < 0.05
        assert facts["motion"]["replica"]["doubts"] == []
        assert "profile.toml" not in facts["files"]
        replica, original = read_reference("sim/ref.csv").data, read_reference("ref.csv").data
        at = np.searchsorted(replica.time, original.time[50:-50])
        difference = np.degrees(replica.lla[at, :2] - original.lla[50:-50, :2]) * 111e3
        assert np.abs(difference).max() < 5.0


def test_a_poor_track_is_doubted(drive: Path, cli: Cli):
    lines = (drive / "ref.csv").read_text().splitlines(keepends=True)
    (drive / "holed.csv").write_text("".join(lines[:800] + lines[900:]))
    shown = cli("simulate", "--from", "holed.csv", "--imu", "ideal", "--rate", "20")
    assert shown.code == 0, shown.err
    replica = read_facts(drive / "sim")["motion"]["replica"]
    doubt = replica["doubts"][-1]
    assert replica["longest_gap_s"] == pytest.approx(10.1)
    assert "10.1 s" in doubt
    assert f"\nwarning     {doubt}" in shown.out
    assert "10.1 s" in (drive / "sim" / "report.html").read_text()


def test_the_library_is_listed_and_drawn(here: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch):
    shown = cli("simulate", "--list")
    assert shown.code == 0, shown.err
    assert len(shown.out.splitlines()) == len(library()) >= 10
    for each in json.loads(cli("simulate", "--list", "--json").out):
        assert each["purpose"]
        assert f"{each['name']} " in shown.out
    assert made(here) == []
    few = [path for path in library() if path.stem in ("tunnel", "rate_table")]
    monkeypatch.setattr("insnav.simulate.motion.library", lambda: few)
    assert cli("simulate", "--list", "--out", "sketches").code == 0
    assert sorted(path.name for path in (here / "sketches" / "figures").iterdir()) == ["rate_table.png", "tunnel.png"]


@pytest.mark.parametrize(
    ("options", "code", "word"),
    [
        ((), 2, "cli.no_motion"),
        ((MOTION, "--from", "x.csv"), 2, "cli.two_motions"),
        (("nowhere",), 2, "nowhere"),
        ((MOTION, "--imu", "nobody"), 2, "imu.unknown"),
        ((MOTION, "--gps", "nobody"), 2, "nobody"),
        ((MOTION, "--rate", "0"), 2, "sim.sampling_rate"),
        ((MOTION, "--fault", "gps-jmp:3m@10s"), 2, "gps-jmp"),
        ((MOTION, "--temperature", "warm"), 2, "cli.not_a_temperature"),
        ((MOTION, "--resume"), 2, "cli.resume_without_runs"),
        ((MOTION, "--runs", "3", "--run", "2"), 2, "cli.runs_or_run"),
        ((MOTION, "--runs", "3", "--imu", "ideal"), 2, "cli.ideal_runs"),
        ((MOTION, "--seed", "-1"), 2, "--seed"),
        (("--from", "none.csv"), 3, "none.csv"),
        (("--from", "."), 3, "session.no_solution"),
        ((MOTION, "--out", "white.toml/such"), 4, "output.folder_unwritable"),
    ],
)
def test_what_cannot_be_is_refused(here: Path, cli: Cli, options: tuple[str, ...], code: int, word: str):
    shown = cli("simulate", *options)
    assert shown.code == code, shown.err
    assert shown.out == ""
    assert word in shown.err
    assert made(here) == []


def test_many_runs_give_the_same_bytes_for_any_number_of_workers(here: Path, cli: Cli):
    for workers in (1, 2):
        shown = cli("simulate", *QUICK, "--runs", 5, "--engine", workers, "--out", f"by{workers}")
        assert shown.code == 0, shown.err
    assert digests(here / "by1") == digests(here / "by2")
    assert not list(here.glob(".*"))
    facts = read_facts(here / "by1")["ensemble"]
    table, epochs = rows(here / "by1" / "runs.csv"), rows(here / "by1" / "ensemble.csv")
    assert [int(row["run"]) for row in table] == [1, 2, 3, 4, 5]
    north = [float(row["rms_north_m"]) for row in table]
    assert facts["errors"]["north"]["rms_m"] == pytest.approx(np.sqrt(np.mean(np.square(north))), rel=0.02)
    assert {int(row["runs"]) for row in epochs} <= set(range(1, 6))
    assert all(float(row["sd_north_m"]) > 0.0 for row in epochs)


def test_one_run_of_many_can_be_had_alone(here: Path, cli: Cli):
    assert cli("simulate", *QUICK, "--runs", 3, "--engine", 1, "--out", "all").code == 0
    assert cli("simulate", *QUICK, "--run", 3).code == 0
    table = rows(here / "all" / "runs.csv")
    assert read_facts(here / "sim")["seed"] == int(table[2]["seed"])
    command = shlex.split(read_facts(here / "sim")["command"])
    os.chdir(here / "sim")
    done = cli(*command[1:], "--figures", "none", "--no-smooth", "--out", "../run")
    assert done.code == 0, done.err
    accuracy = read_facts(here / "run")["accuracy"]["all"]
    assert accuracy["north_m"]["rms"] == pytest.approx(float(table[2]["rms_north_m"]), rel=0.02)


@posix
@pytest.mark.parametrize(("number", "workers"), [(signal.SIGINT, "1"), (signal.SIGTERM, "2")])
def test_a_stopped_series_is_kept_for_the_same_command(here: Path, cli: Cli, number: signal.Signals, workers: str):
    more = (*QUICK, "--runs", "4000", "--engine", workers)
    process = subprocess.Popen([*COMMAND, *more], stderr=subprocess.PIPE, text=True, env=environment())
    give_up = time.monotonic() + 120.0
    while not list(here.glob(".sim.unfinished")):
        assert time.monotonic() < give_up, "nothing was kept"
        assert process.poll() is None, process.stderr
        time.sleep(0.05)
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 128 + number
    assert "--resume" in err
    assert "Traceback" not in err
    assert made(here) == [".sim.unfinished"]
    other = cli("simulate", *QUICK, "--runs", "40", "--resume")
    assert other.code == 2  # another number of runs is another series
    assert "sim.other_series" in other.err


def test_a_series_that_ended_early_is_gone_on_with(here: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch):
    options = ("simulate", *QUICK, "--runs", 5, "--engine", 1)
    assert cli(*options, "--out", "whole").code == 0
    from insnav.errors import ensemble

    done, whole = [], ensemble.reduced

    def counted(*arguments: object) -> object:
        done.append(1)
        if len(done) == 4:
            raise KeyboardInterrupt
        return whole(*arguments)

    monkeypatch.setattr(ensemble, "reduced", counted)
    assert cli(*options).code != 0
    assert (here / ".sim.unfinished").exists()
    shown = cli(*options, "--resume")
    assert shown.code == 0, shown.err
    assert len(done) == 4 + 2
    assert digests(here / "sim") == digests(here / "whole")
    assert not (here / ".sim.unfinished").exists()


def test_a_series_stopped_while_it_is_written_is_kept_too(here: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch):
    from insnav.cli.console import Stopped
    from insnav.report.simulation import page

    def stopped(*_: object) -> None:
        raise Stopped(signal.SIGINT)

    options = ("simulate", *QUICK, "--runs", 2, "--engine", 1)
    with monkeypatch.context() as patch:
        patch.setattr(page, "write_runs", stopped)
        shown = cli(*options)
    assert shown.code == 128 + signal.SIGINT
    assert "--resume" in shown.err
    assert made(here) == [".sim.unfinished"]


def test_a_run_that_fails_is_named(here: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch):
    from insnav.errors import ensemble

    whole, done = ensemble.reduced, []

    def failing(*arguments: object) -> object:
        done.append(1)
        if len(done) == 2:
            raise ValueError("made to fail")
        return whole(*arguments)

    monkeypatch.setattr(ensemble, "reduced", failing)
    shown = cli("simulate", *QUICK, "--runs", 3, "--engine", 1)
    assert shown.code == 0, shown.err
    (failed,) = findings_of(read_facts(here / "sim"), Code.SIMULATION_RUN_FAILED)
    assert failed["run"] == 2
    assert says(shown.out, failed)
    assert "made to fail" in shown.out
    assert [row["run"] for row in rows(here / "sim" / "runs.csv")] == ["1", "3"]
