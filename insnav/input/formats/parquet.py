"""Parquet files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from insnav import spill
from insnav.deferred import library
from insnav.exceptions import InputError
from insnav.input.formats.conventions import damaged
from insnav.input.formats.source import Source, refuse_bomb
from insnav.input.formats.table import Numbers, Table, arrow_floats
from insnav.input.formats.text_values import seconds_of_stamps
from insnav.plain_text import plain_text

pa = library("pyarrow")
parquet = library("pyarrow.parquet")  # its import takes as long as reading a small file

name = "parquet"
suffixes = (".parquet", ".pq")


def recognise(source: Source) -> bool:
    return source.head.startswith(b"PAR1")


def read(source: Source) -> Mapping[str, Table]:
    with damaged("format.parquet_damaged", source):
        schema = parquet.read_schema(pa.BufferReader(pa.py_buffer(source.data)))
    headers = tuple(plain_text(header) for header in schema.names)
    return {"": Table(source.name, source.sha256, headers, _ParquetCells(source, headers))}


@dataclass(frozen=True, slots=True)
class _ParquetCells:
    """Rows of a Parquet file, read column by column; see `Cells`."""

    source: Source
    headers: tuple[str, ...]

    def line(self, row: int) -> str:
        return f"row {row + 1}"

    def read(self, indices: Sequence[int]) -> Numbers:
        with damaged("format.parquet_damaged", self.source):
            file = parquet.ParquetFile(pa.BufferReader(pa.py_buffer(self.source.data)))
            schema = file.schema_arrow
            stamps = [i for i in indices if pa.types.is_timestamp(schema.field(i).type)]
            for i in indices:
                kind = schema.field(i).type
                if i in stamps:
                    continue
                if not (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
                    where = f"{self.source.name}:{self.headers[i]}"
                    raise InputError("format.parquet_type", where=where, column=self.headers[i], kind=str(kind))
            size = 8 * file.metadata.num_rows * len(indices)
            refuse_bomb(self.source.name, "parquet", len(self.source.data), size)
            count = file.metadata.num_rows
            columns = {i: spill.empty((count,)) for i in indices if i not in stamps}
            start = 0
            for batch in file.iter_batches(spill.ROWS, columns=[schema.names[i] for i in columns], use_threads=False):
                for i, column in columns.items():
                    cells = batch.column(schema.names[i]).cast(pa.float64(), safe=False)
                    column[start : start + len(cells)] = arrow_floats(cells)
                start += len(batch)
                spill.release()
            arrow = file.read([schema.names[i] for i in stamps], use_threads=False)
        texts = {}
        for i in stamps:
            texts[i] = seconds_of_stamps(arrow.column(schema.names[i]))
            columns[i] = texts[i].values
        return Numbers(columns, count, texts=texts)
