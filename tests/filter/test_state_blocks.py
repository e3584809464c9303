"""A further state of the filter is a block and its derivatives; layout, prior, decay and feedback follow from it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.filter import error_model, navigator
from insnav.filter.error_model import StateBlock
from insnav.filter.navigator import Navigator
from insnav.filter.receiver import Delay, Receiver
from tests.filter import drives

OFFSET = np.array([0.4, -0.3, 0.2])  # of the velocities of the receiver [m/s]
SD, TIME = 0.5, 100.0  # of it [m/s], [s]


@pytest.mark.parametrize("time", [np.empty(0), np.full(3, TIME)])
def test_an_offset_of_velocities_is_a_block_and_its_derivatives(monkeypatch, time):
    """The block is in `blocks_of`; the derivatives are those that `assess` would have."""
    blocks_of, assess = error_model.blocks_of, navigator.assess
    block = StateBlock("velocity offset", np.zeros(3), np.full(3, SD), time)
    monkeypatch.setattr(error_model, "blocks_of", lambda receiver: (*blocks_of(receiver), block))
    first, place, size = error_model.layout(Receiver(delay=Delay(sd=0.05))).places[-1]
    assert size == 3

    def with_offset(estimated, p, *more):
        found = assess(estimated, p, *more)
        z, h, r, s, sd = more[-5:]
        z[3:] += estimated[place : place + 3]
        h[3:, first : first + 3] = np.eye(3)
        s[:] = h @ p @ h.T + r
        sd[:] = np.sqrt(np.diag(s))
        return found[0], float(z[3:] @ np.linalg.solve(s[3:, 3:], z[3:])), *found[2:]

    monkeypatch.setattr(navigator, "assess", with_offset)
    rng = np.random.default_rng(5)
    imu = drives.noisy_imu(drives.perfect_imu(), drives.MODEL, rng)
    gps = drives.noisy_gps(drives.perfect_gps(), rng)
    gps = replace(gps, v_n=gps.v_n + OFFSET)
    end = gps.time[-1] - TIME
    ready = drives.ready(imu, gps.rows(gps.time < end), drives.begin(drives.MODEL, rng), delay_sd=0.05)
    filtering = Navigator(ready, marks={np.searchsorted(gps.time, end) - 1})
    filtering.feed(imu)
    filtering.finish()
    (state,) = filtering.kept.values()
    value, sd = state.further[-3:], np.sqrt(np.diag(state.covariance)[first : first + 3])
    assert (sd < 0.1).all()
    assert (np.abs(value - OFFSET) < 3.0 * sd).all()
    # without fixes for one correlation time, the variance returns to the prior as exp(-2) does to zero
    left = np.sqrt(np.diag(filtering._estimate.covariance)[first : first + 3])
    faded = np.exp(-2.0) if time.size else 1.0
    np.testing.assert_allclose(left**2, faded * sd**2 + (1.0 - faded) * SD**2, rtol=0.03)
