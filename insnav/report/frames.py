"""Quantities as a data frame: a row an item, units in the column names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from insnav.quantity import Quantity
from insnav.report.page import members

if TYPE_CHECKING:
    import pandas as pd


def rows_frame(rows: Iterable[Iterable[Quantity]]) -> pd.DataFrame:
    """Make a data frame of rows of quantities.

    `rows`: a value of several figures is as many columns, such as ``horizontal_rms_m``.
    """
    import pandas as pd

    return pd.DataFrame([_cells(row) for row in rows])


def _cells(row: Iterable[Quantity]) -> Mapping[str, Any]:
    return {key: value for whole in row for each in members(whole) for key, value in each.facts().items()}
