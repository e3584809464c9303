"""What all data in rows can do: choose some of the rows, become a table of named columns, and come from one.

The columns of a field are named once, with their unit in the name as in files (see `insnav`); the factor to SI follows
from that name.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from insnav.exceptions import InputError
from insnav.spill import chosen
from insnav.units import DEG, DEG_PER_H, G0, PPM

if TYPE_CHECKING:
    import pandas as pd

Selection = slice | NDArray[np.bool_] | NDArray[np.intp]

_FACTORS = (("_deg_h", DEG_PER_H), ("_deg", DEG), ("_mg", 1e-3 * G0), ("_ppm", PPM))  # longest first; else SI


@dataclass(frozen=True, slots=True)
class Tabular:
    """Frozen dataclass of arrays that all have one row an epoch."""

    COLUMNS: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """Columns of each array field, their unit in the name."""

    def rows(self, selection: Selection) -> Self:
        """Some of the rows, of every array that is there; all else is kept. Views for a slice, else copies."""
        if not isinstance(selection, slice):
            return replace(self, **{name: chosen(values, selection) for name, values in self._arrays().items()})
        return replace(self, **{name: values[selection] for name, values in self._arrays().items()})

    def joined(self, after: Self) -> Self:
        """These rows and then those of another, of every array that both have; all else as here.

        Arrays are copies, and None where only one of the two has them.
        """
        others = after._arrays()
        return replace(
            self,
            **{
                name: np.concatenate([values, others[name]]) if name in others else None
                for name, values in self._arrays().items()
            },
        )

    def to_frame(self) -> pd.DataFrame:
        """Table in the canonical columns, unit in the name; of a covariance the standard deviations.

        Returns
        -------
        pandas.DataFrame
            One row an epoch. What is no array (sampling, stamp) is in its ``attrs``.
        """
        import pandas as pd

        frame = pd.DataFrame(self.columns())
        frame.attrs = {
            f.name: value for f in fields(self) if f.name not in self.COLUMNS and (value := getattr(self, f.name))
        }
        return frame

    def columns(self) -> dict[str, NDArray[Any]]:
        """Columns ``(n,)`` of every array that is there, by their canonical names and in the units of these."""
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
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in values.items() if isinstance(value, np.ndarray)}


@dataclass(frozen=True, slots=True)
class FromTable(Tabular):
    """Rows that a table can be made into."""

    NEEDED: ClassVar[tuple[str, ...]] = ("time", "lla")
    """Fields that a table cannot do without; others are ``NaN``, or None if they may be."""

    @classmethod
    def from_frame(cls, frame: pd.DataFrame, **others: str) -> Self:
        """Arrays from a table in the canonical columns; `insnav.load` reads other spellings and units.

        Parameters
        ----------
        frame : pandas.DataFrame
            As from `to_frame`. Columns of what is not known may be absent.
        **others : str
            What is no array, such as ``sampling``; by default as in the ``attrs`` of the frame.

        Returns
        -------
        this class
            Arrays are copies.

        Raises
        ------
        InputError
            A column is unknown, or one that is needed is absent.
        """
        known = [name for names in cls.COLUMNS.values() for name in names]
        needed = [name for field in cls.NEEDED for name in cls.COLUMNS[field]]
        wrong = [str(name) for name in frame.columns if name not in known]
        absent = [name for name in needed if name not in frame.columns]
        if wrong or absent:
            raise InputError(
                "data.columns", table=cls.__name__, unknown=tuple(wrong), missing=tuple(absent), known=tuple(known)
            )
        found: dict[str, Any] = {str(name): value for name, value in frame.attrs.items()}
        for field in fields(cls):
            names = cls.COLUMNS.get(field.name, ())
            if any(name in frame.columns for name in names):
                found[field.name] = _array(frame, names)
            elif names and field.default is MISSING:
                found[field.name] = np.full((len(frame), len(names)), np.nan)
        return cls(**(found | others))


def unit_of(name: str) -> float:
    """SI value of the unit in which a column is, by the end of its name; 1 if that is an SI unit or none."""
    return next((factor for suffix, factor in _FACTORS if name.endswith(suffix)), 1.0)


def runs_of(chosen: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Begin and end ``(m, 2)`` of each unbroken run of chosen rows ``(n,)``."""
    return np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(np.int8), [0]]))).reshape(-1, 2)


def _array(frame: pd.DataFrame, names: tuple[str, ...]) -> NDArray[Any]:
    """(n,) or (n, k) array of SI values; whole numbers for a column that means a kind, such as ``fix``."""
    absent = np.full(len(frame), np.nan)
    # a copy: the arrays that pandas returns are read-only
    columns = [
        np.array(frame[name], dtype=np.float64) * unit_of(name) if name in frame.columns else absent for name in names
    ]
    if names == ("fix",):
        return columns[0].astype(np.int64)
    return columns[0] if len(names) == 1 else np.column_stack(columns)
