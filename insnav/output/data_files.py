"""Columns of numbers as text, simulated data as readable files, a result as one file without executable content.

Equal data give equal bytes: numbers are rounded to fixed decimals in the shortest form, and compressed files contain no
time of writing.
"""

from __future__ import annotations

import contextlib
import gzip
import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum, EnumType
from importlib import import_module
from pathlib import Path
from typing import Any, cast
from zipfile import BadZipFile

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray

from insnav import spill
from insnav.exceptions import InputError, InsnavError, writing
from insnav.kernels.output import WIDEST, rows_as_text
from insnav.types import FloatArray, GpsData, ImuData, IntArray, Trajectory

# patterns of column names, and number of decimals of such a column; the first matching pattern counts
Decimals = tuple[tuple[str, int], ...]
TEXT_ROWS = 1 << 13  # rows converted at a time: they fit in the processor's cache


def rounded(name: str, values: NDArray[Any], decimals: Decimals) -> NDArray[Any]:
    """Round a column of non-integers to its decimals; zero loses its sign, and a heading of 360 deg becomes 0."""
    if values.dtype.kind == "i":
        return values
    values = np.round(values, _places(name, decimals)) + 0.0
    return np.where(values == 360.0, 0.0, values) if name == "heading_deg" else values


def _places(name: str, decimals: Decimals) -> int:
    return next(places for pattern, places in decimals if re.search(pattern, name))


def arrow_table(columns: Mapping[str, Any]) -> pa.Table:
    """Build a table of numbers, null where not finite, and of text."""
    return pa.table({name: _arrow_array(values) for name, values in columns.items()})


def _arrow_array(values: Any) -> Any:
    # without pyarrow.array, which imports pandas: that takes longer than writing the file
    if not isinstance(values, np.ndarray):
        texts = pa.lib.StringBuilder()
        texts.append_values(values)
        return texts.finish()
    values = np.ascontiguousarray(values)
    known = np.isfinite(values)
    bitmap = None if known.all() else pa.py_buffer(np.packbits(known, bitorder="little"))
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), [bitmap, pa.py_buffer(values)])


def write_numbers(columns: Mapping[str, NDArray[Any]], decimals: Decimals, stream: Any, *, header: bool) -> None:
    """Write columns of numbers as `rounded` and `write_csv` would, in a third of the time."""
    numbers = np.empty((len(columns), len(next(iter(columns.values())))))
    for row, (name, values) in zip(numbers, columns.items(), strict=True):
        row[:] = rounded(name, values, decimals) if name == "heading_deg" else values
    places = [0 if v.dtype.kind == "i" else _places(name, decimals) for name, v in columns.items()]
    text = np.empty(numbers.size * WIDEST, np.uint8)
    size = rows_as_text(numbers, 10.0 ** np.array(places), np.array(places, np.uint64), text)
    if size < 0:  # a number is too large or too small for the fast writer
        table = arrow_table({name: rounded(name, values, decimals) for name, values in columns.items()})
        write_csv(table, stream, header=header)
        return
    if header:
        stream.write((",".join(columns) + "\n").encode())
    stream.write(text[:size].data)


def write_csv(table: pa.Table, stream: Any, *, header: bool = True) -> None:
    """Write a table as csv, with a header without quotation marks."""
    if header:
        stream.write((",".join(table.column_names) + "\n").encode())
    pa.csv.write_csv(table, stream, pa.csv.WriteOptions(include_header=False, quoting_style="needed"))


# decimals of data files: far finer than any sensor resolution and test tolerance
_DECIMALS: Decimals = (
    ("^dtheta|^dvel", 13),
    ("^lat|^lon", 11),
    ("time|_rad_s|_m_s2", 9),
    ("_deg", 8),
    ("_m", 6),
    ("temperature|dop|satellites", 3),
)


def write_data(path: Path, data: ImuData | GpsData | Trajectory) -> None:
    """Write samples, fixes or a reference as csv, compressed if the name ends in ``.gz``.

    `data`: columns of only NaN are omitted. The file does not contain the sampling and timestamp convention of an IMU:
    the reader must specify them.
    Raises: OutputError: the file cannot be written.
    """
    known = [name for name, values in data.columns().items() if not np.isnan(values).all()]
    with _opened(path) as stream:
        for rows in spill.blocks(len(data.time), size=TEXT_ROWS):
            columns = data.rows(rows).columns()
            write_numbers({name: columns[name] for name in known}, _DECIMALS, stream, header=rows.start == 0)


def csv_text(columns: Mapping[str, FloatArray], digits: int) -> str:
    """Write csv text of columns ``(n,)``, each number with `digits` significant digits."""
    lines = (",".join(f"{value:.{digits}g}" for value in row) for row in np.column_stack(list(columns.values())))
    return "\n".join([",".join(columns), *lines]) + "\n"


def write_table(path: Path, columns: Mapping[str, FloatArray | IntArray]) -> None:
    """Write columns ``(n,)``, already rounded, as csv, compressed if the name ends in ``.gz``; NaN is an empty cell.

    Raises: OutputError: the file cannot be written.
    """
    with _opened(path) as stream:
        write_csv(arrow_table({name: np.asarray(values) for name, values in columns.items()}), stream)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a file for writing, compressed if its name ends in ``.gz``."""
    with writing("output.file_unwritable", path), path.open("wb") as stream:
        if path.suffix == ".gz":
            with gzip.GzipFile("", "wb", 9, stream, 0) as packed:
                yield packed
        else:
            yield stream


FILE = "found.npz"  # file of a stored result in its folder
_STRUCTURE = "structure"


def store(result: object, file: Path) -> None:
    """Write a result to an npz file; an array that it references several times is written once."""
    arrays: dict[int, np.ndarray] = {}

    def plain(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            arrays.setdefault(id(value), value)
            return {"array": list(arrays).index(id(value))}
        if isinstance(value, Enum):
            return {"member": f"{type(value).__module__}:{type(value).__qualname__}", "value": value.value}
        if is_dataclass(value):
            kind = type(value)
            own = {field.name: plain(getattr(value, field.name)) for field in fields(value) if field.init}
            return {"class": f"{kind.__module__}:{kind.__qualname__}", "fields": own}
        if isinstance(value, Mapping):
            return {"mapping": [[plain(key), plain(item)] for key, item in value.items()]}
        if isinstance(value, slice):
            return {"slice": [plain(bound) for bound in (value.start, value.stop, value.step)]}
        if isinstance(value, tuple | list):
            return {type(value).__name__: [plain(item) for item in value]}
        if isinstance(value, Path):
            return value.as_posix()
        if isinstance(value, InsnavError):
            return {"error": value.as_dict()}
        return value.item() if isinstance(value, np.generic) else value

    structure = json.dumps(plain(result)).encode()
    content = {f"array_{i}": array for i, array in enumerate(arrays.values())}
    np.savez_compressed(file, **{_STRUCTURE: np.frombuffer(structure, np.uint8)}, **content)  # type: ignore[arg-type]


def read_stored(folder: Path, name: str = FILE) -> Any:
    """Read a result from its folder. Raises: InputError: the file is missing, damaged, or of another version."""
    file = folder / name
    try:
        with file.open("rb") as stream, np.load(stream, allow_pickle=False) as content:
            return _restored(json.loads(content[_STRUCTURE].tobytes()), content)
    except (OSError, ValueError, LookupError, TypeError, AttributeError, ImportError, EOFError, BadZipFile) as error:
        raise InputError("output.unreadable_result", where=str(file), reason=str(error)) from error


def _restored(value: Any, content: Mapping[str, np.ndarray]) -> Any:
    # inverse of `plain` in `store`; `content` has the arrays
    if not isinstance(value, dict):
        return value
    if "array" in value:
        return content[f"array_{value['array']}"]
    if "mapping" in value:
        return {_restored(key, content): _restored(item, content) for key, item in value["mapping"]}
    if "error" in value:
        return InsnavError.from_dict(value["error"])
    if "slice" in value:
        return slice(*value["slice"])
    for sequence in (tuple, list):
        if sequence.__name__ in value:
            return sequence(_restored(item, content) for item in value[sequence.__name__])
    module, name = value["class" if "class" in value else "member"].split(":")
    kind: Any = getattr(import_module(module), name) if module.startswith("insnav.") else None
    if "member" in value and isinstance(kind, EnumType):
        return kind(value["value"])
    if "class" not in value or not is_dataclass(kind):
        raise ValueError(f"{module}:{name} is no result of insnav")
    make = cast(Callable[..., Any], kind)
    return make(**{key: _restored(item, content) for key, item in value["fields"].items()})
