"""Arithmetic that fails inside a step, as an error that names the data."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from insnav.exceptions import InputError
from insnav.input import Reading

_COLUMNS = ("gyro", "accel", "lla", "v_n", "position_sd", "velocity_sd")  # of `ImuData` and `GpsData`


@contextmanager
def naming_data(step: str, *given: Reading[Any] | None) -> Iterator[None]:
    """Raise a failure of the arithmetic in a step as an `InputError` with the constant columns and largest values."""
    try:
        yield
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        read = [each for each in given if each is not None]
        parts = ((name, getattr(each.data, name, None)) for name in _COLUMNS for each in read)
        columns = [(name, values) for name, values in parts if values is not None and np.isfinite(values).any()]
        raise InputError(
            "input.arithmetic",
            where=", ".join(dict.fromkeys(each.facts.path for each in read)),
            step=step,
            reason=str(error),
            constant=tuple(name for name, values in columns if np.nanmin(values) == np.nanmax(values)),
            largest=tuple(f"{name} {np.nanmax(np.abs(values)):.3g}" for name, values in columns),
        ) from error
