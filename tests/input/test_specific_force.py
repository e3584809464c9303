"""Specific force along level axes: directions by name or as told, units, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, Severity
from insnav.input.readers.specific_force import read_specific_force
from tests.input.files import noted, write
from tests.refusals import refused

T = np.arange(200) / 100.0
F_N = np.column_stack([np.sin(T), 0.5 * np.cos(T), -9.8 + 0.1 * T])


def table(time: np.ndarray = T, scale: float = 1.0, order: str = "ENU") -> np.ndarray:
    parts = {"N": F_N[:, 0], "E": F_N[:, 1], "D": F_N[:, 2], "U": -F_N[:, 2]}
    return np.column_stack([time, *(scale * parts[axis] for axis in order)])


@pytest.mark.parametrize(
    ("header", "order", "axes", "scale"),
    [
        ("time_s,f_east_m_s2,f_north_m_s2,f_up_m_s2", "ENU", None, 1.0),
        ("time_s,f_north_m_s2,f_east_m_s2,f_down_m_s2", "NED", None, 1.0),
        ("t,fe,fn,fu", "ENU", None, 1.0),
        ("t,fn,fe,fd", "NED", "ENU", 1.0),  # names say more than the option
        ("t,fe,fn,fu", "ENU", None, 1.0 / 9.80665),
        ("t,f_east[mg],f_north[mg],f_up[mg]", "ENU", None, 1e3 / 9.80665),
        ("t,fx,fy,fz", "ENU", "ENU", 1.0),
        ("t,ax,ay,az", "NED", "NED", 1.0),
        ("time_s,x,y,z", "ENU", "ENU", 1.0),
    ],
)
def test_directions_and_units(tmp_path: Path, header: str, order: str, axes: str | None, scale: float):
    path = write(tmp_path / "fw.csv", table(scale=scale, order=order), header)
    read = read_specific_force(path, axes=axes)
    np.testing.assert_allclose(read.data.f_n, F_N, atol=2e-8)
    np.testing.assert_allclose(read.data.time, T)
    assert read.facts.rate_hz == pytest.approx(100.0)


def test_without_times_the_rate_is_told(tmp_path: Path):
    path = write(tmp_path / "fw.csv", table()[:, 1:], "fe,fn,fu")
    read = read_specific_force(path, sample_rate=100.0)
    np.testing.assert_allclose(read.data.f_n, F_N, atol=2e-8)
    np.testing.assert_allclose(read.data.time, T)
    (by_rate,) = noted(read, Code.READ_TIME_BY_RATE)
    assert by_rate["rate_hz"] == 100.0
    with refused(InputError, "columns.missing") as missing:
        read_specific_force(path)
    assert missing.value.values["hint"] == "without_times"
    timed = write(tmp_path / "timed.csv", table(), "t,fe,fn,fu")
    with refused(ConfigError, "input.rate_beside_times"):
        read_specific_force(timed, sample_rate=100.0)


def test_without_a_vertical_axis(tmp_path: Path):
    path = write(tmp_path / "fw.csv", table(order="NE"), "t,fn,fe")
    read = read_specific_force(path)
    np.testing.assert_allclose(read.data.f_n[:, :2], F_N[:, :2], atol=1e-8)
    assert np.isnan(read.data.f_n[:, 2]).all()
    assert noted(read, Code.READ_FORCE_NO_VERTICAL)
    (unit,) = noted(read, Code.READ_FORCE_UNIT_ASSUMED)
    assert unit.severity is Severity.ASSUMPTION
    assert unit["unit"] == "m/s^2"


def test_a_bad_row_and_jitter_are_taken_as_they_are(tmp_path: Path):
    time = T + np.random.default_rng(1).uniform(-0.003, 0.003, len(T))
    rows = table(time)
    path = write(tmp_path / "fw.csv", rows, "t,fe,fn,fu")
    text = path.read_text(encoding="utf-8").splitlines()
    text[50] = text[50].split(",")[0] + ",nan,0,9.8"
    path.write_text("\n".join(text) + "\n", encoding="utf-8")
    read = read_specific_force(path)
    assert read.facts.n_used == len(T) - 1
    np.testing.assert_allclose(read.data.time, np.delete(time, 49), atol=1e-9)
    assert read.events


GAP = np.concatenate([T[:100], T[100:] + 0.5])


@pytest.mark.parametrize(
    ("rows", "header", "word"),
    [
        (table(), "t,fx,fy,fz", "input.level_axes_unclear"),
        (table(GAP), "t,fe,fn,fu", "input.gap"),
        (table(), "t,fe,fn,fd", "input.vertical_no_gravity"),
        (table(scale=3.0), "t,fe,fn,fu", "input.force_unit_unclear"),
        (table(scale=3.0), "t,f_east_m_s2,f_north_m_s2,f_up_m_s2", "input.vertical_no_gravity"),
        (table(), "t,f_east[g],f_north[m/s^2],f_up[m/s^2]", "input.mixed_units"),
        (np.column_stack([table(), F_N[:, 2]]), "t,fe,fn,fu,fd", "input.two_vertical"),
        (table()[:, :2], "t,fe", "columns.missing"),
        (table()[:2], "t,fe,fn,fu", "columns.too_few_rows"),
        (np.where(table() == table()[70, 1], 5e4, table()), "t,fe,fn,fu", "input.impossible_force"),
    ],
)
def test_what_cannot_be_meant_is_refused_by_name(tmp_path: Path, rows: np.ndarray, header: str, word: str):
    path = write(tmp_path / "fw.csv", rows, header)
    with refused(InputError, word) as error:
        read_specific_force(path)
    assert "fw.csv" in error.value.where
