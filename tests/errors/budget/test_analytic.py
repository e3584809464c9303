"""The analytic budget in straight, accelerating and turning motion: against covariance and another integrator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.errors.budget.predicted import analytic, covariance
from insnav.errors.budget.sources import SampledMotion, Source, at_rest, families, sampled, sources_of
from insnav.imu import ClockSpec
from insnav.simulate import circle, straight
from tests.errors.budget.imus import whole
from tests.errors.budget.own_integrator import monte_carlo
from tests.simulate.motions import PLACE, Segment, drive

LENGTH, RATE = 30.0, 25.0
ROWS = np.array([375, 750])
NOISY = ("white", "random walk", "Gauss-Markov", "flicker", "quantisation")


def moving(kind: str) -> SampledMotion:
    truth = {
        "straight": lambda: straight(PLACE, 20.0, 0.7, LENGTH + 1.0),
        "accelerating": lambda: drive((Segment(1.0), Segment(35.0, speed=50.0)), PLACE, seed=3, heading=0.7),
        "turning": lambda: circle(PLACE, 10.0, 0.1, LENGTH + 2.0),
    }[kind]()
    return sampled(truth, 1.0, LENGTH, rate=RATE)


def horizontal(sd: np.ndarray) -> np.ndarray:
    return np.hypot(sd[:, 0], sd[:, 1])


def of_families(sources: tuple[Source, ...], values: np.ndarray) -> dict[str, np.ndarray]:
    """Horizontal position errors by family, of standard deviations by source (m, s, 9)."""
    return {
        name: horizontal(np.sqrt(sum(values[:, k] ** 2 for k, s in enumerate(sources) if s.family == name)))
        for name in families(sources)
    }


@pytest.mark.parametrize("grade", [0.01, 1.0, 10.0])
@pytest.mark.parametrize("kind", ["straight", "accelerating", "turning"])
def test_every_source_is_as_large_as_the_covariance_says(kind, grade):
    motion = moving(kind)
    spec = replace(whole(), clock=ClockSpec())
    sources = tuple(replace(each, sd=grade * each.sd) for each in sources_of(spec, 2e-5))
    found = of_families(sources, analytic(sources, motion, ROWS))
    parts = covariance(sources, motion, ROWS)
    wanted = of_families(sources, np.sqrt(np.einsum("msii->msi", parts)))
    for name in wanted:
        np.testing.assert_allclose(found[name], wanted[name], rtol=0.02, err_msg=name)


@pytest.mark.parametrize("kind", ["accelerating", "turning"])
def test_noise_is_as_large_as_in_runs_of_another_integrator(kind):
    motion, runs = moving(kind), 400
    spec = whole()
    sources = tuple(each for each in sources_of(spec) if each.kind in NOISY)
    found = of_families(sources, analytic(sources, motion, ROWS))
    for number, name in enumerate(families(sources)):
        mine = tuple(each for each in sources if each.family == name)
        ratio = found[name] / horizontal(monte_carlo(mine, motion, ROWS, runs, 100 + number))
        # the RMS of so many runs is good to 3 %, of three axes together
        assert np.all(np.abs(ratio - 1.0) < 0.09), (name, ratio)


def test_quantisation_at_rest_is_its_law():
    """Each step of the integral is a white error of it: Q sqrt(dt t) of position, g Q sqrt(dt t^3 / 3) by a gyro."""
    motion, g = at_rest(60.0), 9.806
    for group, wanted in (("accel", np.sqrt(0.01 * 60.0)), ("gyro", g * np.sqrt(0.01 * 60.0**3 / 3.0))):
        source = (Source(group, "quantisation", "x", "quantisation", 1e-3),)
        sd = analytic(source, motion, np.array([6000]))[0, 0]
        assert np.max(sd[:2]) == pytest.approx(1e-3 * wanted, rel=2e-3)
        assert np.max(sd[6:] if group == "gyro" else sd[3:6]) == pytest.approx(1e-3, rel=0.02)
