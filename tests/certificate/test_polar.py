"""Motions near a pole agree with their derivatives, in axes that do not turn, and with gravity without series."""

from __future__ import annotations

import numpy as np
import pymap3d
import pytest

from insnav.attitude import dcm_from_rph
from insnav.certificate.motions import around_pole, over_pole
from insnav.certificate.platform_checks import exact_gravity_n
from insnav.simulate.truth import EarthTruth
from insnav.types import FloatArray
from insnav.units import UG
from tests.physics.equations import axes_of

OMEGA = 7.292115e-5
MOTIONS = {
    "over": over_pole(250.0, 600.0),
    "past, south": over_pole(900.0, 600.0, miss=3000.0, south=True),
    "around": around_pole(10.0, 2000.0, 600.0, height=5e3),
}
TIME = np.array([31.0, 150.0, 299.2, 300.7, 420.0, 577.0])


def state(truth: EarthTruth, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Position and body axes in axes that do not turn, from latitude, longitude and roll, pitch, heading."""
    at = truth.evaluate(time)
    r_e = np.stack(pymap3d.geodetic2ecef(*at.lla.T, deg=False), axis=-1)
    c, s, zero = np.cos(OMEGA * time), np.sin(OMEGA * time), np.zeros_like(time)
    turn = np.stack([np.stack([c, -s, zero], -1), np.stack([s, c, zero], -1), np.stack([zero, zero, zero + 1], -1)], 1)
    c_eb = axes_of(at.lla[:, 0], at.lla[:, 1]) @ dcm_from_rph(at.rph)
    return np.einsum("nij,nj->ni", turn, r_e), turn @ c_eb


@pytest.mark.parametrize("name", MOTIONS)
def test_sensors_feel_the_motion_and_gravitation(name):
    truth, d = MOTIONS[name], 0.5
    at = truth.evaluate(TIME)
    (r0, _), (r1, c_ib), (r2, _) = (state(truth, TIME + shift) for shift in (-d, 0.0, d))
    acceleration = (r2 - 2.0 * r1 + r0) / d**2
    c_in = c_ib @ np.swapaxes(dcm_from_rph(at.rph), 1, 2)
    gravity = np.einsum("nij,nj->ni", c_in, exact_gravity_n(at.lla[:, 0], at.lla[:, 2]))
    gravitation = gravity - OMEGA**2 * r1 * [1.0, 1.0, 0.0]  # the centrifugal part is in it
    force = np.einsum("nji,nj->ni", c_ib, acceleration - gravitation)
    # second differences of positions of 6.4e6 m are good to 1e-8 m/s^2, the series for gravity to 0.2 ug
    assert np.abs(force - at.f_b).max() <= 0.3 * UG


@pytest.mark.parametrize("name", MOTIONS)
def test_gyros_feel_the_turn(name):
    truth, d = MOTIONS[name], 1e-3
    (_, before), (_, now), (_, after) = (state(truth, TIME + shift) for shift in (-d, 0.0, d))
    turning = np.swapaxes(now, 1, 2) @ (after - before) / (2.0 * d)
    rate = np.stack([turning[:, 2, 1], turning[:, 0, 2], turning[:, 1, 0]], -1)
    assert np.abs(rate - truth.evaluate(TIME).w_ib_b).max() <= 1e-6  # the swing of 5 deg at 2 rad/s by differences


@pytest.mark.parametrize("name", MOTIONS)
def test_velocity_is_the_derivative_of_the_position(name):
    truth, d = MOTIONS[name], 0.1
    at = truth.evaluate(TIME)
    ahead, behind = (np.stack(pymap3d.geodetic2ecef(*truth.evaluate(TIME + k).lla.T, deg=False), -1) for k in (d, -d))
    v_e = np.einsum("nij,nj->ni", axes_of(at.lla[:, 0], at.lla[:, 1]), at.v_n)
    np.testing.assert_allclose((ahead - behind) / (2 * d), v_e, rtol=0, atol=1e-5)


def test_a_flight_over_a_pole_goes_over_it():
    lat = over_pole(250.0, 600.0).evaluate(np.array([0.0, 300.0, 600.0])).lla[:, 0]
    assert lat[1] == pytest.approx(np.pi / 2, abs=1e-12)
    assert lat[0] == pytest.approx(lat[2], abs=1e-12)
    missed = over_pole(250.0, 600.0, miss=30.0, south=True).evaluate(np.array([300.0])).lla[0, 0]
    assert (np.pi / 2 + missed) * (6399593.6 + 10e3) == pytest.approx(30.0, rel=1e-6)
