"""Tables come back as they went in, nothing unknown is written as a number, and no cell is a formula."""

from __future__ import annotations

import csv
import json
import math
import xml.etree.ElementTree as ET  # of our own file

import numpy as np
import pyarrow.parquet
import pytest

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.output.solution_tables import read_solution, write_events, write_run_table
from insnav.output.track_files import KML_POINTS, write_kml
from insnav.plain_text import cell_text, plain_text
from insnav.types import Innovations, SensorErrors, Trajectory
from tests.refusals import refused

SOLUTION = [
    *("time_s", "lat_deg", "lon_deg", "height_m", "vn_m_s", "ve_m_s", "vd_m_s"),
    *("roll_deg", "pitch_deg", "heading_deg", "sd_n_m", "sd_e_m", "sd_d_m"),
    *("sd_vn_m_s", "sd_ve_m_s", "sd_vd_m_s", "sd_roll_deg", "sd_pitch_deg", "sd_heading_deg"),
]
EVENTS = [
    *("time_s", "end_s", "code", "severity", "subject", "value", "limit", "unit"),
    *("action", "hint", "values"),
]
KML = "{http://www.opengis.net/kml/2.2}"


def trajectory(n=50, *, sd=True):
    rng = np.random.default_rng(1)
    return Trajectory(
        604700.0 + np.arange(n) / 10.0,
        np.column_stack((0.8 + 1e-6 * np.arange(n), 0.2 + 1e-6 * np.arange(n), 300.0 + rng.normal(size=n))),
        rng.normal(size=(n, 3)),
        np.column_stack((rng.normal(size=(n, 2)) * 0.1, np.linspace(0.0, 6.28, n))),
        rng.uniform(0.01, 1.0, size=(n, 9)) if sd else None,
    )


def cells(path):
    with path.open(newline="", encoding="utf-8") as stream:
        header, *rows = csv.reader(stream)
    return header, rows


@pytest.mark.parametrize("file_format", ["csv", "parquet"])
@pytest.mark.parametrize("sd", [True, False])
def test_a_solution_comes_back_to_a_hundredth_of_a_millimetre(tmp_path, file_format, sd):
    wrote = trajectory(sd=sd)
    path = write_run_table(tmp_path, wrote, file_format)
    assert path.name == f"solution.{file_format}"
    read = read_solution(tmp_path)
    np.testing.assert_allclose(read.time, wrote.time, atol=1e-6)
    np.testing.assert_allclose(read.lla[:, :2], wrote.lla[:, :2], atol=1e-5 / 6.4e6)
    np.testing.assert_allclose(read.lla[:, 2], wrote.lla[:, 2], atol=1e-5)
    np.testing.assert_allclose(read.v_n, wrote.v_n, atol=1e-6)
    np.testing.assert_allclose(read.rph, wrote.rph, atol=1e-8)
    if sd:
        np.testing.assert_allclose(read.sd, wrote.sd, atol=1e-5)
    else:
        assert read.sd is None


def test_the_columns_of_the_solution_are_the_documented_ones(tmp_path):
    header, rows = cells(write_run_table(tmp_path, trajectory()))
    assert header == SOLUTION
    assert float(rows[0][1]) == pytest.approx(math.degrees(0.8), abs=1e-9)
    assert pyarrow.parquet.read_schema(write_run_table(tmp_path, trajectory(), "parquet")).names == SOLUTION


@pytest.mark.parametrize("file_format", ["csv", "parquet"])
def test_what_is_not_finite_is_an_empty_cell(tmp_path, file_format):
    solution = trajectory()
    solution.v_n[3], solution.sd[4, 8] = np.nan, np.inf
    path = write_run_table(tmp_path, solution, file_format)
    if file_format == "csv":
        text = path.read_text().lower()
        assert "nan" not in text
        assert "inf" not in text
        assert cells(path)[1][3][4:7] == ["", "", ""]
        assert cells(path)[1][4][18] == ""
    else:
        table = pyarrow.parquet.read_table(path)
        assert table["vn_m_s"].null_count == 1
        assert table["sd_heading_deg"].null_count == 1
        assert all(np.isfinite(c.drop_null().to_numpy()).all() for c in table.columns)


def test_heading_stays_below_360_after_rounding_and_zero_has_no_sign(tmp_path):
    solution = trajectory(2)
    solution.rph[:] = [[-1e-12, 0.0, 2.0 * np.pi - 1e-12], [0.0, 0.0, 0.0]]
    rows = cells(write_run_table(tmp_path, solution))[1]
    assert rows[0][7:10] == ["0", "0", "0"]


def test_the_same_solution_gives_the_same_bytes(tmp_path):
    first = write_run_table(tmp_path, trajectory()).read_bytes()
    assert write_run_table(tmp_path, trajectory()).read_bytes() == first
    assert b"\r" not in first


def test_a_folder_without_a_usable_solution_is_an_input_error(tmp_path):
    with refused(InputError, "output.no_table"):
        read_solution(tmp_path)
    for text in (
        "",
        "time_s,lat_deg\n1,2\n",
        "a;b\n1;2\n",
        ",".join(SOLUTION[:10]) + "\n" + "x," * 9 + "y\n",
    ):
        (tmp_path / "solution.csv").write_text(text)
        with refused(InputError, "output.unreadable_table"):
            read_solution(tmp_path)


def test_innovations_of_fixes_without_velocity_have_empty_cells(tmp_path):
    nothing = np.full((2, 3), np.nan)
    path = write_run_table(
        tmp_path,
        Innovations(
            np.array([1.0, 2.0]),
            np.hstack((np.ones((2, 3)), nothing)),
            np.hstack((np.full((2, 3), 2.0), nothing)),
            np.array([0.75, 0.75]),
            np.full(2, np.nan),
            np.array([True, False]),
            np.zeros(2, dtype=bool),
        ),
    )
    header, rows = cells(path)
    row = dict(zip(header, rows[1], strict=True))
    assert row["innovation_n_m"] == "1"
    assert row["sd_d_m"] == "2"
    assert row["innovation_ve_m_s"] == row["sd_vd_m_s"] == row["nis_velocity"] == ""
    assert (rows[0][-2], row["used_position"], row["used_velocity"]) == ("1", "0", "0")


def test_biases_are_in_the_units_of_the_field(tmp_path):
    value = np.array([[np.radians(1.0) / 3600.0] * 3 + [9.80665e-3] * 3 + [1e-6] * 3 + [2e-6] * 3])
    header, rows = cells(write_run_table(tmp_path, SensorErrors(np.array([5.0]), value, 2.0 * value)))
    row = {name: float(cell) for name, cell in zip(header, rows[0], strict=True)}
    assert row["gyro_bias_x_deg_h"] == 1.0
    assert row["accel_bias_y_mg"] == 1.0
    assert row["gyro_scale_z_ppm"] == 1.0
    assert row["accel_scale_x_ppm"] == 2.0
    assert row["sd_gyro_bias_x_deg_h"] == 2.0
    assert row["sd_accel_scale_z_ppm"] == 4.0
    assert len(header) == 25


HOSTILE = [
    "=HYPERLINK(1)",
    "+cmd",
    "-1+1",
    "@SUM(A1)",
    "\t=1",
    "\r=1",
    " =1",
    "\x1b[31m=1",
    "\x00=1",
    "\u200b=1",
]


@pytest.mark.parametrize("text", HOSTILE)
def test_no_text_cell_begins_like_a_formula(tmp_path, text):
    finding = Finding.of(Code.GATE_POSITION, 1.0, subject=text, nis=2.0, limit=math.nan, text=text)
    header, rows = cells(write_events(tmp_path, [finding]))
    assert header == EVENTS
    row = dict(zip(header, rows[0], strict=True))
    for name in ("subject", "action"):
        assert row[name].startswith("'")
    assert row["values"].startswith("{")
    assert json.loads(row["values"]) == {"nis": 2.0, "limit": None, "text": text}
    assert not any(ord(c) < 32 for cell in rows[0] for c in cell)
    assert rows[0][:4] == ["1", "1", "gate.position", "note"]
    assert (row["value"], row["limit"], row["unit"], row["hint"]) == ("2", "", "", "")


def test_events_may_be_absent_and_may_hold_any_punctuation(tmp_path):
    assert cells(write_events(tmp_path, []))[1] == []
    said = 'said "no", then; left\nat once'
    finding = Finding.of(Code.FILTER_RESET, 1.5, 2.75, subject="5 > 3", offset_m=-3.25, limit_m=1.0, text=said)
    numbers = ["1.5", "2.75", "filter.reset", "warning", "5 > 3", "-3.25", "1", "m"]
    ((*row, values),) = cells(write_events(tmp_path, [finding]))[1]
    assert row == [*numbers, 'said "no", then; left at once', ""]
    assert json.loads(values) == {"offset_m": -3.25, "limit_m": 1.0, "text": said}


@pytest.mark.parametrize(
    ("text", "kept"),
    [
        ("\x1b[31mred\x1b[0m", "red"),
        ("\x1b]0;title\x07name", "name"),
        ("\x1b]8;;http://x\x1b\\link", "link"),
        ("a\x07b\x9b31mc", "ab31mc"),
        ("abc\u202etxt.exe", "abctxt.exe"),
        ("Zürich 東京 ±3 µg", "Zürich 東京 ±3 µg"),
    ],
)
def test_terminal_codes_are_taken_out_and_letters_kept(text, kept):
    assert plain_text(text) == kept
    assert cell_text(text) == kept


def test_the_track_is_thinned_escaped_and_clamped(tmp_path):
    root = ET.parse(write_kml(tmp_path, trajectory(20_000), 'a <b> & "c" \x1b[31m')).getroot()
    assert root.findtext(f".//{KML}name") == 'a <b> & "c" '
    points = root.findtext(f".//{KML}LineString/{KML}coordinates").split()
    assert len(points) == KML_POINTS
    lon, lat, height = map(float, points[-1].split(","))
    assert lat == pytest.approx(math.degrees(0.8 + 1e-6 * 19_999), abs=1e-8)
    assert lon == pytest.approx(math.degrees(0.2 + 1e-6 * 19_999), abs=1e-8)
    assert 290.0 < height < 310.0
    assert root.find(f".//{KML}altitudeMode") is None  # clamped to the ground by default


def test_the_track_is_split_at_the_date_line(tmp_path):
    time = np.arange(6.0)
    lon = np.pi + 1e-6 * (time - 2.5)
    lla = np.column_stack((0.0 * time, (lon + np.pi) % (2 * np.pi) - np.pi, 0.0 * time))
    root = ET.parse(write_kml(tmp_path, Trajectory(time, lla, lla, lla), "x")).getroot()
    parts = [part.text.split() for part in root.iter(f"{KML}coordinates")][:2]
    assert [len(part) for part in parts] == [3, 3]
    assert all(float(p.split(",")[0]) > 179.9 for p in parts[0])
    assert all(float(p.split(",")[0]) < -179.9 for p in parts[1])


def test_one_point_is_a_track_too(tmp_path):
    assert ET.parse(write_kml(tmp_path, trajectory(1), "x")).getroot() is not None
