"""Free inertial navigation over, from, to, around and at the poles, against motions in closed form."""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace

import numpy as np
import pymap3d
import pytest

from insnav import strapdown
from insnav.attitude import dcm_from_rph
from insnav.certificate.motions import around_pole, over_pole, polar_truth
from insnav.earth import earth_rate_n, gravity_n
from insnav.output.solution_tables import write_run_table
from insnav.simulate import imu_from_truth
from insnav.simulate.truth import EarthTruth, Harmonic
from insnav.types import FloatArray, ImuData, Trajectory
from insnav.units import DEG
from tests.physics.equations import axes_of

RATE = 100.0  # [Hz]
KILOMETRE = 1000.0 / 6399593.6  # angle of it at a pole, whose radius of curvature is a^2 / b [rad]
POLE = 0.5 * np.pi


@dataclass(frozen=True)
class Errors:
    """Largest differences from the truth in Earth-fixed axes: position [m], velocity [m/s], attitude [rad]."""

    position: float
    velocity: float
    attitude: float
    end: float  # of the position


def body_axes(rph: FloatArray, lla: FloatArray) -> FloatArray:
    return axes_of(lla[:, 0], lla[:, 1]) @ dcm_from_rph(rph)


def earth_fixed(lla: FloatArray) -> FloatArray:
    return np.stack(pymap3d.geodetic2ecef(*lla.T, deg=False), axis=-1)


def flown(truth: EarthTruth, *, free: bool = False, sampling="increment") -> Trajectory:
    """From the exact start on, height held to the truth unless `free`."""
    time = np.arange(round(truth.duration * RATE) + 1) / RATE
    inc = strapdown.increments(strapdown.intervals(imu_from_truth(truth, time, sampling)))
    if sampling == "instant":  # the first value ends no interval
        inc = inc.rows(slice(1, None))
    start = truth.evaluate(time[:1])
    held = None if free else (np.full(inc.time.size, truth.position.height), np.zeros(inc.time.size))
    return strapdown.navigate(inc, start.lla[0], start.v_n[0], start.rph[0], vertical=held)


def errors(found: Trajectory, truth: EarthTruth) -> Errors:
    """Attitude only where the heading is told."""
    off = np.linalg.norm(earth_fixed(found.lla) - truth.position(found.time), axis=1)
    axes = axes_of(found.lla[:, 0], found.lla[:, 1])
    speed = np.einsum("nij,nj->ni", axes, found.v_n) - truth.position(found.time, 1)
    told = np.isfinite(found.rph[:, 2])
    true = truth.evaluate(found.time)
    turn = np.swapaxes(body_axes(true.rph, true.lla)[told], 1, 2) @ body_axes(found.rph, found.lla)[told] - np.eye(3)
    return Errors(off.max(), np.linalg.norm(speed, axis=1).max(), np.abs(turn).max() if told.any() else 0.0, off[-1])


def assert_over_a_pole(found: Trajectory, truth: EarthTruth, bar: float) -> None:
    measured = errors(found, truth)
    print(measured)
    assert measured.position <= bar
    assert measured.velocity <= 1e-5
    assert measured.attitude <= 1e-8
    assert np.abs(found.lla[:, 0]).max() <= POLE
    assert np.abs(found.lla[:, 1]).max() <= np.pi
    for part in (found.lla, found.v_n, found.rph[:, :2]):
        assert np.isfinite(part).all()
    away = np.arccos(np.minimum(np.linalg.norm(truth.position(found.time)[:, :2], axis=1) / 6399593.6, 1.0))
    away = POLE - away  # angle from the pole
    clear = np.abs(away - KILOMETRE) > 1e-2 * KILOMETRE
    np.testing.assert_array_equal(np.isnan(found.rph[clear, 2]), away[clear] < KILOMETRE)


@pytest.mark.parametrize("free", [False, True], ids=["height held", "free"])
@pytest.mark.parametrize("south", [False, True], ids=["north", "south"])
@pytest.mark.parametrize("miss", [0.0, 0.01, 30.0, 900.0])
def test_ten_minutes_over_a_pole(miss, south, free):
    truth = over_pole(250.0, 600.0, miss=miss, south=south)
    assert_over_a_pole(flown(truth, free=free), truth, 1e-3)


@pytest.mark.parametrize("sampling", ["mean", "instant"])
def test_over_a_pole_from_samples_of_other_forms(sampling):
    truth = over_pole(250.0, 600.0)
    assert_over_a_pole(flown(truth, sampling=sampling), truth, 1e-2)


@pytest.mark.parametrize("miss", [0.0, 5e3])
def test_nothing_happens_where_the_axes_change(miss):
    # 540 km at 20 km height: into the cap of Earth-fixed steps and out of it
    truth = over_pole(900.0, 600.0, height=20e3, miss=miss)
    found = flown(truth, free=True)
    colatitude = POLE - np.abs(found.lla[[0, -1], 0])
    assert (np.sin(colatitude) > 0.02).all()
    assert_over_a_pole(found, truth, 1e-2)
    off = np.linalg.norm(earth_fixed(found.lla) - truth.position(found.time), axis=1)
    assert np.abs(np.diff(off)).max() <= 1e-5


@pytest.mark.parametrize("radius", [127.0e3, 128.5e3], ids=["inside", "outside"])
def test_both_kinds_of_steps_agree_at_the_edge(radius):
    truth = around_pole(100.0, radius, 600.0)
    found = flown(truth)
    assert (np.cos(found.lla[:, 0]) < 0.02).all() == (radius < 128e3)
    assert errors(found, truth).position <= 1e-5


@pytest.mark.parametrize("axis", [1.0, -1.0], ids=["north", "south"])
@pytest.mark.parametrize("begin", [0.0, 120.0], ids=["from", "to"])
def test_a_flight_begins_or_ends_at_a_pole(begin, axis):
    omega = 250.0 / 6.41e6
    way = np.array([np.cos(2.0), np.sin(2.0), 0.0])
    turned = omega * begin  # the phase at which the pole is reached
    top = np.array([0.0, 0.0, axis])
    cosine, sine = np.cos(turned) * top - np.sin(turned) * way, np.sin(turned) * top + np.cos(turned) * way
    normal = Harmonic(np.zeros(3), np.zeros(3), cosine, sine, omega)
    truth = polar_truth(normal, 3000.0, 120.0, 5 * DEG, 2.0)
    assert abs(truth.evaluate(np.array([begin])).lla[0, 0]) == pytest.approx(POLE, abs=1e-12)
    assert_over_a_pole(flown(truth), truth, 1e-4)


@pytest.mark.parametrize("south", [False, True], ids=["north", "south"])
@pytest.mark.parametrize("radius", [100.0, 1.0])
def test_circles_about_a_pole_close(radius, south):
    speed = min(radius, 5.0)
    truth = around_pole(speed, radius, 600.0, south=south)
    found = flown(truth)
    assert_over_a_pole(found, truth, 1e-4)
    lon = np.unwrap(found.lla[:, 1])
    assert lon[-1] - lon[0] == pytest.approx(speed / radius * (600.0 - 1 / RATE), rel=1e-6)


@pytest.mark.parametrize("lat", [POLE, -POLE], ids=["north", "south"])
def test_a_thing_at_rest_at_a_pole_stays_there(lat):
    rph, place, n = np.array([0.1, -0.3, 2.2]), np.array([lat, 0.4, 2800.0]), round(3600 * RATE)
    c_bn = dcm_from_rph(rph).T
    gyro, accel = c_bn @ earth_rate_n(lat) / RATE, -c_bn @ gravity_n(lat, 2800.0) / RATE
    imu = ImuData(np.arange(1, n + 1) / RATE, np.tile(gyro, (n, 1)), np.tile(accel, (n, 1)), "increment")
    inc = strapdown.increments(strapdown.intervals(imu))
    found = strapdown.navigate(inc, place, np.zeros(3), rph, vertical=(np.full(n, 2800.0), np.zeros(n)), every=100)
    assert np.linalg.norm(earth_fixed(found.lla) - earth_fixed(place[None]), axis=1).max() <= 1e-6
    assert np.abs(found.lla[:, 0]).max() <= POLE
    assert np.linalg.norm(found.v_n, axis=1).max() <= 1e-7
    assert np.abs(found.rph[:, :2] - rph[:2]).max() <= 1e-10
    assert np.isnan(found.rph[:, 2]).all()


def test_a_heading_not_told_is_an_empty_cell(tmp_path):
    found = flown(over_pole(250.0, 20.0))
    with write_run_table(tmp_path, found).open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    empty = np.array([row["heading_deg"] == "" for row in rows])
    np.testing.assert_array_equal(empty, np.isnan(found.rph[:, 2]))
    assert 700 < empty.sum() < 900  # 2 km at 250 m/s
    assert "nan" not in str(rows).lower()


def test_another_package_leaves_the_map_there():
    pytest.importorskip("pyins", reason="python-ins is not installed")
    from insnav.certificate.integrators import integrators, pyins
    from insnav.certificate.motions import start_of

    truth = replace(over_pole(250.0, 600.0), start=0.003)  # no sample exactly at the pole, where it divides by zero
    time = 0.003 + np.arange(59_900) / RATE
    time[1:] += 0.0041
    imu, n = imu_from_truth(truth, time), time.size - 2
    held = np.full(n, truth.position.height), np.zeros(n)
    beyond = [
        np.abs(each.navigate(imu, start_of(truth, time), *held, 1).lla[:, 0]).max() / DEG
        for each in (integrators()[0], pyins())
    ]
    print(beyond)
    assert beyond[0] <= 90.0
    assert beyond[1] > 90.0001
