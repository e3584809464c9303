"""What a run folder holds: its facts, and the digest of every file in it."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from insnav.exceptions import InputError, reason_of

FACTS_FILE = "run.json"


def read_facts(folder: Path) -> dict[str, Any]:
    """Read the ``run.json`` of a run folder.

    Raises: InputError: not a run folder, or ``run.json`` is damaged.
    """
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


def verify_folder(folder: Path) -> dict[str, Any]:
    """Check that a run folder holds exactly the files it was written with; its ``run.json``.

    Raises: InputError: not a run folder, or a file is missing, changed or added.
    """
    facts = read_facts(folder)
    missing, changed = damage(folder)
    added = tuple(name for name in files_in(folder) if name not in facts["files"])
    if missing or changed or added:
        raise InputError("output.changed_folder", where=str(folder), missing=missing, changed=changed, added=added)
    return facts


def damage(folder: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Name the missing and the changed ones of the files that a run folder was written with.

    Raises: InputError: not a run folder.
    """
    listed, found = read_facts(folder)["files"], files_in(folder)
    changed = (
        name
        for name, entry in listed.items()
        if name in found and (not isinstance(entry, dict) or file_sha256(found[name]) != entry.get("sha256"))
    )
    return tuple(name for name in listed if name not in found), tuple(changed)


def file_sha256(path: Path) -> str:
    """Return the SHA-256 digest of a file as hexadecimal digits."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def files_in(folder: Path) -> dict[str, Path]:
    """Every file below a folder but ``run.json``, by its name with forward slashes, sorted."""
    paths = sorted(p for p in folder.rglob("*") if p.is_symlink() or not p.is_dir())
    names = {p.relative_to(folder).as_posix(): p for p in paths}
    return {name: path for name, path in names.items() if name != FACTS_FILE}
