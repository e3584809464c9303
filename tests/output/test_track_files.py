"""Runs in the formats of other programs: read back by insnav's readers, by evo and by JSON."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from insnav.exceptions import ConfigError
from insnav.input import read_gps, read_reference
from insnav.output.solution_tables import write_run_table
from insnav.output.track_files import WRITERS
from insnav.session.export import export
from insnav.types import Trajectory
from tests.input.recordings import FIXES, TOW, UNIX, WEEK, Motion, same_places
from tests.refusals import refused

MOTION = Motion(FIXES.t + 0.012345)
SD = np.tile([0.05, 0.06, 0.1, 0.01, 0.02, 0.03, 0.001, 0.002, 0.003], (len(FIXES.t), 1))


def trajectory(start: float = TOW) -> Trajectory:
    lla = MOTION.lla * [np.pi / 180.0, np.pi / 180.0, 1.0]
    rph = np.column_stack([0.01 + 0.0 * MOTION.t, -0.02 + 0.0 * MOTION.t, np.radians(MOTION.heading)])
    return Trajectory(start + MOTION.t, lla, MOTION.v_n, rph, SD)


@pytest.fixture
def run(tmp_path):
    def write(start: float = TOW, week: int | None = WEEK):
        folder = tmp_path / "run"
        folder.mkdir(exist_ok=True)
        write_run_table(folder, trajectory(start))
        gps = {"evidence": [], "height": "ellipsoidal"} | ({"gps_week": week} if week else {})
        facts = {"kind": "run", "files": {}, "input": {"gps": gps}}
        (folder / "run.json").write_text(json.dumps(facts))
        return folder

    return write


@pytest.mark.parametrize("kind", ["gpx", "pos", "nmea"])
def test_what_was_written_is_read_again(run, tmp_path, kind):
    path = tmp_path / "track"
    path.write_bytes(export(run(), kind))
    data = read_gps(path).data
    assert np.allclose(data.time, TOW + MOTION.t, atol=2e-6)
    assert same_places(data, MOTION, 1e-3)
    if kind != "gpx":
        assert np.allclose(data.v_n[:, :2], MOTION.v_n[:, :2], atol=1e-4)
        assert np.allclose(data.position_sd, SD[:, :3])
    if kind == "nmea":
        assert data.heading is not None
        assert np.allclose(np.degrees(data.heading), MOTION.heading, atol=1e-3)
    if kind == "pos":
        assert np.allclose(data.velocity_sd, SD[:, 3:6])
        assert set(data.fix) == {1}


def test_csv_is_a_reference(run, tmp_path):
    path = tmp_path / "track.csv"
    path.write_bytes(export(run(), "csv"))
    data = read_reference(path).data
    assert same_places(data, MOTION, 1e-4)
    assert np.allclose(data.rph[:, 2], np.radians(MOTION.heading))


@pytest.mark.parametrize("kind", ["tum", "euroc"])
def test_evo_reads_poses(run, tmp_path, kind):
    from evo.tools import file_interface

    path = tmp_path / "track"
    path.write_bytes(export(run(), kind))
    reader = {"tum": file_interface.read_tum_trajectory_file, "euroc": file_interface.read_euroc_csv_trajectory}[kind]
    poses = reader(str(path))
    start = UNIX if kind == "euroc" else TOW
    assert np.allclose(poses.timestamps, start + MOTION.t, atol=1e-6)
    moved = np.linalg.norm(poses.positions_xyz[-1] - poses.positions_xyz[0])
    angle = 0.25 * (MOTION.t[-1] - MOTION.t[0])
    assert moved == pytest.approx(2.0 * 40.0 * np.sin(angle / 2.0), abs=0.01)  # the chord of the circle
    assert poses.check()[0]


def test_geojson_and_kml(run):
    line = json.loads(export(run(), "geojson"))["features"][0]
    (lon, lat, height) = line["geometry"]["coordinates"][0][0]
    assert np.allclose((lat, lon, height), MOTION.lla[0], atol=1e-6)
    assert line["properties"]["times"][0] == "2025-08-27T11:59:42.012345Z"
    assert b"<coordinates>151.5" in export(run(), "kml")


def test_geojson_has_one_time_for_each_point(run):
    """A single point between two cuts at the date line is no line."""
    folder = run()
    lla = trajectory().lla
    lla[:, 1] = np.radians(179.0)
    lla[5, 1] = lla[-1, 1] = np.radians(-179.0)
    write_run_table(folder, replace(trajectory(), lla=lla))
    line = json.loads(export(folder, "geojson"))["features"][0]
    pieces, last = line["geometry"]["coordinates"], len(MOTION.t) - 1
    assert [len(piece) for piece in pieces] == [5, last - 6]
    expected = np.delete(TOW + MOTION.t, [5, last])
    assert np.allclose(line["properties"]["time_s"], expected)
    assert len(line["properties"]["times"]) == expected.size


def test_unix_times_need_no_week(run, tmp_path):
    path = tmp_path / "track"
    path.write_bytes(export(run(start=UNIX, week=None), "pos"))
    assert np.allclose(read_gps(path).data.time, TOW + MOTION.t, atol=2e-6)


def test_formats_with_dates_ask_for_the_week(run):
    folder = run(start=5.0, week=None)
    for kind in WRITERS:
        if kind in ("gpx", "pos", "nmea", "bag"):
            with refused(ConfigError, "output.no_date"):
                export(folder, kind)
            assert export(folder, kind, week=WEEK)
        else:
            assert export(folder, kind)
    with pytest.raises(ConfigError, match=r"session.unknown_format"):
        export(folder, "shp")


def test_a_bag_is_read_again_by_rosbags_and_here(run, tmp_path):
    from rosbags.highlevel import AnyReader

    path = tmp_path / "track.bag"
    path.write_bytes(export(run(), "bag"))
    gps, reference = read_gps(path).data, read_reference(path).data
    assert np.allclose(gps.time, UNIX + MOTION.t, atol=2e-6)
    assert same_places(gps, MOTION, 1e-3)
    assert np.allclose(gps.v_n, MOTION.v_n, atol=1e-6)
    assert np.allclose(gps.position_sd, SD[:, :3])
    assert same_places(reference, MOTION, 2e-3)
    assert np.allclose(reference.v_n, MOTION.v_n, atol=1e-5)
    rph = trajectory(TOW).rph
    assert np.allclose(np.degrees(np.angle(np.exp(1j * (reference.rph - rph)))), 0.0, atol=1e-4)
    with AnyReader([path]) as reader:
        messages = [
            reader.deserialize(raw, each.msgtype) for each, _, raw in reader.messages() if each.topic == "/odom"
        ]
    assert len(messages) == len(MOTION.t)
    assert messages[0].child_frame_id == "base_link"
    v = messages[0].twist.twist.linear
    assert np.allclose([v.x, v.y, v.z], [np.linalg.norm(MOTION.v_n[0]), 0.0, 0.0], atol=0.2)
