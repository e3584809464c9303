"""Faults do what they say and nothing else, and what cannot be meant is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insnav.earth import ned_offset
from insnav.exceptions import ConfigError
from insnav.simulate.recording import VERBS, parse_fault
from insnav.types import GpsData, ImuData
from tests.refusals import refused

N = 2000


@pytest.fixture
def imu() -> ImuData:
    rng = np.random.default_rng(1)
    return ImuData(100.0 + 0.01 * np.arange(N), rng.standard_normal((N, 3)), rng.standard_normal((N, 3)))


@pytest.fixture
def gps() -> GpsData:
    n = 20
    sd = np.ones((n, 3))
    return GpsData(100.0 + np.arange(n), np.tile([0.8, 0.1, 200.0], (n, 1)), np.zeros((n, 3)), sd, sd)


def moved(before: GpsData, after: GpsData) -> np.ndarray:
    return np.linalg.norm(ned_offset(after.lla, before.lla), axis=1)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("gps-spike:60m@5s", {5: 60.0}),
        ("gps-jump:60m@5s+3s", {5: 60.0, 6: 60.0, 7: 60.0}),
        ("gps-jump:20m@17s", {17: 20.0, 18: 20.0, 19: 20.0}),
        ("gps-drag:2m/s@15s+2s", {16: 2.0, 17: 4.0, 18: 4.0, 19: 4.0}),
        ("gps-flap:50m@5s+6s", {6: 50.0, 7: 50.0, 8: 50.0, 9: 50.0}),
    ],
)
def test_fixes_are_moved_when_and_as_far_as_told(imu, gps, text, expected):
    same, found = parse_fault(text).apply(imu, gps)
    assert same is imu
    distance = np.zeros(20)
    for row, metres in expected.items():
        distance[row] = metres
    np.testing.assert_allclose(moved(gps, found), distance, atol=1e-3)
    np.testing.assert_array_equal(found.v_n, gps.v_n)


def test_other_faults_of_receivers(imu, gps):
    assert parse_fault("gps-outage@5s+3s").apply(imu, gps)[1].time.tolist() == [
        100 + k for k in (*range(5), *range(8, 20))
    ]
    np.testing.assert_allclose(parse_fault("gps-latency:300 ms").apply(imu, gps)[1].time, gps.time + 0.3)
    early = replace(gps, time=gps.time - 10.0)  # half of the fixes before the first sample
    np.testing.assert_allclose(parse_fault("gps-latency:300 ms").apply(imu, early)[1].time, early.time + 0.3)
    late = parse_fault("gps-latency:1.5s@5s+3s").apply(imu, gps)[1]
    assert late.time[4:10].tolist() == [104.0, 106.5, 107.5, 108.0, 108.5, 109.0]
    np.testing.assert_array_equal(late.lla[[5, 6, 8]], gps.lla[5:8])
    np.testing.assert_allclose(parse_fault("gps-sd:0.1").apply(imu, gps)[1].position_sd, 0.1)
    sd = parse_fault("gps-sd:0.1@5s+3s").apply(imu, gps)[1].position_sd[:, 0] / gps.position_sd[:, 0]
    np.testing.assert_allclose(sd, [1.0] * 5 + [0.1] * 3 + [1.0] * 12)
    twice = parse_fault("gps-duplicate@5s").apply(imu, gps)[1]
    assert twice.time.tolist() == sorted([*gps.time, 105.0])
    back = parse_fault("gps-shuffle@5s+3s").apply(imu, gps)[1]
    assert back.time[4:9].tolist() == [104.0, 107.0, 106.0, 105.0, 108.0]


def test_faults_of_sensors(imu, gps):
    def put(text: str) -> ImuData:
        found, same = parse_fault(text).apply(imu, gps)
        assert same is gps
        return found

    assert put("imu-gap@5s+0.5s").time.shape[0] == N - 50
    nan = put("imu-nan@5s+0.05s")
    assert np.isnan(nan.gyro).all(axis=1).sum() == 5
    assert np.isnan(nan.accel[500:505]).all()
    clipped = put("imu-clip:0.5rad/s@5s+2s")
    assert np.abs(clipped.gyro[500:700]).max() == 0.5
    np.testing.assert_array_equal(clipped.gyro[:500], imu.gyro[:500])
    np.testing.assert_array_equal(clipped.accel, imu.accel)
    assert np.abs(put("imu-clip:0.05g@5s+2s").accel[500:700]).max() == pytest.approx(0.05 * 9.80665)
    stuck = put("imu-stuck:gyro-z@5s+2s")
    assert np.unique(stuck.gyro[500:700, 2]).size == 1
    np.testing.assert_array_equal(stuck.gyro[:, :2], imu.gyro[:, :2])
    assert np.unique(put("imu-stuck:all@5s+2s").accel[500:700], axis=0).shape[0] == 1
    spike = put("imu-spike:3rad/s@5s")
    assert spike.gyro[500, 2] == imu.gyro[500, 2] + 3.0
    assert (spike.gyro != imu.gyro).sum() == 1
    np.testing.assert_allclose(put("imu-units:deg/s").gyro, np.degrees(imu.gyro))
    np.testing.assert_allclose(put("imu-units:g").accel * 9.80665, imu.accel)
    flu = put("imu-axes:FLU")
    np.testing.assert_allclose(flu.accel, imu.accel * [1.0, -1.0, -1.0])
    back = put("imu-reverse@5s")
    assert np.flatnonzero(np.diff(back.time) < 0).tolist() == [499]
    assert put("imu-duplicate@5s+0.1s").time.shape[0] == N + 10


def test_increments_get_their_share(imu, gps):
    increments = replace(imu, gyro=imu.gyro * 0.01, accel=imu.accel * 0.01, sampling="increment")
    spike, _ = parse_fault("imu-spike:3rad/s@5s").apply(increments, gps)
    assert spike.gyro[500, 2] - increments.gyro[500, 2] == pytest.approx(0.03)


def test_data_are_not_changed_in_place(imu, gps):
    copies = [array.copy() for array in (imu.time, imu.gyro, imu.accel, gps.time, gps.lla, gps.position_sd)]
    for verb in VERBS.values():
        parse_fault(verb.example.replace("120s", "5s")).apply(imu, gps)
    for before, now in zip(copies, (imu.time, imu.gyro, imu.accel, gps.time, gps.lla, gps.position_sd), strict=True):
        np.testing.assert_array_equal(before, now)


def test_every_verb_is_in_the_manual_and_its_example_is_understood():
    manual = (Path(__file__).parents[2] / "trajectories" / "README.md").read_text(encoding="utf-8")
    for name, verb in VERBS.items():
        assert f"`{verb.example}`" in manual
        assert parse_fault(verb.example).verb == name


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("gps-jmp:60m@120s", "sim.unknown_fault"),
        ("nonsense", "sim.unknown_fault"),
        ("gps-jump@120s", "sim.fault_without_size"),
        ("gps-outage:5m@120s+3s", "sim.fault_with_size"),
        ("gps-outage@120s", "sim.fault_without_length"),
        ("gps-spike:60m", "sim.fault_without_time"),
        ("gps-jump:60s@120s", "unit.of_other_dimension"),
        ("gps-jump:60m@-5s+2s", "sim.fault_times"),
        ("imu-stuck:gyro-w@1s+1s", "sim.not_one_of"),
        ("imu-axes:FFU", "sim.no_directions"),
        ("imu-clip:5m@1s+1s", "unit.of_other_dimension"),
        ("gps-sd:-1", "sim.not_above_zero"),
        ("imu-axes:FLU@1s+1s", "sim.fault_with_time"),
    ],
)
def test_what_cannot_be_meant_is_refused(text, code):
    with refused(ConfigError, code) as caught:
        parse_fault(text)
    assert caught.value.where.startswith("--fault")


def test_a_misspelt_fault_is_suggested():
    with refused(ConfigError, "sim.unknown_fault") as caught:
        parse_fault("gps-jmp:60m@120s")
    assert caught.value.values["close"] == "gps-jump"


@settings(max_examples=300, deadline=None)
@given(
    st.one_of(
        st.text(max_size=40),
        st.builds("{}:{}@{}+{}".format, st.sampled_from(sorted(VERBS)), *[st.text(max_size=8)] * 3),
    )
)
def test_any_text_is_a_fault_or_refused(text):
    try:
        fault = parse_fault(text)
    except ConfigError:
        return
    assert fault.begin >= 0.0
