"""The command line as a process of its own: signals, pipes, standard input, a full disk, a poor terminal."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import QUICK, ROOT

COMMAND = [sys.executable, "-c", "from insnav.cli import main; main()", "run"]
posix = pytest.mark.skipif(sys.platform == "win32", reason="signals and pipes are different there")


def _environment(**more: str) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT), **more}


def _start(*arguments: str, **more: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*COMMAND, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=_environment(),
        **more,  # type: ignore[call-overload]
    )


def _wait_for(process: subprocess.Popen[str], word: str) -> None:
    assert process.stderr is not None
    for line in process.stderr:
        if word in line:
            return
    pytest.fail(f"the log never said {word!r}")


@pytest.fixture(scope="session")
def undisturbed(files: Path, tmp_path_factory: pytest.TempPathFactory) -> float:
    """How long a run takes that nobody stops [s], and the kernels are in their cache: a compiler hears no signals."""
    folder = tmp_path_factory.mktemp("undisturbed")
    taken = 0.0
    for name in ("compiling", "run"):
        names = (str(files / "imu.csv"), "--gps", str(files / "gps.csv"), "--out", str(folder / name))
        begin = time.perf_counter()
        subprocess.run([*COMMAND, *names], env=_environment(), capture_output=True, check=True)
        taken = time.perf_counter() - begin
    return taken


@posix
@pytest.mark.parametrize(
    ("number", "code", "word"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]
)
@pytest.mark.parametrize("moment", [0.0, 0.2])
def test_a_signal_stops_at_once_and_leaves_nothing(
    drive: Path, undisturbed: float, number: signal.Signals, code: int, word: str, moment: float
):
    taken = []
    while len(taken) < 3 and min(taken, default=np.inf) > 0.5 * undisturbed:  # what others do makes it only longer
        process = _start("imu.csv", "--gps", "gps.csv", "-v")
        _wait_for(process, "insnav: IMU model")
        time.sleep(moment * undisturbed)  # while it navigates, however fast the machine is
        process.send_signal(number)
        begin = time.perf_counter()
        out, err = process.communicate(timeout=30)
        taken.append(time.perf_counter() - begin)
        assert process.returncode == code, err
        assert out == ""
        assert err.endswith(f" cli.{word}\n")
        assert "Traceback" not in err
        assert sorted(path.name for path in drive.iterdir()) == ["gps.csv", "imu.csv", "ref.csv"]
    assert min(taken) < 0.5 * undisturbed


@posix
@pytest.mark.usefixtures("undisturbed", "drive")
@pytest.mark.parametrize("called", ["_numba_unpickle", "_raw_object_cache_getbuffer", "detach"])
def test_a_signal_waits_while_compiled_code_calls_python(called: str):
    """It ignores an exception of the called function, then uses a missing result or frees memory twice."""
    code = f"""
import os, signal, sys
def interrupt(frame, event, _):
    if event == "call" and frame.f_code.co_name == {called!r}:
        sys.setprofile(None)
        os.kill(os.getpid(), signal.SIGTERM)
sys.setprofile(interrupt)
from insnav.cli import main
main()
"""
    command = [sys.executable, "-c", code, *COMMAND[3:], *QUICK]
    done = subprocess.run(command, env=_environment(), capture_output=True, text=True)
    assert done.returncode == 143, done.stderr
    assert done.stderr.endswith(" cli.terminated\n")


@pytest.mark.parametrize("asked", [None, "2"])
def test_linear_algebra_has_one_thread_unless_others_are_asked_for(asked: str | None):
    """Threads of small matrices wait for each other, which costs CPU time and no one sees why."""
    code = """
import os, sys
from insnav import cli
assert "numpy" not in sys.modules
cli._run = lambda _: print(os.environ["OPENBLAS_NUM_THREADS"])
cli.main()
"""
    environment = _environment()
    environment.pop("OPENBLAS_NUM_THREADS", None)
    if asked is not None:
        environment["OPENBLAS_NUM_THREADS"] = asked
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.stdout.strip() == (asked or "1"), done.stderr


@posix
@pytest.mark.usefixtures("undisturbed")
def test_long_work_names_its_stages_on_a_terminal(drive: Path):
    import pty

    # shown from the begin on: on a fast machine this drive is navigated within the second that short work has
    code = "from insnav import cli, progress; progress.DELAY, progress.REDRAWN = 0.0, 0.01; cli.main()"
    ours, theirs = pty.openpty()
    terminal = _environment(TERM="xterm", COLUMNS="100")
    with subprocess.Popen(
        [sys.executable, "-c", code, "run", "imu.csv", "--gps", "gps.csv"],
        stdout=subprocess.PIPE,
        stderr=theirs,
        env=terminal,
    ) as process:
        os.close(theirs)
        seen = b""
        while True:
            try:
                piece = os.read(ours, 4096)
            except OSError:  # the other end is closed
                break
            if not piece:
                break
            seen += piece
    os.close(ours)
    assert process.returncode == 0, seen.decode()
    assert b"writing" in seen
    assert seen.rindex(b"navigating") < seen.rindex(b"writing")


@posix
def test_a_reader_that_goes_away_is_no_error(drive: Path):
    process = _start(*QUICK, "--json")
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    err = process.stderr.read()
    process.stderr.close()
    assert process.wait(30) == 141
    assert "error" not in err
    assert "Traceback" not in err
    assert (drive / "run" / "run.json").exists()


def test_the_imu_file_may_come_from_standard_input(drive: Path):
    with Path("imu.csv").open("rb") as file:
        done = subprocess.run(
            [*COMMAND, "-", *QUICK[1:], "--json"], stdin=file, capture_output=True, env=_environment(), check=False
        )
    assert done.returncode == 0, done.stderr.decode()
    facts = json.loads(done.stdout)
    assert facts["input"]["imu"]["path"] == "standard input"
    assert facts["input"]["imu"]["n_rows"] == 13000


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_a_result_that_cannot_be_printed_is_an_output_error(drive: Path):
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [*COMMAND, *QUICK], stdout=full, stderr=subprocess.PIPE, text=True, env=_environment(), check=False
        )
    assert done.returncode == 4
    assert "where: standard output" in done.stderr
    assert "Traceback" not in done.stderr


@posix
def test_a_name_that_is_not_utf_8_is_kept(drive: Path, tmp_path: Path):
    place = tmp_path / os.fsdecode(b"v\xe9")
    try:
        shutil.copytree(drive, place)
    except OSError:
        pytest.skip("this file system has UTF-8 names only")
    done = subprocess.run(
        [*COMMAND, place], capture_output=True, text=True, env=_environment(), cwd=tmp_path, check=False
    )
    assert done.returncode == 0, done.stderr
    facts = json.loads((tmp_path / "run" / "run.json").read_text(encoding="utf-8"))
    assert facts["configuration"]["imu_file"] == str(place)


def test_a_terminal_without_unicode_and_a_home_that_is_not_there(drive: Path):
    poor = _environment(HOME="/nonexistent", PYTHONUTF8="0", PYTHONIOENCODING="ascii", TERM="dumb", LC_ALL="C")
    done = subprocess.run([*COMMAND, *QUICK], capture_output=True, text=True, env=poor, check=False)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert "not checked: no reference" in done.stdout
