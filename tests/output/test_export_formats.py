"""SBET, UTM, ECEF, other epochs and points: against specifications of formats, PROJ, pymap3d and closed forms."""

from __future__ import annotations

import json

import numpy as np
import pymap3d
import pytest
from pyproj import Proj

from insnav.attitude import wrap_pi
from insnav.earth import lla_offset, ned_offset
from insnav.exceptions import ConfigError, InputError
from insnav.input.readers.rows import read_epochs
from insnav.output.solution_tables import write_run_table
from insnav.output.track_files import UTM_SCALE, body_motion, transverse_mercator, utm_zone
from insnav.session.export import export, track_of
from insnav.types import Trajectory
from tests.filter import drives
from tests.refusals import refused

# Applanix POSPac: little-endian doubles, in this order
_SCALARS = ("roll", "pitch", "platform_heading", "wander_angle")
_VECTORS = tuple(f"{axis}_{what}" for what in ("acceleration", "angular_rate") for axis in "xyz")
_PLACE = ("time", "latitude", "longitude", "altitude", "x_velocity", "y_velocity", "z_velocity")
SBET = np.dtype([(name, "<f8") for name in (*_PLACE, *_SCALARS, *_VECTORS)])
SMRMSG = np.dtype([("time", "<f8"), ("position", "<f8", 3), ("velocity", "<f8", 3), ("attitude_arcmin", "<f8", 3)])
RADIUS, RATE, LAT = 40.0, 0.4, 0.7
POINT = np.array([1.0, -2.0, 0.5])


def circle(step: float = 0.05, offset: float = 0.0) -> Trajectory:
    """Clockwise, level, with the nose along the path; seconds of week 2300 from a Saturday night on."""
    t = offset + np.arange(0.0, 20.0, step)
    heading = RATE * t
    place = RADIUS * np.column_stack([np.sin(heading), 1.0 - np.cos(heading), 0.0 * t])
    v_n = RADIUS * RATE * np.column_stack([np.cos(heading), np.sin(heading), 0.0 * t])
    lla = lla_offset(np.tile([LAT, -2.0, 120.0], (t.size, 1)), place)
    sd = np.tile([0.1, 0.2, 0.3, 0.01, 0.02, 0.03, 0.001, 0.002, 0.003], (t.size, 1))
    return Trajectory(604790.0 + t, lla, v_n, np.column_stack([0 * t, 0 * t, heading % (2 * np.pi)]), sd)


@pytest.fixture
def folder(tmp_path):
    def write(track: Trajectory, *, week: int | None = 2300):
        place = tmp_path / "circle"
        place.mkdir(exist_ok=True)
        write_run_table(place, track, "parquet")
        gps = {"evidence": [], "height": "ellipsoidal"} | ({"gps_week": week} if week else {})
        (place / "run.json").write_text(json.dumps({"kind": "run", "files": {}, "input": {"gps": gps}}))
        return place

    return write


def test_an_sbet_has_the_records_of_its_specification(folder):
    track = circle()
    found = np.frombuffer(export(folder(track), "sbet"), SBET)
    np.testing.assert_allclose(found["time"], track.time, rtol=0.0, atol=1e-6)  # on over the end of the week
    np.testing.assert_allclose(found["latitude"], track.lla[:, 0], rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(found["longitude"], track.lla[:, 1], rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(found["altitude"], track.lla[:, 2])
    # without wander angle, x, y, z of the velocity are North, East, Down
    assert not found["wander_angle"].any()
    for name, column in zip(("x_velocity", "y_velocity", "z_velocity"), track.v_n.T, strict=True):
        np.testing.assert_allclose(found[name], column)
    np.testing.assert_allclose(found["platform_heading"], track.rph[:, 2])
    # centripetal, to the right; gravity is not in it
    inner = found[5:-5]
    np.testing.assert_allclose(inner["y_acceleration"], RADIUS * RATE**2, rtol=1e-4)
    np.testing.assert_allclose(inner["x_acceleration"], 0.0, atol=1e-3)
    np.testing.assert_allclose(inner["z_acceleration"], 0.0, atol=1e-4)
    np.testing.assert_allclose(inner["z_angular_rate"], RATE, rtol=0.0, atol=1e-5)
    np.testing.assert_allclose(inner["x_angular_rate"], 0.0, atol=1e-5)


def test_the_rms_file_is_in_arc_minutes(folder):
    found = np.frombuffer(export(folder(circle()), "smrmsg"), SMRMSG)
    np.testing.assert_allclose(found["position"], [[0.1, 0.2, 0.3]] * found.size, rtol=1e-6)
    np.testing.assert_allclose(found["velocity"], [[0.01, 0.02, 0.03]] * found.size, rtol=1e-6)
    np.testing.assert_allclose(found["attitude_arcmin"], [[3.43775, 6.87549, 10.31324]] * found.size, rtol=1e-5)
    time = np.frombuffer(export(folder(circle(), week=None), "sbet"), SBET)["time"]
    np.testing.assert_allclose(time, circle().time)  # without a date, the times as they are


@pytest.mark.parametrize(
    ("lat", "lon", "zone"),
    [(0.5, 9.0, 32), (-33.9, 151.2, 56), (60.4, 5.3, 32), (78.2, 15.6, 33), (79.0, 8.9, 31), (45.0, -180.0, 1)],
)
def test_utm_is_that_of_proj(lat, lon, zone):
    number, south = utm_zone(np.radians(lat), np.radians(lon))
    assert (number, south) == (zone, lat < 0.0)
    lats, lons = np.linspace(lat - 0.4, lat + 0.4, 30), np.linspace(lon - 1.0, lon + 4.0, 30)
    east, north, turned = transverse_mercator(np.radians(lats), np.radians(lons - (6.0 * zone - 183.0)))
    proj = Proj(proj="utm", zone=zone, south=south, ellps="WGS84")
    x, y = proj(lons, lats)
    np.testing.assert_allclose(500e3 + UTM_SCALE * east, x, rtol=0.0, atol=1.5e-8)
    np.testing.assert_allclose(1e7 * south + UTM_SCALE * north, y, rtol=0.0, atol=1.5e-8)
    factors = proj.get_factors(lons, lats)
    np.testing.assert_allclose(np.degrees(turned), factors.meridian_convergence, rtol=0.0, atol=1e-7)


def rows_of(text: bytes) -> dict[str, np.ndarray]:
    head, *lines = text.decode().splitlines()
    return dict(zip(head.split(","), np.array([line.split(",") for line in lines]).T, strict=True))


def test_utm_and_ecef_columns(folder):
    track = circle()
    place = folder(track)
    lat, lon, height = track.lla.T
    utm, ecef = rows_of(export(place, "utm")), rows_of(export(place, "ecef"))
    assert set(utm["zone"]) == {"11N"}  # 114.6 deg West
    x, y = Proj(proj="utm", zone=11, ellps="WGS84")(np.degrees(lon), np.degrees(lat))
    np.testing.assert_allclose(utm["easting_m"].astype(float), x, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(utm["northing_m"].astype(float), y, rtol=0.0, atol=1e-6)
    # a course in the grid is the course minus the convergence
    course = np.arctan2(np.diff(x), np.diff(y))
    true = RATE * (track.time[:-1] - 604790.0 + 0.025)
    found = np.degrees(wrap_pi(true - course))
    np.testing.assert_allclose(found, utm["convergence_deg"].astype(float)[:-1], rtol=0.0, atol=2e-3)
    at = np.column_stack(pymap3d.geodetic2ecef(lat, lon, height, deg=False))
    got = np.column_stack([ecef[name].astype(float) for name in ("x_m", "y_m", "z_m")])
    np.testing.assert_allclose(got, at, rtol=0.0, atol=1e-6)
    v = np.column_stack([ecef[name].astype(float) for name in ("vx_m_s", "vy_m_s", "vz_m_s")])
    np.testing.assert_allclose(v[1:-1], (at[2:] - at[:-2]) / 0.1, rtol=0.0, atol=2e-3)


def test_utm_ends_towards_the_poles(folder):
    track = circle()
    track.lla[:, 0] += 0.8
    with refused(ConfigError, "output.beyond_utm"):
        export(folder(track), "utm")


def test_interpolation_is_as_exact_as_it_says(folder):
    """Rows from the exact motion of a drive, ten a second; between them the exact motion again."""
    motion = drives.truth(1)
    time = 1000.0 + np.arange(1, 700) / 10.0
    at = motion.evaluate(time)
    place = folder(Trajectory(time, at.lla, at.v_n, at.rph))
    epochs = np.sort(np.random.default_rng(1).uniform(1001.0, 1069.0, 500))
    track, found = track_of(place, epochs=epochs)
    true, way = motion.evaluate(epochs), track.trajectory
    assert np.abs(ned_offset(way.lla, true.lla)).max() < 2.0 * found[0]["position_m"]
    assert np.abs(way.v_n - true.v_n).max() < 2.0 * found[0]["velocity_m_s"]
    assert np.abs(wrap_pi(way.rph - true.rph)).max() < 2.0 * found[0]["attitude_rad"]
    assert 0.3 * found[0]["attitude_rad"] < np.abs(wrap_pi(way.rph - true.rph)).max()
    # rows of the run are left as they are
    exact, none = track_of(place, epochs=time[5:9])
    np.testing.assert_allclose(exact.trajectory.lla, at.lla[5:9], rtol=0.0, atol=1e-15)
    assert none == ()


def test_rows_a_second_fall_on_round_epochs(folder):
    track, _ = track_of(folder(circle(offset=0.013)), interval=0.25)
    np.testing.assert_allclose(track.trajectory.time, np.arange(604790.25, 604809.9, 0.25), rtol=0.0, atol=1e-9)


def test_a_point_moves_on_its_own_circle(folder):
    way = track_of(folder(circle()), point=POINT)[0].trajectory
    # 2 m to the left of a clockwise circle, and 1 m ahead
    size = np.hypot(RADIUS + 2.0, 1.0)
    np.testing.assert_allclose(np.linalg.norm(way.v_n, axis=1)[3:-3], RATE * size, rtol=1e-4)
    np.testing.assert_allclose(way.lla[:, 2], 119.5, rtol=0.0, atol=1e-3)
    # heading error of 3 mrad at 2.24 m, beside 0.1 m
    sd = np.hypot(0.1**2 + 0.2**2, 0.0) + (0.003**2) * 5.0 + 0.5**2 * (0.001**2 + 0.002**2)
    np.testing.assert_allclose((way.sd[:, :2] ** 2).sum(axis=1), sd, rtol=1e-6)


def test_a_gap_and_few_rows_have_no_wild_motion():
    track = circle()
    kept = np.r_[0:100, 200:203, 300:400]
    rate, acceleration = body_motion(track.rows(kept))
    assert np.abs(rate[:, 2]).max() < 1.01 * RATE
    assert np.abs(acceleration).max() < 1.02 * RADIUS * RATE**2
    assert np.abs(rate[100:103]).max() < 1e-5  # of the level axes alone


def test_epochs_are_read_and_refused(tmp_path, folder):
    path = tmp_path / "triggers.txt"
    path.write_text("# camera\nevent_s, name\n604791.5,a\n604792.125,b\n")
    np.testing.assert_array_equal(read_epochs(path), [604791.5, 604792.125])
    for text, code in (
        ("time\n", "input.no_epochs"),
        ("1.0\nx\n", "input.no_epoch"),
        ("2.0\n1.0\n", "input.epochs_backward"),
        ("1.0\nnan\n", "input.epochs_backward"),
    ):
        path.write_text(text)
        with refused(InputError, code):
            read_epochs(path)
    with refused(InputError, "session.epochs_outside"):
        track_of(folder(circle()), epochs=np.array([1.0, 2.0]))
    found = track_of(folder(circle()), epochs=np.array([604790.0, 604900.0]))[1]
    assert [(each["count"], each["total"]) for each in found] == [(1, 2)]
