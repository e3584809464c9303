"""The short-duration mechanization is off by what it leaves out, and by nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from insnav import strapdown
from insnav.earth import gravity_n, ned_offset, radii
from insnav.simulate import imu_from_truth, straight
from insnav.strapdown import navigate_short
from insnav.types import Increments

OMEGA = 7.292115e-5
PLACE = np.array([np.radians(50.0), 0.3, 200.0])


def increments_of(truth, rate: float = 100.0, duration: float = 60.0) -> Increments:
    time = np.arange(round(duration * rate) + 1) / rate
    return strapdown.increments(strapdown.intervals(imu_from_truth(truth, time)))


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 217.0])
def test_after_a_minute_it_is_off_by_coriolis(heading_deg: float):
    """Steady motion: half of ``(2 w_ie + w_en) x v`` times t squared, written out for the sphere-like rates."""
    heading = np.radians(heading_deg)
    truth = straight(PLACE, 30.0, heading, 61.0)
    at = truth.evaluate(np.array([0.0, 60.0]))
    got = navigate_short(increments_of(truth), at.lla[0], at.v_n[0], at.rph[0])
    vn, ve = at.v_n[0, :2]
    s, c = OMEGA * np.sin(PLACE[0]), OMEGA * np.cos(PLACE[0])
    meridian, transverse = radii(PLACE[0])
    spin = ve * np.tan(PLACE[0]) / (transverse + PLACE[2])
    expected = np.array(
        [
            (2 * s + spin) * ve,
            -(2 * s + spin) * vn,
            2 * c * ve + ve**2 / (transverse + PLACE[2]) + vn**2 / (meridian + PLACE[2]),
        ]
    )
    # down: v is wrong by 60 s of Coriolis, but gravity's change with the wrong height adds parts in 1e3
    np.testing.assert_allclose(got.v_n[-1] - at.v_n[-1], expected * 60.0, atol=1e-3)
    np.testing.assert_allclose(ned_offset(got.lla[-1], at.lla[1]), 0.5 * expected * 3600.0, rtol=0.01, atol=0.02)


def test_at_rest_it_stays_where_it_is():
    truth = straight(PLACE, 0.0, 0.7, 61.0, roll=0.05, pitch=-0.1)
    at = truth.evaluate(np.zeros(1))
    got = navigate_short(increments_of(truth), at.lla[0], at.v_n[0], at.rph[0])
    # the attitude that Euler's rule turns with is that of the start of a sample: half a sample of the Earth's rate
    half = 0.5 * 0.01 * OMEGA * gravity_n(PLACE[0], PLACE[2])[2] * 60.0
    assert np.abs(got.v_n[-1]).max() < 1.1 * half
    assert np.abs(got.rph[-1] - at.rph[0]).max() < 1e-8


def test_without_the_turn_of_the_axes_the_level_is_lost():
    """The Earth's rate about north tilts them: ``1/6 g W cos(L) t^3`` to the side, 25 m a minute at the equator."""
    truth = straight(PLACE, 0.0, 0.0, 61.0)
    at = truth.evaluate(np.zeros(1))
    got = navigate_short(increments_of(truth), at.lla[0], at.v_n[0], at.rph[0], turning=False)
    off = ned_offset(got.lla[-1], at.lla[0])
    g = gravity_n(PLACE[0], PLACE[2])[2]
    assert abs(off[1]) == pytest.approx(g * OMEGA * np.cos(PLACE[0]) * 60.0**3 / 6.0, rel=1e-3)
    assert abs(off[0]) < 0.1


def test_euler_is_of_first_order():
    """Half the interval, half the error that is left when Coriolis is known: a vehicle that pitches and gains speed."""
    from insnav.certificate.motions import swell

    truth = swell(11.0, PLACE)
    at = truth.evaluate(np.array([0.0, 10.0]))
    left = []
    for rate in (100.0, 200.0, 400.0):
        inc = increments_of(truth, rate, 10.0)
        got = navigate_short(inc, at.lla[0], at.v_n[0], at.rph[0])
        fine = navigate_short(increments_of(truth, 6400.0, 10.0), at.lla[0], at.v_n[0], at.rph[0])
        left.append(np.linalg.norm(got.v_n[-1] - fine.v_n[-1]))
    assert left[0] / left[1] == pytest.approx(2.0, rel=0.15)
    assert left[1] / left[2] == pytest.approx(2.0, rel=0.15)
