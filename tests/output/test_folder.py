"""The run folder is complete or absent, whatever happens on the way."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from insnav.exceptions import InputError, OutputError
from insnav.output.folder import RunFolder
from tests.refusals import refused
from tests.shared import verify_folder

FACTS = {"name": "drive", "sd_m": None}


def make(target, *, force=False, text="1\n"):
    with RunFolder(target, force=force) as folder:
        folder.path("solution.csv").write_text(text)
        folder.path("figures/track.png").write_bytes(b"png")
        folder.commit(FACTS)
    return target


def fail_inside(target, error, *, force=False):
    with RunFolder(target, force=force) as folder:
        folder.path("solution.csv").write_text("new\n")
        raise error


def leftovers(parent):
    return [p.name for p in parent.iterdir() if p.name.startswith(".")]


def dead_pid():
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_run_json_lists_the_digest_of_every_other_file(tmp_path):
    target = make(tmp_path / "run")
    facts = json.loads((target / "run.json").read_text())
    assert facts["name"] == "drive"
    assert facts["files"] == {
        "figures/track.png": {"bytes": 3, "sha256": hashlib.sha256(b"png").hexdigest()},
        "solution.csv": {"bytes": 2, "sha256": hashlib.sha256(b"1\n").hexdigest()},
    }
    assert verify_folder(target) == facts
    assert leftovers(tmp_path) == []


def test_nothing_is_at_the_target_before_the_commit(tmp_path):
    with RunFolder(tmp_path / "run", force=False) as folder:
        folder.path("solution.csv").write_text("1\n")
        assert not (tmp_path / "run").exists()
        folder.commit(FACTS)
        assert (tmp_path / "run" / "run.json").exists()


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_an_exception_leaves_no_trace(tmp_path, error):
    with pytest.raises(error):
        fail_inside(tmp_path / "run", error)
    assert list(tmp_path.iterdir()) == []


def test_an_existing_folder_needs_force_and_is_then_replaced_whole(tmp_path):
    target = make(tmp_path / "run", text="old\n")
    with refused(OutputError, "output.folder_exists"):
        make(target)
    assert (target / "solution.csv").read_text() == "old\n"
    with RunFolder(target, force=True) as folder:
        folder.path("other.csv").write_text("new\n")
        folder.commit(FACTS)
    assert sorted(p.name for p in target.iterdir()) == ["other.csv", "run.json"]
    assert leftovers(tmp_path) == []


def test_with_force_a_failed_run_keeps_the_old_result(tmp_path):
    target = make(tmp_path / "run", text="old\n")
    with pytest.raises(ValueError):
        fail_inside(target, ValueError, force=True)
    assert (target / "solution.csv").read_text() == "old\n"
    verify_folder(target)


def test_force_never_removes_what_no_run_has_written(tmp_path):
    target = tmp_path / "thesis"
    target.mkdir()
    (target / "chapter.tex").write_text("years of work")
    with refused(OutputError, "output.foreign_files") as caught:
        make(target, force=True)
    assert caught.value.values["files"] == ("chapter.tex",)
    assert (target / "chapter.tex").read_text() == "years of work"
    run = make(tmp_path / "run")
    (run / "notes.txt").write_text("mine")
    with refused(OutputError, "output.foreign_files") as caught:
        make(run, force=True)
    assert caught.value.values["files"] == ("notes.txt",)
    assert (run / "notes.txt").exists()


def test_the_folder_one_is_in_is_never_the_output(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    for target in (Path(), Path(".."), Path("/")):
        with pytest.raises(OutputError):
            make(target, force=True)


def test_a_missing_parent_is_made_and_goes_with_work_that_fails(tmp_path):
    (tmp_path / "a").mkdir()
    with pytest.raises(ValueError, match="gone"):
        fail_inside(tmp_path / "a" / "b" / "c" / "run", ValueError("gone"))
    assert list((tmp_path / "a").iterdir()) == []
    verify_folder(make(tmp_path / "a" / "b" / "c" / "run"))


def test_a_file_in_the_way_is_said_before_the_work(tmp_path):
    (tmp_path / "file").write_text("")
    for force in (False, True):
        with refused(OutputError, "output.folder_is_file"), RunFolder(tmp_path / "file", force=force):
            pytest.fail("the work has begun")
    place = tmp_path / "file" / "a" / "b"
    with refused(OutputError, "output.folder_unwritable") as caught, RunFolder(place, force=False):
        pytest.fail("the work has begun")
    assert caught.value.values["reason"] == os.strerror(errno.ENOTDIR)


def test_a_read_only_parent_is_said_before_the_work(tmp_path, monkeypatch):
    # Permission bits do not stop a privileged user, so the answer of the system is given here.
    monkeypatch.setattr(os, "access", lambda *_: False)
    with refused(OutputError, "output.folder_unwritable") as caught, RunFolder(tmp_path / "run", force=False):
        pytest.fail("the work has begun")
    assert caught.value.exit_code == 4
    assert caught.value.values["reason"] == os.strerror(errno.EACCES)


def test_a_symbolic_link_is_followed_to_what_is_there(tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "disk" / "run")
    with refused(OutputError, "output.dangling_link") as caught:
        make(tmp_path / "link")
    assert caught.value.values["target"] == str(tmp_path / "disk" / "run")
    assert not any((tmp_path / "disk").iterdir())
    make(tmp_path / "disk" / "run")
    make(tmp_path / "link", force=True)
    assert (tmp_path / "link").is_symlink()
    verify_folder(tmp_path / "disk" / "run")


@pytest.mark.parametrize("name", ["../x.csv", "/tmp/x.csv", "a/../../x.csv", "run.json", ""])
def test_no_name_leads_out_of_the_folder(tmp_path, name):
    with pytest.raises(OutputError), RunFolder(tmp_path / "run", force=False) as folder:
        folder.path(name)
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_run_left_is_cleaned_by_the_next(tmp_path):
    pid = dead_pid()
    (tmp_path / f".run.tmp-{pid}").mkdir()
    (tmp_path / f".run.tmp-{os.getppid()}").mkdir()  # alive
    (tmp_path / f".other.tmp-{pid}").mkdir()  # not of this target
    make(tmp_path / "run")
    assert set(leftovers(tmp_path)) == {f".run.tmp-{os.getppid()}", f".other.tmp-{pid}"}


def test_an_old_result_caught_between_two_renames_comes_back(tmp_path):
    make(tmp_path / "run", text="old\n").rename(tmp_path / f".run.old-{dead_pid()}")
    with refused(OutputError, "output.folder_exists"):
        make(tmp_path / "run")
    assert (tmp_path / "run" / "solution.csv").read_text() == "old\n"


STEPS = ["mkdir", "fsync", "rename-old", "rename-new"]
KILLED = """
import os, signal, sys
from pathlib import Path
from insnav.output.folder import RunFolder
target, step = Path(sys.argv[1]), sys.argv[2]
def die(*_): os.kill(os.getpid(), signal.SIGKILL)
with RunFolder(target, force=True) as folder:
    folder.path("solution.csv").write_text("new\\n")
    if step == "mkdir": die()
    if step == "fsync": os.fsync = die
    rename, calls = Path.rename, []
    def counted(self, to):
        calls.append(to)
        if len(calls) == {"rename-old": 1, "rename-new": 2}.get(step, 0): die()
        return rename(self, to)
    Path.rename = counted
    folder.commit({})
"""


@pytest.mark.skipif(os.name == "nt", reason="no SIGKILL here")
@pytest.mark.parametrize("step", STEPS)
def test_killed_at_any_step_the_next_run_finds_the_old_result_complete(tmp_path, step):
    target = make(tmp_path / "run", text="old\n")
    done = subprocess.run([sys.executable, "-c", KILLED, str(target), step], check=False)
    assert done.returncode == -signal.SIGKILL
    with refused(OutputError, "output.folder_exists"):  # the next run cleans up, then refuses
        make(target)
    verify_folder(target)
    assert (target / "solution.csv").read_text() == "old\n"
    assert leftovers(tmp_path) == []


FULL = """
import resource, sys
from pathlib import Path
from insnav.exceptions import OutputError
from insnav.output.folder import RunFolder
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
try:
    with RunFolder(Path(sys.argv[1]), force=False) as folder:
        if sys.argv[2] == "python":
            folder.path("solution.csv").write_text("1" * 1_000_000)
        else:
            import numpy as np
            from insnav.output.solution_tables import write_run_table
            from insnav.types import Trajectory
            z = np.random.default_rng(0).normal(size=(100_000, 3))
            write_run_table(folder.directory, Trajectory(np.arange(1e5), z, z, z), sys.argv[2])
        folder.commit({})
except OutputError as error:
    print(error.code, error.values["written"], error.values["free"])
    sys.exit(error.exit_code)
"""


@pytest.mark.skipif(os.name == "nt", reason="no file size limit here")
@pytest.mark.parametrize("how", ["python", "csv", "parquet"])
def test_a_full_disk_is_said_with_bytes_and_leaves_nothing(tmp_path, how):
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(tmp_path / "run"), how], capture_output=True, text=True, check=False
    )
    assert done.returncode == 4, done.stderr
    code, *sizes = done.stdout.split()
    assert code == "output.unwritten"
    assert all(size.isdigit() for size in sizes)
    assert list(tmp_path.iterdir()) == []


def test_an_input_error_inside_the_work_is_not_taken_for_a_write_error(tmp_path):
    with pytest.raises(FileNotFoundError), RunFolder(tmp_path / "run", force=False):
        (tmp_path / "missing.csv").read_text()


def test_a_target_that_appears_meanwhile_is_kept(tmp_path):
    with RunFolder(tmp_path / "run", force=False) as folder:
        (tmp_path / "run").mkdir()
        (tmp_path / "run" / "theirs.txt").write_text("x")
        with refused(OutputError, "output.folder_exists"):
            folder.commit(FACTS)
    assert (tmp_path / "run" / "theirs.txt").exists()
    assert leftovers(tmp_path) == []


@pytest.mark.parametrize("damage", ["change", "remove", "add", "facts", "nothing"])
def test_verification_finds_every_kind_of_damage(tmp_path, damage):
    target = make(tmp_path / "run")
    if damage == "change":
        (target / "solution.csv").write_text("2\n")
    elif damage == "remove":
        (target / "solution.csv").unlink()
    elif damage == "add":
        (target / "more.csv").write_text("")
    elif damage == "facts":
        (target / "run.json").write_text('{"files": ')
    else:
        verify_folder(target)
        return
    with refused(InputError, "output.damaged_json") if damage == "facts" else pytest.raises(AssertionError):
        verify_folder(target)


def test_facts_with_nan_are_a_defect_and_never_written(tmp_path):
    with pytest.raises(ValueError), RunFolder(tmp_path / "run", force=False) as folder:
        folder.commit({"x": float("nan")})
    assert list(tmp_path.iterdir()) == []
