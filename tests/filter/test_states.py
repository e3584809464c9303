"""The filter can be stopped at a fix and gone on from there, as if it had not been."""

from __future__ import annotations

import numpy as np

from insnav.filter.gps_noise import CorrelatedNoise
from insnav.filter.navigator import Navigator
from tests.filter import drives


def test_going_on_from_a_kept_state_gives_the_same_result():
    rng = np.random.default_rng(8)
    imu = drives.noisy_imu(drives.perfect_imu(), drives.MODEL, rng)
    gps = drives.noisy_gps(drives.perfect_gps(), rng)
    start = drives.begin(drives.MODEL, rng)
    lasting = CorrelatedNoise(sd=np.array([0.2, 0.2, 0.4]), time=60.0, share=0.2)
    ready = drives.ready(imu, gps, start, delay_sd=0.05, output_interval=1.0, correlated=lasting)
    whole = Navigator(ready, marks={100})
    whole.feed(imu)
    all_of_it = whole.finish()
    (state,) = whole.kept.values()
    assert state.time == gps.time[100]
    rest = Navigator(ready, state)
    rest.feed(imu)
    second = rest.finish()
    late = all_of_it.innovations.time > all_of_it.epochs.time[100] + 1e-6
    # both put the solution into GPS time by the same final estimate of the offset
    np.testing.assert_allclose(second.innovations.innovation, all_of_it.innovations.innovation[late], rtol=0, atol=2e-6)
    # the first row of the solution ends a sub-step, which the other filter did not have there
    expected = all_of_it.epochs.covariance[late]
    sd = np.sqrt(np.diagonal(expected, axis1=1, axis2=2))
    np.testing.assert_allclose(
        (second.epochs.covariance - expected) / (sd[:, :, None] * sd[:, None, :]), 0.0, atol=1e-4
    )
    np.testing.assert_allclose(second.gps_delay, all_of_it.gps_delay, rtol=1e-4)
