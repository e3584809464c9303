"""Gravity of the certificate against its potential by differences, and what a wrong model is found by."""

from __future__ import annotations

import numpy as np
import pytest

from insnav.certificate import platform_checks as subject
from insnav.earth import gravity_n
from tests.test_earth import gradient_of_potential


@pytest.mark.parametrize("height", [0.0, 1e3, 2e4, 1e5])
def test_it_is_the_gradient_of_the_potential(height):
    # the potential is written with a series for q there, and differentiated by steps of 100 m: errors of 3e-9 m/s^2
    lat = np.radians(np.linspace(-89.0, 89.0, 90))
    north, down = gradient_of_potential(lat, height, 100.0)
    found = subject.exact_gravity_n(lat, height)
    np.testing.assert_allclose(found[:, 0], north, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found[:, 2], down, rtol=0, atol=1e-8)
    assert (found[:, 1] == 0.0).all()


def test_at_the_ellipsoid_it_is_the_published_one_and_plumb():
    for lat_deg, published in subject.PUBLISHED.items():
        assert subject.exact_gravity_n(np.radians(lat_deg), 0.0)[2] == pytest.approx(published, abs=2e-10)
    assert np.abs(subject.exact_gravity_n(np.radians(np.linspace(-90, 90, 91)), 0.0)[:, 0]).max() <= 1e-12


def wrong(kind):
    def model(lat, height):
        g = gravity_n(lat, height)
        if kind == "no north":
            g[..., 0] = 0.0
        elif kind == "first order":
            g[..., 2] -= 3.0 * 9.8 * (np.asarray(height) / 6378137.0) ** 2
        elif kind == "2e-8 off":
            g[..., 2] += 2e-8
        return g

    return model


@pytest.mark.parametrize(
    ("kind", "failing"),
    [
        ("right", set()),
        ("no north", {"5 km, north", "10 km, north", "20 km, north"}),
        ("first order", {"5 km, down", "10 km, down", "20 km, down"}),
        ("2e-8 off", {"equator and pole, published", "at the ellipsoid, down"}),
    ],
)
def test_a_wrong_model_is_named(monkeypatch, kind, failing):
    monkeypatch.setattr(subject, "gravity_n", wrong(kind))
    assert {check.case for check in subject.gravity() if not check.passed} == failing
