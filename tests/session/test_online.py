"""The online filter against the filter of recordings, which has all data at once, and against the truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import insnav
from insnav import OnlineFilter, OnlineState
from insnav.earth import ned_offset
from insnav.exceptions import ConfigError, InputError
from insnav.filter.prepare import Start
from insnav.findings import Code
from insnav.messages import sentence
from insnav.strapdown import nominal_interval
from insnav.types import GpsData, ImuData, Run, Trajectory
from insnav.units import DEG
from tests.reversed_messages import as_shown
from tests.shared import recorded

ALIKE = 1e-9  # [rad], [m], [m/s]
GIVEN: dict[str, Any] = {"imu": "automotive", "lever_arm": (0.0, 0.0, 0.0), "gps_delay": 0.0}
Late = Callable[[float], float]


@cache
def city(seed: int, receiver: str = "single") -> tuple[ImuData, GpsData, Trajectory]:
    made = insnav.simulate("city", imu="automotive", gps=receiver, seed=seed)
    assert made.gps is not None
    assert made.reference is not None
    return made.imu.data, made.gps.data, made.reference.data


def causal(imu: ImuData, gps: GpsData, /, **inputs: Any) -> Run:
    """``insnav run --no-smooth --noise model --explain off --aiding off --rate full``."""
    drive = insnav.load(imu, gps, noise="model", explain="off", **inputs)
    return drive.navigate(smooth=False, aiding="off", output_interval=0.0).found.run


def fed(
    imu: ImuData, gps: GpsData, /, block: int | Sequence[int] = 10, late: Late = lambda time: 0.0, **inputs: Any
) -> tuple[OnlineFilter, list[OnlineState]]:
    """Feed samples in blocks, each fix when it arrives; the states after each block."""
    nav = OnlineFilter(**inputs, sampling=imu.sampling, stamp=imu.stamp)
    arrival = gps.time + [late(each) for each in gps.time]
    fixes, states, first = list(np.argsort(arrival, kind="stable")), [], 0
    sizes = [block] if isinstance(block, int) else block
    while first < imu.time.size:
        rows = slice(first, first + sizes[len(states) % len(sizes)])
        nav.imu(imu.time[rows], imu.gyro[rows], imu.accel[rows])
        first, now = rows.stop, imu.time[rows][-1]
        while fixes and (arrival[fixes[0]] <= now or first >= imu.time.size):
            row = fixes.pop(0)
            sd = np.concatenate([gps.position_sd[row], gps.velocity_sd[row]])
            fix = None if gps.fix is None else int(gps.fix[row])
            nav.gps(gps.time[row], gps.lla[row], gps.v_n[row], sd, fix)
        states.append(nav.state)
    return nav, states


def assert_alike(states: Sequence[OnlineState], run: Run) -> None:
    """Every aligned state is a row of the solution, and has its covariance at a fix."""
    states = [each for each in states if each.aligned]
    time, solution, epochs = np.array([each.time for each in states]), run.solution, run.epochs
    row = np.searchsorted(solution.time, time - 1e-7)
    assert solution.time[row] == pytest.approx(time, abs=1e-7)
    for name in ("lla", "v_n", "rph"):
        assert np.abs(np.array([getattr(each, name) for each in states]) - getattr(solution, name)[row]).max() < ALIKE
    fix = np.searchsorted(epochs.time, time - 1e-7).clip(max=epochs.time.size - 1)
    for k in np.flatnonzero(np.abs(epochs.time[fix] - time) < 1e-7):
        assert np.abs(states[k].covariance[:9, :9] - epochs.covariance[fix[k]]).max() < ALIKE
        assert np.abs(states[k].gyro_bias - run.sensor_errors.value[fix[k], :3]).max() < ALIKE
        assert np.abs(states[k].accel_bias - run.sensor_errors.value[fix[k], 3:6]).max() < ALIKE
        assert states[k].sd == pytest.approx(solution.sd[row[k]], abs=ALIKE)  # type: ignore[index]


@pytest.mark.parametrize(("seed", "block"), [(3, 10), (8, (1, 7, 40, 150))], ids=["tens", "any blocks"])
def test_equals_the_filter_of_recordings(seed: int, block: int | tuple[int, ...]) -> None:
    imu, gps, _ = city(seed)
    states = fed(imu, gps, block, **GIVEN)[1]
    assert sum(each.aligned for each in states) > 0.7 * len(states)
    assert_alike(states, causal(imu, gps, **GIVEN))


def test_equals_it_with_an_estimated_lever_arm_and_covariance_at_every_fix() -> None:
    imu, gps, _ = city(3)
    imu = imu.beginning(200.0)
    given = GIVEN | {"lever_arm": (0.5, -0.3, -1.0), "lever_arm_sd": 0.1}
    assert_alike(fed(imu, gps, 1, **given)[1], causal(imu, gps, **given))


@pytest.mark.parametrize(
    ("name", "length", "imu_model"),
    [("rtklib_drive_20250708", 300.0, "consumer"), ("ixr_tsukishima_20210412", 400.0, "industrial")],
)
def test_equals_it_on_a_recording(name: str, length: float, imu_model: str) -> None:
    folder = recorded(name)
    imu, gps = insnav.read_imu(folder / "imu.csv.gz").data, insnav.read_gps(folder / "gps.csv").data
    imu = imu.beginning(length)
    imu = ImuData(imu.time, imu.gyro, imu.accel, imu.sampling, imu.stamp)
    unknown = ~np.isfinite(gps.position_sd)
    gps = replace(gps, position_sd=np.where(unknown, [1.5, 1.5, 3.0], gps.position_sd))
    gps = replace(gps, velocity_sd=np.where(np.isfinite(gps.velocity_sd), gps.velocity_sd, [0.2, 0.2, 0.3]))
    given = GIVEN | {"imu": imu_model}
    states = fed(imu, gps, rate=1.0 / nominal_interval(imu.time), **given)[1]
    assert sum(each.aligned for each in states) > 0.5 * len(states)
    assert_alike(states, causal(imu, gps, **given))


@pytest.mark.parametrize("given", [{}, {"heading": 28.0 * DEG, "lever_arm": (2.0, 0.5, 0.0)}], ids=["right", "wrong"])
def test_a_run_with_these_options_does_not_depend_on_later_data(given: dict[str, Any]) -> None:
    """The filtered solution is the same with and without later data, even if lever arm and heading are wrong."""
    imu, gps, _ = city(3, "rtk")
    given = GIVEN | given
    run = causal(imu, gps, **given)
    assert_alike(fed(imu, gps, 40, **given)[1], run)
    whole, half = run.solution, causal(imu.beginning(300.0), gps, **given).solution
    rows = slice(half.time.size - 100)  # the newest samples have other neighbours
    for name in ("time", "lla", "v_n", "rph"):
        assert (getattr(half, name)[rows] == getattr(whole, name)[rows]).all()


def test_late_fixes_equal_fixes_on_time() -> None:
    imu, gps, _ = city(3)
    run = causal(imu, gps, **GIVEN)
    nav, states = fed(imu, gps, late=lambda time: 0.2 + 1.6 * abs(np.sin(7.0 * time)), **GIVEN)
    assert not [each for each in nav.state.findings if each.code is Code.ONLINE_FIX_LATE]
    assert_alike(states[-1:], run)
    # the order was really another, and the filter did not wait for late fixes
    late = [each for each in states if each.aligned][:-1]
    row = np.searchsorted(run.solution.time, [each.time for each in late])
    assert max(np.abs(np.array([each.v_n for each in late]) - run.solution.v_n[row]).max(axis=1)) > 1e-3
    assert imu.time[-1] - states[-1].time < 0.3


def test_a_fix_beyond_the_window_is_refused_with_a_finding() -> None:
    imu, gps, _ = city(3)
    imu = imu.beginning(200.0)
    before = fed(imu, gps.rows(gps.time < 180.0), **GIVEN)[1][-1]
    nav = fed(imu, gps.rows(gps.time < 180.0), **GIVEN)[0]
    row = int(np.searchsorted(gps.time, imu.time[-1] - 3.5))
    nav.gps(gps.time[row], gps.lla[row], gps.v_n[row])
    late = [each for each in nav.state.findings if each.code is Code.ONLINE_FIX_LATE]
    assert late[0]["late_s"] == pytest.approx(imu.time[-1] - gps.time[row])
    assert late[0]["limit_s"] == 2.0
    assert (nav.state.lla == before.lla).all()
    nav.gps(gps.time[row + 2], gps.lla[row + 2], gps.v_n[row + 2])
    assert (nav.state.lla != before.lla).any()
    after = nav.state
    nav.gps(gps.time[row + 2], gps.lla[row], gps.v_n[row])
    assert nav.state.findings[-1].code is Code.ONLINE_FIX_REPEATED
    assert (nav.state.lla == after.lla).all()


def test_aligns_again_after_a_gap_and_equals_the_filter_of_recordings() -> None:
    imu, gps, _ = city(4)
    imu = imu.rows((imu.time < 200.0) | (imu.time > 205.0))
    states = fed(imu, gps, **GIVEN)[1]
    aligned = np.array([each.aligned for each in states])
    gaps = [each for each in states[-1].findings if each.code is Code.ONLINE_GAP]
    assert len(gaps) == 1
    assert gaps[0]["gap_s"] == pytest.approx(5.02)
    assert np.flatnonzero(np.diff(aligned.astype(int))).size == 3  # aligned, lost, aligned
    assert_alike(states, causal(imu, gps, **GIVEN))


def test_says_that_it_is_aligning() -> None:
    imu, gps, _ = city(3)
    nav, states = fed(imu.beginning(30.0), gps.rows(gps.time < 30.0), **GIVEN)
    assert not any(each.aligned for each in states)
    state = nav.state
    assert state.findings[-1].code is Code.ONLINE_ALIGNING
    assert as_shown("attitude") in sentence(state.findings[-1])
    assert np.isnan([state.time, *state.lla, *state.rph, *state.sd]).all()


def test_a_stop_with_a_heading_needs_no_motion() -> None:
    imu, gps, truth = city(3)
    given = GIVEN | {"static": (0.0, 30.0), "heading": float(truth.rph[0, 2])}
    states = fed(imu, gps, **given)[1]
    assert next(each.time for each in states if each.aligned) < 31.0
    assert_alike(states, causal(imu, gps, **given))


def test_an_initial_state_needs_no_alignment() -> None:
    imu, gps, truth = city(3)
    row = int(np.searchsorted(truth.time, 100.0))
    sds = np.full(3, 2.0), np.full(3, 0.1), np.full(3, DEG)
    start = Start(float(truth.time[row]), truth.lla[row], truth.v_n[row], truth.rph[row], *sds)
    given = GIVEN | {"initial": start}
    states = fed(imu, gps, rate=100.0, **given)[1]
    assert next(each.time for each in states if each.aligned) < 102.0
    assert_alike(states, causal(imu, gps, **given))


def test_is_as_accurate_as_it_says_with_nothing_given_but_the_imu() -> None:
    """Against the truth: the mean of the normalised squared errors of position and attitude, of six drives.

    The receiver has hardly any errors that last from fix to fix, which the filter does not know.
    """
    squares = []
    for seed in range(20, 26):
        imu, gps, truth = city(seed, "rtk")
        state = fed(imu, gps, 500, imu="automotive")[1][-1]
        row = int(np.searchsorted(truth.time, state.time - 1e-6))
        error = ned_offset(state.lla, truth.lla[row]) - truth.v_n[row] * (state.time - truth.time[row])
        angle = (state.rph - truth.rph[row] + np.pi) % (2.0 * np.pi) - np.pi
        squares.append(np.concatenate([error, angle]) / state.sd[[0, 1, 2, 6, 7, 8]])
    assert 0.3 < np.mean(np.square(squares)) < 2.0


@pytest.mark.parametrize(
    ("samples", "code"),
    [
        (([2.0, 1.0], np.zeros((2, 3)), np.zeros((2, 3))), "online.time_back"),
        (([1.0, 1.0], np.zeros((2, 3)), np.zeros((2, 3))), "online.time_back"),
        (([0.5], np.zeros((1, 3)), np.zeros((1, 3))), "online.time_back"),
        (([np.nan], np.zeros((1, 3)), np.zeros((1, 3))), "online.not_finite"),
        (([2.0], np.full((1, 3), np.inf), np.zeros((1, 3))), "online.not_finite"),
        (([2.0, 3.0], np.zeros((2, 3)), np.zeros((3, 3))), "online.shape"),
        (([2.0, 3.0], np.zeros(6), np.zeros((2, 3))), "online.shape"),
        ((2.0, [0.0, 0.0], [0.0, 0.0, 0.0]), "online.shape"),
        (([[2.0]], np.zeros((1, 3)), np.zeros((1, 3))), "online.shape"),
        ((2.0, "abc", np.zeros(3)), "online.not_numbers"),
    ],
)
def test_bad_samples_are_refused_whole(samples: Any, code: str) -> None:
    nav = OnlineFilter(**GIVEN)
    nav.imu(1.0, np.zeros(3), [0.0, 0.0, -9.8])
    with pytest.raises(InputError) as refused:
        nav.imu(*samples)
    assert refused.value.code == code
    nav.imu(1.01, np.zeros(3), [0.0, 0.0, -9.8])  # goes on where it was


@pytest.mark.parametrize(
    ("fix", "code"),
    [
        ((1.0, (48.0, 11.0, 500.0)), "online.not_radians"),
        ((1.0, (0.8, np.nan, 500.0)), "online.not_finite"),
        ((np.nan, (0.8, 0.2, 500.0)), "online.not_finite"),
        ((1.0, (0.8, 0.2)), "online.shape"),
        ((1.0, (0.8, 0.2, 500.0), (1.0, 2.0)), "online.shape"),
        ((1.0, (0.8, 0.2, 500.0), None, (1.0, 1.0)), "online.shape"),
        ((1.0, (0.8, 0.2, 500.0), None, (1.0, 1.0, 0.0)), "online.not_an_sd"),
    ],
)
def test_bad_fixes_are_refused(fix: Any, code: str) -> None:
    with pytest.raises(InputError) as refused:
        OnlineFilter(**GIVEN).gps(*fix)
    assert refused.value.code == code


def test_bad_inputs_are_refused() -> None:
    for given in ({"lever_arm": (0, 0)}, {"gps_delay": 60.0}, {"static": (5.0, 1.0)}, {"rate": 0.0}):
        with pytest.raises(ConfigError):
            OnlineFilter(**(GIVEN | given))


def test_correlated_errors_of_fixes_are_covered_if_given() -> None:
    inside: dict[bool, list[float]] = {True: [], False: []}
    share = 1.3**2 / (0.7**2 + 1.3**2)  # of the receiver "single", with 100 s
    for seed in (1, 2):
        imu, gps, truth = city(seed)
        for correlated in (None, (share, 100.0)):
            states = [each for each in fed(imu, gps, 100, **GIVEN, correlated=correlated)[1] if each.aligned]
            time, lla, sd = (np.array([getattr(each, name) for each in states]) for name in ("time", "lla", "sd"))
            true = np.column_stack([np.interp(time, truth.time, each) for each in truth.lla.T])
            inside[correlated is None].append(np.mean((np.abs(ned_offset(lla, true)) < 3.0 * sd[:, :3]).all(axis=1)))
    assert min(inside[False]) > 0.95
    assert max(inside[True]) < 0.3


@pytest.mark.parametrize("correlated", [(1.2, 100.0), (0.5, 0.0), (np.nan, 100.0), (0.5, np.nan)])
def test_impossible_correlation_is_refused(correlated: tuple[float, float]) -> None:
    with pytest.raises(ConfigError) as caught:
        insnav.OnlineFilter("automotive", correlated=correlated)
    assert (caught.value.code, caught.value.where) == ("input.out_of_range", "correlated")
