"""Positions and velocities that contradict each other, and the name of the confusion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import insnav
from insnav.exceptions import InputError
from insnav.findings import Code, of_code
from insnav.input import read_gps
from insnav.input.interpret.velocities import fit_velocities, scales
from insnav.messages import LANGUAGES, render_error, sentence
from insnav.types import GpsData
from tests.filter import drives
from tests.input.files import noted
from tests.shared import recorded


def _forward(v_n: np.ndarray) -> np.ndarray:
    """Speed as a velocity East, as drivers that publish forward, left, up are read."""
    return np.column_stack([0.0 * v_n[:, 0], np.linalg.norm(v_n[:, :2], axis=1), v_n[:, 2]])


CONFUSED = {
    "-vn, -ve": lambda gps: replace(gps, v_n=-gps.v_n),
    "ve, vn": lambda gps: replace(gps, v_n=gps.v_n[:, [1, 0, 2]] * [1.0, 1.0, -1.0]),
    "km/h": lambda gps: replace(gps, v_n=3.6 * gps.v_n),
    "knot": lambda gps: replace(gps, v_n=gps.v_n / 0.514444),
    "mph": lambda gps: replace(gps, v_n=gps.v_n / 0.44704),
    "positions_exchanged": lambda gps: replace(gps, lla=gps.lla[:, [1, 0, 2]]),
    "velocity_in_vehicle": lambda gps: replace(gps, v_n=_forward(gps.v_n)),
    "positions_radians": lambda gps: replace(gps, lla=gps.lla * [np.pi / 180.0, np.pi / 180.0, 1.0]),
    "heights_feet": lambda gps: replace(gps, lla=gps.lla * [1.0, 1.0, 1.0 / 0.3048]),
    "velocity_up": lambda gps: replace(gps, v_n=gps.v_n * [1.0, 1.0, -1.0]),
}


def fixes(seed: int) -> GpsData:
    return drives.noisy_gps(drives.perfect_gps(laps=8), np.random.default_rng([75, seed]))


def confusion(gps: GpsData) -> str:
    fit = fit_velocities(gps.time, gps.lla, gps.v_n)
    if fit is None:
        return "no telling"
    return {"velocity_names": ", ".join(fit.columns), "velocity_unit": fit.unit}.get(fit.confusion, fit.confusion)


def test_true_fixes_are_not_accused():
    for seed in range(10):
        assert confusion(fixes(seed)) == ""
        for course in (0.0, 3.0, 45.0, 88.0):
            assert confusion(straight(course, seed)) == ""


def straight(course: float, seed: int) -> GpsData:
    """Fixes of a straight drive at 8 m/s, with noise of 1 m and 0.1 m/s."""
    rng, time = np.random.default_rng([76, seed]), np.arange(120.0)
    v_n = 8.0 * np.array([np.cos(np.deg2rad(course)), np.sin(np.deg2rad(course)), 0.0])
    metres = np.outer(time, v_n) + rng.normal(size=(120, 3))
    lla = [0.8, 0.2, 100.0] + metres / [6.37e6, 6.37e6 * np.cos(0.8), -1.0]
    noisy = v_n + 0.1 * rng.normal(size=(120, 3))
    return GpsData(time, lla, noisy, np.ones((120, 3)), np.full((120, 3), 0.1))


@pytest.mark.parametrize("course", [20.0, 70.0, 160.0])
def test_forward_velocities_of_a_straight_drive_are_not_north_or_east(course):
    for seed in range(3):
        gps = straight(course, seed)
        speed = np.linalg.norm(gps.v_n[:, :2], axis=1)
        for forward in (0, 1):  # of drivers that publish forward, left, up as x, y, z and as y, x, -z
            v_n = np.zeros_like(gps.v_n)
            v_n[:, forward] = speed
            assert confusion(replace(gps, v_n=v_n)) == "velocity_in_vehicle"


def test_velocities_of_a_vehicle_that_moves_sideways_are_recognised():
    """A multicopter whose nose is 40 deg off its course."""
    c, s = np.cos(np.deg2rad(40.0)), np.sin(np.deg2rad(40.0))
    for seed in range(3):
        gps = fixes(seed)
        v_n = _forward(gps.v_n) @ [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]
        assert confusion(replace(gps, v_n=v_n)) == "velocity_in_vehicle"


def test_a_vertical_velocity_alone_is_no_velocity(tmp_path):
    """Columns forward, left, up: the vertical one alone made every velocity a rejected one."""
    gps = straight(20.0, 0)
    rows = np.column_stack([gps.time, np.rad2deg(gps.lla[:, :2]), gps.lla[:, 2], gps.v_n])
    names = ["time_s", "lat_deg", "lon_deg", "height_m", "vel_forward", "vel_left", "vel_up"]
    pd.DataFrame(rows, columns=names).to_csv(tmp_path / "gps.csv", index=False)
    assert not np.isfinite(read_gps(tmp_path / "gps.csv").data.v_n).any()


def test_false_fixes_and_an_outage_are_no_confusion():
    gps = fixes(0)
    off = gps.lla.copy()
    off[100:180] += [1e-4, 1e-4, 50.0]
    gone = np.ones(gps.time.shape[0], dtype=bool)
    gone[200:300] = False
    v_n = gps.v_n.copy()
    v_n[::7] = np.nan
    assert confusion(replace(gps, lla=off, v_n=v_n).rows(gone)) == ""


@pytest.mark.parametrize("name", CONFUSED)
def test_each_confusion_has_its_name(name):
    for seed in range(3):
        gps = CONFUSED[name](fixes(seed))
        assert name == confusion(gps)
        fit = fit_velocities(gps.time, gps.lla, gps.v_n)
        assert fit is not None
        for lang in LANGUAGES:
            said = render_error("gps.confused_columns", "why", {"confusion": fit.confusion}, lang)
            assert fit.confusion not in said


RECORDED = ("rtklib_drive_20250708", "ixr_tsukishima_20210412", "umn_thor75_uav")


@pytest.mark.parametrize("drive", RECORDED)
def test_a_velocity_up_and_feet_are_told_on_recorded_drives(drive):
    gps = read_gps(recorded(drive) / "gps.csv").data
    assert confusion(gps) == ""
    for name in ("velocity_up", "heights_feet"):
        assert name == confusion(CONFUSED[name](gps))


def test_heights_that_wander_before_the_start_of_a_flight_accuse_nobody():
    gps = read_gps(recorded("umn_thor75_uav") / "gps.csv").data
    v_n = np.where((gps.time < gps.time[0] + 100.0)[:, None], gps.v_n, np.nan)  # those of the ground
    assert confusion(replace(gps, v_n=v_n)) == ""
    later = gps.rows((gps.time > gps.time[0] + 100.0) & (gps.time < gps.time[0] + 204.0))
    assert confusion(later) == ""


def test_long_climbs_tell_it_where_noise_hides_short_ones():
    sample = read_gps(Path(__file__).parents[2] / "trajectories" / "sample" / "gps.csv").data
    assert confusion(sample) == ""
    assert confusion(CONFUSED["velocity_up"](sample)) == "velocity_up"


def test_a_confused_file_is_refused():
    drive = insnav.simulate("round_trip", seed=1)
    with pytest.raises(InputError, match=r"gps.confused_columns") as caught:
        insnav.load(drive.imu.data, CONFUSED["positions_exchanged"](drive.gps.data))
    assert caught.value.values["confusion"] == "positions_exchanged"
    assert caught.value.exit_code == 3


@pytest.mark.parametrize(("unit", "factor"), [("m/s", 1.0), ("km/h", 3.6), ("knot", 1.0 / 0.514444)])
def test_a_vertical_speed_that_comes_from_the_heights_has_not_the_unit_of_the_speed(unit, factor, tmp_path):
    """It was divided too, and the heights said to be in feet."""
    gps = read_gps(Path(__file__).parents[2] / "trajectories" / "sample" / "gps.csv").data
    speed, course = np.hypot(*gps.v_n[:, :2].T), np.rad2deg(np.arctan2(gps.v_n[:, 1], gps.v_n[:, 0])) % 360.0
    columns = [gps.time, *np.rad2deg(gps.lla[:, :2].T), gps.lla[:, 2], factor * speed, course]
    names = ["time", "lat", "lon", "height", "speed", "course"]
    pd.DataFrame(np.column_stack(columns), columns=names).to_csv(tmp_path / "gps.csv", index=False)
    read = read_gps(tmp_path / "gps.csv")
    found = [(each["unit"], each["ratio"]) for each in noted(read, Code.READ_VELOCITY_UNIT)]
    assert found == ([] if unit == "m/s" else [(unit, pytest.approx(1.0 / factor, rel=0.05))])
    np.testing.assert_allclose(read.data.v_n[:, :2], gps.v_n[:, :2], atol=0.03 * 16.0)
    assert confusion(read.data) == ""


def test_a_reference_whose_heights_are_in_feet_is_refused():
    """Its velocities are right: it is the heights by which the solution would be judged."""
    drive = insnav.simulate("aircraft_pattern", seed=1)
    truth = drive.reference.data
    confused = replace(truth, lla=truth.lla * [1.0, 1.0, 1.0 / 0.3048])
    with pytest.raises(InputError, match=r"ref.confused_columns"):
        insnav.load(drive.imu.data, drive.gps.data, ref=confused)


def moved_otherwise(gps: GpsData, north: float = 1.0, east: float = 1.0, up: float = 1.0) -> GpsData:
    """Fixes whose positions move so many times as far from the first."""
    return replace(gps, lla=gps.lla[0] + (gps.lla - gps.lla[0]) * [north, east, up])


@pytest.mark.parametrize("seed", range(4))
def test_a_scale_of_positions_against_velocities_is_told_for_its_axis(seed):
    gps = fixes(seed)
    assert not scales(gps.time, gps.lla, gps.v_n)
    for factors in ({"north": 0.9}, {"east": 1.1}, {"north": 1.06, "east": 1.06}):
        found = scales(gps.time, moved_otherwise(gps, **factors).lla, gps.v_n)
        assert {name for name, _, _ in found} == set(factors)
        for name, size, sd in found:
            assert abs(size - factors[name]) < max(3.0 * sd, 0.015)
    slower = replace(gps, v_n=0.9 * gps.v_n)
    assert {"north", "east"} <= {name for name, _, _ in scales(slower.time, slower.lla, slower.v_n)}


@pytest.mark.parametrize("drive", ["rtklib_drive_20250708", "ixr_tsukishima_20210412", "umn_thor75_uav"])
def test_recorded_fixes_have_one_scale_in_any_three_minutes(drive):
    gps = read_gps(recorded(drive) / "gps.csv").data
    for begin in np.arange(gps.time[0], gps.time[-1] - 180.0, 60.0):
        some = gps.rows(np.flatnonzero((gps.time >= begin) & (gps.time < begin + 180.0)))
        assert not scales(some.time, some.lla, some.v_n)
    assert scales(gps.time, moved_otherwise(gps, east=0.95).lla, gps.v_n)[0][0] == "east"


def test_heights_that_move_twice_as_far_as_velocities_say_are_a_warning():
    drive = insnav.simulate("mountain_road", imu="automotive", gps="rtk", seed=4)
    gps = drive.gps.data
    first = gps.rows(gps.time < gps.time[0] + 200.0)
    imu = drive.imu.data.rows(drive.imu.data.time < gps.time[0] + 200.0)
    wrong = insnav.load(imu, moved_otherwise(first, up=2.0))
    (scale,) = of_code(wrong.gps.events, Code.GPS_SCALE)
    assert scale["axis"] == "up and down"
    assert scale["ratio"] == pytest.approx(2.0, abs=max(3.0 * scale["sd"], 0.03))
    assert sentence(scale) in wrong.navigate().page().warnings
    assert not any(of_code(insnav.load(imu, first).gps.events, Code.GPS_SCALE))
