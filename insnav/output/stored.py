"""Result as one file: package dataclasses by field, arrays unchanged, no executable content."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum, EnumType
from importlib import import_module
from pathlib import Path
from typing import Any, cast
from zipfile import BadZipFile

import numpy as np

from insnav.exceptions import InputError, InsnavError

FILE = "found.npz"
_STRUCTURE = "structure"


def store(result: object, file: Path) -> None:
    """Write a result; an array referenced several times is written once."""
    arrays: dict[int, np.ndarray] = {}

    def plain(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            arrays.setdefault(id(value), value)
            return {"array": list(arrays).index(id(value))}
        if isinstance(value, Enum):
            return {"member": f"{type(value).__module__}:{type(value).__qualname__}", "value": value.value}
        if is_dataclass(value):
            kind = type(value)
            own = {each.name: plain(getattr(value, each.name)) for each in fields(value) if each.init}
            return {"class": f"{kind.__module__}:{kind.__qualname__}", "fields": own}
        if isinstance(value, Mapping):
            return {"mapping": [[plain(key), plain(each)] for key, each in value.items()]}
        if isinstance(value, slice):
            return {"slice": [plain(each) for each in (value.start, value.stop, value.step)]}
        if isinstance(value, tuple | list):
            return {type(value).__name__: [plain(each) for each in value]}
        if isinstance(value, Path):
            return value.as_posix()
        if isinstance(value, InsnavError):
            return {"error": value.as_dict()}
        return value.item() if isinstance(value, np.generic) else value

    structure = json.dumps(plain(result)).encode()
    content = {f"array_{i}": array for i, array in enumerate(arrays.values())}
    np.savez_compressed(file, **{_STRUCTURE: np.frombuffer(structure, np.uint8)}, **content)  # type: ignore[arg-type]


def read_stored(folder: Path, name: str = FILE) -> Any:
    """Read a result from its folder.

    Raises: InputError: the file is missing, damaged, or of another version.
    """
    file = folder / name
    try:
        with file.open("rb") as stream, np.load(stream, allow_pickle=False) as content:
            return _restored(json.loads(content[_STRUCTURE].tobytes()), content)
    except (OSError, ValueError, LookupError, TypeError, AttributeError, ImportError, EOFError, BadZipFile) as error:
        raise InputError("output.unreadable_result", where=str(file), reason=str(error)) from error


def _restored(value: Any, content: Mapping[str, np.ndarray]) -> Any:
    if not isinstance(value, dict):
        return value
    if "array" in value:
        return content[f"array_{value['array']}"]
    if "mapping" in value:
        return {_restored(key, content): _restored(each, content) for key, each in value["mapping"]}
    if "error" in value:
        return InsnavError.from_dict(value["error"])
    if "slice" in value:
        return slice(*value["slice"])
    for sequence in (tuple, list):
        if sequence.__name__ in value:
            return sequence(_restored(each, content) for each in value[sequence.__name__])
    module, name = value["class" if "class" in value else "member"].split(":")
    kind: Any = getattr(import_module(module), name) if module.startswith("insnav.") else None
    if "member" in value and isinstance(kind, EnumType):
        return kind(value["value"])
    if "class" not in value or not is_dataclass(kind):
        raise ValueError(f"{module}:{name} is no result of insnav")
    make = cast(Callable[..., Any], kind)
    return make(**{key: _restored(each, content) for key, each in value["fields"].items()})
