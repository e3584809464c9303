"""The filter's uncertainty is true: errors over many seeds are as large as the covariance says.

Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 5.4.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import chi2

from insnav.earth import ned_offset
from insnav.explain.explanation import Explanation
from insnav.filter.navigator import Navigator
from insnav.simulate import reference
from tests.filter import drives

SEEDS = range(30)
CONVERGED = 60.0  # [s]


@dataclass(frozen=True)
class Consistency:
    nees: np.ndarray  # (seeds, epochs, 4): all nine errors, position, velocity, attitude
    nis: np.ndarray  # (seeds, epochs, 2): position, velocity
    time: np.ndarray


@pytest.fixture(scope="module")
def found() -> Consistency:
    motion = drives.truth()
    nees, nis = [], []
    for seed in SEEDS:
        rng = np.random.default_rng([77, seed])
        imu = drives.noisy_imu(drives.perfect_imu(), drives.MODEL, rng)
        gps = drives.noisy_gps(drives.perfect_gps(), rng)
        run = drives.navigate(imu, gps, drives.begin(drives.MODEL, rng), drives.MODEL, gates=drives.UNFAILING)
        assert run.events == ()
        epochs = run.epochs
        true = reference(motion, epochs.time)
        phi = drives.attitude_error(epochs.q_nb, true.rph)
        error = np.column_stack([ned_offset(epochs.lla, true.lla), epochs.v_n - true.v_n, phi])
        parts = [slice(0, 9), slice(0, 3), slice(3, 6), slice(6, 9)]
        nees.append([])
        for part in parts:
            e, p = error[:, part], epochs.covariance[:, part, part]
            nees[-1].append(np.einsum("ni,ni->n", e, np.linalg.solve(p, e[..., None])[..., 0]))
        nis.append([run.innovations.nis_position, run.innovations.nis_velocity])
    late = epochs.time > motion.start + CONVERGED
    return Consistency(np.moveaxis(nees, 1, 2)[:, late], np.moveaxis(nis, 1, 2)[:, late], epochs.time[late])


def test_nees_of_the_nine_errors_is_inside_its_band(found):
    n = len(SEEDS)
    low, high = chi2.ppf([0.025, 0.975], 9 * n) / n
    mean = found.nees[:, :, 0].mean(axis=0)
    inside = np.mean((mean >= low) & (mean <= high))
    print(f"NEES of 9: mean {mean.mean():.3f}, inside [{low:.2f}, {high:.2f}] at {100 * inside:.1f} % of epochs")
    assert inside >= 0.9


@pytest.mark.parametrize(("part", "column"), [("position", 1), ("velocity", 2), ("attitude", 3)])
def test_time_mean_of_nees(found, part, column):
    mean = found.nees[:, :, column].mean() / 3
    print(f"NEES/3 of {part}: {mean:.3f}")
    assert 0.9 <= mean <= 1.1


@pytest.mark.parametrize(("part", "column"), [("position", 0), ("velocity", 1)])
def test_mean_of_nis(found, part, column):
    # innovations are white: 30 seeds of 239 fixes leave 0.01 of scatter
    mean = found.nis[:, :, column].mean() / 3
    print(f"NIS/3 of {part}: {mean:.3f}")
    assert 0.96 <= mean <= 1.04


def test_innovations_are_white(found):
    x = found.nis[:, :, 0] / 3 - 1
    lagged = np.mean(x[:, 1:] * x[:, :-1]) / np.mean(x * x)
    assert abs(lagged) < 0.05


def test_the_mean_square_of_innovations_is_one_and_more_where_the_noise_is_understated() -> None:
    """Six values of each of 300 fixes: its standard deviation is sqrt(2 / 1800) = 0.033."""
    rng = np.random.default_rng(78)
    imu, gps = drives.noisy_imu(drives.perfect_imu(), drives.MODEL, rng), drives.noisy_gps(drives.perfect_gps(), rng)
    begin = drives.begin(drives.MODEL, rng)
    for part, low, high in ((1.0, 0.87, 1.13), (0.7, 1.2, 2.1)):
        fixes = replace(gps, position_sd=part * gps.position_sd, velocity_sd=part * gps.velocity_sd)
        navigator = Navigator(drives.ready(imu, fixes, begin, drives.MODEL, gates=drives.UNFAILING))
        navigator.feed(imu)
        assert low < navigator.misfit()[1] < high


def test_ambiguous_explanations_add_their_variance_between_its_times() -> None:
    rng = np.random.default_rng(79)
    imu, gps = drives.noisy_imu(drives.perfect_imu(), drives.MODEL, rng), drives.noisy_gps(drives.perfect_gps(), rng)
    run = drives.navigate(imu, gps, drives.begin(drives.MODEL, rng), drives.MODEL)
    time, variance = run.solution.time[[0, -1]], np.array([np.arange(9.0), 3.0 * np.arange(9.0)])
    sd = Explanation(between=(time, variance)).widen(run).solution.sd
    added = sd**2 - run.solution.sd**2
    middle = np.abs(run.solution.time - time.mean()).argmin()
    np.testing.assert_allclose(added[[0, middle, -1]], np.outer([1.0, 2.0, 3.0], np.arange(9.0)), rtol=1e-2, atol=1e-9)
