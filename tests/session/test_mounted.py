"""An IMU that sits anyhow in the vehicle: turned, told, or refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import insnav
from insnav.alignment import find_mounting
from insnav.attitude import dcm_from_rph, quat_from_rph, wrap_pi
from insnav.exceptions import InputError
from insnav.findings import OF_THE_IMU, Code, Finding, Severity, of_code
from insnav.input import read_gps, read_imu
from insnav.input.interpret.physics import axes_matrix
from insnav.kernels.smoother import STATE
from insnav.messages import sentence
from insnav.simulate import GpsErrors
from insnav.steps.check_given import doubt_mounting
from insnav.steps.mounting import _travel
from insnav.strapdown import intervals
from insnav.units import DEG
from tests.alignment.test_alignment import STILL
from tests.filter.drives import without_velocities
from tests.refusals import refused
from tests.shared import recorded
from tests.simulate.motions import Segment, drive, measured


@pytest.fixture(scope="module")
def plain() -> insnav.Drive:
    return insnav.simulate("city", seed=2)


def turned(plain, matrix: np.ndarray, **inputs) -> insnav.Drive:
    imu = plain.imu.data
    imu = replace(imu, gyro=imu.gyro @ matrix.T, accel=imu.accel @ matrix.T)
    return insnav.load(imu, plain.gps.data, **inputs)


def test_an_imu_as_it_should_be_is_left_alone(plain):
    again = turned(plain, np.eye(3))
    np.testing.assert_array_equal(again.imu.data.gyro, plain.imu.data.gyro)
    assert again.model.mounting_yaw.value == 0.0
    assert again.notes == plain.notes


@pytest.mark.parametrize("letters", ["RBD", "BLD", "FLU", "FDL", "URF"])
def test_square_mountings_are_turned_to_the_vehicle_and_told(plain, letters):
    found = turned(plain, axes_matrix(letters).T)
    np.testing.assert_allclose(found.imu.data.gyro, plain.imu.data.gyro, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.imu.data.accel, plain.imu.data.accel, rtol=0, atol=1e-12)
    assert found.imu.facts.axes == letters
    (axes,) = of_code(found.notes, Code.MOUNTING_ALONG_AXES)
    assert axes["axes"] == letters
    assert axes["windows"] > 1
    assert axes.severity is Severity.ASSUMPTION


def test_a_yaw_is_told_and_heading_is_that_of_the_imu(plain):
    found = turned(plain, dcm_from_rph(np.array([0.0, 0.0, 30.0 * DEG])).T)
    (yaw,) = of_code(found.notes, Code.MOUNTING_YAW)
    assert yaw["yaw_rad"] == pytest.approx(30.0 * DEG, abs=4.0 * yaw["sd_rad"])
    np.testing.assert_allclose([float(each) for each in yaw["axes"].split(",")], [0.0, 0.0, 30.0], atol=5.0)
    result = found.navigate(output_interval=1.0)
    assert sentence(yaw)[:40] in result.summary()
    run = result.found.run
    assert run.smoothed is not None
    true = plain.reference.data
    expected = np.interp(run.smoothed.solution.time, true.time, np.unwrap(true.rph[:, 2])) + 30.0 * DEG
    off = np.abs(wrap_pi(run.smoothed.solution.rph[:, 2] - expected))
    assert np.median(off) < 1.5 * DEG
    assert np.mean(off < 3.0 * run.smoothed.solution.sd[:, 8]) > 0.97


def test_an_imu_that_leans_points_along_no_axis_of_the_vehicle(plain):
    """Two flights were said to have x, y, z down, forward, right and left, up, forward: attitudes 30 to 70 deg off."""
    angles = np.array([40.0, 35.0, -50.0]) * DEG
    found = turned(plain, dcm_from_rph(angles).T)
    (tilted,) = of_code(found.notes, *(code for code in Code if code.startswith("mounting")))
    assert tilted.code is Code.MOUNTING_TILTED
    assert tilted["yaw_rad"] == pytest.approx(-50.0 * DEG, abs=5.5 * DEG)
    np.testing.assert_allclose([float(each) for each in tilted["axes"].split(",")], angles / DEG, atol=5.0)
    result = found.navigate(output_interval=1.0)
    assert sentence(tilted)[:40] in result.summary()
    solution = result.found.run.smoothed.solution
    true = plain.reference.data
    vehicle = np.column_stack([np.interp(solution.time, true.time, np.unwrap(each)) for each in true.rph.T])
    expected = dcm_from_rph(vehicle) @ dcm_from_rph(angles)
    left = dcm_from_rph(solution.rph) @ np.swapaxes(expected, 1, 2)
    off = np.arccos(np.clip(0.5 * (np.trace(left, axis1=1, axis2=2) - 1.0), -1.0, 1.0))
    assert np.median(off) < 1.5 * DEG


@pytest.mark.parametrize(("gps", "letters"), [("single", "RBD"), ("dgps", "LFD"), ("rtk", "BLD"), ("single", "FRD")])
def test_positions_alone_tell_the_mounting_as_velocities_do(gps, letters):
    """Headings of an IMU turned by 90 or 180 deg were 54 to 176 deg off."""
    plain = insnav.simulate("city", imu="industrial", gps=gps, seed=11)
    plain = replace(
        plain, recording=replace(plain.recording, gps=replace(plain.gps, data=without_velocities(plain.gps.data)))
    )
    found = turned(plain, axes_matrix(letters).T)
    np.testing.assert_allclose(found.imu.data.gyro, plain.imu.data.gyro, rtol=0, atol=1e-12)
    assert [each["axes"] for each in of_code(found.notes, Code.MOUNTING_ALONG_AXES)] == [letters] * (letters != "FRD")
    assert not any(of_code(found.notes, Code.MOUNTING_ASSUMED))
    if gps != "dgps":
        return
    heading, true = found.navigate(output_interval=1.0).found.run.smoothed.solution, plain.reference.data
    expected = np.interp(heading.time, true.time, np.unwrap(true.rph[:, 2]))
    assert np.sqrt(np.mean(wrap_pi(heading.rph[:, 2] - expected) ** 2)) < 0.5 * DEG


@pytest.mark.parametrize("velocities", [True, False])
def test_a_log_without_standard_deviations_tells_it_as_well_as_its_positions_scatter(velocities):
    """Gentle motion in a town, which fixes 1.5 m off, as the filter takes those of this log, would hide."""
    folder = recorded("ixr_tsukishima_20210412")
    imu, gps = read_imu(folder / "imu.csv.gz").data, read_gps(folder / "gps.csv").data
    begin = float(imu.time[0]) + 500.0
    imu = imu.rows((imu.time >= begin) & (imu.time < begin + 400.0))
    gps = gps.rows(np.flatnonzero((gps.time >= begin) & (gps.time < begin + 400.0))[::5])
    turn = axes_matrix("BLD")
    found = insnav.load(
        replace(imu, gyro=imu.gyro @ turn, accel=imu.accel @ turn), gps if velocities else without_velocities(gps)
    )
    assert found.imu.facts.axes == "BLD"


def test_what_contradicts_an_imu_that_nothing_tells_the_mounting_of_may_be_its_axes():
    """A town turned by 90 deg: a gyro was named that was right, and headings were 86 deg off."""
    jump = Finding.of(Code.GPS_FROZEN, 3.0)
    for code in OF_THE_IMU:
        (doubt,) = doubt_mounting((jump, Finding.of(code, 9.0), Finding.of(code, 20.0)))
        assert (doubt.code, doubt.severity, doubt.begin) == (Code.MOUNTING_DOUBTED, Severity.WARNING, 9.0)
        assert doubt["count"] == 2
    assert not doubt_mounting((jump,))


def test_what_a_drive_does_not_tell_of_the_mounting_is_an_assumption(plain):
    """Without velocities headings of a turned IMU were 54 to 176 deg off, and nothing was said."""
    assert not any(of_code(plain.notes, Code.MOUNTING_ASSUMED))
    imu, gps, begin = plain.imu.data, without_velocities(plain.gps.data), plain.imu.data.time[0] + 75.0
    imu, gps = (each.rows((each.time >= begin) & (each.time < begin + 40.0)) for each in (imu, gps))
    (assumed,) = of_code(insnav.load(imu, gps).notes, Code.MOUNTING_ASSUMED)
    assert assumed.severity is Severity.ASSUMPTION
    still = replace(gps, lla=gps.lla[:1] + 0.0 * gps.lla)
    assert not any(of_code(insnav.load(imu, still).notes, Code.MOUNTING_ASSUMED))


@pytest.mark.parametrize(
    ("axes", "yaw"),
    [("FRD", 0.0), ("RBD", 0.0), ("BLD", 0.0), ("LFD", 0.0), ("FLU", 0.0), ("BRU", 0.0), ("0,0,60", 60.0)],
)
def test_a_slow_robot_has_the_axes_that_make_its_fixes_likeliest(axes, yaw):
    """It hardly accelerates, but turns: with x taken for forward its heading was 114 deg off, and 2.4 deg stated.

    With z up it was refused.
    """
    laps = [Segment(8.0, speed=1.0), *[Segment(12.0), Segment(10.0, turn=80 * DEG), Segment(9.0, turn=-50 * DEG)] * 7]
    truth = drive([Segment(30.0), *laps], np.array([0.8, 0.2, 400.0]), seed=4, heading=1.0, body=STILL)
    place, letters = axes_matrix(axes).T, "FRD" if yaw else axes
    imu, gps = measured(truth, 50.0, "automotive", GpsErrors((0.3, 0.3, 0.6), velocity_noise=(0.05, 0.05, 0.05)), 4)
    columns = np.column_stack([imu.time, 50.0 * np.hstack([imu.gyro, imu.accel]) @ np.kron(np.eye(2), place.T)])
    names = [f"{sensor}_{each}" for sensor, unit in (("gyro", "rad_s"), ("accel", "m_s2")) for each in "xyz"]
    found = insnav.load(pd.DataFrame(columns, columns=["time_s", *names]), gps)
    assert (found.imu.facts.axes or "FRD") == letters
    turned = (Code.MOUNTING_UPSIDE_DOWN, Code.MOUNTING_ALONG_AXES_FIXES, Code.MOUNTING_ALONG_AXES_COURSE)
    assert [each["axes"] for each in of_code(found.notes, *turned)] == [letters] * (letters != "FRD")
    smoothed = found.navigate(output_interval=1.0).found.run.smoothed.solution
    off = wrap_pi(smoothed.rph[:, 2] - truth.evaluate(smoothed.time).rph[:, 2] - yaw * DEG)
    assert np.mean(np.abs(off) < 3.0 * smoothed.sd[:, 8]) > 0.97
    assert found.model.mounting_yaw.value == pytest.approx(yaw * DEG, abs=10.0 * DEG if yaw else 0.0)


@pytest.mark.parametrize(("axes", "seed"), [("RBD", 4), ("BRU", 4), ("FRD", 5)])
def test_a_slow_robot_that_moves_already_is_turned_by_where_it_goes(axes, seed):
    """Its heading comes round whatever it begins with, and all axes are as likely: it was 90 deg off, 0.3 stated."""
    laps = [Segment(12.0), Segment(10.0, turn=80 * DEG), Segment(9.0, turn=-50 * DEG)] * 8
    truth = drive([Segment(6.0, speed=2.0), *laps], np.array([0.8, 0.2, 400.0]), seed=seed, heading=1.0, body=STILL)
    imu, gps = measured(truth, 50.0, "automotive", GpsErrors((0.3, 0.3, 0.6), velocity_noise=(0.05, 0.05, 0.05)), seed)
    imu, turn = imu.rows(imu.time > 10.0), np.kron(np.eye(2), axes_matrix(axes))
    columns = np.column_stack([imu.time, 50.0 * np.hstack([imu.gyro, imu.accel]) @ turn])
    names = [f"{sensor}_{each}" for sensor, unit in (("gyro", "rad_s"), ("accel", "m_s2")) for each in "xyz"]
    found = insnav.load(pd.DataFrame(columns, columns=["time_s", *names]), gps)
    smoothed = found.navigate(output_interval=1.0).found.run.smoothed.solution
    off = wrap_pi(smoothed.rph[:, 2] - truth.evaluate(smoothed.time).rph[:, 2])
    assert np.mean(np.abs(off) < 3.0 * smoothed.sd[:, 8]) > 0.97
    assert np.sqrt(np.mean(off**2)) < 5.0 * DEG


def test_a_forklift_goes_along_one_axis_forward_and_backward():
    """Eight with the IMU turned were 90 or 180 deg off, 0.2 to 1 stated: they "went not where they pointed"."""
    speed = np.tile(np.repeat([1.0, -1.0], [60, 40]), 8)
    heading = 0.005 * np.arange(speed.size)
    epochs = np.zeros((speed.size, STATE + 10))
    epochs[:, STATE + 3] = speed * np.cos(heading + 0.5 * np.pi)
    epochs[:, STATE + 4] = speed * np.sin(heading + 0.5 * np.pi)
    epochs[:, STATE + 6 : STATE + 10] = quat_from_rph(np.outer(heading, [0.0, 0.0, 1.0]))
    yaw, share = _travel(SimpleNamespace(epochs=epochs), 0)
    assert yaw == pytest.approx(-0.5 * np.pi, abs=1e-6)
    assert share > 0.99
    epochs[:, STATE + 3 : STATE + 5] = np.random.default_rng(1).normal(size=(speed.size, 2))  # a drone
    assert _travel(SimpleNamespace(epochs=epochs), 0)[1] < 0.3


def test_check_and_run_give_the_mounting_with_the_same_signs(plain):
    found = turned(plain, dcm_from_rph(np.array([0.0, 4.0, -6.0]) * DEG).T)
    seen = find_mounting(intervals(found.imu.data), found.fixes)
    assert seen is not None
    (nhc,) = of_code(found.navigate(aiding="on", smooth=False).findings, Code.NHC_USED)
    angles = np.array([nhc["pitch_rad"], nhc["yaw_rad"]])
    np.testing.assert_allclose(angles, seen.angles[1:], atol=1.5 * DEG)
    assert angles[1] < -4.0 * DEG


def test_units_that_no_header_names_are_found_from_gravity_and_the_course(plain):
    imu = plain.imu.data
    columns = np.column_stack([imu.time, imu.gyro * 1e3, imu.accel / 9.80665e-3])
    frame = pd.DataFrame(columns, columns=["time", "gx", "gy", "gz", "ax", "ay", "az"])
    with refused(InputError, "clock.gyro_unit") as caught:
        insnav.load(frame, plain.gps.data)
    assert caught.value.values["unit"] == "mrad/s"
    assert caught.value.gives == {"units": {"gyro": "mrad/s"}}
    found = insnav.load(frame, plain.gps.data, units="gyro=mrad/s")
    np.testing.assert_allclose(found.imu.data.gyro, imu.gyro, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(found.imu.data.accel, imu.accel, rtol=1e-9)


def test_left_handed_axes_are_refused(plain):
    with refused(InputError, "mounting.left_handed") as caught:
        turned(plain, np.diag([1.0, -1.0, 1.0]))
    assert caught.value.values["points"] == ("forward", "left", "down")


@pytest.mark.parametrize(("sensor", "axis"), [("accelerometer", "x"), ("accelerometer", "y"), ("gyro", "z")])
def test_one_inverted_sensor_is_named(plain, sensor, axis):
    """About x a car hardly turns: x and z of the gyros, or two axes of the accelerometers, were said to contradict."""
    wrong = 1.0 - 2.0 * (np.array(list("xyz")) == axis)
    imu = plain.imu.data
    imu = replace(imu, accel=imu.accel * wrong) if sensor == "accelerometer" else replace(imu, gyro=imu.gyro * wrong)
    code = "mounting.accelerometer_inverted" if sensor == "accelerometer" else "mounting.gyros_wrong_way"
    with refused(InputError, code) as caught:
        insnav.load(imu, plain.gps.data)
    assert axis == caught.value.values.get("axis") or (axis,) == caught.value.values.get("axes")


@pytest.mark.parametrize("axis", [0, 2])
def test_one_gyro_in_another_unit_is_named(plain, axis):
    """All three were said to be in deg/s: by gravity, or by the course."""
    imu = plain.imu.data
    columns = np.column_stack([imu.time, imu.gyro * np.where(np.arange(3) == axis, np.rad2deg(1.0), 1.0), imu.accel])
    names = [f"gyro_{each}_rad_s" for each in "xyz"] + [f"accel_{each}_m_s2" for each in "xyz"]
    frame = pd.DataFrame(columns, columns=["time_s", *names])
    with pytest.raises(InputError, match=r"gyro_unit_odd"):
        insnav.load(frame, plain.gps.data)


def test_gyros_with_their_columns_exchanged_are_refused(plain):
    wrong = replace(plain.imu.data, gyro=plain.imu.data.gyro[:, [2, 1, 0]])
    with pytest.raises(InputError, match=r"mounting.gyro_order") as caught:
        insnav.load(wrong, plain.gps.data)
    assert caught.value.values["about"] == ("z", "y", "x")


def test_level_turns_of_an_aircraft_are_not_left_handed():
    """Coordinated turns fit a mirrored set of axes, too, and by chance better: a good flight was refused."""
    flight = insnav.simulate("aircraft_pattern", imu="tactical", gps="single", seed=904)
    found = find_mounting(intervals(flight.imu.data), flight.gps.data)
    assert found is not None
    assert found.right_handed


def test_axes_given_that_the_drive_contradicts_are_a_warning():
    sample = Path(__file__).parents[2] / "trajectories" / "sample"
    wrong = insnav.load(sample / "imu.csv.gz", gps=sample / "gps.csv", axes="FLU")
    (warning,) = of_code(wrong.imu.events, Code.MOUNTING_CONTRADICTS_GIVEN)
    assert (warning["given"], warning.severity) == ("FLU", Severity.WARNING)
    assert warning.begin == wrong.imu.data.time[0]


def test_angles_as_axes_are_a_rotation():
    angles = np.array([10.0, -20.0, 30.0])
    np.testing.assert_array_equal(axes_matrix("10,-20,30"), dcm_from_rph(angles * DEG))
    with pytest.raises(insnav.exceptions.ConfigError):
        axes_matrix("10,20")


def test_a_file_whose_z_points_up_needs_no_axes_where_the_drive_tells_them(plain, tmp_path):
    from insnav.output.data_files import write_data

    imu = plain.imu.data
    flip = axes_matrix("FLU").T
    write_data(tmp_path / "imu.csv", replace(imu, gyro=imu.gyro @ flip.T, accel=imu.accel @ flip.T))
    found = insnav.load(tmp_path / "imu.csv", plain.gps.data)
    assert found.imu.facts.axes == "FLU"
    np.testing.assert_allclose(found.imu.data.accel, imu.accel, rtol=0, atol=1e-5)
    short = plain.gps.data.rows(plain.gps.data.time < imu.time[0] + 30.0)
    with refused(InputError, "columns.axes_flu"):
        insnav.load(tmp_path / "imu.csv", short)
