"""Parquet files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from insnav.exceptions import InputError
from insnav.input.formats.source import Source
from insnav.input.formats.table import Numbers, Table, arrow_floats
from insnav.input.formats.text_values import seconds_of_stamps
from insnav.input.formats.unpack import MAX_BYTES, MAX_RATIO, RATIO_FROM
from insnav.plain_text import plain_text

name = "parquet"
suffixes = (".parquet", ".pq")


def recognise(source: Source) -> bool:
    return source.head.startswith(b"PAR1")


def read(source: Source) -> Mapping[str, Table]:
    import pyarrow as pa
    from pyarrow import parquet  # only for parquet: it costs as much as reading a small file

    try:
        schema = parquet.read_schema(pa.BufferReader(pa.py_buffer(source.data)))
    except (pa.ArrowInvalid, OSError) as error:
        raise _damaged(source, error) from error
    headers = tuple(plain_text(header) for header in schema.names)
    return {"": Table(source.name, source.sha256, headers, _ParquetCells(source, headers))}


def _damaged(source: Source, error: Exception) -> InputError:
    return InputError("the parquet file is damaged", where=source.name, why=plain_text(error), fix="write it again")


def _refuse_bomb(source: Source, size: int) -> None:
    """Refuse columns that become so large that no recording does."""
    if size > MAX_BYTES or (size > RATIO_FROM and size > MAX_RATIO * len(source.data)):
        raise InputError(
            "the parquet file unpacks to more than is sensible",
            where=source.name,
            why=f"{len(source.data)} bytes would become {size}",
            fix="if it is a real recording, write it as CSV",
        )


@dataclass(frozen=True, slots=True)
class _ParquetCells:
    source: Source
    headers: tuple[str, ...]

    def line(self, row: int) -> str:
        return f"row {row + 1}"

    def read(self, indices: Sequence[int]) -> Numbers:
        import pyarrow as pa
        from pyarrow import parquet

        try:
            file = parquet.ParquetFile(pa.BufferReader(pa.py_buffer(self.source.data)))
            schema = file.schema_arrow
            stamps = [i for i in indices if pa.types.is_timestamp(schema.field(i).type)]
            for i in indices:
                kind = schema.field(i).type
                if i in stamps:
                    continue
                if not (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
                    raise InputError(
                        f"column {self.headers[i]!r} does not hold numbers",
                        where=f"{self.source.name}:{self.headers[i]}",
                        why=f"its type is {kind}",
                        fix="save it as float64; times as seconds",
                    )
            _refuse_bomb(self.source, 8 * file.metadata.num_rows * len(indices))
            arrow = file.read([schema.names[i] for i in indices], use_threads=False)
            cast = {i: arrow.column(schema.names[i]) for i in indices}
            cast = {i: column.cast(pa.float64(), safe=False) for i, column in cast.items() if i not in stamps}
            columns = {
                i: np.concatenate([np.empty(0), *(arrow_floats(chunk) for chunk in column.chunks)])
                for i, column in cast.items()
            }
        except (pa.ArrowInvalid, OSError) as error:
            raise _damaged(self.source, error) from error
        texts = {}
        for i in stamps:
            texts[i] = seconds_of_stamps(arrow.column(schema.names[i]))
            columns[i] = texts[i].values
        return Numbers(columns, arrow.num_rows, texts=texts)
