"""Recordings below a folder: identification of IMU data, fixes and references, and their grouping."""

from __future__ import annotations

import errno
import os
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from insnav.engine import Workers, attempt, each
from insnav.exceptions import InputError, InsnavError
from insnav.findings import Code, Finding
from insnav.fleet.batch import Drive, name_of
from insnav.input.formats.recording_folder import NO_DATA, ROLE, unused
from insnav.input.formats.registry import open_tables, suffixes
from insnav.input.readers.kinds import kinds_of
from insnav.output.folder import FACTS_FILE, read_facts

_PARTS = ("imu", "gps", "ref")
_NAMED = {"samples": "imu", "gnss": "gps", "gnns": "gps", "fixes": "gps", "reference": "ref", "truth": "ref"}
_SPARE = {"imu": Code.BATCH_SPARE_SAMPLES, "gps": Code.BATCH_SPARE_FIXES, "ref": Code.BATCH_SPARE_REFERENCE}
_MANY = 200  # number of files from which several processes examine them

_Parts = dict[str, Path]  # file of each part
_Roles = Mapping[Path, str | Finding]  # role of each file: ``imu``, ``gps``, ``ref``, ``both``; else why none


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
    left: list[Finding] = []
    places = list(_places(folder.resolve(), without and without.resolve(), left))
    names: Counter[str] = Counter()
    engine = workers if sum(map(len, places)) > _MANY else 1  # processes take seconds to start
    for place, roles in zip(places, each(_roles, places, engine), strict=True):
        if isinstance(roles, InsnavError):
            left += [Finding.of(Code.BATCH_NO_RECORDING, subject=str(path), cause=roles.facts) for path in place]
            continue
        found = list(_paired(place, _with_broken(roles)))
        used = {path for _, parts, _ in found for path in parts.values()}
        spare = {path: role for path, role in roles.items() if path not in used}
        left += [Finding.of(_SPARE[r], subject=str(path)) if isinstance(r, str) else r for path, r in spare.items()]
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
            "batch.no_drives", where=str(folder), count=sum(map(len, places)), cause=left[0] if left else None
        )
    return drives, left


def _places(folder: Path, without: Path | None, left: list[Finding]) -> Iterator[list[Path]]:
    """Yield the files of every folder, or the folder if it is one recording; `left` gets unreadable ones."""
    seen: set[Path] = set()  # links may form circles

    def unreadable(error: OSError) -> None:
        left.append(Finding.of(Code.BATCH_UNREADABLE, subject=str(error.filename), reason=str(error.strerror)))

    for name, folders, files in os.walk(folder, onerror=unreadable, followlinks=True):
        here, real = Path(name), Path(name).resolve()
        if real == without or real in seen or _result(here):
            folders.clear()
            continue
        seen.add(real)
        names = sorted(each for each in files if not each.startswith(".") and Path(each).suffix.lower() not in NO_DATA)
        data = [here / each for each in names]
        inner = any(_whole(here / each) for each in folders)  # formats examine subfolders of a folder
        others = [here / each for each in unused(names)]
        parts = [(_named(each), _key(each)) for each in others]
        pair = any(("gps", key) in parts for part, key in parts if part == "imu")
        one = not inner and not pair and here != folder and _whole(here, len(data))
        if one and Counter(map(_role, data[:4])) != Counter(_PARTS):
            folders.clear()
            data = [here]
            left.extend(Finding.of(Code.BATCH_OTHER_NAMES, subject=str(each)) for each in others)
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
    """Return whether a folder with so many files is one recording, with fixes if these may be in another file."""
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
    """Add roles of unreadable samples and fixes, by name, or as the only file with fixes: these drives fail.

    A file gets the part that its drive, or the whole folder, lacks.
    """
    unread = [path for path, role in roles.items() if role not in _PARTS and set(path.suffixes) & set(suffixes())]
    parts = {path: _named(path) or "imu" * (len(unread) == 1) for path in unread}
    content = {**roles, **parts}
    found = dict(roles)
    for path in unread if "both" not in roles.values() else ():
        other = {"imu": "gps", "gps": "imu"}.get(parts[path], "none")
        own = [each for each in roles if _key(each) == _key(path)]
        lacking = other in content.values() and parts[path] not in roles.values()
        if parts[path] not in map(roles.get, own) and (lacking or other in map(content.get, own)):
            found[path] = parts[path]
    return found


def _named(path: Path) -> str:
    """Return the part in a file name; empty for none."""
    word = ROLE.search(_stem(path))
    return _NAMED.get(word[2].lower(), word[2].lower()) if word else ""


def _key(path: Path) -> str:
    """Return the drive's name: a file name without its part."""
    return ROLE.sub("", _stem(path)).strip("-_. ").lower()


def _paired(files: Sequence[Path], roles: _Roles) -> Iterator[tuple[Path, _Parts, str]]:
    """Yield location, files, and ambiguities of the drives in a folder: separate logs, and matching files."""
    for path in files:
        if roles[path] == "both":
            yield path if path.is_dir() else path.with_name(_stem(path)), {"imu": path}, ""
    parts = {part: [path for path in files if roles[path] == part] for part in _PARTS}
    if len(parts["imu"]) == len(parts["gps"]) == 1 < len(parts["ref"]):  # the reference named like one of the two
        keys = {_key(parts["imu"][0]), _key(parts["gps"][0])}
        parts["ref"] = [path for path in parts["ref"] if _key(path) in keys]
    if max(map(len, parts.values())) == 1 and parts["imu"]:
        path = parts["imu"][0]
        yield path if path.is_dir() else path.parent, {part: own[0] for part, own in parts.items() if own}, ""
        return
    named: dict[str, dict[str, list[Path]]] = defaultdict(lambda: {part: [] for part in _PARTS})
    for part, own in parts.items():
        for path in own:
            named[_key(path)][part].append(path)
    spare = [path for group in named.values() if not group["imu"] for path in group["gps"]]
    for stem, group in named.items():
        if not group["imu"]:
            continue
        where = group["imu"][0].with_name(stem or _stem(group["imu"][0]))
        several = [path.name for paths in group.values() if len(paths) > 1 for path in paths]
        if not group["gps"] and not group["ref"]:
            several += [path.name for path in spare]
        yield where, {part: paths[0] for part, paths in group.items() if paths}, ", ".join(several)


def _stem(path: Path) -> str:
    return path.name.split(".")[0] or path.name
