"""Receivers: each kind of error with its size, when it happens, and what the receiver says of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insnav.earth import ned_offset
from insnav.exceptions import ConfigError
from insnav.simulate import GpsErrors, gps_from_truth, straight
from insnav.simulate.recording import PRESETS, load_gps, to_toml
from insnav.simulate.sensor_errors import GpsSpec, RandomSpells, measure_gps
from insnav.types import GpsData
from tests.refusals import problems_of, refused
from tests.simulate.motions import PLACE, town

STILL = straight(PLACE, 0.0, 0.5, 20_000.0)
FAST = straight(PLACE, 50.0, 0.0, 300.0)  # due North
FINE = GpsErrors((1e-6, 1e-6, 1e-6), velocity_noise=(1e-6, 1e-6, 1e-6))  # as good as none


def spec(**more) -> GpsSpec:
    return GpsSpec(**{"name": "test", "errors": FINE} | more)


def off(gps: GpsData, truth=STILL) -> np.ndarray:
    """Position errors North, East, Down at the stamps [m]."""
    return ned_offset(gps.lla, truth.evaluate(gps.time).lla)


def runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """Begin and end of each stretch of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def test_fixes_come_at_their_rate():
    gps = measure_gps(town(start=1000.0), spec(rate=5.0), 1)
    np.testing.assert_allclose(gps.time, 1000.0 + np.arange(1, 601) / 5.0)


def test_latency_stamps_a_fix_later_than_it_is_valid():
    gps = measure_gps(FAST, spec(latency=0.3), 1)
    np.testing.assert_allclose(off(gps, FAST)[:, 0], -0.3 * 50.0, atol=1e-3)
    assert gps.time[0] == 1.0
    shaky = off(measure_gps(FAST, spec(latency=0.3, jitter=0.05, rate=2.0), 1), FAST)[:, 0]
    assert shaky.mean() == pytest.approx(-0.3 * 50.0, abs=0.2)
    assert shaky.std() == pytest.approx(0.05 * 50.0, rel=0.1)


def test_the_antenna_is_at_the_end_of_the_lever_arm():
    truth, lever = town(start=1000.0), (0.8, -0.3, -1.2)
    gps = measure_gps(truth, spec(lever_b=lever), 1)
    exact = gps_from_truth(truth, gps.time, np.array(lever))
    assert np.abs(ned_offset(gps.lla, exact.lla)).max() < 1e-5
    assert np.linalg.norm(off(gps, truth), axis=1) == pytest.approx(np.linalg.norm(lever), abs=1e-3)
    assert np.abs(gps.v_n - exact.v_n).max() < 1e-5


def test_lasting_errors_last_and_are_told_with_the_rest():
    errors = GpsErrors((0.3, 0.6, 0.9), (0.4, 0.8, 1.2), correlation_time=40.0, velocity_noise=(0.1, 0.2, 0.3))
    gps = measure_gps(STILL, spec(errors=errors), 3)
    np.testing.assert_allclose(gps.position_sd[0], [0.5, 1.0, 1.5])
    np.testing.assert_allclose(off(gps).std(axis=0), [0.5, 1.0, 1.5], rtol=0.08)
    np.testing.assert_allclose(gps.v_n.std(axis=0), [0.1, 0.2, 0.3], rtol=0.03)
    np.testing.assert_allclose(gps.velocity_sd[0], [0.1, 0.2, 0.3])
    for lag in (10, 40):
        correlation = np.mean(off(gps)[lag:] * off(gps)[:-lag], axis=0) / [0.25, 1.0, 2.25]
        np.testing.assert_allclose(correlation, 0.64 * np.exp(-lag / 40.0), atol=0.08)
    white = np.diff(off(gps), axis=0).std(axis=0) / np.sqrt(2.0)  # a second changes little of what lasts
    np.testing.assert_allclose(white, np.hypot([0.3, 0.6, 0.9], np.array([0.4, 0.8, 1.2]) * np.sqrt(1 / 40)), rtol=0.04)


def test_a_receiver_may_overstate_or_understate_itself_and_give_no_velocities():
    gps = measure_gps(STILL, spec(stated=0.5, velocities=False, errors=GpsErrors((1.0, 1.0, 2.0))), 1)
    np.testing.assert_allclose(gps.position_sd[0], [0.5, 0.5, 1.0])
    np.testing.assert_allclose(off(gps).std(axis=0), [1.0, 1.0, 2.0], rtol=0.03)
    assert np.isnan(gps.v_n).all()
    assert np.isnan(gps.velocity_sd).all()


def test_listed_outages_are_exactly_where_they_are_listed():
    gps = measure_gps(town(start=1000.0), spec(outages=((20.0, 10.0), (50.0, 5.0))), 1)
    since = gps.time - 1000.0
    missing = np.setdiff1d(np.arange(1.0, 121.0), since.round(9))
    np.testing.assert_array_equal(missing, np.concatenate([np.arange(20.0, 30.0), np.arange(50.0, 55.0)]))


def test_regular_outages_end_each_period():
    gps = measure_gps(town(start=1000.0), spec(outage_period=(40.0, 15.0)), 1)
    missing = np.setdiff1d(np.arange(1.0, 121.0), (gps.time - 1000.0).round(9))
    np.testing.assert_array_equal(missing, np.concatenate([np.arange(a, a + 15.0) for a in (25.0, 65.0, 105.0)]))


def test_random_outages_have_their_mean_length_and_distance():
    time = measure_gps(STILL, spec(outage=RandomSpells(every=100.0, length=12.0)), 2).time
    missing = np.isin(np.arange(1.0, 20_001.0), time.round(9), invert=True)
    dark = runs(missing)
    share = 12.0 / 112.0  # of a process that is off for 12 s and on for 100 s
    assert missing.mean() == pytest.approx(share, rel=0.25)  # four standard deviations of 180 outages
    assert np.mean([b - a for a, b in dark]) == pytest.approx(12.5, rel=0.3)  # those that hit a second
    assert len(dark) == pytest.approx(20_000.0 / 112.0, rel=0.25)


def test_multipath_jumps_stay_for_their_length_and_are_not_told():
    gps = measure_gps(STILL, spec(multipath=RandomSpells(every=60.0, length=8.0), multipath_size=8.0), 2)
    error = off(gps)
    jumped = np.abs(error[:, 0]) > 1e-3
    spells = runs(jumped)
    assert jumped.mean() == pytest.approx(8.0 / 68.0, rel=0.25)
    sizes = np.array([error[a] for a, _ in spells])
    np.testing.assert_allclose(sizes.std(axis=0), 8.0, rtol=0.15)
    inside = [np.ptp(error[a:b], axis=0).max() for a, b in spells]
    assert np.median(inside) < 1e-4  # a jump stays what it is
    np.testing.assert_allclose(gps.position_sd, 1e-6)
    assert np.all(gps.fix == 5)


def test_a_float_solution_is_worse_and_says_so():
    gps = measure_gps(STILL, spec(fix=1, degraded=RandomSpells(every=50.0, length=10.0), degraded_noise=0.3), 2)
    error, worse = off(gps), gps.fix == 2
    assert set(np.unique(gps.fix)) == {1, 2}
    assert worse.mean() == pytest.approx(10.0 / 60.0, rel=0.25)
    np.testing.assert_allclose(error[worse].std(axis=0), 0.3, rtol=0.05)
    np.testing.assert_allclose(gps.position_sd[worse], 0.3, rtol=1e-6)
    assert np.abs(error[~worse]).max() < 1e-4
    np.testing.assert_allclose(gps.position_sd[~worse], 1e-6)


def test_one_kind_of_error_does_not_change_another():
    errors = GpsErrors((1.0, 1.0, 2.0), (1.0, 1.0, 2.0))
    plain = measure_gps(STILL, spec(errors=errors), 7)
    dark = measure_gps(STILL, spec(errors=errors, outage=RandomSpells(100.0, 20.0)), 7)
    both = np.isin(plain.time, dark.time)
    assert 0.5 < both.mean() < 0.95
    np.testing.assert_array_equal(plain.lla[both], dark.lla)
    np.testing.assert_array_equal(plain.v_n[both], dark.v_n)
    jumpy = measure_gps(STILL, spec(errors=errors, multipath=RandomSpells(60.0, 8.0), multipath_size=8.0), 7)
    same = np.abs(off(jumpy) - off(plain)).max(axis=1) < 1e-6
    assert same.mean() == pytest.approx(1.0 - 8.0 / 68.0, abs=0.03)
    again, other = (measure_gps(STILL, spec(errors=errors), seed) for seed in (7, 8))
    np.testing.assert_array_equal(plain.lla, again.lla)
    assert not np.any(plain.lla == other.lla)


def test_a_motion_without_a_fix_is_refused():
    with refused(ConfigError, "sim.no_fix"):
        measure_gps(town(), spec(outages=((0.0, 500.0),)), 1)
    with refused(ConfigError, "sim.no_fix"):
        measure_gps(straight(PLACE, 0.0, 0.0, 0.5), spec(), 1)


# ---- the file


WHOLE = """
name = "mine"
source = "its datasheet"
rate = "5 Hz"
lever_arm = ["0.8 m", "-30 cm", "-1.2 m"]
latency = "0.1 s"
jitter = "5 ms"
fix = 4
stated = 0.5
[position]
white = "1 m"
lasting = ["1 m", "2 m", "3 m"]
correlation_time = "2 min"
[velocity]
white = "10 cm/s"
[multipath]
every = "60 s"
length = "8 s"
size = "7 m"
[degraded]
every = "200 s"
length = "10 s"
white = "0.3 m"
[outage]
every = "150 s"
length = "12 s"
period = ["300 s", "20 s"]
list = [["120 s", "30 s"], ["4 min", "1 min"]]
"""


def test_every_key_is_read_in_si_and_written_back_exactly(tmp_path: Path):
    (tmp_path / "gps.toml").write_text(WHOLE)
    read = load_gps(str(tmp_path / "gps.toml"))
    assert read == GpsSpec(
        name="mine",
        errors=GpsErrors((1.0, 1.0, 1.0), (1.0, 2.0, 3.0), 120.0, (0.1, 0.1, 0.1)),
        rate=5.0,
        lever_b=(0.8, -0.3, -1.2),
        latency=0.1,
        jitter=0.005,
        fix=4,
        multipath=RandomSpells(60.0, 8.0),
        multipath_size=7.0,
        degraded=RandomSpells(200.0, 10.0),
        degraded_noise=0.3,
        outages=((120.0, 30.0), (240.0, 60.0)),
        outage_period=(300.0, 20.0),
        outage=RandomSpells(150.0, 12.0),
        stated=0.5,
        source="its datasheet",
    )
    for each in (read, *(load_gps(name) for name in PRESETS)):
        (tmp_path / "again.toml").write_text(to_toml(each))
        assert load_gps(str(tmp_path / "again.toml")) == each


def test_a_receiver_may_have_no_velocities(tmp_path: Path):
    (tmp_path / "bare.toml").write_text('[position]\nwhite = "1 m"\n')
    bare = load_gps(str(tmp_path / "bare.toml"))
    assert (bare.name, bare.velocities, bare.rate, bare.fix) == ("bare", False, 1.0, 5)
    (tmp_path / "again.toml").write_text(to_toml(bare))
    assert load_gps(str(tmp_path / "again.toml")) == replace(bare, name="bare")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('[position]\nwhite = "0 m"', "position: sim.no_position_noise"),
        ('[position]\nwhite = "-1 m"', "position.white: config.negative"),
        ('[position]\nwhite = "1 s"', "position.white: unit.of_other_dimension"),
        ('[position]\nwhite = "1 m"\ncorrelation_time = "0 s"', "position: config.not_above_zero"),
        ('[position]\nwite = "1 m"', "position.wite: config.unknown_key"),
        ('rate = "0 Hz"\n[position]\nwhite = "1 m"', "bad.toml: sim.receiver_rate"),
        ('rate = "500 Hz"\n[position]\nwhite = "1 m"', "bad.toml: sim.receiver_rate"),
        ('fix = 9\n[position]\nwhite = "1 m"', "fix: config.out_of_range"),
        ('[position]\nwhite = "1 m"\n[velocity]\nwhite = "0 m/s"', "velocity: config.not_above_zero"),
        ('[position]\nwhite = "1 m"\n[outage]\nevery = "9 s"', "outage: sim.outage_lengths"),
        ('[position]\nwhite = "1 m"\n[outage]\nperiod = ["9 s", "9 s"]', "outage: sim.outage_period"),
        ('[position]\nwhite = "1 m"\n[outage]\nlist = ["9 s", "9 s"]', "outage.list: sim.no_pair_of_times"),
        ('[position]\nwhite = "1 m"\n[multipath]\nevery = "9 s"\nlength = "9 s"', "multipath.size: config.missing_key"),
        ("", "position: config.missing_key"),
    ],
)
def test_every_mistake_is_named(tmp_path: Path, text: str, expected: str):
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_gps(str(path))
    assert any(each.endswith(expected) for each in problems_of(caught.value))
    assert caught.value.where.startswith(str(path))


def test_all_mistakes_are_told_at_once(tmp_path: Path):
    path = tmp_path / "bad.toml"
    path.write_text('rte = "1 Hz"\nfix = 9\n[position]\nwhite = "1 s"\n[velocity]\nwhite = 3\n')
    with pytest.raises(ConfigError) as caught:
        load_gps(str(path))
    assert sorted(problems_of(caught.value)) == [
        "fix: config.out_of_range",
        "position.white: unit.of_other_dimension",
        "rte: config.unknown_key",
        "velocity.white: config.no_quantity",
    ]


def test_a_misspelt_preset_is_suggested():
    with pytest.raises(ConfigError) as caught:
        load_gps("singel")
    assert (caught.value.code, caught.value.values["close"]) == ("sim.unknown_receiver", "single")
