"""Epochs at which a pose is wanted, such as camera triggers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from insnav.exceptions import InputError
from insnav.input.formats.source import open_source
from insnav.input.formats.text_dialect import is_comment
from insnav.types import FloatArray

_CLOSEST = 4e-6  # closer epochs are one row of a solution [s]


def read_epochs(path: str | Path) -> FloatArray:
    """Read increasing epochs [s] from the first column of a text file.

    Header lines before the first number, empty lines and comments are skipped.
    Raises: InputError: no epochs, a cell that is not a number, or epochs that do not increase.
    """
    source = open_source(path)
    found: list[float] = []
    for number, line in enumerate(bytes(source.data).decode("utf-8", "replace").lstrip("\ufeff").splitlines(), 1):
        cell = re.split(r"[,;\s]", line.strip(), maxsplit=1)[0].strip('"')
        if not cell or is_comment(line):
            continue
        try:
            found.append(float(cell))
        except ValueError:
            if found:
                raise InputError("input.no_epoch", where=f"{source.name}:{number}", text=cell[:40]) from None
    return as_epochs(found, source.name)


def as_epochs(times: object, where: str) -> FloatArray:
    """Check epochs [s]: at least one, finite and increasing.

    Raises: InputError: they are not.
    """
    epochs = np.asarray(times, dtype=np.float64)
    if epochs.ndim != 1 or not epochs.size:
        raise InputError("input.no_epochs", where=where)
    wrong = ~np.isfinite(epochs)
    wrong[1:] |= ~(np.diff(epochs) > _CLOSEST)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InputError("input.epochs_backward", where=where, row=row + 1, time_s=float(epochs[row]))
    return epochs
