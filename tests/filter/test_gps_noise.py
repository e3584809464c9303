"""The lag between velocity and position of the fixes: found where it is, zero where it is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insnav
from insnav.earth import ned_offset
from insnav.filter.gps_noise import (
    DEFAULT_POSITION,
    DEFAULT_VELOCITY,
    FLOAT,
    FLOAT_SD,
    OPEN_SD,
    velocity_lag,
    with_sd,
)
from insnav.filter.noise_identification import identify_noise
from insnav.findings import ASSUMED_POSITION_SD, Code, Severity, of_code
from insnav.session.simulation import plan_of, profiled
from insnav.simulate import GpsErrors, corrupt_gps, gps_from_truth
from insnav.types import GpsData
from tests.filter import drives

RTK = GpsErrors((0.02, 0.02, 0.03), velocity_noise=(0.05, 0.05, 0.05))
METRES = GpsErrors((1.5, 1.5, 3.0), velocity_noise=(0.1, 0.1, 0.1))
SEEDS = range(20)
CUT_CORNERS = {0.5: 0.0, 1.0: 0.005}  # by a spline through fixes so far apart, in a lively drive [s]


def lagging(lag: float, every: float = 0.5) -> GpsData:
    motion = drives.truth(4)
    time = np.arange(motion.start + 1.0, motion.start + motion.duration - 1.0, every)
    older = gps_from_truth(motion, time - lag, drives.LEVER_B)
    return replace(gps_from_truth(motion, time, drives.LEVER_B), v_n=older.v_n)


def every_fourth(n: int, rng: np.random.Generator) -> np.ndarray:
    return np.arange(n) % 4 == 0


def third_and_fourth(n: int, rng: np.random.Generator) -> np.ndarray:
    return (np.arange(n) % 3 == 0) | (np.arange(n) % 4 == 1)


def some(n: int, rng: np.random.Generator) -> np.ndarray:
    return rng.random(n) < 0.1


def lags(gps: GpsData, errors: GpsErrors, missing=None) -> np.ndarray:
    """Lag and its standard deviation for every seed, velocities taken out by a pattern."""
    found = []
    for seed in SEEDS:
        noisy = corrupt_gps(gps, errors, seed)
        if missing is not None:
            v = noisy.v_n.copy()
            v[missing(v.shape[0], np.random.default_rng(seed))] = np.nan
            noisy = replace(noisy, v_n=v)
        found.append(velocity_lag(noisy))
    return np.transpose(found)


@pytest.mark.parametrize("missing", [None, every_fourth, third_and_fourth, some])
@pytest.mark.parametrize("errors", [RTK, METRES], ids=["RTK", "metres"])
@pytest.mark.parametrize("every", [0.5, 1.0])
def test_no_lag_is_found_where_there_is_none(every, errors, missing):
    lag, sd = lags(lagging(0.0, every), errors, missing)
    assert (np.abs(lag) <= CUT_CORNERS[every] + 4.0 * sd).all()


@pytest.mark.parametrize(("every", "noise"), [(0.2, 0.02), (0.2, 0.05), (0.5, 0.1), (0.5, 0.3), (1.0, 0.3)])
def test_noise_of_the_positions_does_not_hide_a_lag(every, noise):
    """The acceleration of a spline through noisy positions is noise: used by itself it finds a tenth of the lag."""
    lag, sd = lags(lagging(0.13, every), GpsErrors((noise,) * 3, velocity_noise=(0.05, 0.05, 0.05)))
    assert np.mean(lag) == pytest.approx(0.13, abs=CUT_CORNERS.get(every, 0.0) + 4.0 * np.std(lag) / np.sqrt(lag.size))
    # the noise of a slope alternates from fix to fix and averages out faster than white noise: the sd is an upper bound
    assert np.std(lag) / np.mean(sd) < 1.2


@pytest.mark.parametrize("missing", [None, some])
@pytest.mark.parametrize("every", [0.5, 1.0])
def test_a_lag_is_found(every, missing):
    lag, sd = lags(lagging(0.13, every), RTK, missing)
    assert (np.abs(lag - 0.13) <= CUT_CORNERS[every] + 4.0 * sd).all()
    assert (sd < 0.005).all()


def test_velocities_that_are_never_even_give_no_lag():
    lag, sd = lags(lagging(0.13), RTK, third_and_fourth)
    np.testing.assert_array_equal(lag, 0.0)
    np.testing.assert_array_equal(sd, np.inf)


# ---- horizontal velocity only


def level_only(gps: GpsData) -> GpsData:
    v_n, sd = gps.v_n.copy(), gps.velocity_sd.copy()
    v_n[:, 2] = sd[:, 2] = np.nan
    return replace(gps, v_n=v_n, velocity_sd=sd)


def test_a_horizontal_velocity_is_used_and_the_vertical_one_left_open():
    """North and east are told as before, the vertical velocity as little as without any."""
    rng = np.random.default_rng(5)
    imu = drives.noisy_imu(drives.perfect_imu(laps=3), drives.MODEL, rng)
    whole = drives.noisy_gps(drives.perfect_gps(laps=3), rng)
    level, notes = with_sd(level_only(whole))
    np.testing.assert_array_equal(with_sd(level)[0].velocity_sd, level.velocity_sd)
    assert Code.GPS_VELOCITY_LEVEL in {note.code for note in notes}
    np.testing.assert_array_equal(level.velocity_sd[:, :2], whole.velocity_sd[:, :2])
    none = replace(whole, v_n=np.full_like(whole.v_n, np.nan))
    start = drives.begin(drives.MODEL, rng, laps=3)
    sd = [
        np.median(drives.navigate(imu, gps, start, drives.MODEL).solution.sd[:, 3:6], axis=0)
        for gps in (whole, level, none)
    ]
    np.testing.assert_allclose(sd[1][:2], sd[0][:2], rtol=0.02)
    assert sd[1][2] > 1.1 * sd[0][2]
    assert (sd[1][:2] < 0.8 * sd[2][:2]).all()


@pytest.mark.parametrize("value", [0.0, -1.0])
def test_a_vertical_velocity_that_never_changes_is_not_measured(value):
    """With zeros in every row heights were 6.7 m off, and accelerometers had a scale factor of 5 %."""
    gps = drives.noisy_gps(drives.perfect_gps(laps=3), np.random.default_rng(5))
    same, notes = with_sd(replace(gps, v_n=np.where([True, True, False], gps.v_n, value)))
    np.testing.assert_array_equal(same.velocity_sd, with_sd(level_only(gps))[0].velocity_sd)
    assert Code.GPS_VELOCITY_LEVEL in {note.code for note in notes}
    still = replace(gps, v_n=np.zeros_like(gps.v_n))
    np.testing.assert_array_equal(with_sd(still)[0].velocity_sd, gps.velocity_sd)


def test_an_open_velocity_says_nothing_of_the_noise():
    rng = np.random.default_rng(6)
    imu = drives.noisy_imu(drives.perfect_imu(laps=8), drives.MODEL, rng)
    gps, _ = with_sd(level_only(drives.noisy_gps(drives.perfect_gps(laps=8), rng)))
    start = drives.begin(drives.MODEL, rng, laps=8)
    found = identify_noise(drives.ready(imu, gps, start, gates=drives.UNFAILING), drives.SPEC)
    assert found is not None
    assert found.velocity_factor[0] == pytest.approx(1.0, abs=0.07)


def test_standard_deviations_that_are_given_are_kept_beside_those_that_are_not():
    """A file without a column for heights: 1 cm North and East was replaced by what is usual of the fix type."""
    gps = lagging(0.0)
    sd = np.tile([0.01, 0.02, np.nan], (len(gps.time), 1))
    level = replace(gps, position_sd=sd, lla=gps.lla * [1.0, 1.0, 0.0])
    filled, notes = with_sd(level)
    assert (filled.position_sd == [0.01, 0.02, OPEN_SD]).all()
    assert not any(of_code(notes, *ASSUMED_POSITION_SD))
    filled, notes = with_sd(replace(gps, position_sd=100.0 * sd))
    assert (filled.position_sd[:, :2] == [1.0, 2.0]).all()
    assert (filled.position_sd[:, 2] >= 2.0).all()
    assert any(of_code(notes, Code.GPS_POSITION_SD_SCATTER))


def test_heights_that_are_not_measured_make_no_position_poor_or_precise():
    """Open heights, 100 m, were what is known of each position, and kept float solutions at the 1 cm they claim."""
    gps = lagging(0.0)
    unknown, level = np.full((len(gps.time), 3), np.nan), gps.lla * [1.0, 1.0, 0.0]
    (filled, notes), (with_heights, _) = (
        with_sd(replace(gps, position_sd=unknown, lla=lla)) for lla in (level, gps.lla)
    )
    assert filled.position_sd[:, :2] == pytest.approx(with_heights.position_sd[:, :2], rel=1e-3)
    assert (filled.position_sd[:, 2] == OPEN_SD).all()
    assert any(of_code(notes, Code.GPS_POSITION_SD_SCATTER))
    sd, kinds = np.tile([0.01, 0.01, np.nan], (len(gps.time), 1)), np.full(len(gps.time), FLOAT)
    floats, notes = with_sd(replace(gps, position_sd=sd, lla=level, fix=kinds), scatter_alone=False)
    assert (floats.position_sd[:, :2] >= FLOAT_SD).all()


@pytest.mark.parametrize("profile", ["motorway", "bends"])
def test_fixes_five_seconds_apart_tell_no_lag_of_velocities(profile):
    """A spline through them is no motion: lags of 0.20 and -0.17 s, seven and three standard deviations, were found."""
    gps = insnav.simulate(profile, imu="automotive", gps="dgps", seed=3).gps.data
    assert np.isfinite(velocity_lag(gps)[1])
    assert velocity_lag(gps.rows(slice(None, None, 5))) == (0.0, np.inf)


@pytest.mark.parametrize("every", [5, 20])
def test_fixes_far_apart_scatter_by_motion(every):
    """Velocities of a flight every 10 s had 8 m/s, with which nothing was seen to move."""
    gps = insnav.simulate("city", imu="automotive", gps="dgps", seed=3).gps.data.rows(slice(None, None, every))
    unknown = replace(gps, velocity_sd=np.full_like(gps.v_n, np.nan), position_sd=np.full_like(gps.v_n, np.nan))
    filled, _ = with_sd(unknown)
    np.testing.assert_allclose(filled.velocity_sd, np.tile(DEFAULT_VELOCITY, (gps.time.size, 1)))
    np.testing.assert_allclose(filled.position_sd, np.tile(DEFAULT_POSITION, (gps.time.size, 1)))


def test_velocities_in_steps_are_no_surer_than_these():
    """A knot, printed with two decimals: what stays on one of them while moving is off alike for as long."""
    knot, sd = 0.514444, np.full((60, 3), 0.02)
    v_n = np.column_stack([np.arange(60) % 20, np.repeat([0.0, 7.0, 8.0], 20), np.arange(60) % 2]) * knot
    lla = np.column_stack([np.linspace(0.8, 0.8001, 60), np.full(60, 0.2), np.linspace(0, 9, 60)])
    fixes = GpsData(np.arange(60.0), lla, np.round(v_n, 2), np.ones((60, 3)), sd)
    found, notes = with_sd(fixes)
    (note,) = of_code(notes, Code.GPS_ROUNDED_VELOCITY)
    least = knot / np.sqrt(12.0)
    assert note.severity is Severity.ASSUMPTION
    assert note["step_m_s"] == pytest.approx(knot, abs=0.005)
    assert note["sd_m_s"] == pytest.approx(least, abs=0.005)
    np.testing.assert_allclose(found.velocity_sd[:, [0, 2]], least, rtol=0.01)
    np.testing.assert_allclose(found.velocity_sd[:, 1], np.repeat(least * np.sqrt([1.0, 20.0, 20.0]), 20), rtol=0.01)
    smooth = replace(fixes, v_n=np.round(v_n + 0.1 * np.random.default_rng(3).standard_normal(v_n.shape), 2))
    for each in (smooth, replace(fixes, velocity_sd=10.0 * least * np.ones((60, 3)))):
        kept, notes = with_sd(each)
        np.testing.assert_array_equal(kept.velocity_sd, each.velocity_sd)
        assert not any(of_code(notes, Code.GPS_ROUNDED_VELOCITY))


def test_a_velocity_north_without_one_east_is_not_used_and_said_so():
    v_n = np.tile([1.0, np.nan, 0.1], (9, 1))
    fixes = GpsData(np.arange(9.0), np.full((9, 3), 0.8), v_n, np.ones((9, 3)), np.full((9, 3), 0.1))
    found, notes = with_sd(fixes)
    assert np.isnan(found.v_n).all()
    (note,) = of_code(notes, Code.GPS_VELOCITY_HALF)
    assert note["count"] == 9
    assert note.severity is Severity.ASSUMPTION


def test_a_drive_with_velocities_in_knots_is_as_good_as_it_says():
    """With the 0.05 m/s that they state it was 75 % inside 3 sd, 2.5 m off; of as many decimals as there are 0.8."""
    made = plan_of(profiled("city", 4), {"imu": "consumer", "gps": "single", "seed": 4}).measured()
    imu, gps = (each.rows(each.time < made.imu.time[0] + 400.0) for each in (made.imu, made.gps))
    knots = replace(gps, v_n=np.round(0.514444 * np.round(gps.v_n / 0.514444), 2))
    solution = insnav.load(imu, knots).navigate().found.run.smoothed.solution
    lla = np.column_stack([np.interp(solution.time, made.reference.time, each) for each in made.reference.lla.T])
    off = np.abs(ned_offset(solution.lla, lla))
    assert np.mean(off < 3.0 * solution.sd[:, :3]) > 0.99
    assert np.sqrt(np.mean(off[:, :2] ** 2)) < 1.5
