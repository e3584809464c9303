"""Help is quick, readable and has examples; a wrong option ends in one short block."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest

from insnav.messages import phrase
from tests.cli.conftest import ROOT, Cli

COMMANDS = ("run", "align", "compare", "tune")


def test_help_lists_every_command_and_exit_code(cli: Cli):
    shown = cli("--help")
    assert shown.code == 0
    assert shown.err == ""
    for word in (*COMMANDS, "Examples:", "3 unusable data", "4 cannot write", "130, 143 interrupted"):
        assert word in shown.out


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_a_command_has_examples_and_fits_a_terminal(cli: Cli, command: str):
    shown = cli(command, "--help")
    assert shown.code == 0
    assert f"insnav {command} " in shown.out.split("Examples:")[1]
    assert max(map(len, shown.out.splitlines())) <= 80
    assert "{" not in shown.out
    assert "<" not in shown.out.split("Files:")[1]  # no type of Python


def test_help_of_run_has_its_options_in_groups(cli: Cli):
    shown = cli("run", "--help").out
    groups = [line[:-1] for line in shown.splitlines() if line.endswith(":") and line[0] != " "]
    assert groups == ["Files", "IMU", "GPS and reference", "Start", "Faults", "Other aiding", "Result", "Other"]


def test_no_command_shows_the_help(cli: Cli):
    shown = cli()
    assert shown.code == 2
    assert "Commands:" in shown.out


def test_version(cli: Cli):
    from insnav import __version__

    assert cli("--version").out == f"insnav {__version__}\n"


def imported(program: str) -> set[str]:
    """Give the modules that a Python program imports."""
    program = f"import sys\ntry:\n    {program}\nfinally:\n    print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    return set(done.stdout.splitlines()[-1].split())


def test_help_needs_no_heavy_import_and_little_time():
    """What a start takes is what it imports; times depend on what else the machine does."""
    modules = imported("sys.argv = ['insnav', '--help']; from insnav.cli import main; main()")
    packages = {name.partition(".")[0] for name in modules}
    assert "insnav" in packages
    assert not packages & {"numpy", "numba", "scipy", "pandas", "matplotlib", "pyarrow", "pydantic", "rich", "filterpy"}
    assert len(modules) < 0.5 * len(imported("import pandas"))  # .31


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run", "imu.csv", "--gp", "x"), ("cli.no_such_option", "--gp.", "--gps", "insnav run")),
        (("compare", "run"), ("cli.missing_option", "--ref", "insnav compare")),
        (("runn",), ("'runn'", "'run'", "cli.usage")),
        (("run", "a", "--gps", "b", "--figures", "pdf"), ("--figures", "'pdf'", "'png'")),
        (("run", "a", "--gps", "b", "--heading", "x"), ("--heading", "unit.missing")),
        (("align", "a"), ("session.no_latitude", "--lat")),
    ],
)
def test_a_wrong_option_is_one_block_with_exit_code_2(cli: Cli, arguments: tuple[str, ...], words: tuple[str, ...]):
    shown = cli(*arguments)
    assert shown.code == 2
    assert shown.out == ""
    assert shown.err.startswith("insnav: error: ")
    assert shown.err.count("insnav: error") == 1
    assert "  fix:   " in shown.err
    assert len(shown.err.splitlines()) <= 4
    for word in words:
        assert word in shown.err


def test_debug_gives_the_traceback_and_keeps_the_exit_code(cli: Cli):
    quiet, loud = cli("run", "none.csv", "--gps", "none.csv"), cli("run", "none.csv", "--gps", "none.csv", "--debug")
    assert quiet.code == loud.code == 3
    assert "Traceback" not in quiet.err
    assert "Traceback" in loud.err
    assert loud.err.endswith(quiet.err[quiet.err.index("insnav: error") :])


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_a_shell_completes_commands(cli: Cli, monkeypatch: pytest.MonkeyPatch, shell: str):
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")  # of the process that started the tests
    assert "insnav" in cli("--show-completion", shell).out
    monkeypatch.setenv("_INSNAV_COMPLETE", f"complete_{shell}")
    monkeypatch.setenv("COMP_WORDS", "insnav comp")
    monkeypatch.setenv("COMP_CWORD", "1")
    monkeypatch.setenv("_TYPER_COMPLETE_ARGS", "insnav comp")
    assert "compare" in cli().out


@pytest.mark.parametrize(
    ("typed", "folders"),
    [
        ("run --imu ", ("imu/grades", "imu/parts")),
        ("run --imu ADIS", ("imu/grades", "imu/parts")),
        ("simulate city --gps r", ("simulate/receivers",)),
        ("imus st", ("imu/parts",)),
        ("simulate c", ("profiles",)),
        ("require --profile t", ("profiles",)),
        ("run imu", ()),  # a file, which the shell completes itself
    ],
)
def test_a_shell_completes_presets_parts_and_profiles(cli: Cli, monkeypatch, typed: str, folders: tuple[str, ...]):
    monkeypatch.setenv("_INSNAV_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", f"insnav {typed}")
    monkeypatch.setenv("COMP_CWORD", str(len(typed.split(" "))))
    places = [ROOT / "trajectories" if name == "profiles" else ROOT / "insnav" / name for name in folders]
    known = {path.stem for place in places for path in place.glob("*.toml")} - {"corpus"}
    begun = {name for name in known if name.startswith(typed.split(" ")[-1].lower())}
    assert {*cli().out.lower().split()} == begun
    assert bool(begun) == bool(folders)


def test_colour_is_for_terminals_that_want_it(monkeypatch: pytest.MonkeyPatch):
    from insnav.cli import console

    monkeypatch.setattr(sys, "stdout", type("Terminal", (), {"isatty": lambda self: True})())
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    good = phrase("light.good")
    assert console.coloured(f"{good}: it holds\na good one") == f"\x1b[32m{good}\x1b[0m: it holds\na good one"
    monkeypatch.setenv("NO_COLOR", "1")
    assert console.coloured(f"{good}: it holds") == f"{good}: it holds"


def test_work_that_takes_long_is_named_where_there_is_no_terminal(monkeypatch, capsys):
    from insnav.cli import console

    monkeypatch.setattr(console, "LOGGED", 0.05)
    monkeypatch.setattr(console, "level", 0)
    with console.Stages() as stage:
        stage("navigating")
        time.sleep(0.5)
    lines = capsys.readouterr().err.splitlines()
    said = phrase("terminal.so_far", stage="navigating", time_s=0.0)
    assert lines[0] == f"insnav: {said}".rstrip()
    assert 2 <= len(lines) <= 4  # ever more rarely: after once, twice, four, eight times as long


def test_what_is_done_is_named_while_a_drive_of_a_fleet_is_navigated_here(monkeypatch, capsys):
    from insnav import cli
    from insnav.cli import batch, console

    monkeypatch.setattr(console, "LOGGED", 0.05)
    monkeypatch.setattr(console, "level", 0)
    monkeypatch.setattr(cli, "_run", lambda _: time.sleep(0.5) or 0)
    with console.Stages() as stage:
        stage("navigating")
        batch.run_drive(["imu.csv"])
    assert len(capsys.readouterr().err.splitlines()) >= 2
