"""Numbers as text: what the kernel writes is what Python and Arrow write of the rounded numbers."""

import io
from decimal import Decimal

import numpy as np
import pytest

from insnav.output.data_files import arrow_table, rounded, write_csv, write_numbers

DECIMALS = (("^lat", 10), ("_deg|time", 6), ("_m$", 5), ("nis", 4))
NAMES = ("time_s", "lat_deg", "heading_deg", "height_m", "nis", "used")


def numbers(count=20_000):
    """Columns of all sizes, with what is not known, zeros of either sign and whole numbers."""
    rng = np.random.default_rng(4)
    columns = {
        "time_s": 456_000.0 + 0.005 * np.arange(count),
        "lat_deg": rng.uniform(-90.0, 90.0, count),
        "heading_deg": rng.uniform(0.0, 360.0, count),
        "height_m": rng.normal(size=count) * 10.0 ** rng.uniform(-7.0, 4.0, count),
        "nis": rng.chisquare(3, count),
        "used": rng.integers(0, 2, count),
    }
    columns["heading_deg"][:3] = 359.9999999, 359.9999994, 0.0
    columns["height_m"][:6] = np.nan, -1e-9, -0.0, 1e9 - 1.0, -12.5, np.inf
    columns["nis"][5:9] = np.nan
    return columns


def by_arrow(columns):
    stream = io.BytesIO()
    write_csv(arrow_table({name: rounded(name, v, DECIMALS) for name, v in columns.items()}), stream)
    return stream.getvalue()


def by_kernel(columns):
    stream = io.BytesIO()
    write_numbers(columns, DECIMALS, stream, header=True)
    return stream.getvalue()


def test_kernel_writes_the_bytes_of_arrow():
    assert by_kernel(numbers()) == by_arrow(numbers())


def test_kernel_writes_the_shortest_text_of_each_number():
    columns = numbers(300)
    header, *rows = by_kernel(columns).decode().splitlines()
    assert header == ",".join(NAMES)
    places = {"time_s": 6, "lat_deg": 10, "heading_deg": 6, "height_m": 5, "nis": 4, "used": 0}
    for i, row in enumerate(rows):
        for name, cell in zip(NAMES, row.split(","), strict=True):
            value = round(float(columns[name][i]), places[name])
            if not np.isfinite(value):
                assert cell == ""
                continue
            value = 0.0 if name == "heading_deg" and value == 360.0 else value
            assert float(cell) == value
            assert "e" not in cell
            assert cell == "0" or Decimal(cell) == Decimal(repr(value))
            assert "." not in cell or not cell.endswith("0")
            assert cell != "-0"


@pytest.mark.parametrize("value", [3e-8, -3e-8, 2e10, 1e18])
def test_numbers_with_an_exponent_are_left_to_arrow(value):
    columns = {"lat_deg": np.array([1.0, value]), "used": np.array([1, 0])}
    assert by_kernel(columns) == by_arrow(columns)
    assert b"e" in by_kernel(columns).splitlines()[2] or value == 1e18
