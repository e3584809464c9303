"""RTKLIB solutions, written here by the manual's format from a known motion, and real ones where they lie."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pymap3d
import pytest

from insnav.exceptions import InputError
from insnav.findings import Code
from insnav.input import read_gps, read_imu, read_reference
from insnav.input.formats.registry import open_table
from tests.input.files import SHARED, noted
from tests.refusals import refused

REAL = SHARED / "data" / "formats" / "rtklib"
real = pytest.mark.skipif(
    not REAL.is_dir(), reason="real RTKLIB solutions (../shared/data/formats/rtklib) are not here"
)

PLACE = (-33.25, 151.5, 80.0)
COVARIANCE = np.array([[0.04, 0.012, -0.02], [0.012, 0.09, 0.015], [-0.02, 0.015, 0.25]])  # North, East, Down
TOW = 302_400.0 + 0.25 * np.arange(8)  # Wednesday noon
WEEK = 2032  # from 16 December 2018
LLH = "latitude(deg) longitude(deg)  height(m)"
LAYOUTS = {
    "llh": (LLH, "neu"),
    "dms": ("latitude(d'\") longitude(d'\")  height(m)", "neu"),
    "ecef": ("x-ecef(m)      y-ecef(m)      z-ecef(m)", "xyz"),
    "baseline": ("e-baseline(m)  n-baseline(m)  u-baseline(m)", "enu"),
}


def to_earth(lat: float, lon: float) -> np.ndarray:
    """Columns North, East, Down in Earth-fixed axes."""
    s, c, sl, cl = np.sin(np.radians(lat)), np.cos(np.radians(lat)), np.sin(np.radians(lon)), np.cos(np.radians(lon))
    return np.array([[-s * cl, -sl, -c * cl], [-s * sl, cl, -c * sl], [c, 0.0, -s]])


def motion() -> tuple[np.ndarray, np.ndarray]:
    """Latitude, longitude [deg], height [m] of a circle, and velocity North, East, Down [m/s]."""
    t = TOW - TOW[0]
    ned = np.column_stack([20.0 * np.sin(t), 20.0 * np.cos(t), -t])
    v_n = np.column_stack([20.0 * np.cos(t), -20.0 * np.sin(t), -np.ones_like(t)])
    return np.column_stack(pymap3d.ned2geodetic(*ned.T, *PLACE)), v_n


def signed_root(value: float) -> float:
    return float(np.sign(value) * np.sqrt(abs(value)))


def when(tow: float, calendar: bool, ahead: float) -> str:
    """Time of a row, `ahead` seconds ahead of GPS time."""
    if not calendar:
        return f"{WEEK} {tow + ahead:.3f}"
    instant = np.datetime64("1980-01-06T00:00:00.000") + np.timedelta64(
        round((WEEK * 604800 + tow + ahead) * 1e3), "ms"
    )
    date, clock = str(instant).split("T")
    return f"{date.replace('-', '/')} {clock}"


def solution(
    layout: str,
    *,
    calendar: bool = True,
    scale: str = "GPST",
    ahead: float = 0.0,
    separator: str = " ",
    velocity: bool = True,
) -> str:
    """Text of a solution as `outsolheads` and `outsols` of RTKLIB write it."""
    names, axes = LAYOUTS[layout]
    lla, v_n = motion()
    rows = []
    for tow, place, v in zip(TOW, lla, v_n, strict=True):
        earth = to_earth(*place[:2])
        turn = {"neu": np.diag([1.0, 1.0, -1.0]), "xyz": earth}.get(axes)
        if layout == "baseline":
            turn = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]) @ to_earth(*PLACE[:2]).T @ earth
        covariance, v = turn @ COVARIANCE @ turn.T, turn @ v
        if layout == "llh":
            where = [f"{place[0]:.9f}", f"{place[1]:.9f}", f"{place[2]:.4f}"]
        elif layout == "dms":
            degrees = np.trunc(place[:2])
            minutes = np.trunc(60.0 * np.abs(place[:2] - degrees))
            seconds = 3600.0 * np.abs(place[:2] - degrees) - 60.0 * minutes
            where = [f"{d:.0f} {m:02.0f} {s:08.5f}" for d, m, s in zip(degrees, minutes, seconds, strict=True)]
            where.append(f"{place[2]:.4f}")
        elif layout == "ecef":
            where = [f"{x:.4f}" for x in pymap3d.geodetic2ecef(*place)]
        else:
            where = [f"{x:.4f}" for x in pymap3d.geodetic2enu(*place, *PLACE)]
        deviations = [covariance[i, i] ** 0.5 for i in range(3)]
        deviations += [signed_root(covariance[i, j]) for i, j in ((0, 1), (1, 2), (2, 0))]
        cells = [when(tow, calendar, ahead), *where, "2", "11", *(f"{sd:.4f}" for sd in deviations), "0.25", "3.5"]
        if velocity:
            cells += [*(f"{x:.5f}" for x in v), *(f"{0.1 * sd:.5f}" for sd in deviations)]
        rows.append(separator.join(cells))
    pairs = [axes[0] + axes[1], axes[1] + axes[2], axes[2] + axes[0]]
    header = [f"%  {scale}   ", *names.split(), "Q", "ns", *(f"sd{a}(m)" for a in (*axes, *pairs)), "age(s)", "ratio"]
    if velocity:
        header += [*(f"v{a}(m/s)" for a in axes), *(f"sdv{a}" for a in (*axes, *pairs))]
    head = ["% program   : RTKLIB ver.2.4.2", f"% ref pos   :  {PLACE[0]:.9f}  {PLACE[1]:.9f}  {PLACE[2]:.4f}", "%"]
    head.append("% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,ns=# of satellites)")
    return "\n".join([*head, separator.join(header), *rows]) + "\n"


def written(folder: Path, text: str) -> Path:
    path = folder / "rover.pos"
    path.write_text(text)
    return path


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize(
    ("calendar", "separator"), [(True, " "), (False, " "), (True, ","), (False, ";"), (False, "\t")]
)
def test_every_layout_gives_the_motion_it_was_written_from(tmp_path, layout, calendar, separator):
    reading = read_gps(written(tmp_path, solution(layout, calendar=calendar, separator=separator)))
    gps = reading.data
    lla, v_n = motion()
    assert np.allclose(gps.time, TOW, rtol=0.0, atol=1e-6)
    assert np.allclose(np.degrees(gps.lla[:, :2]), lla[:, :2], rtol=0.0, atol=2e-9)
    assert np.allclose(gps.lla[:, 2], lla[:, 2], rtol=0.0, atol=2e-4)
    assert np.allclose(gps.v_n, v_n, rtol=0.0, atol=2e-5)
    assert np.allclose(gps.position_sd, np.sqrt(np.diag(COVARIANCE)), rtol=0.0, atol=5e-4)
    assert np.allclose(gps.velocity_sd, 0.1 * np.sqrt(np.diag(COVARIANCE)), rtol=0.0, atol=5e-5)
    assert gps.fix is not None
    assert set(gps.fix) == {2}
    (scale,) = noted(reading, Code.READ_TIME_GPS_WEEK)
    assert (scale["week"], scale["scale"]) == (WEEK, "GPST")


@pytest.mark.parametrize("calendar", [True, False])
@pytest.mark.parametrize(("scale", "ahead"), [("UTC", -18.0), ("JST", 32_400.0 - 18.0)])
def test_other_time_scales_become_gps_time(tmp_path, scale, ahead, calendar):
    reading = read_gps(written(tmp_path, solution("llh", calendar=calendar, scale=scale, ahead=ahead)))
    assert np.allclose(reading.data.time, TOW, rtol=0.0, atol=1e-6)
    (time,) = noted(reading, Code.READ_TIME_GPS_WEEK)
    assert (time["week"], time["scale"], time["leap_s"]) == (WEEK, scale, 18.0)
    assert time.get("ahead_s") == {"UTC": None, "JST": 32_400.0}[scale]


@pytest.mark.parametrize(
    ("date", "leap"), [("1980/02/01", 0), ("2015/06/30", 16), ("2015/07/01", 17), ("2017/01/01", 18)]
)
def test_leap_seconds_are_those_of_the_date(tmp_path, date, leap):
    rows = [f"{date} 23:59:{second:06.3f} 48.0 11.0 500.0 1 9" for second in (57.0, 58.0, 59.0)]
    text = "\n".join([f"%  UTC {LLH} Q ns", *rows]) + "\n"
    seconds = (np.datetime64(date.replace("/", "-")) - np.datetime64("1980-01-06")).astype(int) * 86400 + 86397
    assert read_gps(written(tmp_path, text)).data.time[0] == (seconds + leap) % 604800


def test_the_end_of_the_week_goes_on(tmp_path):
    rows = [f"{week} {tow} 48.0 11.0 500.0 1 9" for week, tow in ((2243, 604799.0), (2244, 0.0), (2244, 1.0))]
    gps = read_gps(written(tmp_path, "\n".join([f"%  GPST {LLH} Q ns", *rows]) + "\n")).data
    assert gps.time.tolist() == [604799.0, 604800.0, 604801.0]


def test_the_sign_of_zero_degrees_counts(tmp_path):
    rows = [f"2244 {i}.0 -0 30 00.0 -0 07 30.0 500.0 1 9" for i in range(4)]
    header = "%  GPST latitude(d'\") longitude(d'\") height(m) Q ns"
    lla = read_gps(written(tmp_path, "\n".join([header, *rows]) + "\n")).data.lla
    assert np.allclose(np.degrees(lla[:, :2]), [-0.5, -0.125], rtol=1e-12)


def test_deviations_of_zero_are_unknown_and_said(tmp_path):
    rows = [f"2244 {i}.0 48.0 11.0 500.0 1 9 0.1 0.2 {0.3 * (i > 0):.1f}" for i in range(4)]
    reading = read_gps(written(tmp_path, "\n".join([f"%  GPST {LLH} Q ns sdn(m) sde(m) sdu(m)", *rows]) + "\n"))
    assert np.isnan(reading.data.position_sd[0, 2])
    assert np.allclose(reading.data.position_sd[1:], [0.1, 0.2, 0.3])
    assert [each["count"] for each in noted(reading, Code.READ_SD_UNKNOWN)] == [1]


def test_heights_above_the_geoid_are_told_by_the_header(tmp_path):
    text = solution("llh").replace("WGS84/ellipsoidal", "WGS84/geodetic")
    assert read_gps(written(tmp_path, text)).facts.height == "msl"
    assert read_gps(written(tmp_path, solution("llh"))).facts.height == "ellipsoidal"


def test_a_cut_last_row_is_left_out(tmp_path):
    reading = read_gps(written(tmp_path, solution("ecef")[:-150]))
    assert len(reading.data.time) == len(TOW) - 1
    assert reading.events[-1].code is Code.ROWS_CUT


def test_it_is_a_reference_too_and_no_imu_file(tmp_path):
    path = written(tmp_path, solution("llh"))
    assert len(read_reference(path).data.time) == len(TOW)
    with refused(InputError, "format.fixes_for_samples"):
        read_imu(path)


def changed(old: str, new: str, layout: str = "llh") -> str:
    text = solution(layout)
    assert old in text
    return text.replace(old, new)


REFUSED = {
    "no header": ("\n".join(solution("llh").splitlines()[5:]) + "\n", "format.rtklib_no_header"),
    "two headers": (solution("llh") + solution("ecef"), "format.rtklib_headers"),
    "unknown scale": (changed("%  GPST", "%  BDT"), "format.rtklib_other_header"),
    "unknown columns": (changed("longitude(deg)", "longitude(rad)"), "format.rtklib_other_header"),
    "Tokyo": (changed("=WGS84/", "=Tokyo/"), "format.rtklib_tokyo"),
    "no reference": (changed("% ref pos", "% nothing", "baseline"), "format.rtklib_no_reference"),
    "moving base": (
        changed("% program", "% pos mode  : Moving-Base\n% program", "baseline"),
        "format.rtklib_no_reference",
    ),
    "not near the Earth": (
        re.sub(r"(\d\d:\d\d:\d\d\S*) \S+", r"\1 17.0", solution("ecef")),
        "format.rtklib_off_earth",
    ),
    "month 13": (changed("2018/12/", "2018/13/"), "format.rtklib_range"),
    "31 February": (changed("2018/12/19", "2019/02/31"), "format.rtklib_no_day"),
    "text": (changed(" 2 11 ", " fix 11 "), "format.cell_no_number"),
    "a cell too many": (changed(" 2 11 ", " 2 2 11 "), "format.row_too_long"),
}


@pytest.mark.parametrize(("text", "code"), REFUSED.values(), ids=REFUSED.keys())
def test_what_is_not_clear_is_refused(tmp_path, text, code):
    with refused(InputError, code) as caught:
        read_gps(written(tmp_path, text))
    assert "rover.pos" in caught.value.where
    assert caught.value.fix


def test_a_bad_cell_is_named_by_line_and_column(tmp_path):
    lines = solution("llh").splitlines()
    lines[7] = lines[7].replace(" 2 11 ", " 2 x ")
    with pytest.raises(InputError) as caught:
        read_gps(written(tmp_path, "\n".join(lines) + "\n"))
    assert caught.value.where.endswith("rover.pos:8:ns")


@real
def test_the_walk_with_an_f9p():
    reading = read_gps(REAL / "walk_calendar_lla_vel.pos")
    assert len(reading.data.time) == 536
    assert reading.data.time[0] == pytest.approx(408639.749, abs=1e-6)  # as iTOW in the receiver's own log
    assert np.degrees(reading.data.lla[0, :2]) == pytest.approx([40.0966916, -105.1471665], abs=1e-9)
    assert reading.facts.rate_hz == pytest.approx(4.0)
    assert reading.data.v_n[0].tolist() == [0.001, -0.002, -0.027]


@real
def test_a_drive_in_earth_fixed_axes():
    reading = read_gps(REAL / "ginav_tokyo_ppk_weektow_ecef.pos")
    gps = reading.data
    assert len(gps.time) == 1059
    assert gps.time[-1] - gps.time[0] == 1241.0
    assert np.degrees(gps.lla[0, :2]) == pytest.approx([35.6293, 139.7871], abs=1e-3)
    assert np.isnan(gps.velocity_sd).all()
    moved = np.column_stack(
        pymap3d.geodetic2ned(*np.degrees(gps.lla[:, :2]).T, gps.lla[:, 2], *np.degrees(gps.lla[0, :2]), gps.lla[0, 2])
    )
    step = np.diff(gps.time) == 1.0
    speed = (np.diff(moved, axis=0) - 0.5 * (gps.v_n[1:] + gps.v_n[:-1]))[step]
    assert np.median(np.linalg.norm(speed, axis=1)) < 0.2  # positions and velocities are of one motion


@real
@pytest.mark.parametrize(
    "name", ["lla_gpst2_111_dd", "lla_gpst2_111_ds", "lla_gpst_000_dd", "lla_utc_111_dd", "lla_jst_111_dd"]
)
def test_variants_of_one_solution_agree(name):
    expected, found = (open_table(REAL / f"variant_{each}.pos") for each in ("ecef_gpst2_111_dd", name))
    numbers = found.cells.read(range(len(found.headers)))
    wanted = expected.cells.read([expected.headers.index(header) for header in found.headers])
    scale = {"lat_deg": 111e3, "lon_deg": 111e3}
    for header, value, want in zip(found.headers, numbers.columns.values(), wanted.columns.values(), strict=True):
        assert value * scale.get(header, 1.0) == pytest.approx(want * scale.get(header, 1.0), abs=2e-3), header


@real
def test_files_that_only_look_like_it_are_refused():
    for name, code in (
        ("variant_header_missing", "format.rtklib_no_header"),
        ("variant_inside_data", "format.cell_no_number"),
    ):
        with refused(InputError, code):
            read_gps(REAL / f"{name}.pos")
    with refused(InputError, "columns.no_header"):
        read_gps(REAL / "libgnsspp_not_rtklib_columns.pos")
