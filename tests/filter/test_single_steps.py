"""Single steps of preparation, filter and noise search, each against its closed form."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insnav import strapdown
from insnav.alignment.in_motion import SPAN
from insnav.attitude import dcm_from_rph
from insnav.earth import lla_offset
from insnav.filter.delay_and_lever import _with_course
from insnav.filter.fine_alignment import fine_alignment
from insnav.filter.gates import without_frozen
from insnav.filter.innovation_likelihood import InnovationLikelihood
from insnav.filter.measurements.measurement import NOTHING, FilterView
from insnav.filter.navigator import Navigator
from insnav.filter.noise_identification import kind_of
from insnav.imu import load_imu
from insnav.kernels.earth import OMEGA
from insnav.types import Alignment, FloatArray, GpsData, ImuData
from tests.filter import drives


def navigator(**values: object) -> Navigator:
    """A filter of one error-free lap."""
    start = drives.begin(drives.MODEL, laps=1)
    return Navigator(drives.ready(drives.perfect_imu(laps=1), drives.perfect_gps(laps=1), start, **values))


@pytest.mark.parametrize("lag", [0.0, 0.4, -0.2])
@pytest.mark.parametrize("moments", [(1.0,), (0.5, 1.5)])
def test_rates_and_forces_are_those_at_the_time_of_the_velocity(lag, moments):
    """Both change linearly: the mean about a time is the value there, and the turn since then the mean rate."""
    ready = navigator(velocity_lag=lag)._ready
    receiver = replace(ready.receiver, lag=replace(ready.receiver.lag, moments=moments))
    filtered = Navigator(replace(ready, receiver=receiver))
    edges, dt = np.arange(0.0, 10.0, 0.02), 0.02
    rate, rate_slope = np.array([0.01, -0.02, 0.03]), np.array([0.02, 0.01, -0.01])
    force, force_slope = np.array([1.0, -2.0, -9.8]), np.array([0.3, 0.2, -0.1])
    middle = (edges - 0.5 * dt)[:, None]
    samples = ImuData(edges, dt * (rate + middle * rate_slope), dt * (force + middle * force_slope), "increment")
    times = np.array([4.0, 5.0, 6.4])
    filtered._sense(times, np.full(3, lag), strapdown.intervals(samples, dt))
    seen_rate, seen_force, swing, older = filtered._sensed
    at = (times - lag)[:, None]
    np.testing.assert_allclose(seen_rate, rate + at * rate_slope, rtol=0, atol=1e-9)
    np.testing.assert_allclose(seen_force, force + at * force_slope, rtol=0, atol=1e-9)
    if lag == 0.0:
        assert (swing.size, older.size) == (0, 0)
        return
    np.testing.assert_allclose(swing, rate + (at - 0.5 * dt) * rate_slope, rtol=0, atol=1e-9)
    spread = np.mean(np.square(moments)) * lag**2  # of the square of the time
    np.testing.assert_allclose(
        older[:, :3], lag * (rate + times[:, None] * rate_slope) - 0.5 * spread * rate_slope, rtol=0, atol=1e-9
    )
    for row, time in zip(older, times, strict=True):
        gains = []
        for part in moments:
            h, turn, gain = part * lag / 200, Rotation.identity(), np.zeros(3)
            for before in h * (np.arange(200) + 0.5):  # back from the time of the fix
                back = Rotation.from_rotvec(-0.5 * h * (rate + (time - before) * rate_slope))
                gain += h * (turn * back).apply(force + (time - before) * force_slope)
                turn = turn * back * back
            gains.append(gain)
        np.testing.assert_allclose(row[3:], np.mean(gains, axis=0), rtol=0, atol=2e-4)


def test_the_covariance_of_both_arms_is_that_of_their_states():
    """Lever arm, and vibration arm minus lever arm; the variance of a difference has both covariances."""
    start = drives.begin(drives.MODEL, laps=1)
    ready = drives.ready(drives.perfect_imu(laps=1), drives.perfect_gps(laps=1), start, lever_sd=2.0)
    arm = replace(ready.receiver.lever_arm, shaken=0.5)
    filtered = Navigator(replace(ready, receiver=replace(ready.receiver, lever_arm=arm)))
    filtered.feed(ready.imu)
    estimate = filtered._estimate
    off, covariance = filtered.levers()
    p, lever, shaken = estimate.covariance, *(slice(i, i + 3) for i in (estimate.at.lever, estimate.at.shaken))
    np.testing.assert_allclose(off, [estimate.lever - drives.LEVER_B, estimate.shaken - estimate.lever])
    difference = p[shaken, shaken] + p[lever, lever] - p[shaken, lever] - p[lever, shaken]
    np.testing.assert_allclose(covariance, [p[lever, lever], difference], rtol=0, atol=1e-12)
    assert np.abs(p[shaken, lever]).max() > 1e-6


def test_aiding_sees_the_mean_of_the_gyros_between_two_epochs():
    class Watching:
        order, name, unit, excluded_by, sd = 0, "watching", "", frozenset[str](), np.ones(1)
        views: tuple[FilterView, ...] = ()

        def observe(self, at: FilterView, z: FloatArray, h: FloatArray) -> slice:
            self.views += (at,)
            return NOTHING

    watching, imu = Watching(), drives.perfect_imu(laps=1)
    filtered = navigator(aiding=[watching])
    filtered.feed(imu.rows(slice(0, 1500)))
    assert len(watching.views) > 20
    for view in watching.views:
        rows = (imu.time > view.begin + 1e-6) & (imu.time < view.time + 1e-6)
        angle = imu.gyro[rows].sum(axis=0)
        np.testing.assert_allclose(view.mean_gyro, angle / (view.time - view.begin), rtol=1e-9, atol=1e-12)


def test_each_change_at_rest_enters_between_the_middles_of_two_parts():
    """Four parts of 20 s: the rate of change times the length of a part is the square of each change."""
    ready = navigator()._ready
    sway = np.array([[1e-3, 2e-3], [3e-3, 1e-3], [2e-3, 5e-3]])
    part = ready.starts[0]
    still = replace(part.alignment, static=(part.alignment.time, part.alignment.time + 80.0), sway=sway)
    estimate = Navigator(replace(ready, starts=(replace(part, alignment=still),)))._estimate
    np.testing.assert_allclose(20.0 * estimate._noise.sway, sway**2, rtol=1e-12)


def test_the_kind_of_imu_is_the_nearest_one_above_or_below():
    """A drive that shows ten times the noise of its prior; one kind has that noise, another a hundred times more."""
    kinds = [
        replace(drives.SPEC, gyro=replace(drives.SPEC.gyro, random_walk=factor * drives.SPEC.gyro.random_walk))
        for factor in (1.0, 10.0, 1000.0)
    ]
    usual = float(drives.SPEC.gyro.random_walk[0])
    value = 10.0 * usual
    figure = SimpleNamespace(
        key="gyro.random_walk", observable=True, prior=usual, value=value, low=0.8 * value, high=1.25 * value
    )
    drive = SimpleNamespace(prior=kinds[0], parameters=[SimpleNamespace(sd=0.8)])
    for others in (kinds[1:], kinds[:0:-1]):
        assert kind_of(SimpleNamespace(seen=[drive], figures=[figure]), others) is kinds[1]


@pytest.mark.parametrize("times", [0.5, 3.0])
def test_the_noise_of_gyros_at_rest_is_the_middle_of_their_prior(times):
    rng, dt = np.random.default_rng(6), 0.02
    time, density = np.arange(0.0, 400.0, dt), times * drives.SPEC.gyro.random_walk
    gyro = density * np.sqrt(dt) * rng.standard_normal((time.size, 3))
    imu = ImuData(time, gyro, np.tile([0.0, 0.0, -9.8 * dt], (time.size, 1)), "increment")
    of = object.__new__(InnovationLikelihood)
    of._ready = SimpleNamespace(alignment=SimpleNamespace(static=(0.0, 400.0)), imu=imu)
    of.prior, of._states, of.velocity_sd = drives.SPEC, 21, np.full(3, 0.1)
    of._offered, of._given = np.ones(10, bool), np.arange(10.0)
    middle = {parameter.key: parameter.middle for parameter in of._choose()}
    assert middle["gyro.random_walk"] == pytest.approx(np.log(times), abs=0.1)
    assert middle["accel.random_walk"] == 0.0


@pytest.mark.parametrize("course", [0.0, 45.0, 90.0])
def test_whole_fixes_that_stay_while_the_imu_shakes_are_frozen_on_every_course(course):
    time, rng = np.arange(120.0), np.random.default_rng(7)
    way = 10.0 * time[:, None] * [np.cos(np.deg2rad(course)), np.sin(np.deg2rad(course)), 0.0]
    lla = lla_offset(np.tile([0.8, 0.2, 100.0], (120, 1)), way + 0.3 * rng.standard_normal((120, 3)))
    lla[41:61] = lla[40]
    none = np.full((120, 3), np.nan)
    force = rng.normal([0.0, 0.0, -9.8], 1.0, (1200, 3))
    imu = ImuData(np.arange(0.0, 120.0, 0.1), np.zeros((1200, 3)), force)
    found, _ = without_frozen(GpsData(time, lla, none, np.ones((120, 3)), none), imu)
    assert np.flatnonzero(found.position_sd[:, 0] > 1.0).tolist() == list(range(41, 61))


def test_a_fine_alignment_uses_no_sample_outside_the_rest():
    time, lla = np.arange(0.01, 60.0, 0.01), np.array([0.8, 0.2, 300.0])
    rate = OMEGA * np.array([np.cos(0.8), 0.0, -np.sin(0.8)])
    rng = np.random.default_rng(9)
    gyro = rate + 1e-6 * rng.standard_normal((time.size, 3))
    accel = [0.0, 0.0, -9.8] + 1e-3 * rng.standard_normal((time.size, 3))
    imu, inside = ImuData(time, gyro, accel), (time >= 10.0) & (time <= 50.0)
    shaken = ImuData(time, np.where(inside[:, None], gyro, 1.0), np.where(inside[:, None], accel, 5.0))
    wanted, found = (fine_alignment(each, load_imu("navigation"), lla, (10.0, 50.0), 0.0) for each in (imu, shaken))
    np.testing.assert_array_equal(found.coarse.rph, wanted.coarse.rph)
    np.testing.assert_allclose(found.coarse.rph, 0.0, atol=1e-3)


def test_the_course_shows_the_gyro_bias_of_a_drive_that_turns_at_its_start():
    """A bend of 40 deg in the first seconds, then a straight road; the vertical gyro is off by 1 mrad/s."""
    dt, bias, lat = 0.02, 1e-3, 0.8
    time = np.arange(dt, 200.0, dt)
    heading = np.deg2rad(40.0) * np.clip(time / SPAN, 0.0, 1.0)
    earth = OMEGA * np.array([np.cos(lat), 0.0, -np.sin(lat)])
    gyro = np.einsum("nij,i->nj", dcm_from_rph(np.column_stack([0.0 * time, 0.0 * time, heading])), earth)
    gyro[:, 2] += np.gradient(heading, dt) + bias
    imu = ImuData(time, gyro, np.tile([0.0, 0.0, -9.8], (time.size, 1)))
    at = np.arange(1.0, 199.0)
    course = np.interp(at, time, heading)
    v_n = 15.0 * np.column_stack([np.cos(course), np.sin(course), 0.0 * at])
    lla = lla_offset(np.tile([lat, 0.2, 100.0], (at.size, 1)), np.cumsum(v_n, axis=0))
    gps = GpsData(at, lla, v_n, np.ones((at.size, 3)), np.full((at.size, 3), 0.1))
    start = float(time[0])
    alignment = Alignment(start, np.zeros(3), np.full(3, 1e-3), np.zeros(3), np.full(3, 0.01), None, *drives.GIVEN)
    found = _with_course(SimpleNamespace(gps=gps, fix_time=at, imu=imu, nominal=dt), alignment)
    assert found.gyro_bias[2] == pytest.approx(bias, abs=2e-5)
    assert found.gyro_bias_sd[2] < 0.1 * alignment.gyro_bias_sd[2]
    np.testing.assert_array_equal(found.gyro_bias[:2], 0.0)
