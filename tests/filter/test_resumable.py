"""Blocks of any size give the same bits."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from insnav.types import GpsData, ImuData, Run
from tests.filter import drives

N = 2500  # samples, 25 s at 100 Hz
RNG_SEED = 8


def short(sampling: str, stamp: str) -> ImuData:
    """The first half minute, with jittered stamps and three holes, one of them right before a fix."""
    imu = drives.perfect_imu(100.0, sampling)
    rng = np.random.default_rng(RNG_SEED)
    time = imu.time[:N] + rng.uniform(-0.0015, 0.0015, N)
    keep = np.ones(N, dtype=bool)
    keep[400:403] = keep[987:1010] = keep[1500:1650] = False
    return ImuData(time[keep], imu.gyro[:N][keep], imu.accel[:N][keep], sampling, stamp)


def fixes() -> GpsData:
    """Fixes between samples, on samples, two close together, one in a hole and none for five seconds."""
    gps = drives.perfect_gps(0.7)
    rng = np.random.default_rng(RNG_SEED)
    gps = drives.noisy_gps(gps, rng)
    time = gps.time + rng.uniform(-0.01, 0.01, gps.time.size)
    time[3] = time[2] + 0.0004
    keep = (time < 1005.0) | (time > 1010.0)
    velocity = gps.v_n.copy()
    velocity[::3] = np.nan
    return GpsData(time[keep], gps.lla[keep], velocity[keep], gps.position_sd[keep], gps.velocity_sd[keep])


def bits(run: Run) -> dict[str, np.ndarray]:
    """Every array of a run by its name."""
    found = {}
    for part in ("solution", "innovations", "sensor_errors", "epochs"):
        value = getattr(run, part)
        found |= {f"{part}.{f.name}": np.asarray(getattr(value, f.name)) for f in fields(value)}
    return found | {"delay": np.array([run.gps_delay, run.gps_delay_sd])}


CASES = [
    ("increment", "end", {}),
    ("increment", "start", {}),
    ("increment", "mid", {}),
    ("mean", "end", {"output_interval": 0.0}),
    ("mean", "start", {"output_interval": 0.1}),
    ("mean", "mid", {"delay": 0.013}),
    ("instant", "end", {"delay_sd": 0.05}),
]


@pytest.mark.parametrize(("sampling", "stamp", "settings"), CASES)
def test_blocks_of_any_size_give_the_same_bits(sampling, stamp, settings):
    imu, gps = short(sampling, stamp), fixes()
    start = drives.begin(drives.MODEL, np.random.default_rng(3))
    whole = drives.navigate(imu, gps, start, drives.MODEL, **settings)
    wanted = bits(whole)
    assert wanted["epochs.time"].size >= 20
    assert all(np.isfinite(wanted[name]).all() for name in ("solution.lla", "solution.sd", "epochs.covariance"))
    for size in (1, 7, 1000):
        run = drives.navigate(imu, gps, start, drives.MODEL, blocks=size, **settings)
        for name, value in bits(run).items():
            np.testing.assert_array_equal(value, wanted[name], err_msg=f"{name}, blocks of {size}")
        assert run.events == whole.events


def test_a_rejected_fix_and_a_reset_are_the_same_in_blocks():
    imu, gps = short("increment", "end"), fixes()
    lla = gps.lla.copy()
    lla[8:, 2] += 3000.0
    gps = replace(gps, lla=lla)
    start = drives.begin(drives.MODEL, np.random.default_rng(3))
    whole = drives.navigate(imu, gps, start, drives.MODEL)
    assert len(whole.events) > 5
    for size in (1, 1000):
        run = drives.navigate(imu, gps, start, drives.MODEL, blocks=size)
        assert run.events == whole.events
        np.testing.assert_array_equal(run.solution.lla, whole.solution.lla)


def test_the_solution_covers_the_record_on_its_grid():
    imu, gps = short("increment", "end"), fixes()
    start = drives.begin(drives.MODEL, np.random.default_rng(3))
    every = drives.navigate(imu, gps, start, drives.MODEL, blocks=50, output_interval=0.0).solution
    assert np.isin(imu.time[imu.time > 1000.0], every.time).all()
    assert (np.diff(every.time) > 0.0).all()
    tenth = drives.navigate(imu, gps, start, drives.MODEL, blocks=50, output_interval=0.1).solution
    late = tenth.time - np.round(tenth.time, 1)
    assert tenth.time.size == pytest.approx(250, abs=2)
    assert ((late > -1e-6) & (late < 0.0125)).all()
