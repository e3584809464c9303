"""Text files without the usual header: KF-GINS and VectorNav, written by their descriptions, and real ones."""

from __future__ import annotations

import numpy as np
import pytest

from insnav.exceptions import InputError
from insnav.findings import Code, Severity, of_code
from insnav.input import read_gps, read_imu, read_reference
from insnav.input.formats.registry import open_tables
from tests.input.recordings import FIXES, REAL, SAMPLES, TOW, WEEK, real, same_places
from tests.input.written_logs import inertial_explorer
from tests.refusals import refused


def kf_gins(kind: str) -> str:
    """Rows as the README of KF-GINS describes them."""
    if kind == "imu":
        rows = np.column_stack([TOW + SAMPLES.t, SAMPLES.gyro * 0.01, SAMPLES.accel * 0.01])
    elif kind == "reference":
        heading = FIXES.heading[:, None]
        attitude = np.hstack([np.zeros((len(heading), 2)), heading])
        rows = np.column_stack([np.full(len(heading), WEEK), TOW + FIXES.t, FIXES.lla, FIXES.v_n, attitude])
    else:
        n = len(FIXES.t)
        rows = np.column_stack([TOW + FIXES.t, FIXES.lla, np.tile([0.02, 0.03, 0.05], (n, 1))])
        if kind == "gps with velocity":
            rows = np.column_stack([rows, FIXES.v_n, np.tile([0.1, 0.2, 0.3], (n, 1))])
    return "\n".join(" ".join(f"{x:.10f}" for x in row) for row in rows) + "\n"


def vectornav() -> str:
    """Names of the binary outputs of a VN-310, samples and fixes in one file, each fix held between two."""
    head = "Time [s],Time::TimeStartup [ns],Time::GpsTow [ns],Time::GpsWeek,"
    head += ",".join(f"IMU::Uncomp{s}::{a} [{u}]" for s, u in (("Gyro", "rad/s"), ("Accel", "m/s^2")) for a in "XYZ")
    head += ",IMU::Temp [Celsius],GNSS1::Tow [ns],GNSS1::Week,GNSS1::Fix,GNSS1::PosLla::latitude [deg],"
    head += "GNSS1::PosLla::longitude [deg],GNSS1::PosLla::altitude [m]," + ",".join(
        f"GNSS1::VelNed::{a} [m/s]" for a in "NED"
    )
    head += "," + ",".join(f"GNSS1::PosU::{a} [m]" for a in "NED") + ",GNSS1::VelU [m/s],Satellites"
    lines = [head]
    for i, t in enumerate(SAMPLES.t[:780]):
        fix = i // 20
        tow = round((TOW + FIXES.t[fix]) * 1e9)
        imu = [*SAMPLES.gyro[i], *SAMPLES.accel[i], 31.5]
        gnss = [tow, WEEK, 3, *FIXES.lla[fix], *FIXES.v_n[fix], 1.0, 2.0, 3.0, 0.2, "[0|3|1][0|7|1]"]
        lines.append(",".join(map(str, [t, i, round((TOW + t) * 1e9), WEEK, *imu, *gnss])))
    return "\n".join(lines) + "\n"


@pytest.fixture
def save(tmp_path):
    def write(text: str):
        path = tmp_path / "file.txt"
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("kind", ["gps", "gps with velocity"])
def test_kf_gins_fixes(save, kind):
    data = read_gps(save(kf_gins(kind))).data
    assert np.allclose(data.time, TOW + FIXES.t)
    assert same_places(data)
    assert np.allclose(data.position_sd, [0.02, 0.03, 0.05])
    if kind != "gps":
        assert np.allclose(data.v_n, FIXES.v_n)
        assert np.allclose(data.velocity_sd, [0.1, 0.2, 0.3])


def test_kf_gins_increments_and_reference(save):
    data = read_imu(save(kf_gins("imu"))).data
    assert data.sampling == "increment"
    assert np.allclose(data.accel, 0.01 * SAMPLES.accel)
    reference = read_reference(save(kf_gins("reference"))).data
    assert same_places(reference)
    assert np.allclose(np.degrees(reference.rph[:, 2]), FIXES.heading)


@pytest.mark.parametrize(
    "change",
    [
        lambda n: np.column_stack([n[:, 0], n[:, 1:] * 1000.0]),  # not gravity
        lambda n: n[:, [1, 2, 3, 4, 5, 6, 0]] * [1, 1, 1, 2, 2, 2, 1],  # time last, but not gravity
        lambda n: n[::-1],  # time goes back
        lambda n: n[:, [1, 0, 2, 3, 4, 5, 6]],
        lambda n: n[:, :6],
        lambda n: np.column_stack([n, n[:, 0]]),
    ],
)
def test_numbers_that_could_be_anything_are_refused(save, change):
    rows = change(np.array([list(map(float, line.split())) for line in kf_gins("imu").splitlines()]))
    with refused(InputError, "columns.no_header"):
        read_imu(save("\n".join(" ".join(map(repr, row)) for row in rows.tolist())))


def test_vectornav(save):
    path = save(vectornav())
    imu, gps = read_imu(path), read_gps(path)
    assert np.allclose(imu.data.time, TOW + SAMPLES.t[:780], atol=1e-9)
    assert np.allclose(imu.data.accel, SAMPLES.accel[:780])
    assert np.allclose(imu.data.temperature, 31.5)
    assert len(gps.data.time) == 39
    assert same_places(gps.data, type(FIXES)(FIXES.t[:39]))
    assert np.allclose(gps.data.position_sd, [1.0, 2.0, 3.0])
    assert np.allclose(gps.data.velocity_sd, 0.2)
    assert set(gps.data.fix) == {5}


def test_a_cut_last_row_is_said(save):
    path = save(vectornav()[:-300])
    (cut,) = of_code(read_imu(path).events, Code.ROWS_CUT)
    assert (cut.subject, cut.severity, cut["file"]) == ("imu", Severity.WARNING, path.name)


@real
def test_real_vectornav():
    folder = REAL / "vectornav"
    imu = read_imu(folder / "lckf_vn310-imu.csv")
    assert imu.facts.n_used == 1612
    assert imu.facts.rate_hz == pytest.approx(50.0, rel=1e-3)
    gps = read_gps(folder / "lckf_vn310-gnss.csv").data
    assert np.allclose(np.degrees(gps.lla[0, :2]), (48.7807, 9.1716), atol=1e-4)
    assert imu.data.time[0] < gps.time[1] < imu.data.time[-1]
    assert len(read_gps(folder / "fixedsize_vn310-gnss.csv").data.time) == 12
    (cut,) = of_code(read_imu(folder / "fixedsize_vn310-imu.csv").events, Code.ROWS_CUT)
    assert cut.subject == "imu"
    assert len(read_gps(folder / "static_vn310-gnss.csv").data.time) == 48  # it starts without a fix
    assert "reference" in open_tables(folder / "fixedsize_vn310-gnss.csv")


@pytest.mark.parametrize("kind", ["blanks", "commas", "dms", "utc"])
def test_inertial_explorer(save, kind):
    reading = read_reference(save(inertial_explorer(kind=kind).decode()))
    data = reading.data
    assert reading.facts.gps_week == WEEK
    assert np.allclose(data.time, TOW + FIXES.t, atol=1e-6)
    assert same_places(data, metres=1e-3)
    assert np.allclose(data.v_n, FIXES.v_n, atol=1e-5)
    assert np.allclose(np.degrees(data.rph), np.column_stack([np.tile([0.5, -1.0], (len(FIXES.t), 1)), FIXES.heading]))
    assert np.allclose(data.sd[:, :3], [0.1, 0.2, 0.3])
    gps = read_gps(save(inertial_explorer(kind=kind, attitude=False).decode()))
    assert same_places(gps.data, metres=1e-3)
    with refused(InputError, "format.no_samples"):
        read_imu(save(inertial_explorer(kind=kind).decode()))


@real
def test_an_export_without_positions_says_so():
    with refused(InputError, "format.explorer_no_positions"):
        read_gps(REAL / "inertial_explorer" / "ie870_trolley_plotprofile.txt")
