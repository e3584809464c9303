"""The filter's uncertainty is true: errors over many seeds are as large as the covariance says.

Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 5.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import chi2

from insnav.earth import ned_offset
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
