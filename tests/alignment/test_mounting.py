"""The axes of an IMU in the vehicle, found from a drive with bends: every rotation, and every set that is none."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import insnav
from insnav.alignment import find_mounting, mounting
from insnav.attitude import dcm_from_quat, dcm_from_rph, quat_from_rotvec, wrap_pi
from insnav.input import read_gps, read_imu
from insnav.input.interpret.physics import axes_matrix
from insnav.simulate import gps_from_truth, imu_from_truth, straight
from insnav.strapdown import intervals, joined
from insnav.types import GpsData, ImuData
from insnav.units import DEG
from tests.filter import drives
from tests.shared import recorded

LAPS = 4
LETTERS = [
    "".join(each)
    for each in itertools.product("FBRLDU", repeat=3)
    if len({"FBRLDU".index(letter) // 2 for letter in each}) == 3
]


@lru_cache(maxsize=3)
def recording(seed: int) -> tuple[ImuData, GpsData]:
    rng = np.random.default_rng([71, seed])
    imu = drives.noisy_imu(drives.perfect_imu(laps=LAPS), drives.MODEL, rng)
    return imu, drives.noisy_gps(drives.perfect_gps(laps=LAPS), rng)


def sensed(matrix: np.ndarray, seed: int = 0, gyro: np.ndarray | None = None) -> tuple[ImuData, GpsData]:
    """What a sensor shows to whose axes a matrix brings the vectors of the vehicle."""
    imu, gps = recording(seed)
    return replace(imu, gyro=imu.gyro @ (matrix if gyro is None else gyro).T, accel=imu.accel @ matrix.T), gps


def handed(letters: str) -> float:
    columns = [np.sign([1, -1])["FBRLDU".index(each) % 2] * np.eye(3)["FBRLDU".index(each) // 2] for each in letters]
    return float(np.linalg.det(np.array(columns)))


@pytest.mark.parametrize("letters", [each for each in LETTERS if handed(each) > 0])
def test_each_of_the_24_right_handed_axes_is_found(letters):
    imu, gps = sensed(axes_matrix(letters).T)
    found = find_mounting(intervals(imu), gps)
    assert found is not None
    assert found.right_handed
    assert found.letters == letters


@pytest.mark.parametrize("letters", ["FLD", "FRU", "BRD", "RFD", "LFU"])
def test_left_handed_axes_are_none(letters):
    columns = [np.sign([1, -1])["FBRLDU".index(each) % 2] * np.eye(3)["FBRLDU".index(each) // 2] for each in letters]
    imu, gps = sensed(np.array(columns))
    found = find_mounting(intervals(imu), gps)
    assert found is not None
    assert not found.right_handed
    assert found.mirrored
    assert found.letters == letters


@pytest.mark.parametrize("signs", [(-1, -1, -1), (1, 1, -1), (-1, 1, -1)])
def test_gyros_that_turn_against_the_accelerometers_are_found(signs):
    imu, gps = sensed(np.eye(3), gyro=np.diag(signs).astype(float))
    found = find_mounting(intervals(imu), gps)
    assert found is not None
    assert not found.mirrored
    assert found.gyros[2, 2] == -1.0


@pytest.mark.parametrize("order", [(0, 2, 1), (1, 2, 0), (2, 0, 1), (2, 1, 0)])
@pytest.mark.parametrize("positions", [False, True], ids=["velocities", "positions alone"])
def test_gyros_in_another_order_are_found(order, positions):
    """In bends on a plain: x and y, which hardly turn, may be exchanged unseen."""
    imu, gps = sensed(np.eye(3), gyro=np.eye(3)[list(order)])
    found = find_mounting(intervals(imu), drives.without_velocities(gps) if positions else gps)
    assert found is not None
    assert not found.right_handed
    np.testing.assert_array_equal(found.gyros @ np.eye(3)[list(order)], np.eye(3))
    assert found.letters == "FRD"


@pytest.mark.parametrize("order", [(0, 2, 1), (2, 1, 0)])
def test_accelerometers_with_two_axes_exchanged_are_found(order):
    imu, gps = sensed(np.eye(3)[list(order)], gyro=np.eye(3))
    found = find_mounting(intervals(imu), gps)
    assert found is not None
    assert not found.right_handed
    np.testing.assert_array_equal(np.abs(found.gyros), np.eye(3)[list(order)])


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("all_as_degrees", [False, True])
def test_one_gyro_in_another_unit_is_found(axis, all_as_degrees):
    """On a recorded drive, whose IMU rolls and pitches; without a unit in the header, all are taken for deg/s."""
    drive = recorded("rtklib_drive_20250708")
    imu, gps = read_imu(drive / "imu.csv.gz").data, read_gps(drive / "gps.csv").data
    units = np.ones(3)
    units[axis] = 180.0 / np.pi
    units *= np.pi / 180.0 if all_as_degrees else 1.0
    found = find_mounting(intervals(replace(imu, gyro=imu.gyro * units)), gps)
    assert found is not None
    assert not found.right_handed
    assert np.allclose(np.diag(found.gyros) / found.gyros[axis, axis], units[axis] / units)
    plain = find_mounting(intervals(imu), gps)
    assert plain is not None
    assert plain.right_handed
    assert found.letters == plain.letters


@pytest.mark.parametrize(("axis", "unit"), [(0, DEG), (1, DEG), (2, 1.0 / DEG)])
def test_noise_tells_the_unit_of_gyros_that_hardly_turn(axis, unit):
    """On a plain, read in deg/s as z says: gyros x and y as small as in rad/s fit nearly as well, tilts apart."""
    sample = Path(__file__).parents[2] / "trajectories" / "sample"
    imu, gps = read_imu(sample / "imu.csv.gz").data, read_gps(sample / "gps.csv").data
    units = np.where(np.arange(3) == axis, unit, 1.0) * (DEG if axis == 2 else 1.0)
    found = find_mounting(intervals(replace(imu, gyro=imu.gyro * units)), gps)
    assert found is not None
    sizes = np.diag(found.gyros)
    assert sizes[axis] == pytest.approx(sizes[(axis + 1) % 3] / unit)


@pytest.mark.parametrize(("axis", "rate", "length"), [(0, 4.0, 20.0), (1, -30.0, 40.0), (0, 60.0, 40.0)])
def test_a_gyro_that_is_off_for_a_while_is_in_no_other_unit(axis, rate, length):
    """It fits in a smaller one, in which it hardly turns."""
    made = insnav.simulate("motorway", imu="industrial", gps="rtk", seed=3, rate=50.0)
    imu, gps = made.imu.data, made.gps.data
    gyro, since = imu.gyro.copy(), imu.time - imu.time[0]
    gyro[(since > 100.0) & (since < 100.0 + length), axis] += rate * DEG
    found = find_mounting(intervals(replace(imu, gyro=gyro)), gps)
    assert found is None or np.array_equal(np.abs(found.gyros), np.eye(3))


# columns of accelerometers and gyros, as a matrix from the right ones
EXCHANGED, FIRST, SECOND = np.eye(3)[[1, 0, 2]], np.diag([-1.0, 1.0, 1.0]), np.diag([1.0, -1.0, 1.0])
WRONG = {
    "gyros x and y": (np.eye(3), EXCHANGED),
    "sign of gyro x": (np.eye(3), FIRST),
    "sign of gyro y": (np.eye(3), SECOND),
    "accelerometers x and y": (EXCHANGED, np.eye(3)),
    "sign of accelerometer x": (FIRST, np.eye(3)),
    "signs of all accelerometers": (-np.eye(3), np.eye(3)),
}


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("positions", [False, True], ids=["velocities", "positions alone"])
def test_gravity_tells_any_wrong_column_in_a_city(wrong, positions):
    """The corrections must be the inverse of what was done to the samples."""
    made = insnav.simulate("city", imu="industrial", gps="single", seed=11)
    imu, gps = made.imu.data, drives.without_velocities(made.gps.data) if positions else made.gps.data
    accel, gyro = WRONG[wrong]
    found = find_mounting(intervals(replace(imu, accel=imu.accel @ accel.T, gyro=imu.gyro @ gyro.T)), gps)
    assert found is not None
    assert not found.right_handed
    np.testing.assert_array_equal(found.corrections[0] @ accel, np.eye(3))
    np.testing.assert_array_equal(found.corrections[1] @ gyro, np.eye(3))


@pytest.mark.parametrize("change", [np.eye(3), np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])])
def test_sums_give_the_increments_of_a_steady_turn(change):
    """Rodrigues' formula, integrated once and twice in closed form; the angles are small to second order."""
    rate, force, length, size = np.array([0.1, -0.2, 0.25]), np.array([1.0, 2.0, -9.8]), 0.96, 24
    part, ones = length / size, np.ones((2 * size, 1))
    imu = ImuData(part * np.arange(1, 2 * size + 1), ones * (change.T @ rate), ones * force, sampling="mean")
    sums = mounting._Sums.of(joined([intervals(imu)]))
    spans, some = sums.between(np.array([0.5, 1.5]) * length)
    np.testing.assert_allclose(spans, length)
    turned, pushed, moved = np.split((some @ mounting._increments_of(change))[0], 3)
    np.testing.assert_allclose(turned, rate * length, atol=1e-12)
    turn = float(np.linalg.norm(rate))
    once, angle = np.cross(rate / turn, force), turn * length
    twice, third = np.cross(rate / turn, once), angle - np.sin(angle)
    velocity = force * length + (once * (1.0 - np.cos(angle)) + twice * third) / turn
    place = once * third + twice * (0.5 * angle**2 - 1.0 + np.cos(angle))
    place = 0.5 * force * length**2 + place / turn**2
    half = dcm_from_quat(quat_from_rotvec(0.5 * rate * length))
    np.testing.assert_allclose(half @ pushed, velocity, atol=0.05 * angle**2 * np.linalg.norm(velocity))
    np.testing.assert_allclose(half @ moved, place, atol=0.05 * angle**2 * np.linalg.norm(place))


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_each_of_the_48_signed_orders_is_found_in_a_city(sensor):
    """Gyros: the inverse of the change. Accelerometers: its image of the gyros, which a reflection turns round."""
    made = insnav.simulate("city", imu="industrial", gps="single", seed=11, rate=50.0)
    imu, orders = made.imu.data, itertools.permutations(np.eye(3))
    for order, signs in itertools.product(orders, itertools.product((1.0, -1.0), repeat=3)):
        change = np.array(order) * np.array(signs)[:, None]
        found = find_mounting(intervals(replace(imu, **{sensor: getattr(imu, sensor) @ change.T})), made.gps.data)
        assert found is not None
        reflection = float(np.linalg.det(change))
        np.testing.assert_array_equal(found.gyros, change.T if sensor == "gyro" else reflection * change)
        assert found.mirrored == (sensor == "accel" and reflection < 0.0)


def test_the_prior_odds_are_shared_by_all_orders_with_as_many_changes():
    """96 orders. One change: three signs, six exchanges or all signs, of the gyros or of the accelerometers."""
    count = mounting._alternatives()
    assert count.sum() == 48 * 2
    assert count[:2].tolist() == [1, 2 * (3 + 6 + 1)]


@pytest.mark.parametrize("profile", ["city", "motorway", "mountain_road", "aircraft_pattern", "figure_eight"])
@pytest.mark.parametrize("positions", [False, True], ids=["velocities", "positions alone"])
def test_right_columns_are_never_refused(profile, positions):
    made = insnav.simulate(profile, imu="consumer", gps="single", seed=12)
    gps = drives.without_velocities(made.gps.data) if positions else made.gps.data
    found = find_mounting(intervals(made.imu.data), gps)
    assert found is None or found.right_handed


@pytest.mark.parametrize("gyro", [EXCHANGED, FIRST, SECOND], ids=["x and y", "sign of x", "sign of y"])
def test_a_motorway_hardly_tells_the_gyros_that_hardly_turn(gyro):
    """Gravity nearly keeps its direction in the vehicle: no error, or one that names the wrong columns."""
    made = insnav.simulate("motorway", imu="industrial", gps="single", seed=1010)
    found = find_mounting(intervals(replace(made.imu.data, gyro=made.imu.data.gyro @ gyro.T)), made.gps.data)
    assert found is None or found.right_handed or (found.corrections[1] @ gyro == np.eye(3)).all()


def test_columns_in_rotated_axes_are_those_of_the_file():
    """Samples read as forward, left, up: an exchange there has changed signs in vehicle axes."""
    given = axes_matrix("FLU")
    turned = given @ EXCHANGED @ given.T
    made = insnav.simulate("city", imu="industrial", gps="single", seed=11)
    found = find_mounting(intervals(replace(made.imu.data, gyro=made.imu.data.gyro @ turned.T)), made.gps.data)
    assert found is not None
    np.testing.assert_array_equal(found.of_columns(given).corrections, [np.eye(3), EXCHANGED])


@pytest.mark.parametrize("yaw", [-150.0, -30.0, 4.0, 30.0, 75.0])
def test_any_yaw_is_found_as_well_as_it_says(yaw):
    for seed in range(3):
        imu, gps = sensed(dcm_from_rph(np.array([2.0, -3.0, yaw]) * DEG).T, seed)
        found = find_mounting(intervals(imu), gps)
        assert found is not None
        np.testing.assert_allclose(found.angles[:2] / DEG, [2.0, -3.0], atol=2.5)
        assert abs(wrap_pi(found.angles[2] - yaw * DEG)) < 3.0 * found.sd
        assert found.sd < 3.0 * DEG


def cuts(imu: ImuData, gps: GpsData, begins: np.ndarray, length: float) -> Iterator[tuple[ImuData, GpsData]]:
    """Parts of a recording, each so long, that begin so long after its first sample [s]."""
    for begin in imu.time[0] + begins:
        some, fixes = (each.rows((each.time >= begin) & (each.time < begin + length)) for each in (imu, gps))
        yield some, fixes


@pytest.mark.parametrize("gps", ["single", "dgps", "rtk", "urban"])
def test_positions_alone_tell_it_as_well_as_they_say(gps):
    for seed in range(3):
        drive = insnav.simulate("city", imu=["consumer", "industrial", "tactical"][seed], gps=gps, seed=40 + seed)
        found = find_mounting(intervals(drive.imu.data), drives.without_velocities(drive.gps.data))
        assert found is not None
        assert found.right_handed
        assert found.letters == "FRD"
        assert abs(found.angles[2]) < 3.0 * found.sd


def test_positions_tell_it_where_velocities_are_useless():
    imu, gps = sensed(axes_matrix("BLD").T)
    wild = gps.v_n + 3.0 * np.random.default_rng(7).standard_normal(gps.v_n.shape)
    found = find_mounting(intervals(imu), replace(gps, v_n=wild))
    assert found is not None
    assert found.letters == "BLD"


def test_a_minute_of_a_drive_tells_it_mostly():
    """Three of seven did in windows of which none overlapped another."""
    drive = insnav.simulate("city", imu="industrial", gps="single", seed=3)
    letters = []
    for imu, gps in cuts(drive.imu.data, drive.gps.data, 60.0 * np.arange(7), 60.0):
        found = find_mounting(intervals(imu), gps)
        letters += [found.letters] if found is not None else []
    assert letters == ["FRD"] * len(letters)
    assert len(letters) >= 5


def test_a_drone_that_flies_any_side_ahead_is_no_turned_imu():
    """It keeps its heading wherever it goes."""
    drive = insnav.simulate("city", imu="tactical", gps="rtk", seed=5)
    imu, true = drive.imu.data, drive.reference.data
    heading = np.interp(imu.time, true.time, np.unwrap(true.rph[:, 2]))
    zero = np.zeros_like(heading)
    kept = dcm_from_rph(np.column_stack([zero, zero, heading]))
    down = np.array([0.0, 0.0, 1.0])
    gyro = np.einsum("nij,nj->ni", kept, imu.gyro - np.gradient(heading, imu.time)[:, None] * down)
    drone = replace(imu, gyro=gyro, accel=np.einsum("nij,nj->ni", kept, imu.accel))
    assert find_mounting(intervals(drone), drives.without_velocities(drive.gps.data)) is None
    for some, gps in cuts(drone, drive.gps.data, 60.0 * np.arange(7), 60.0):
        assert find_mounting(intervals(some), gps) is None


def test_a_gyro_bias_and_a_late_clock_do_no_harm():
    imu, gps = sensed(dcm_from_rph(np.array([0.0, 0.0, 30.0]) * DEG).T)
    imu = replace(imu, gyro=imu.gyro + np.array([0.5, -0.8, 0.6]) * DEG * 0.02, time=imu.time + 0.25)
    found = find_mounting(intervals(imu), gps)
    assert found is not None
    assert found.right_handed
    assert found.angles[2] / DEG == pytest.approx(30.0, abs=4.0)


def test_a_straight_road_tells_nothing():
    motion = straight(drives.PLACE, 20.0, 0.6, 200.0)
    imu = imu_from_truth(motion, np.arange(10001) / 50.0)
    gps = gps_from_truth(motion, np.arange(1.0, 199.0), drives.LEVER_B)
    sd = np.full_like(gps.lla, 0.5)
    assert find_mounting(intervals(imu), replace(gps, position_sd=sd, velocity_sd=0.1 * sd)) is None


def test_fixes_of_another_drive_tell_nothing():
    imu, gps = recording(0)
    assert find_mounting(intervals(imu), replace(gps, time=gps.time[::-1].copy()[::-1] + 41.0)) is None


def test_axes_that_are_not_square_do_not_pass_for_a_gyro_bias():
    """Consumer sensors, misaligned by 10 mrad, in curves without end; their gyro bias is seen at rest."""
    far = []
    for seed in range(1, 4):
        drive = insnav.simulate("figure_eight", imu="consumer", seed=seed)
        found = find_mounting(intervals(drive.imu.data), drive.gps.data)
        assert found is not None
        far.append(found.angles[2] / found.sd)
    assert np.mean(np.square(far)) < 2.0, far


def test_steady_turns_of_an_aircraft_are_no_turned_imu():
    """Banked, at one speed: gyro and accelerometer bias look like a mounting of 17 standard deviations, 55 deg."""
    flight = insnav.simulate("aircraft_pattern", imu="consumer", gps="rtk", seed=7806)
    far = []
    for imu, gps in cuts(flight.imu.data, flight.gps.data, 100.0 * np.arange(8), 200.0):
        found = find_mounting(intervals(imu), gps)
        if found is not None:
            far.append(found.angles[2] / found.sd)
    assert len(far) > 2
    assert np.max(np.abs(far)) < 3.0, far
