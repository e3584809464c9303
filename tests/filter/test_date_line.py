"""The filter at the date line does what it does anywhere else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.earth import ned_offset
from insnav.types import Run
from tests.filter import drives


def shifted(lon: float) -> Run:
    """The drive of the other tests, turned about the Earth's axis: the IMU does not notice."""
    rng = np.random.default_rng(4)
    imu = drives.noisy_imu(drives.perfect_imu(laps=1), drives.MODEL, rng)
    gps = drives.noisy_gps(drives.perfect_gps(laps=1), rng)
    start = drives.begin(drives.MODEL, rng, laps=1)

    def there(lla):
        moved = np.array(lla)
        moved[..., 1] = (moved[..., 1] + lon + np.pi) % (2 * np.pi) - np.pi
        return moved

    start = replace(start, initial=replace(start.initial, lla=there(start.initial.lla)))
    return drives.navigate(imu, replace(gps, lla=there(gps.lla)), start, drives.MODEL)


def test_nothing_jumps_at_the_date_line():
    here, there = shifted(0.0), shifted(np.pi - drives.PLACE[1] - 1e-6)
    lon = there.solution.lla[:, 1]
    assert (np.abs(np.diff(lon)) > 6.0).any()  # it was crossed
    assert (lon >= -np.pi).all()
    assert (lon < np.pi).all()
    assert here.events == there.events == ()
    back = there.solution.lla - [0.0, np.pi - drives.PLACE[1] - 1e-6, 0.0]
    assert np.abs(ned_offset(back, here.solution.lla)).max() <= 1e-6
    np.testing.assert_allclose(there.innovations.innovation, here.innovations.innovation, atol=1e-6)
