"""Samples become seamless intervals, whatever their stamps; what is missing is marked, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.alignment.in_motion import history
from insnav.attitude import dcm_from_quat
from insnav.exceptions import InputError
from insnav.strapdown import Intervals, increments, intervals, joined, nominal_interval, split
from insnav.types import ImuData, Sampling, Stamp
from tests.refusals import refused

N, STEP = 2000, 0.01
FORMS: list[tuple[Sampling, Stamp]] = [("mean", "end"), ("mean", "start"), ("mean", "mid"), ("increment", "end")]


def record(sampling: Sampling = "increment", stamp: Stamp = "end") -> ImuData:
    """Rates and forces of which no two samples are alike."""
    rng = np.random.default_rng(1)
    size = STEP if sampling == "increment" else 1.0
    values = [np.cumsum(rng.standard_normal((N, 3)), axis=0) * scale * size for scale in (0.01, 0.1)]
    return ImuData(100.0 + STEP * np.arange(N), *values, sampling, stamp)


def without(imu: ImuData, rows: slice) -> ImuData:
    keep = np.ones(imu.time.size, dtype=bool)
    keep[rows] = False
    return replace(imu, time=imu.time[keep], gyro=imu.gyro[keep], accel=imu.accel[keep])


def jittered(imu: ImuData, size: float = 0.0039) -> ImuData:
    return replace(imu, time=imu.time + np.random.default_rng(2).uniform(-size, size, N))


def late(imu: ImuData) -> ImuData:
    """Every tenth stamp comes late, and the step after it is as much shorter."""
    time = imu.time.copy()
    time[5::10] += np.linspace(0.001, 0.0098, time[5::10].size)
    return replace(imu, time=time)


def assert_seamless(parts: Intervals) -> None:
    assert (parts.dt > 0.0).all()
    np.testing.assert_allclose(parts.end[1:] - parts.dt[1:], parts.end[:-1], rtol=0, atol=1e-9)


@pytest.mark.parametrize("shift", [0.0, 0.5, 1.0])
def test_the_stamp_only_moves_the_intervals(shift):
    imu = record("mean")
    stamp: Stamp = {0.0: "end", 0.5: "mid", 1.0: "start"}[shift]
    wanted = intervals(imu)
    found = intervals(replace(imu, time=imu.time - shift * STEP, stamp=stamp))
    np.testing.assert_allclose(found.end, wanted.end, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.gyro, wanted.gyro, rtol=0, atol=1e-12)
    assert_seamless(found)


def test_mean_and_increment_are_the_same_integral():
    mean, increment = intervals(record("mean")), intervals(record("increment"))
    np.testing.assert_allclose(mean.gyro, increment.gyro, rtol=1e-9)
    np.testing.assert_allclose(mean.accel, increment.accel, rtol=1e-9)


@pytest.mark.parametrize("change", [jittered, late], ids=["jitter", "late"])
@pytest.mark.parametrize(("sampling", "stamp"), FORMS)
def test_uneven_stamps_are_no_hole(sampling, stamp, change):
    parts = intervals(change(record(sampling, stamp)), STEP)
    assert parts.end.size == N
    assert (parts.gap == 0.0).all()
    assert_seamless(parts)


@pytest.mark.parametrize("change", [jittered, late], ids=["jitter", "late"])
def test_increments_with_uneven_stamps_keep_their_sum(change):
    imu = change(record())
    found = increments(intervals(imu, STEP))
    np.testing.assert_allclose(found.dtheta.sum(axis=0), imu.gyro.sum(axis=0), rtol=1e-9)
    np.testing.assert_allclose(found.dvel.sum(axis=0), imu.accel.sum(axis=0), rtol=1e-9)


@pytest.mark.parametrize("missing", [1, 2, 30])
@pytest.mark.parametrize(("sampling", "stamp"), FORMS)
def test_missing_samples_are_bridged_in_a_straight_line_and_marked(sampling, stamp, missing):
    whole = record(sampling, stamp)
    imu = without(whole, slice(700, 700 + missing))
    parts, unharmed = intervals(imu), intervals(whole)
    bridge = slice(700, 700 + missing)
    assert np.flatnonzero(parts.gap).tolist() == list(range(700, 700 + missing))
    np.testing.assert_allclose(parts.gap[bridge], missing * STEP, rtol=1e-6)
    assert_seamless(parts)
    np.testing.assert_allclose(parts.end, unharmed.end, rtol=0, atol=1e-9)
    line = np.linspace(unharmed.gyro[699], unharmed.gyro[700 + missing], missing + 2)[1:-1]
    np.testing.assert_allclose(parts.gyro[bridge], line, rtol=1e-9)
    measured = parts.gap == 0.0
    np.testing.assert_allclose(parts.accel[measured], unharmed.accel[measured], rtol=1e-9)
    assert len(np.unique(parts.segment)) == 3  # before, across, after: no polynomial reaches into the hole


@pytest.mark.parametrize("sampling", ["mean", "increment", "instant"])
def test_a_missing_sample_among_jitter_is_still_a_hole(sampling):
    parts = intervals(without(jittered(record(sampling), 0.0012), slice(700, 701)), STEP)
    assert np.flatnonzero(parts.gap).tolist() == [700]


def test_pieces_fill_their_intervals_and_add_up():
    parts = intervals(record())
    # inside an interval, twice inside one, on an end, a half microsecond beside one, outside
    times = np.array([50.0, 100.5034, 100.7021, 100.7083, 101.0, 101.25 + 5e-7, 500.0])
    parent, s0, s1 = split(parts, times, 0, N)
    assert parent.size == N + 3
    assert (s1 > s0).all()
    count = np.ones(N)
    count[[51, 71]] = 2, 3
    np.testing.assert_array_equal(np.bincount(parent), count)
    cut, whole = increments(parts, (parent, s0, s1)), increments(parts)
    assert np.isin(times[1:4].round(6), cut.time.round(6)).all()
    assert cut.dt.sum() == pytest.approx(whole.dt.sum(), rel=1e-12)
    for name in ("dtheta", "dvel"):
        total = np.zeros((N, 3))
        np.add.at(total, parent, getattr(cut, name))
        np.testing.assert_allclose(total, getattr(whole, name), rtol=1e-9, atol=1e-12)


def test_one_sample_makes_no_interval():
    with refused(InputError, "data.few_samples"):
        nominal_interval(np.array([1.0]))


def test_joined_intervals_turn_and_push_as_the_samples_do():
    # two axes out of phase: without the second-order terms the joined angles would lose the cone
    n, dt = 2000, 0.005
    t = dt * np.arange(1, n + 1)
    gyro = np.column_stack([1.5 * np.sin(20.0 * t), 1.5 * np.cos(20.0 * t), 0.4 + 0.0 * t])
    accel = np.column_stack([3.0 * np.cos(20.0 * t), 2.0 * np.sin(20.0 * t), -9.8 + 0.0 * t])
    for sampling in ("mean", "instant"):
        parts = intervals(ImuData(t, gyro, accel, sampling=sampling))
        less = joined([parts])
        assert less.end[-1] == parts.end[-1]
        assert less.dt[1] == pytest.approx(0.04)
        ends = [history(each, 0.0, 10.0, np.zeros(3), np.zeros(3), 0.5) for each in (parts, less)]
        away = dcm_from_quat(ends[0].q_nb[-1]).T @ dcm_from_quat(ends[1].q_nb[-1])
        # of the second order alone: 10 s of a cone of 1.5 rad/s make 0.56 rad
        assert np.abs(away - np.eye(3)).max() < 1e-3
        assert np.abs(ends[0].u_n[-1] - ends[1].u_n[-1]).max() < 0.05


def test_joined_intervals_end_at_gaps():
    t = np.concatenate([0.01 * np.arange(1, 103), 2.0 + 0.01 * np.arange(100)])
    parts = intervals(ImuData(t, np.zeros((t.size, 3)), np.ones((t.size, 3))))
    less = joined([parts])
    assert float(less.dt[less.gap == 0.0].sum()) == pytest.approx(float(parts.dt[parts.gap == 0.0].sum()))
    assert np.abs(less.accel / less.dt[:, None] - 1.0).max() < 1e-12
    assert np.unique(less.segment).size == 3
