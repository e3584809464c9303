"""Parquet files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from insnav.deferred import library
from insnav.exceptions import InputError
from insnav.input.formats.conventions import damaged
from insnav.input.formats.source import Source
from insnav.input.formats.table import Numbers, Table, arrow_floats
from insnav.input.formats.text_values import seconds_of_stamps
from insnav.input.formats.unpack import refuse_bomb
from insnav.plain_text import plain_text

pa = library("pyarrow")
parquet = library("pyarrow.parquet")  # it costs as much as reading a small file

name = "parquet"
suffixes = (".parquet", ".pq")


def recognise(source: Source) -> bool:
    return source.head.startswith(b"PAR1")


def read(source: Source) -> Mapping[str, Table]:
    with damaged(source, "parquet file", "write it again"):
        schema = parquet.read_schema(pa.BufferReader(pa.py_buffer(source.data)))
    headers = tuple(plain_text(header) for header in schema.names)
    return {"": Table(source.name, source.sha256, headers, _ParquetCells(source, headers))}


@dataclass(frozen=True, slots=True)
class _ParquetCells:
    source: Source
    headers: tuple[str, ...]

    def line(self, row: int) -> str:
        return f"row {row + 1}"

    def read(self, indices: Sequence[int]) -> Numbers:
        with damaged(self.source, "parquet file", "write it again"):
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
            size = 8 * file.metadata.num_rows * len(indices)
            refuse_bomb("parquet file", self.source.name, len(self.source.data), size, "write it as CSV")
            arrow = file.read([schema.names[i] for i in indices], use_threads=False)
            cast = {i: arrow.column(schema.names[i]) for i in indices}
            cast = {i: column.cast(pa.float64(), safe=False) for i, column in cast.items() if i not in stamps}
            columns = {
                i: np.concatenate([np.empty(0), *(arrow_floats(chunk) for chunk in column.chunks)])
                for i, column in cast.items()
            }
        texts = {}
        for i in stamps:
            texts[i] = seconds_of_stamps(arrow.column(schema.names[i]))
            columns[i] = texts[i].values
        return Numbers(columns, arrow.num_rows, texts=texts)
