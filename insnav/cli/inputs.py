"""Reading for the commands of the laboratory, which take one file and not a drive."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from insnav.cli import parse
from insnav.cli.data_options import say_reading as say_reading

if TYPE_CHECKING:
    from insnav.cli.options import SamplingChoice, StampChoice
    from insnav.input import Reading
    from insnav.types import ImuData


@contextmanager
def named_options() -> Iterator[None]:
    """Do nothing: errors name options where they are printed."""
    yield


def read_samples(
    path: Path,
    axes: str | None,
    columns: str | None,
    units: str | None,
    sampling: SamplingChoice | None,
    stamp: StampChoice | None,
    calibration: Path | None,
) -> Reading[ImuData]:
    """Read the IMU file with the options every command shares, and correct known errors."""
    from insnav.session import read

    return read.read_samples(
        path,
        {
            "axes": axes,
            "columns": None if columns is None else parse.columns(columns, "--columns"),
            "units": units,
            "sampling": None if sampling is None else sampling.value,
            "stamp": None if stamp is None else stamp.value,
            "calibration": calibration,
        },
    )
