"""Navigation of many drives, each in its own run folder, independent of the others, and resumable.

The recordings below a folder are identified as IMU data, fixes and references, and grouped.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from insnav.engine import Workers, attempt, each
from insnav.exceptions import ConfigError, InputError, InsnavError, OutputError, writing
from insnav.findings import Code, Finding
from insnav.input.formats.recording_folder import NO_DATA, ROLE, unused
from insnav.input.formats.registry import open_tables, suffixes
from insnav.input.readers.kinds import kinds_of
from insnav.output.folder import FACTS_FILE, damage, file_sha256, files_in, foreign_files, read_facts, write_text
from insnav.version import __version__

DRIVES = "drives"  # folder of the run folders in the fleet folder
FILES = ("found.npz", "report.html", "fleet.csv", FACTS_FILE)  # further files of a fleet folder
_OWN = {DRIVES, *FILES}
_UNSAFE = re.compile(r"[^\w.+-]+")
_ASIDE = ".aside-"  # part of the new name of a folder that occupied the place of a result
_LONGEST = 100  # largest length of a name [bytes]
_PARTS = ("imu", "gps", "ref")
_NAMED = {"samples": "imu", "gnss": "gps", "gnns": "gps", "fixes": "gps", "reference": "ref", "truth": "ref"}
_SPARE = {"imu": Code.BATCH_SPARE_SAMPLES, "gps": Code.BATCH_SPARE_FIXES, "ref": Code.BATCH_SPARE_REFERENCE}
_MANY = 200  # number of files from which several processes examine them

_Parts = dict[str, Path]  # file of each part
_Roles = Mapping[Path, str | Finding]  # role of each file: ``imu``, ``gps``, ``ref``, ``both``; else why none


def name_of(text: str) -> str:
    """Convert a text to a run folder name valid in every file system, without the suffix ``.json`` of its note."""
    return _UNSAFE.sub("_", text).encode()[:_LONGEST].decode(errors="ignore").removesuffix(".json").strip("._")


@dataclass(frozen=True, slots=True)
class Drive:
    """Drive of a fleet."""

    name: str  # name of its run folder
    vehicle: str
    arguments: tuple[str, ...]  # arguments of ``insnav run``, with absolute paths, without --out
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
    digest: str  # digest of its files, its options and this version
    failed: InsnavError | None = None
    facts: Mapping[str, Any] | None = None  # ``run.json`` of its folder, if present
    kept: bool = False  # True if an earlier batch finished it
    file: str = ""  # file of the IMU samples


def batch(
    run: Callable[[Sequence[str]], None],
    drives: Sequence[Drive],
    folder: Path,
    *,
    again: bool = False,
    workers: Workers = "processes",
    progress: Callable[[int], None] | None = None,
) -> list[Navigated]:
    """Navigate drives and write their run folders below `folder`; skip finished drives.

    `run`: navigates with arguments of ``insnav run``; importable by workers. `again`: include drives with unchanged
    files, options and version. `progress`: called with the number of drives done.
    Raises: ConfigError: two drives of one name. OutputError: `folder` has other content, or cannot be written.
    """
    repeated = [name for name, count in Counter(each.name.lower() for each in drives).items() if count > 1]
    if repeated:
        files = ", ".join(each.arguments[0] for each in drives if each.name.lower() == repeated[0])
        raise ConfigError("batch.same_name", where=files, name=repeated[0])
    check_folder(folder)
    place, outcomes = folder / DRIVES, []
    with _alone(folder):
        keys = [_digest(drive) for drive in drives]
        finished = [None if again else _finished(place, drive, key) for drive, key in zip(drives, keys, strict=True)]
        jobs = [(drive, key) for drive, key, kept in zip(drives, keys, finished, strict=True) if kept is None]
        navigated = each(_navigated, jobs, workers, (run, place))
        for number, (drive, kept) in enumerate(zip(drives, finished, strict=True), start=1):
            outcome = next(navigated) if kept is None else kept
            if isinstance(outcome, InsnavError):  # the worker process died
                outcome = Navigated(drive.name, drive.vehicle, "", outcome, file=drive.arguments[0])
            outcomes.append(_with_facts(outcome, place))
            if progress is not None:
                progress(number)
    return outcomes


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Create the folder of a fleet if necessary, and lock it while the context is active.

    Raises: OutputError: another batch uses it, or it cannot be written.
    """
    with writing("batch.unwritable", folder):
        (folder / DRIVES).mkdir(parents=True, exist_ok=True)
        lock = folder / DRIVES / ".lock"
        handle = lock.open("w")
    with handle:
        try:
            if sys.platform == "win32":
                import msvcrt

                msvcrt.locking(handle.fileno(), msvcrt.LK_NBLCK, 1)
            else:
                import fcntl

                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
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
    """Check that a folder is empty or contains a fleet.

    Raises: OutputError.
    """
    names = {each.name for each in folder.iterdir() if not each.name.startswith(".")} if folder.is_dir() else set()
    facts = attempt(read_facts, folder)
    if DRIVES in names and not isinstance(facts, InsnavError) and facts.get("kind") == "fleet":
        return  # other content is never removed
    if names - _OWN or (names and DRIVES not in names):
        raise OutputError("batch.other_folder", where=str(folder), files=tuple(sorted(names - _OWN)[:3]), needed=DRIVES)


def moved_aside(folder: Path) -> list[Finding]:
    """Report foreign or damaged folders that were renamed, as they occupied the place of a run folder."""
    places = sorted((folder / DRIVES).glob(f"*{_ASIDE}*"))
    return [Finding.of(Code.BATCH_MOVED_ASIDE, subject=str(each)) for each in places]


def _finished(place: Path, drive: Drive, key: str) -> Navigated | None:
    """Return the outcome of a finished drive, else None. `place`: folder of the run folders."""
    finished = _read_note(place / f"{drive.name}.json", key)
    if finished is not None and (  # after a write error or a defect, a drive is repeated
        attempt(damage, place / drive.name) == ((), ()) if finished.failed is None else finished.failed.exit_code < 4
    ):
        return replace(finished, kept=True)
    return None


def _navigated(run: Callable[[Sequence[str]], None], place: Path, job: tuple[Drive, str]) -> Navigated:
    """Navigate a drive, and store its outcome with the digest. `place`: folder of the run folders."""
    (drive, key), begin = job, time.monotonic()
    outcome = attempt(_run, run, place / drive.name, drive)
    failed = outcome if isinstance(outcome, InsnavError) else None
    navigated = Navigated(drive.name, drive.vehicle, key, failed, file=drive.arguments[0])
    # results exclude the duration, which depends on the machine
    note = {**asdict(navigated), "seconds": round(time.monotonic() - begin, 3)}
    write_text(place / f"{drive.name}.json", json.dumps(note, indent=1, default=InsnavError.as_dict))
    return navigated


def _run(run: Callable[[Sequence[str]], None], place: Path, drive: Drive) -> None:
    drive.files()
    if place.is_dir() and foreign_files(place):  # foreign content and damaged results are kept under another name
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
        content = json.loads(note.read_text(encoding="utf-8"))
        content["failed"] = content["failed"] and InsnavError.from_dict(content["failed"])
        del content["seconds"]
        outcome = Navigated(**content)
    except (OSError, ValueError, TypeError, KeyError):
        return None
    return outcome if outcome.digest == key else None


def _with_facts(found: Navigated, place: Path) -> Navigated:
    if found.failed is not None and found.failed.exit_code != 1:  # no solution; a folder may hold an old one
        return found
    facts = attempt(read_facts, place / found.name)
    return replace(found, failed=facts) if isinstance(facts, InsnavError) else replace(found, facts=facts)


def find_drives(folder: Path, without: Path | None, workers: Workers) -> tuple[list[Drive], list[Finding]]:
    """Find recordings in a folder and its subfolders, except results of insnav.

    `without`: a folder to exclude, if any.
    Returns: the drives, named by their location; and skipped files, each as the subject of a finding.
    Raises: InputError: the folder cannot be read, or contains no recording.
    """
    if not os.access(folder, os.R_OK | os.X_OK) or not folder.is_dir():
        reason = errno.ENOTDIR if folder.is_file() else errno.EACCES if folder.is_dir() else errno.ENOENT
        raise InputError("batch.unreadable_folder", where=str(folder), reason=os.strerror(reason))
    drives: list[Drive] = []
    skipped: list[Finding] = []
    places = list(_places(folder.resolve(), without and without.resolve(), skipped))
    names: Counter[str] = Counter()
    engine = workers if sum(map(len, places)) > _MANY else 1  # processes take seconds to start
    for place, roles in zip(places, each(_roles, places, engine), strict=True):
        if isinstance(roles, InsnavError):
            skipped += [Finding.of(Code.BATCH_NO_RECORDING, subject=str(path), cause=roles.facts) for path in place]
            continue
        found = list(_paired(place, _with_broken(roles)))
        used = {path for _, parts, _ in found for path in parts.values()}
        spare = {path: role for path, role in roles.items() if path not in used}
        skipped += [Finding.of(_SPARE[r], subject=str(path)) if isinstance(r, str) else r for path, r in spare.items()]
        for where, parts, unclear in found:
            inside = where.relative_to(folder.resolve()).parts
            files = [word for part in parts for word in (f"--{part}", str(parts[part])) if part != "imu"]
            name = name_of("-".join(inside)) or "drive"
            names[name.lower()] += 1
            if names[name.lower()] > 1:
                name = f"{name}-{names[name.lower()]}"
            vehicle = inside[0] if len(inside) > 1 else ""
            drives.append(Drive(name, vehicle, (str(parts["imu"]), *files), unclear))
    if not drives:
        raise InputError(
            "batch.no_drives", where=str(folder), count=sum(map(len, places)), cause=skipped[0] if skipped else None
        )
    return drives, skipped


def _places(folder: Path, without: Path | None, left: list[Finding]) -> Iterator[list[Path]]:
    """Yield the files of every folder, or the folder if it is one recording; report skipped paths in `left`."""
    visited: set[Path] = set()  # links may form circles

    def unreadable(error: OSError) -> None:
        left.append(Finding.of(Code.BATCH_UNREADABLE, subject=str(error.filename), reason=str(error.strerror)))

    for name, folders, files in os.walk(folder, onerror=unreadable, followlinks=True):
        here, real = Path(name), Path(name).resolve()
        if real == without or real in visited or _result(here):
            folders.clear()
            continue
        visited.add(real)
        names = sorted(each for each in files if not each.startswith(".") and Path(each).suffix.lower() not in NO_DATA)
        data = [here / each for each in names]
        inner = any(_whole(here / each) for each in folders)  # a folder format also reads subfolders
        unread = [here / each for each in unused(names)]
        parts = [(_named(each), _key(each)) for each in unread]
        pair = any(("gps", key) in parts for part, key in parts if part == "imu")
        complete = not inner and not pair and here != folder and _whole(here, len(data))
        if complete and Counter(map(_role, data[:4])) != Counter(_PARTS):
            folders.clear()
            data = [here]
            left.extend(Finding.of(Code.BATCH_OTHER_NAMES, subject=str(each)) for each in unread)
        folders[:] = sorted(each for each in folders if not each.startswith("."))
        if data:
            yield data


def _result(folder: Path) -> bool:
    """Return whether insnav wrote this folder, except simulated recordings."""
    if not (folder / FACTS_FILE).is_file():
        return False
    try:
        files = read_facts(folder)["files"]
    except InputError:
        return False
    return not any(name.startswith("imu.") and not name.endswith(".toml") for name in files)


def _whole(folder: Path, files: int = 1) -> bool:
    """Return whether a folder is one recording; with several `files`, not if it has only IMU data."""
    try:
        return kinds_of(open_tables(folder)) != {"imu"} or files == 1
    except Exception:  # after any error its files are examined individually
        return False


def _roles(files: Sequence[Path]) -> _Roles:
    return {path: _role(path) for path in files}


def _role(path: Path) -> str | Finding:
    kinds = attempt(lambda: kinds_of(open_tables(path)))
    if isinstance(kinds, InsnavError):  # a file of another kind, or a broken one
        return Finding.of(Code.BATCH_NO_RECORDING, subject=str(path), cause=kinds.facts)
    if not kinds:
        return Finding.of(Code.BATCH_NO_COLUMNS, subject=str(path))
    if {"imu", "gps"} <= kinds:
        return "both"
    return "imu" if "imu" in kinds else "ref" if "reference" in kinds or _named(path) == "ref" else "gps"


def _with_broken(roles: _Roles) -> _Roles:
    """Give unreadable files the role in their names, or ``imu`` to a single one, so that their drives fail visibly.

    A file gets a role only if its drive, or the whole folder, lacks this role.
    """
    unread = [path for path, role in roles.items() if role not in _PARTS and set(path.suffixes) & set(suffixes())]
    parts = {path: _named(path) or "imu" * (len(unread) == 1) for path in unread}
    content = {**roles, **parts}
    extended = dict(roles)
    for path in unread if "both" not in roles.values() else ():
        counterpart = {"imu": "gps", "gps": "imu"}.get(parts[path], "none")
        siblings = [each for each in roles if _key(each) == _key(path)]
        lacking = counterpart in content.values() and parts[path] not in roles.values()
        if parts[path] not in map(roles.get, siblings) and (lacking or counterpart in map(content.get, siblings)):
            extended[path] = parts[path]
    return extended


def _named(path: Path) -> str:
    """Return the part that a file name states, such as ``imu``; empty if none."""
    word = ROLE.search(_stem(path))
    return _NAMED.get(word[2].lower(), word[2].lower()) if word else ""


def _key(path: Path) -> str:
    """Return the drive in a file name: the name without its part."""
    return ROLE.sub("", _stem(path)).strip("-_. ").lower()


def _paired(files: Sequence[Path], roles: _Roles) -> Iterator[tuple[Path, _Parts, str]]:
    """Yield location, files and ambiguous files of each drive in a folder: complete logs, then matching files."""
    for path in files:
        if roles[path] == "both":
            yield path if path.is_dir() else path.with_name(_stem(path)), {"imu": path}, ""
    parts = {part: [path for path in files if roles[path] == part] for part in _PARTS}
    if len(parts["imu"]) == len(parts["gps"]) == 1 < len(parts["ref"]):  # keep references named like IMU or GPS file
        keys = {_key(parts["imu"][0]), _key(parts["gps"][0])}
        parts["ref"] = [path for path in parts["ref"] if _key(path) in keys]
    if max(map(len, parts.values())) == 1 and parts["imu"]:
        path = parts["imu"][0]
        yield path if path.is_dir() else path.parent, {part: own[0] for part, own in parts.items() if own}, ""
        return
    # several drives: files are grouped by their names without the part
    named: dict[str, dict[str, list[Path]]] = defaultdict(lambda: {part: [] for part in _PARTS})
    for part, own in parts.items():
        for path in own:
            named[_key(path)][part].append(path)
    spare = [path for group in named.values() if not group["imu"] for path in group["gps"]]
    for stem, group in named.items():
        if not group["imu"]:
            continue
        where = group["imu"][0].with_name(stem or _stem(group["imu"][0]))
        ambiguous = [path.name for paths in group.values() if len(paths) > 1 for path in paths]
        if not group["gps"] and not group["ref"]:
            ambiguous += [path.name for path in spare]
        yield where, {part: paths[0] for part, paths in group.items() if paths}, ", ".join(ambiguous)


def _stem(path: Path) -> str:
    return path.name.split(".")[0] or path.name
