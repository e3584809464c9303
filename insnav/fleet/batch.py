"""Navigation of many drives, each in its own run folder, independent of the others, and resumable."""

from __future__ import annotations

import hashlib
import json
import os
import re
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from insnav.engine import Workers, attempt, each
from insnav.exceptions import ConfigError, InputError, InsnavError, OutputError, writing
from insnav.findings import Code, Finding
from insnav.output.folder import FACTS_FILE, damage, file_sha256, files_in, foreign_files, read_facts, write_text
from insnav.version import __version__

DRIVES = "drives"  # folder of the run folders in the fleet folder
FILES = ("found.npz", "report.html", "fleet.csv", FACTS_FILE)  # further files of a fleet folder
_OWN = {DRIVES, *FILES}
_UNSAFE = re.compile(r"[^\w.+-]+")
_ASIDE = ".aside-"  # in the new name of a folder at the place of a result
_LONGEST = 100  # bytes of a name


def name_of(text: str) -> str:
    """Convert a text to a run folder name valid in every file system; notes next to the folders end in ``.json``."""
    return _UNSAFE.sub("_", text).encode()[:_LONGEST].decode(errors="ignore").removesuffix(".json").strip("._")


@dataclass(frozen=True, slots=True)
class Drive:
    """Drive of a fleet."""

    name: str  # of its run folder
    vehicle: str
    arguments: tuple[str, ...]  # of ``insnav run``, paths absolute, without --out
    unclear: str = ""  # files whose assignment to the drive is ambiguous

    def files(self) -> tuple[Path, Path | None]:
        """Return IMU and GPS file; None if one file has both. Raises InputError: the assignment is ambiguous."""
        if self.unclear:
            raise InputError("batch.unclear_files", where=self.arguments[0], files=self.unclear)
        before = self.arguments.index("--gps") if "--gps" in self.arguments else None
        return Path(self.arguments[0]), None if before is None else Path(self.arguments[before + 1])


@dataclass(frozen=True, slots=True)
class Navigated:
    """Outcome of one drive."""

    name: str
    vehicle: str
    digest: str  # of its files, its options and this version
    failed: InsnavError | None = None
    facts: Mapping[str, Any] | None = None  # ``run.json`` of its folder, if present
    kept: bool = False  # finished earlier
    file: str = ""  # its samples


def batch(
    run: Callable[[Sequence[str]], None],
    drives: Sequence[Drive],
    folder: Path,
    *,
    again: bool = False,
    workers: Workers = "processes",
    progress: Callable[[int], None] | None = None,
) -> list[Navigated]:
    """Navigate drives into run folders below `folder`, except finished drives.

    `run`: navigates with arguments of ``insnav run``; importable by workers. `again`: include drives with unchanged
    files, options and version. `progress`: called with the number of drives done.
    Raises: ConfigError: two drives of one name. OutputError: `folder` has other content, or cannot be written.
    """
    several = [name for name, count in Counter(each.name.lower() for each in drives).items() if count > 1]
    if several:
        files = ", ".join(each.arguments[0] for each in drives if each.name.lower() == several[0])
        raise ConfigError("batch.same_name", where=files, name=several[0])
    check_folder(folder)
    place, found = folder / DRIVES, []
    with _alone(folder):
        keys = [_digest(drive) for drive in drives]
        finished = [None if again else _finished(place, drive, key) for drive, key in zip(drives, keys, strict=True)]
        jobs = [(drive, key) for drive, key, kept in zip(drives, keys, finished, strict=True) if kept is None]
        navigated = each(_navigated, jobs, workers, (run, place))
        for number, (drive, kept) in enumerate(zip(drives, finished, strict=True), start=1):
            outcome = next(navigated) if kept is None else kept
            if isinstance(outcome, InsnavError):  # its process died
                outcome = Navigated(drive.name, drive.vehicle, "", outcome, file=drive.arguments[0])
            found.append(_with_facts(outcome, place))
            if progress is not None:
                progress(number)
    return found


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Lock the folder of a fleet, created if necessary, until the process ends.

    Raises: OutputError: another batch uses it, or it cannot be written.
    """
    with writing("batch.unwritable", folder):
        (folder / DRIVES).mkdir(parents=True, exist_ok=True)
        lock = folder / DRIVES / ".lock"
        held = lock.open("w")
    with held:
        try:
            if sys.platform == "win32":
                import msvcrt

                msvcrt.locking(held.fileno(), msvcrt.LK_NBLCK, 1)
            else:
                import fcntl

                fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except (BlockingIOError, PermissionError):
            raise OutputError("batch.busy", where=str(folder)) from None
        except OSError:  # a file system without locks
            pass
        try:
            yield
        finally:
            with suppress(OSError):
                lock.unlink()


def check_folder(folder: Path) -> None:
    """Refuse a folder with other content than a fleet.

    Raises: OutputError.
    """
    held = {each.name for each in folder.iterdir() if not each.name.startswith(".")} if folder.is_dir() else set()
    facts = attempt(read_facts, folder)
    if DRIVES in held and not isinstance(facts, InsnavError) and facts.get("kind") == "fleet":
        return  # other content is never removed
    if held - _OWN or (held and DRIVES not in held):
        raise OutputError("batch.other_folder", where=str(folder), files=tuple(sorted(held - _OWN)[:3]), needed=DRIVES)


def moved_aside(folder: Path) -> list[Finding]:
    """Report content moved aside from the place of run folders, as foreign or damaged."""
    places = sorted((folder / DRIVES).glob(f"*{_ASIDE}*"))
    return [Finding.of(Code.BATCH_MOVED_ASIDE, subject=str(each)) for each in places]


def _finished(place: Path, drive: Drive, key: str) -> Navigated | None:
    """Return the outcome of a finished drive, else None. `place`: of the run folders."""
    finished = _read_note(place / f"{drive.name}.json", key)
    if finished is not None and (  # a write failure or a defect may succeed now
        attempt(damage, place / drive.name) == ((), ()) if finished.failed is None else finished.failed.exit_code < 4
    ):
        return replace(finished, kept=True)
    return None


def _navigated(run: Callable[[Sequence[str]], None], place: Path, job: tuple[Drive, str]) -> Navigated:
    """Navigate a drive with this digest, and store its outcome."""
    (drive, key), begin = job, time.monotonic()
    outcome = attempt(_run, run, place / drive.name, drive)
    failed = outcome if isinstance(outcome, InsnavError) else None
    found = Navigated(drive.name, drive.vehicle, key, failed, file=drive.arguments[0])
    # results exclude the duration, which depends on the machine
    note = {**asdict(found), "seconds": round(time.monotonic() - begin, 3)}
    write_text(place / f"{drive.name}.json", json.dumps(note, indent=1, default=InsnavError.as_dict))
    return found


def _run(run: Callable[[Sequence[str]], None], place: Path, drive: Drive) -> None:
    drive.files()
    if place.is_dir() and foreign_files(place):  # or a damaged result: kept in any case
        place.rename(place.with_name(f"{place.name}{_ASIDE}{time.time_ns()}"))
    run([*drive.arguments, "--out", str(place), "--force"])


def _digest(drive: Drive) -> str:
    """Compute a key of everything that determines the run folder of a drive."""
    digest = hashlib.sha256(json.dumps([__version__, asdict(drive)]).encode())
    for argument in drive.arguments:
        path = Path(argument)
        try:
            if path.is_absolute() and path.exists():
                files = files_in(path) if path.is_dir() else {"": path}
                digest.update(os.fsencode("".join(f"{name} {file_sha256(file)}" for name, file in files.items())))
        except OSError as error:
            digest.update(str(error).encode())
    return digest.hexdigest()


def _read_note(note: Path, key: str) -> Navigated | None:
    try:
        known = json.loads(note.read_text(encoding="utf-8"))
        known["failed"] = known["failed"] and InsnavError.from_dict(known["failed"])
        del known["seconds"]
        found = Navigated(**known)
    except (OSError, ValueError, TypeError, KeyError):
        return None
    return found if found.digest == key else None


def _with_facts(found: Navigated, place: Path) -> Navigated:
    if found.failed is not None and found.failed.exit_code != 1:  # no solution; an old one may exist
        return found
    facts = attempt(read_facts, place / found.name)
    return replace(found, failed=facts) if isinstance(facts, InsnavError) else replace(found, facts=facts)
