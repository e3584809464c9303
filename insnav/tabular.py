"""Row-wise data: selection of rows, and conversion to and from tables of named columns.

The columns of a field are defined once, with the unit in the name as in files (see `insnav`). The column name
determines the factor to SI.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from insnav.exceptions import InputError
from insnav.spill import chosen
from insnav.units import DEG, DEG_PER_H, G0, PPM

if TYPE_CHECKING:
    import pandas as pd

Selection = slice | NDArray[np.bool_] | NDArray[np.intp]

_FACTORS = (("_deg_h", DEG_PER_H), ("_deg", DEG), ("_mg", 1e-3 * G0), ("_ppm", PPM))  # longest suffix first; else SI


@dataclass(frozen=True, slots=True)
class Tabular:
    """Frozen dataclass of arrays with one row per epoch."""

    COLUMNS: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """Names of the columns of each array field, ending in the unit."""

    def rows(self, selection: Selection) -> Self:
        """Select rows of every array that is not None; keep other fields. Arrays are views for a slice, else copies."""
        if isinstance(selection, slice):
            return self._changed(lambda _, values: values[selection])
        return self._changed(lambda _, values: chosen(values, selection))

    def joined(self, after: Self) -> Self:
        """Append the rows of another object, for every array that both have; other fields are unchanged.

        Arrays are copies, and None if only one object has them.
        """

        def both(name: str, values: NDArray[Any]) -> NDArray[Any] | None:
            following = getattr(after, name)
            return None if following is None else np.concatenate([values, following])

        return self._changed(both)

    def _changed(self, change: Callable[[str, NDArray[Any]], NDArray[Any] | None]) -> Self:
        """Copy the object with changed arrays, for every block of samples: `replace` would take three times as long."""
        new = object.__new__(type(self))
        names: tuple[str, ...] = self.__slots__
        for name in names:
            value = getattr(self, name)
            object.__setattr__(new, name, change(name, value) if isinstance(value, np.ndarray) else value)
        return new

    def to_frame(self) -> pd.DataFrame:
        """Convert to a table with canonical columns, unit in the name; covariances become standard deviations.

        Returns
        -------
        pandas.DataFrame
            One row per epoch. Fields other than arrays (sampling, stamp) are in its ``attrs``.
        """
        import pandas as pd

        frame = pd.DataFrame(self.columns())
        frame.attrs = {
            f.name: value for f in fields(self) if f.name not in self.COLUMNS and (value := getattr(self, f.name))
        }
        return frame

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the columns ``(n,)`` of every array that is not None, by canonical name, in the unit of the name."""
        columns: dict[str, NDArray[Any]] = {}
        for field, values in self._arrays().items():
            table = np.sqrt(np.diagonal(values, axis1=1, axis2=2)) if values.ndim == 3 else values
            for name, column in zip(
                self.COLUMNS[field], table.reshape(len(table), math.prod(table.shape[1:])).T, strict=True
            ):
                factor = unit_of(name)
                columns[name] = column if factor == 1.0 else column / factor
        return columns

    def _arrays(self) -> dict[str, NDArray[Any]]:
        names: tuple[str, ...] = self.__slots__
        return {name: value for name in names if isinstance(value := getattr(self, name), np.ndarray)}


@dataclass(frozen=True, slots=True)
class FromTable(Tabular):
    """Tabular data that can also be read from a table."""

    NEEDED: ClassVar[tuple[str, ...]] = ("time", "lla")
    """Fields whose columns a table must have; other absent fields are ``NaN``, or None where None is their default."""

    @classmethod
    def from_frame(cls, frame: pd.DataFrame, **others: str) -> Self:
        """Read arrays from a table with canonical columns; `insnav.load` reads other spellings and units.

        Parameters
        ----------
        frame : pandas.DataFrame
            Table in the form of `to_frame`. Columns of unknown values may be absent.
        **others : str
            Fields other than arrays, such as ``sampling``; by default from the ``attrs`` of the frame.

        Returns
        -------
        this class
            Arrays are copies.

        Raises
        ------
        InputError
            A column is unknown, or a required one is absent.
        """
        known = [name for names in cls.COLUMNS.values() for name in names]
        needed = [name for field in cls.NEEDED for name in cls.COLUMNS[field]]
        wrong = [str(name) for name in frame.columns if name not in known]
        absent = [name for name in needed if name not in frame.columns]
        if wrong or absent:
            raise InputError(
                "data.columns", table=cls.__name__, unknown=tuple(wrong), missing=tuple(absent), known=tuple(known)
            )
        values: dict[str, Any] = {str(name): value for name, value in frame.attrs.items()}
        for field in fields(cls):
            names = cls.COLUMNS.get(field.name, ())
            if any(name in frame.columns for name in names):
                values[field.name] = _array(frame, names)
            elif names and field.default is MISSING:
                values[field.name] = np.full((len(frame), len(names)), np.nan)
        return cls(**(values | others))


def unit_of(name: str) -> float:
    """Return the factor to SI of a column, from the unit at the end of its name; 1 for an SI unit or no unit."""
    return next((factor for suffix, factor in _FACTORS if name.endswith(suffix)), 1.0)


def runs_of(chosen: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return first row and end row (exclusive) ``(m, 2)`` of each unbroken run of True in `chosen` ``(n,)``."""
    return np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(np.int8), [0]]))).reshape(-1, 2)


def _array(frame: pd.DataFrame, names: tuple[str, ...]) -> NDArray[Any]:
    """Return an (n,) or (n, k) array of SI values; integers for a column of categories, such as ``fix``."""
    absent = np.full(len(frame), np.nan)
    # a copy: the arrays that pandas returns are read-only
    columns = [
        np.array(frame[name], dtype=np.float64) * unit_of(name) if name in frame.columns else absent for name in names
    ]
    if names == ("fix",):
        return columns[0].astype(np.int64)
    return columns[0] if len(names) == 1 else np.column_stack(columns)
