"""Run folder: built separately, complete or absent, with its facts and a digest of every file.

The folder is built as ``.NAME.tmp-PID`` next to its target and renamed when everything is on disk. After any
interruption, the target is either unchanged or complete.
"""

from __future__ import annotations

import contextlib
import errno
import glob
import hashlib
import itertools
import json
import os
import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

from insnav.exceptions import NO_ROOM, InputError, OutputError, reason_of, writing
from insnav.plain_text import NOT_UTF8, plain_text

FACTS_FILE = "run.json"


def read_facts(folder: Path) -> dict[str, Any]:
    """Read the ``run.json`` of a run folder. Raises: InputError: not a run folder, or ``run.json`` is damaged."""
    path = folder / FACTS_FILE
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError("output.no_run_folder", where=str(path), reason=reason_of(error)) from error
    except (ValueError, RecursionError) as error:
        raise InputError("output.damaged_json", where=str(path), reason=str(error)) from error
    if not isinstance(facts, dict) or not isinstance(facts.get("files"), dict):
        raise InputError("output.json_without_files", where=str(path))
    return facts


def damage(folder: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """List the missing and the changed files of a run folder. Raises: InputError: not a run folder."""
    listed, present = read_facts(folder)["files"], files_in(folder)
    changed = (
        name
        for name, entry in listed.items()
        if name in present and (not isinstance(entry, dict) or file_sha256(present[name]) != entry.get("sha256"))
    )
    return tuple(name for name in listed if name not in present), tuple(changed)


def file_sha256(path: Path) -> str:
    """Return the SHA-256 digest of a file as hexadecimal digits."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def files_in(folder: Path) -> dict[str, Path]:
    """Return every file below a folder except ``run.json``, by its name with forward slashes, sorted."""
    paths = sorted(p for p in folder.rglob("*") if p.is_symlink() or not p.is_dir())
    names = {p.relative_to(folder).as_posix(): p for p in paths}
    return {name: path for name, path in names.items() if name != FACTS_FILE}


_DROPPINGS = {".DS_Store", "Thumbs.db", "desktop.ini"}  # files that file managers write
_LONGEST_NAME = 230  # file systems allow 255 bytes, including the suffix during construction
_MARK = re.compile(r"\.(tmp|old)-(\d+)$")  # suffix of a temporary folder: kind, process number


class RunFolder:
    """Result folder that appears at its target only when `commit` has succeeded.

    Use it as a context manager around the whole work. On entry it checks everything that could prevent writing. Leaving
    without `commit`, for any reason, keeps the target unchanged.

    Parent folders are created. `force`: replace an existing run at the target. ``keep``: rename the existing run to the
    first free name of ``run~1``, ``run~2``, …, stored as `kept`.

    Raises: OutputError: on entry: no permission, a file at the target, an existing folder without `force`, or with
    `force` a folder with other files. Later: disk full, or the target was created meanwhile.
    """

    def __init__(self, target: Path, *, force: bool | Literal["keep"]) -> None:
        self.target = target
        self.force = force
        self.kept: Path | None = None
        self._place = target
        self._aside = target
        self._made: list[Path] = []  # created parent folders of the target
        self._committing = self._committed = False

    def __enter__(self) -> Self:
        for name in self.target.parts:
            if (size := len(os.fsencode(name))) > _LONGEST_NAME:
                raise OutputError("output.long_name", where=plain_text(name)[:60] + "…", size=size, limit=_LONGEST_NAME)
        self._place = resolved(self.target)
        with contextlib.suppress(OSError):
            _clean_stale(self._place)
        _check_target(self._place, force=self.force)
        self._aside = _beside(self._place, "tmp")
        with writing("output.folder_unwritable", self._place.parent):
            self._made = [parent for parent in self._place.parents if not parent.exists()]
            self._place.parent.mkdir(parents=True, exist_ok=True)
            if self._aside.exists():  # remains of a dead process with the same PID
                shutil.rmtree(self._aside)
            self._aside.mkdir()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._committed:
            return
        written = free = 0
        with contextlib.suppress(OSError):
            written = sum(p.stat().st_size for p in self._aside.rglob("*") if p.is_file())
        with contextlib.suppress(OSError):
            free = shutil.disk_usage(self._place.parent).free
        shutil.rmtree(self._aside, ignore_errors=True)
        with contextlib.suppress(OSError):  # fails if another process uses a created parent folder
            for parent in self._made:
                parent.rmdir()
        if isinstance(error, OSError):
            failure = self._explained(error, written, free)
            if failure is not None:
                raise failure from error

    @property
    def directory(self) -> Path:
        """Temporary directory for the files, until `commit` moves it."""
        return self._aside

    def path(self, name: str) -> Path:
        """Return the path of a result file, such as ``figures/track.png``; create its parent folders.

        Raises: OutputError: the name is outside the folder, or is ``run.json``, which `commit` writes.
        """
        path = Path(os.path.normpath(self._aside / name))
        if path == self._aside or not path.is_relative_to(self._aside) or name == FACTS_FILE:
            raise OutputError("output.no_file_name", where=str(self._place), name=name)
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def commit(self, facts: Mapping[str, Any]) -> Path:
        """Write ``run.json`` last, flush everything to disk and move the folder to its target, which is returned.

        `facts`: ready for JSON; ``files`` (size and SHA-256 digest of every other file) is added.
        Raises: OutputError: the folder cannot be moved, as the target was created meanwhile.
        """
        self._committing = True
        files = {
            name: {"bytes": path.stat().st_size, "sha256": file_sha256(path)}
            for name, path in files_in(self._aside).items()
        }
        text = json.dumps({**facts, "files": files}, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        (self._aside / FACTS_FILE).write_text(text, encoding="utf-8", newline="\n", errors=NOT_UTF8)
        for path in (*self._aside.rglob("*"), self._aside):
            _sync(path)
        self._move_into_place()
        self._committed = True
        return self._place

    def _move_into_place(self) -> None:
        free_names = (self._place.with_name(f"{self._place.name}~{number}") for number in itertools.count(1))
        keep = self.force == "keep"
        old = next(free for free in free_names if not free.exists()) if keep else _beside(self._place, "old")
        replacing = self._place.exists()  # move the old result away, and back if the new one cannot be moved
        if replacing:
            _check_target(self._place, force=self.force)
            self._place.rename(old)
        try:
            self._aside.rename(self._place)
        except OSError as error:
            if replacing:
                old.rename(self._place)
            raise OutputError("output.folder_unmovable", where=str(self._place), reason=reason_of(error)) from error
        _sync(self._place.parent)
        if replacing and keep:
            self.kept = old
        elif replacing:
            shutil.rmtree(old, ignore_errors=True)

    def _explained(self, error: OSError, written: int, free: int) -> OutputError | None:
        """Convert a write failure to an `OutputError`; None if the `OSError` has another cause."""
        in_folder = error.filename is not None and str(error.filename).startswith(str(self._aside))
        if error.errno not in NO_ROOM and not in_folder and not self._committing:
            return None
        return OutputError(
            "output.unwritten", where=str(self._place), reason=reason_of(error), written=written, free=free
        )


def write_text(path: Path, text: str) -> None:
    """Write a text file: write a temporary file, then move it to its path.

    `path`: its folder is created if necessary.
    Raises: OutputError: the file cannot be written.
    """
    aside = _beside(path, "tmp")
    with writing("output.file_unwritable", path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            aside.write_text(text, encoding="utf-8", newline="\n", errors=NOT_UTF8)
            aside.replace(path)
        except OSError:
            aside.unlink(missing_ok=True)
            raise


def resolved(target: Path) -> Path:
    """Resolve the path of an output folder.

    Raises: OutputError: an impossible path, or a dangling link, which would create a folder elsewhere.
    """
    if target.is_symlink() and not target.exists():
        raise OutputError("output.dangling_link", where=str(target), target=plain_text(target.readlink()))
    try:
        return target.resolve()
    except (OSError, RuntimeError) as error:
        raise OutputError("output.no_place", where=str(target), reason=reason_of(error)) from error


def _check_target(place: Path, *, force: bool | Literal["keep"]) -> None:
    where = str(place)
    if not place.name or Path.cwd().is_relative_to(place):
        raise OutputError("output.current_folder", where=where)
    existing_parent = next(parent for parent in place.parents if parent.exists())
    if not existing_parent.is_dir() or not os.access(existing_parent, os.W_OK | os.X_OK):
        reason = os.strerror(errno.EACCES if existing_parent.is_dir() else errno.ENOTDIR)
        raise OutputError("output.folder_unwritable", where=str(existing_parent), reason=reason)
    if not place.exists():
        return
    if not place.is_dir():
        raise OutputError("output.folder_is_file", where=where)
    foreign = foreign_files(place) if force else []
    if foreign:
        raise OutputError("output.foreign_files", where=where, count=len(foreign), files=tuple(foreign[:3]))
    if not force or (force == "keep" and not (place / FACTS_FILE).exists()):
        raise OutputError("output.folder_exists", where=where)


def foreign_files(place: Path) -> list[str]:
    """List the files in a folder that do not belong to a run."""
    present = [name for name in files_in(place) if Path(name).name not in _DROPPINGS]
    try:
        listed = read_facts(place)["files"]
    except InputError:
        return present + ([FACTS_FILE] if (place / FACTS_FILE).exists() else [])
    return [name for name in present if name not in listed]


def _beside(place: Path, kind: str) -> Path:  # temporary name next to a path, with the process number
    return place.with_name(f".{place.name}.{kind}-{os.getpid()}")


def _clean_stale(place: Path) -> None:
    """Remove remains of dead processes next to a target; restore a result interrupted between two renames."""
    for path in place.parent.glob(f".{glob.escape(place.name)}.*-*"):
        mark = _MARK.search(path.name)
        if mark is None or path.name[1 : mark.start()] != place.name or _alive(int(mark[2])):
            continue
        if mark[1] == "old" and not place.exists():
            path.rename(place)
        else:
            shutil.rmtree(path, ignore_errors=True)


def _alive(pid: int) -> bool:
    if os.name == "nt":  # signal 0 is Ctrl-C on Windows
        return True
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True


def _sync(path: Path) -> None:
    if path.is_dir() and os.name == "nt":  # Windows cannot open a folder
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
