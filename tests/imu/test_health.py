"""Samples that no sensor felt are found, by name and count; healthy and coarse ones are left alone."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from insnav.exceptions import InputError
from insnav.findings import Code, Severity
from insnav.imu.health import inspect
from insnav.kernels.increments import glance
from insnav.types import ImuData
from tests.filter import drives
from tests.refusals import refused


@pytest.fixture
def imu():
    rng = np.random.default_rng(12)
    exact = drives.perfect_imu(sampling="mean")
    return replace(
        exact,
        gyro=exact.gyro + 2e-3 * rng.standard_normal(exact.gyro.shape),
        accel=exact.accel + 0.02 * rng.standard_normal(exact.accel.shape),
    )


def changed(imu, rows, axis, values):
    data = np.hstack([imu.gyro, imu.accel])
    data[rows, axis] = values
    return replace(imu, gyro=data[:, :3].copy(), accel=data[:, 3:].copy())


def test_healthy_samples_are_the_same_object(imu):
    found, events = inspect(imu)
    assert found is imu
    assert events == []


@pytest.mark.parametrize(("axis", "size"), [(2, 3.0), (0, -3.0), (5, 10.0), (3, -10.0)])
def test_a_spike_is_replaced_and_nothing_else(imu, axis, size):
    whole = np.hstack([imu.gyro, imu.accel])
    bad = changed(imu, 700, axis, whole[700, axis] + size)
    found, (event,) = inspect(bad)
    assert event.code is Code.IMU_SPIKE
    assert event.begin == imu.time[700]
    assert event.subject == ("gyro " if axis < 3 else "accelerometer ") + "xyz"[axis % 3]
    assert event["rate_rad_s" if axis < 3 else "acceleration_m_s2"] == pytest.approx(size, abs=0.5)
    assert event.severity is Severity.NOTE
    after = np.hstack([found.gyro, found.accel])
    assert after[700, axis] == pytest.approx(whole[699:702:2, axis].mean())
    after[700, axis] = whole[700, axis]
    np.testing.assert_array_equal(after, whole)


@pytest.mark.parametrize(("axis", "size"), [(2, 0.2), (0, -0.7), (5, 3.0), (3, -5.0)])
def test_a_small_jump_of_one_axis_alone_is_a_spike_as_by_a_changed_digit(imu, axis, size):
    """0.7 rad/s for 10 ms turned the solution by 0.4 deg, of which nothing told."""
    whole = np.hstack([imu.gyro, imu.accel])
    found, (event,) = inspect(changed(imu, 700, axis, whole[700, axis] + size))
    assert (event.code, event.begin) == (Code.IMU_SPIKE, imu.time[700])
    assert np.hstack([found.gyro, found.accel])[700, axis] == pytest.approx(whole[699:702:2, axis].mean())


@pytest.mark.parametrize("axes", [(2, 5), (0, 1)])
def test_a_shock_that_several_axes_feel_is_none(imu, axes):
    bad = imu
    for axis in axes:
        bad = changed(bad, 700, axis, np.hstack([imu.gyro, imu.accel])[700, axis] + (0.3 if axis < 3 else 3.0))
    assert inspect(bad) == (bad, [])


def test_a_vibration_of_one_axis_is_none(imu):
    rows = np.arange(700, 712)
    bad = changed(imu, rows, 2, imu.gyro[rows, 2] + 0.3 * (-1.0) ** rows)
    assert inspect(bad) == (bad, [])


def test_a_limit_below_the_largest_value_is_one_too(imu):
    """Gyros that clip at less than the largest value of the record: runs of the same value that none beside exceeds."""
    rows = slice(1000, 1400)
    limit = np.quantile(imu.gyro[rows, 2], 0.7)
    bad = changed(imu, rows, 2, np.minimum(imu.gyro[rows, 2], limit))
    bad = changed(bad, 200, 2, 2.0 * abs(limit) + 0.1)
    found, events = inspect(bad)
    clipped = [event for event in events if event.code is Code.IMU_SATURATED]
    assert clipped
    assert all(imu.time[1000] <= event.begin < imu.time[1400] for event in clipped)
    assert found.time.shape[0] < imu.time.shape[0]


def test_increments_are_judged_as_rates(imu):
    step = np.diff(imu.time, prepend=imu.time[0] - 0.02)[:, None]
    bad = changed(imu, 700, 2, 3.0)
    found, (event,) = inspect(replace(bad, gyro=bad.gyro * step, accel=bad.accel * step, sampling="increment"))
    assert event.code is Code.IMU_SPIKE
    assert abs(found.gyro[700, 2]) < 0.05


@pytest.mark.parametrize("seconds", [0.1, 2.0])
def test_a_clipped_stretch_is_taken_out_and_named(imu, seconds):
    rows = slice(3000, 3000 + round(seconds / 0.02))
    bad = changed(imu, rows, 2, 8.0)
    found, (event,) = inspect(bad)
    assert (event.code, event.severity, event.subject) == (Code.IMU_SATURATED, Severity.WARNING, "gyro z")
    assert event["duration_s"] == pytest.approx(seconds, abs=0.03)
    assert event.end == imu.time[rows.stop - 1]
    assert event.begin == imu.time[3000]
    assert found.time.shape[0] == imu.time.shape[0] - (rows.stop - rows.start)


@pytest.mark.parametrize("axis", [0, 4])
def test_a_stuck_axis_is_taken_out_and_named(imu, axis):
    whole = np.hstack([imu.gyro, imu.accel])
    bad = changed(imu, slice(5000, 5060), axis, whole[4999, axis])
    found, (event,) = inspect(bad)
    assert (event.code, event.severity) == (Code.IMU_STUCK, Severity.WARNING)
    assert event.subject == {0: "gyro x", 4: "accelerometer y"}[axis]
    assert event.begin == imu.time[4999]
    assert found.time.shape[0] == imu.time.shape[0] - 61


def test_a_rest_without_noise_is_no_fault():
    """Simulated sensors without errors: one comes to rest after the other."""
    exact = rests_between_turns(4, noise=0.0)
    assert inspect(exact)[1] == []
    data = np.hstack([exact.gyro, exact.accel])
    assert (data[100:5000] == data[100]).all()
    data[100:110, 1] += 1e-6 * np.arange(10, 0, -1)
    found, events = inspect(replace(exact, gyro=data[:, :3].copy(), accel=data[:, 3:].copy()))
    assert events == []
    assert len(found.time) == len(exact.time)


@pytest.mark.parametrize("seconds", [0.6, 2.0, 12.0])
def test_a_logger_that_hangs_is_found(imu, seconds):
    rows = slice(5000, 5000 + round(seconds / 0.02))
    data = np.hstack([imu.gyro, imu.accel])
    data[rows] = data[4999]
    found, (event,) = inspect(replace(imu, gyro=data[:, :3].copy(), accel=data[:, 3:].copy()))
    assert (event.code, event.severity) == (Code.IMU_FROZEN, Severity.WARNING)
    assert event["duration_s"] == pytest.approx(seconds, abs=0.03)
    assert found.time.shape[0] == imu.time.shape[0] - (rows.stop - rows.start) - 1


def rests_between_turns(seed: int, noise: float = 1.0) -> ImuData:
    """Ten minutes with stops: engine and road are felt by all axes, at rest only by the accelerometers."""
    rng = np.random.default_rng(seed)
    time = np.arange(1, 60001) * 0.01
    moving = (np.sin(time / 25.0) > -0.3) & (time > 60.0)
    rate = np.where(moving[:, None], 0.1 * np.sin(np.outer(time, [0.3, 0.5, 0.2])), 0.0)
    gyro = rate + noise * rng.standard_normal((60000, 3)) * np.where(moving[:, None], 0.02, 0.002)
    accel = [0.0, 0.0, -9.8] + noise * rng.standard_normal((60000, 3)) * np.where(moving[:, None], 0.5, 0.02)
    return ImuData(time, gyro, accel)


@pytest.mark.parametrize("step", [0.01, 0.02, 0.04])
def test_coarse_gyros_are_no_fault(step):
    imu = rests_between_turns(1)
    assert inspect(replace(imu, gyro=np.round(imu.gyro / step) * step))[1] == []


@pytest.mark.parametrize("step", [0.02, 0.05, 0.1])
def test_coarse_accelerometers_do_not_reach_the_end_of_their_range(step):
    imu = rests_between_turns(3)
    accel = imu.accel.copy()
    accel[2000:2300, 0] = -6.03 + 0.01 * np.random.default_rng(3).standard_normal(300)  # steady braking
    assert inspect(replace(imu, accel=np.round(accel / step) * step))[1] == []


@pytest.mark.parametrize("steps", [1, 2, 3])
@pytest.mark.parametrize("step", [0.001, 0.005])
def test_gyros_with_a_dead_band_are_no_fault(step, steps):
    imu = rests_between_turns(2)
    gyro = np.round(imu.gyro / step) * step
    gyro[np.abs(gyro) <= steps * step * 1.001] = 0.0
    assert inspect(replace(imu, gyro=gyro))[1] == []


@pytest.mark.parametrize("axis", [1, 2, 3])
@pytest.mark.parametrize("seconds", [1.0, 10.0])
def test_a_coarse_sensor_that_is_stuck_in_motion_is_found(axis, seconds):
    imu = rests_between_turns(3)
    imu = replace(imu, gyro=np.round(imu.gyro / 0.002) * 0.002)
    first = 20000
    bad = changed(imu, slice(first, first + round(100 * seconds)), axis, np.hstack([imu.gyro, imu.accel])[first, axis])
    (event,) = inspect(bad)[1]
    assert event.code is Code.IMU_STUCK
    assert event["duration_s"] >= seconds - 0.02


@pytest.mark.parametrize("times", [4, 9])
def test_an_axis_that_sticks_again_and_again_is_found_each_time(times):
    data = rests_between_turns(3)
    gyro = data.gyro.copy()
    begins = np.linspace(0.1, 0.9, times) * data.time[-1]
    for begin in begins:
        rows = (data.time >= begin) & (data.time < begin + 2.0)
        gyro[rows, 2] = gyro[np.argmax(rows), 2]
    _, events = inspect(replace(data, gyro=gyro))
    assert [event.code for event in events] == [Code.IMU_STUCK] * times
    np.testing.assert_allclose([event.begin for event in events], begins, atol=0.1)


@pytest.mark.parametrize("least", [0.002, 0.01, 0.05])
def test_gyros_that_report_only_what_changed_are_no_fault(least):
    data = rests_between_turns(4)
    held = data.gyro.copy()
    for before, now in pairwise(held):
        now[:] = np.where(np.abs(now - before) < least, before, now)
    assert not [event for event in inspect(replace(data, gyro=held))[1] if event.code is Code.IMU_STUCK]


def test_an_axis_that_never_changes_is_refused_by_name(imu):
    with refused(InputError, "imu.axis_constant") as caught:
        inspect(changed(imu, slice(None), 1, 0.0))
    assert caught.value.values["axis"] == "gyro y"
    assert caught.value.values["rate_rad_s"] == 0.0


def test_coarse_steps_at_rest_are_no_fault(imu):
    rng = np.random.default_rng(3)
    n = 20000
    coarse = np.round(rng.standard_normal((n, 6)) * 0.3)  # nearly always zero, one step up or down now and then
    rest = replace(imu, time=np.arange(n) * 0.01, gyro=coarse[:, :3] * 1e-3, accel=coarse[:, 3:] * 0.02)
    assert inspect(rest)[1] == []


def test_a_short_record_is_left_alone(imu):
    short = replace(imu, time=imu.time[:10], gyro=imu.gyro[:10] * 0.0, accel=imu.accel[:10])
    assert inspect(short) == (short, [])


@pytest.mark.parametrize("sampling", ["increment", "mean"])
def test_the_sample_after_a_gap_is_no_spike(sampling):
    """An increment stands for its own interval, not for the gap before it."""
    imu = drives.perfect_imu(laps=1, sampling=sampling)
    cut = imu.rows((imu.time <= 1030.0) | (imu.time > 1032.0))
    found, events = inspect(cut)
    assert events == []
    assert found is cut


def test_a_glance_finds_each_sample_that_jumps_and_returns() -> None:
    """Beside the definition on all triples of samples: some of the blocks have such a sample."""
    random, found, limit, back = np.random.default_rng(4), set(), np.full(6, 2.0), 0.1
    for _ in range(40):
        values = random.normal(size=(20, 6))
        change = np.diff(values, axis=0)
        before, after, least = change[:-1], change[1:], np.minimum(np.abs(change[:-1]), np.abs(change[1:]))
        jumps = (before * after < 0.0) & (least > limit) & (np.abs(before + after) < back * least)
        odd = glance(values[:, :3].copy(), values[:, 3:].copy(), np.ones(20), limit, back)[2]
        assert odd == jumps.any()
        found.add(bool(odd))
    assert found == {False, True}
