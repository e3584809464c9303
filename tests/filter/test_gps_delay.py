"""Delays of the fixes from -2 to 2 s: the likelihood has one top, and the solution is in the time of the fixes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import insnav
from insnav.attitude import dcm_from_quat, quat_from_dcm, skew
from insnav.earth import OMEGA_EARTH, lla_offset, ned_offset
from insnav.errors.ensemble import normalised
from insnav.errors.evaluated_run import EvaluatedRun, run_warnings
from insnav.exceptions import InputError
from insnav.filter import delay_and_lever
from insnav.filter.delay_and_lever import Aligned, Found, delay_of, filtered, on_time, scale_of
from insnav.filter.error_model import error_model, layout
from insnav.filter.filter_input import FilterInput
from insnav.filter.gates import impossible
from insnav.filter.late_fixes import REACH, LateFixes
from insnav.filter.navigate import feed
from insnav.filter.navigator import Navigator
from insnav.filter.prepare import prepare
from insnav.filter.receiver import DELAY_SD, LEVER_SD
from insnav.findings import Code, of_code
from insnav.input import read_gps, read_imu
from insnav.kernels import errorstate
from insnav.kernels.smoother import CORRECTION, STATE
from insnav.session.simulation import plan_of, profiled
from insnav.simulate import gps_from_truth
from insnav.simulate.recording import load_gps
from insnav.steps import Model
from insnav.types import FloatArray, GpsData, ImuData
from tests import shared
from tests.filter import drives

SAMPLE = Path(__file__).parents[2] / "trajectories" / "sample"
LAPS = 8  # ten minutes


@lru_cache(maxsize=1)
def recorded() -> FilterInput:
    """Aligned by its own start, with a lever arm that nobody gave."""
    rng = np.random.default_rng([31, 4])
    imu = drives.noisy_imu(drives.perfect_imu(laps=LAPS), drives.MODEL, rng)
    gps = drives.noisy_gps(drives.perfect_gps(laps=LAPS), rng)
    model = error_model(drives.SPEC, 21)
    start = drives.begin(model, np.random.default_rng([5, 4]), LAPS)
    return drives.ready(imu, gps, start, model, lever_b=np.zeros(3), lever_sd=2.0, delay_sd=DELAY_SD)


def late(ready: FilterInput, delay: float) -> FilterInput:
    """The same with its fixes stamped late, aligned anew, as after reading."""
    gps = replace(ready.gps, time=ready.gps.time + delay)
    return prepare(ready.imu, gps, drives.SPEC, ready.receiver)[0]


def by_likelihood(ready: FilterInput) -> tuple[float, float, float]:
    """Delay, its standard deviation and its drift."""
    return delay_of(filtered(ready))[:3]


def rate_of(model: Model) -> float:
    """Rate of the clock of the samples [s/s]."""
    (found,) = of_code(model.findings, Code.IMU_CLOCK_RATE)
    return found.value


def of_one_moment(before: float) -> float:
    return float(before == 1.0)


def since_the_fix_before(before: float) -> float:
    return float(before < 2.0)


def low_pass(before: float) -> float:
    return float(np.exp(-before))


def lagging(lag: float, noise: float, weight: Callable[[float], float] = of_one_moment) -> FilterInput:
    """Velocities that are older than positions, which scatter; `weight`: of what they were so many lags before."""
    ready, motion = recorded(), drives.truth(LAPS)
    gps = drives.perfect_gps(laps=LAPS)
    before = [1.0] if weight is of_one_moment else list(0.05 * np.arange(0.5, 160.0))
    share = np.array([weight(each) for each in before])
    older = [
        gps_from_truth(motion, np.maximum(gps.time - each * lag, motion.start), drives.LEVER_B).v_n for each in before
    ]
    own = gps_from_truth(motion, gps.time, drives.LEVER_B).v_n
    gps = replace(
        gps, v_n=gps.v_n + np.tensordot(share / share.sum(), older, 1) - own, position_sd=np.full_like(gps.lla, noise)
    )
    return replace(ready, gps=drives.noisy_gps(gps, np.random.default_rng([11, round(100 * lag)])))


@pytest.mark.parametrize("lag", [0.0, 0.13, 0.4])
@pytest.mark.parametrize(("noise", "delay"), [(0.02, 0.2), (1.5, -0.07)])
def test_delay_and_lag_of_velocities_are_told_apart(lag, noise, delay):
    """With metres of scatter velocities tell the delay, and without their lag a wrong one."""
    there = late(lagging(lag, noise), delay)

    def prepared(clock: float, rate: float) -> Aligned:
        imu = replace(there.imu, time=there.imu.time + clock)
        return Aligned(*prepare(imu, there.gps, drives.SPEC, there.receiver), clock)

    aligned = on_time(prepared, there.receiver)
    ready = aligned.ready
    assert abs(aligned.clock - delay) < 2.0 * DELAY_SD  # from where the filter goes on
    assert abs(ready.receiver.lag.value - lag) < 3.0 * max(ready.receiver.lag.sd, 0.002)
    assert ready.receiver.lag.sd < 0.03


def test_the_filter_is_no_surer_of_the_delay_than_of_the_lag():
    ready = late(lagging(0.13, 1.5), 0.1)
    run = insnav.load(ready.imu, gps=ready.gps).navigate().found.run
    assert abs(run.gps_delay - 0.1) < 3.0 * run.gps_delay_sd
    assert 0.003 < run.gps_delay_sd < 0.03


@pytest.mark.parametrize(
    ("noise", "weight"), [(0.02, of_one_moment), (1.5, of_one_moment), (0.02, since_the_fix_before), (0.02, low_pass)]
)
def test_velocities_that_lag_bend_neither_delay_nor_lever_arm(noise, weight):
    ready = late(lagging(0.3, noise, weight), 0.1)
    run = insnav.load(ready.imu, gps=ready.gps).navigate().found.run
    assert abs(run.gps_delay - 0.1) < 3.0 * run.gps_delay_sd
    assert (np.abs(run.lever_b - drives.LEVER_B) < 3.0 * run.lever_sd).all()
    assert run.lever_sd.max() < 0.3


@pytest.mark.parametrize("delay", [-1.3, -0.4, -0.1, 0.0, 0.1, 0.3, 1.0, 1.7])
def test_a_delay_is_found_from_anywhere(delay):
    found, sd, drift = by_likelihood(late(recorded(), delay))
    assert drift == 0.0
    assert found == pytest.approx(delay, abs=0.03)  # the filter goes on from there
    assert 0.0 < sd < 0.02 + 0.01 * abs(delay)  # far from its start the filter is bent: windows agree less
    assert abs(found - delay) < 4.0 * sd


def test_a_delay_is_found_without_velocities():
    ready = recorded()
    n = ready.gps.time.size
    gps = replace(ready.gps, v_n=np.full((n, 3), np.nan), velocity_sd=np.full((n, 3), np.nan))
    found, sd, _ = by_likelihood(late(replace(ready, gps=gps), 0.8))
    assert abs(found - 0.8) < 3.0 * sd < 0.2


def test_false_fixes_do_not_decide():
    ready = recorded()
    false = np.random.default_rng(2).random(ready.gps.time.size) < 0.02
    lla = ready.gps.lla.copy()
    lla[false, :2] += 50.0 / 6.4e6
    found, *_ = by_likelihood(late(replace(ready, gps=replace(ready.gps, lla=lla)), 0.5))
    assert found == pytest.approx(0.5, abs=0.05)


def test_false_fixes_of_a_precise_receiver_do_not_decide():
    """One in 20 off by 30 m and stated to 1 cm: nothing was found but a lag of 0.115 s, the whole drive 0.12 m off."""
    folder = shared.recorded("rtklib_drive_20250708")
    imu, gps = read_imu(folder / "imu.csv.gz").data, read_gps(folder / "gps.csv").data
    rng, off = np.random.default_rng(4), np.zeros_like(gps.lla)
    false = rng.random(gps.time.size) < 0.05
    off[false, :2] = rng.choice([-30.0, 30.0], (int(false.sum()), 2))
    model = insnav.load(imu, replace(gps, lla=lla_offset(gps.lla, off))).until("align").model
    assert model.clock.value == pytest.approx(-0.071, abs=0.012)
    assert rate_of(model) == pytest.approx(-290e-6, abs=60e-6)
    assert model.ready.receiver.lag.value == pytest.approx(0.130, abs=0.005)


@pytest.mark.parametrize("row", [0, 1, 200, -1])
def test_a_fix_where_nothing_can_have_been_does_not_decide(row):
    ready = recorded()
    lla = ready.gps.lla.copy()
    lla[row, 0] += 1e5 / 6.4e6
    lost = replace(ready.gps, lla=lla)
    assert impossible(ready.gates, lost)[row]
    assert np.count_nonzero(impossible(ready.gates, lost)) <= 2  # the only neighbour of the second is one, too
    assert by_likelihood(replace(ready, gps=lost)) == pytest.approx(by_likelihood(ready), abs=0.003)


@pytest.mark.parametrize("rate", [200e-6, -350e-6])
def test_a_clock_that_drifts_is_found(rate):
    ready = recorded()
    begin = ready.imu.time[0]
    imu = replace(ready.imu, time=ready.imu.time - rate * (ready.imu.time - begin))
    found, sd, drift = by_likelihood(prepare(imu, ready.gps, drives.SPEC, ready.receiver)[0])
    assert drift == pytest.approx(rate, abs=0.25 * abs(rate))
    assert found == pytest.approx(0.0, abs=0.03)
    assert sd < 0.02


def test_an_uneven_likelihood_gives_no_delay():
    """Urban fixes, eight windows: the top at 0.28 s is sharp, but hardly likelier than no delay, the truth."""
    options = {"imu": "consumer", "gps": "urban", "seed": 1016}
    made = plan_of(profiled("round_trip", 1016), options).measured()
    velocities = {name: getattr(made.gps, name) * [1.0, 1.0, np.nan] for name in ("v_n", "velocity_sd")}
    aligned = insnav.load(made.imu, gps=replace(made.gps, **velocities)).until("align")
    assert aligned.model.clock.value == 0.0


def test_windows_that_disagree_give_no_delay():
    """Turns of a motorway with consumer gyros: a sharp top at 0.08 s, 9 sd by its curvature; truth 0."""
    made = plan_of(profiled("motorway", 5), {"imu": "consumer", "seed": 5}).measured()
    drive = insnav.load(made.imu, gps=made.gps)
    assert drive.until("align").model.clock.value == 0.0
    run = drive.navigate(smooth=False).found.run
    assert abs(run.gps_delay) < min(3.0 * run.gps_delay_sd, 0.010)


def test_nothing_is_said_where_nothing_tells():
    ready = recorded()
    found = by_likelihood(replace(ready, imu=ready.imu.rows(ready.imu.time < ready.imu.time[0] + 20.0)))
    assert found[:3] == (0.0, np.inf, 0.0)
    assert by_likelihood(late(ready, REACH + 1.5))[1] == np.inf


@pytest.fixture(scope="module")
def plain() -> EvaluatedRun:
    return navigated(0.0)


def navigated(delay: float, **inputs) -> EvaluatedRun:
    """The sample drive, fixes and reference stamped late by `delay`: the clock of the fixes is the better one."""
    known = insnav.load(SAMPLE / "imu.csv.gz", SAMPLE / "gps.csv", SAMPLE / "ref.csv")
    gps, ref = known.gps.data, known.reference.data
    return (
        insnav.load(
            known.imu.data,
            replace(gps, time=gps.time + delay),
            replace(ref, time=ref.time + delay),
            noise="model",
            **inputs,
        )
        .navigate()
        .found
    )


def rms(found: EvaluatedRun) -> FloatArray:
    return np.asarray(np.sqrt(np.mean(found.smoothed_errors.position**2, axis=0)))


@pytest.mark.parametrize("delay", [-0.4, 1.0])
def test_the_solution_follows_the_time_of_the_fixes(plain, delay):
    found = navigated(delay)
    assert found.run.gps_delay == pytest.approx(delay, abs=0.010)
    assert abs(found.run.gps_delay - delay) < 3.0 * found.run.gps_delay_sd
    np.testing.assert_allclose(rms(found), rms(plain), atol=0.03)
    (said,) = run_warnings(found)
    assert (said.code, said["delay_s"]) == (Code.RUN_LATE_FIXES, found.run.gps_delay)
    assert run_warnings(plain) == ()
    assert found.run.solution.time[0] == pytest.approx(plain.run.solution.time[0] + delay, abs=0.2)


def test_a_drive_without_delay_is_left_as_it_is():
    drive = insnav.load(SAMPLE / "imu.csv.gz", SAMPLE / "gps.csv")
    aligned = drive.until("align")
    assert aligned.model.clock.value == 0.0
    np.testing.assert_array_equal(aligned.ready.imu.time, drive.imu.data.time)


def test_a_delay_that_is_given_is_not_looked_for():
    known = insnav.load(SAMPLE / "imu.csv.gz", SAMPLE / "gps.csv")
    gps = replace(known.gps.data, time=known.gps.data.time + 0.5)
    assert insnav.load(known.imu.data, gps, gps_delay=0.5).until("align").model.clock.value == 0.0
    assert insnav.load(known.imu.data, gps).until("align").model.clock.value == pytest.approx(0.5, abs=0.03)
    late = replace(gps, time=gps.time + 1.6)
    insnav.load(known.imu.data, late, gps_delay=2.1)
    with pytest.raises(InputError, match=r"clock.differ"):
        insnav.load(known.imu.data, gps, gps_delay=2.9)


def test_position_in_the_time_of_the_fixes_leaves_the_delay_error_out():
    rng = np.random.default_rng(7)
    half = rng.standard_normal((24, 24))
    p, x = half @ half.T, np.concatenate([np.zeros(3), rng.normal(scale=10.0, size=3), [1.0, 0.0, 0.0, 0.0]])
    shown = np.eye(24)[:9]  # what the fixes see of the errors: dp - v dd
    shown[:3, 21] = -x[3:6]
    expected, found, variance = shown @ p @ shown.T, np.empty((9, 9)), np.empty(12)
    errorstate.at_fix_time(p, x, found)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-9)
    errorstate.variances(p, x, variance)
    np.testing.assert_allclose(variance[:9], np.diag(expected), rtol=1e-12)
    np.testing.assert_allclose(variance[9:], expected[[6, 6, 7], [7, 8, 8]], rtol=1e-12)


def test_attitude_and_velocity_are_no_surer_than_the_clock():
    """A navigation-grade IMU: at 20 mrad/s 2 ms are more than its attitude is uncertain by (0.77 inside without)."""
    inside, square = [], []
    for seed in (32, 33):  # with 32 the delay is off by 2.4 of its sd
        plan = plan_of(profiled("city", seed), {"imu": "navigation", "seed": seed})
        made = plan.measured()
        run = insnav.load(made.imu, gps=made.gps, imu=plan.imu, lever_arm=tuple(made.lever_b)).navigate().found.run
        for state in (run.epochs, run.smoothed.epochs):
            state = state.rows((state.time > plan.truth.start + 30.0) & (state.time < plan.truth.start + 600.0))
            nees = normalised(state, plan.truth, np.zeros(3))
            inside.append(np.mean(nees[:, 2] < 14.16))  # 3 sd of three degrees of freedom
            square.append(np.mean(nees[:, 1:], axis=0) / 3.0)
    assert np.mean(inside) > 0.97
    assert np.all(np.mean(square, axis=0) < 3.0)


def test_steady_turns_are_no_delay():
    """Around a circle a delay is a heading, and a window of it was 0.14 s sure of one; the whole drive is not."""
    made = insnav.simulate("figure_eight", imu="automotive", gps="rtk", seed=105)
    imu, gps = (each.data.rows(each.data.time < 240.0) for each in (made.imu, made.gps))
    aligned = insnav.load(imu, gps).until("align")
    assert aligned.model.clock.value == 0.0
    assert abs(by_likelihood(aligned.ready)[0]) < 0.005


@pytest.mark.parametrize(
    ("profile", "grade", "gps", "seed"), [("bends", "consumer", "rtk", 306), ("round_trip", "consumer", "single", 301)]
)
def test_windows_are_not_believed_where_they_make_positions_unlikelier(profile, grade, gps, seed):
    """Three minutes: windows claim 0.8 s, at which the heading is 10 deg off; there is none."""
    made = plan_of(profiled(profile, seed), {"imu": grade, "gps": gps, "seed": seed}).measured()
    found = insnav.load(made.imu, made.gps).navigate().found.run
    assert abs(found.gps_delay) < 3.0 * found.gps_delay_sd
    assert found.gps_delay_sd < 0.03


def test_where_windows_are_not_believed_the_filter_leads_to_the_delay():
    made = plan_of(profiled("motorway", 5), {"imu": "consumer", "seed": 5}).measured()
    fixes = replace(made.gps, time=made.gps.time + 0.3)
    found = insnav.load(made.imu, fixes).navigate()
    assert found.found.run.gps_delay == pytest.approx(0.3, abs=0.04)
    assert not any(of_code(found.findings, Code.IMU_CLOCK_RATE))


def test_the_filter_leads_where_windows_see_nothing():
    """Three minutes by RTK from a moving start, 0.4 s late: it was 0.106 +- 0.007 s, windows 0.02 +- 0.04."""
    made = plan_of(profiled("round_trip", 415), {"imu": "consumer", "gps": "rtk", "seed": 415}).measured()
    run = insnav.load(made.imu, replace(made.gps, time=made.gps.time + 0.4)).navigate(smooth=False).found.run
    assert abs(run.gps_delay - 0.4) < min(3.0 * run.gps_delay_sd, 0.02)


@pytest.mark.parametrize(
    ("profile", "seed", "grade", "arm", "begin", "delay"),
    [
        ("bends", 1401, "consumer", (-1.5, 0.6, -0.9), 90.0, 0.3),
        ("round_trip", 1400, "consumer", (0.8, -0.4, -1.3), 30.0, 0.1),
        ("figure_eight", 1417, "tactical", (-1.5, 0.6, -0.9), 0.0, -0.1),
    ],
)
def test_delay_and_lever_arm_are_not_taken_for_one_another(profile, seed, grade, arm, begin, delay):
    """By RTK in motion, nothing given: delays were found up to 0.32 s off, arms up to 50 standard deviations."""
    receiver = replace(load_gps("rtk"), lever_b=arm)
    made = plan_of(profiled(profile, seed), {"imu": grade, "gps": receiver, "seed": seed}).measured()
    imu, gps = (each.rows(each.time > made.imu.time[0] + begin) for each in (made.imu, made.gps))
    run = insnav.load(imu, replace(gps, time=gps.time + delay)).navigate(smooth=False).found.run
    assert abs(run.gps_delay - delay) < min(3.0 * run.gps_delay_sd, 0.01)
    assert (np.abs(run.lever_b - arm) < 3.0 * run.lever_sd).all()


@pytest.mark.parametrize(
    ("profile", "seed", "grade", "arm", "rate", "length", "delay"),
    [
        ("city", 75014, "industrial", (0.7, 0.9, -1.3), 10, 277.5, 0.0),
        ("round_trip", 75026, "tactical", (-1.9, 0.0, -0.2), 2, 172.6, 0.2),
    ],
)
def test_how_a_receiver_smooths_velocities_bends_neither_delay_nor_lever_arm(
    profile, seed, grade, arm, rate, length, delay
):
    """Trapezoidal means of 20 Hz since the fix before, which alias what shakes: arms were 13 standard deviations off.

    The delay was five off where it was derived by the acceleration of the middle alone.
    """
    receiver = replace(load_gps("rtk"), lever_b=arm, rate=20.0)
    made = plan_of(profiled(profile, seed), {"imu": grade, "gps": receiver, "seed": seed, "rate": 100.0}).measured()
    imu, gps = (each.rows(each.time < made.imu.time[0] + length) for each in (made.imu, made.gps))
    number = 20 // rate
    moved = np.cumsum(0.5 * (gps.v_n[1:] + gps.v_n[:-1]), axis=0)
    v_n = gps.v_n.copy()
    v_n[number + 1 :] = (moved[number:] - moved[:-number]) / number
    gps = replace(gps, time=gps.time + delay, v_n=v_n).rows(slice(number, None, number))
    run = insnav.load(imu, gps).navigate(smooth=False).found.run
    assert abs(run.gps_delay - delay) < min(3.0 * run.gps_delay_sd, 0.01)
    assert (np.abs(run.lever_b - arm) < 3.0 * run.lever_sd).all()


@pytest.mark.parametrize(
    ("seed", "span", "speed", "velocities", "delay"),
    [(7807, (220.1, 391.4), 60.0, False, 0.4), (7809, (497.6, 693.7), np.inf, True, -0.3)],
)
def test_a_correction_of_the_attitude_tells_no_delay_from_a_lever_arm(seed, span, speed, velocities, delay):
    """Flights by RTK: arm and delay were 7 and 9 of their standard deviations off, 34 % of positions inside 3.

    At one speed both move the antenna alike, however it turns: only what was believed before tells them apart.
    """
    receiver, arm = load_gps("rtk"), np.array([-1.5, 0.6, -0.9])
    options = {"imu": "consumer", "gps": replace(receiver, lever_b=arm), "seed": seed}
    made = plan_of(profiled("aircraft_pattern", seed), options).measured()
    begin, end = made.imu.time[0] + np.array(span)
    imu, gps = (each.rows((each.time > begin) & (each.time < end)) for each in (made.imu, made.gps))
    if not velocities:
        gps = replace(gps, v_n=np.full_like(gps.v_n, np.nan), velocity_sd=np.full_like(gps.v_n, np.nan))
    run = insnav.load(imu, replace(gps, time=gps.time + delay)).navigate(smooth=False).found.run
    assert abs(run.gps_delay - delay) < 3.0 * run.gps_delay_sd
    assert (np.abs(run.lever_b - arm) < 3.0 * run.lever_sd).all()
    if speed < np.inf:
        assert run.gps_delay_sd > 0.5 / np.hypot(1.0 / DELAY_SD, speed / LEVER_SD)


@pytest.mark.parametrize(
    ("profile", "grade", "gps", "begin", "length", "delay"),
    [
        ("city", "automotive", "rtk", 75.0, 38.0, -0.3),
        ("round_trip", "consumer", "rtk", 30.0, 38.0, -0.3),
        ("mountain_road", "tactical", "rtk", 75.0, 38.0, -0.3),
        ("bends", "consumer", "single", 75.0, 25.0, 0.0),  # of which nothing tells how long errors of fixes last
    ],
)
def test_a_drive_of_half_a_minute_is_as_good_as_it_says(profile, grade, gps, begin, length, delay):
    """They were 33 to 71 % inside 3 sd, the state of the filter goes but half way, and said by nothing."""
    made = plan_of(profiled(profile, 71), {"imu": grade, "gps": gps, "seed": 71}).measured()
    begin += made.imu.time[0]
    imu, fixes = (each.rows((each.time >= begin) & (each.time < begin + length)) for each in (made.imu, made.gps))
    run = insnav.load(imu, replace(fixes, time=fixes.time + delay)).navigate().found.run
    solution, truth = run.smoothed.solution, made.reference
    lla = np.column_stack([np.interp(solution.time - delay, truth.time, column) for column in truth.lla.T])
    assert np.mean(np.abs(ned_offset(solution.lla, lla)) <= 3.0 * solution.sd[:, :3]) > 0.99
    assert abs(run.gps_delay - delay) < 3.0 * run.gps_delay_sd


@pytest.mark.parametrize("first", [0, 6])
def test_a_drift_of_the_clock_is_found_by_fixes_of_which_gates_reject_many(first):
    """RTK, a fix every 5 s: those that gates passed were no likelier with it; six faults and 96 m stated."""
    folder = shared.recorded("rtklib_drive_20250708")
    imu, gps = read_imu(folder / "imu.csv.gz").data, read_gps(folder / "gps.csv").data
    model = insnav.load(imu, gps.rows(slice(first, None, 20))).until("align").model
    assert rate_of(model) == pytest.approx(-290e-6, abs=90e-6)
    assert model.clock.value == pytest.approx(-0.06, abs=0.02)


def a_minute(name: str, begin: float, late: float) -> insnav.Drive:
    """Of a recorded drive, with a fix a second, stamped late."""
    folder = shared.recorded(name)
    imu, gps = read_imu(folder / "imu.csv.gz").data, read_gps(folder / "gps.csv").data
    gps = gps.rows(np.flatnonzero(np.diff(np.floor(gps.time - gps.time[0] + 1e-6), prepend=-1.0) > 0.0))
    imu, gps = (each.rows((each.time >= begin) & (each.time <= begin + 60.0)) for each in (imu, gps))
    return insnav.load(imu, replace(gps, time=gps.time + late))


@pytest.mark.parametrize(("begin", "late"), [(243312.0, -0.2), (243362.0, 0.3), (243512.0, 0.3)])
def test_a_minute_shows_the_lag_of_velocities_that_its_fixes_alone_show(begin, late):
    """The whole drive: 0.130 s. With the noise that the fixes state a delay explained the same: 0.006 to 0.010 s."""
    assert a_minute("rtklib_drive_20250708", begin, late).until("align").ready.receiver.lag.value == pytest.approx(
        0.13, abs=0.02
    )


# what the whole drives show: delay in the middle of each minute and lever arm; the clock of the first drifts by 292 ppm
CAR, UAV = (0.09, -0.02, -0.17), (0.01, -0.01, -0.03)


@pytest.mark.parametrize(
    ("name", "begin", "late", "delay", "arm"),
    [
        ("rtklib_drive_20250708", 243262.0, 0.0, 0.016, CAR),
        ("rtklib_drive_20250708", 243537.0, -0.2, -0.065, CAR),
        ("rtklib_drive_20250708", 243637.0, 0.0, -0.094, CAR),
        ("umn_thor75_uav", 302.0, 0.3, 0.086, UAV),
        ("umn_thor75_uav", 462.0, -0.2, 0.086, UAV),
    ],
)
def test_a_minute_is_no_surer_of_delay_and_lever_arm_than_its_parts_agree(name, begin, late, delay, arm):
    """Delays were up to 13, lever arms up to 6 standard deviations off the whole drive's, which are those of now."""
    run = a_minute(name, begin, late).navigate(smooth=False).found.run
    assert abs(run.gps_delay - late - delay) < 3.0 * run.gps_delay_sd < 1.0
    assert (np.abs(run.lever_b - arm) < 3.3 * run.lever_sd).all()
    assert run.lever_sd.max() < 1.2


def test_what_is_less_sure_of_the_delay_is_as_sure_of_all_else_with_it():
    half = np.random.default_rng(8).standard_normal((24, 24))
    p = half @ half.T
    by, sd = p[:, 21] / p[21, 21], 2.0 * float(np.sqrt(p[21, 21]))
    given = p - p[21, 21] * np.outer(by, by)  # with a delay that is known
    np.testing.assert_allclose(errorstate.less_sure(p, sd), given + sd**2 * np.outer(by, by), rtol=1e-9, atol=1e-9)
    assert errorstate.less_sure(p, 0.4 * sd) is p


def test_noise_of_the_fixes_shows_no_delay():
    """Covariances do not depend on what was measured; at one speed they fell to a third, and the delay was 11 sd off.

    The IMU is ideal, so that an exact velocity is to be had, and with it the standard deviation that is right.
    """
    plan = plan_of(profiled("aircraft_pattern", 7811), {"imu": "ideal", "gps": "rtk", "seed": 3})
    made, found = plan.measured(), []
    begin = made.imu.time[0] + 400.0
    imu, gps = (each.rows((each.time > begin) & (each.time < begin + 150.0)) for each in (made.imu, made.gps))
    true = plan.truth.evaluate(gps.time)
    ready = insnav.load(imu, replace(gps, lla=true.lla, v_n=true.v_n), imu="consumer").until("align").ready
    ready = drives.changed(ready, settled=True)
    for noise in (0.0, 1.0, 1.0, 1.0):
        rng = np.random.default_rng([31, len(found)])
        off, change = noise * rng.standard_normal((2, *gps.lla.shape))
        lla, v_n = lla_offset(true.lla, off * ready.gps.position_sd), true.v_n + change * ready.gps.velocity_sd
        navigator = Navigator(replace(ready, gps=replace(ready.gps, lla=lla, v_n=v_n)))
        feed(navigator, ready.imu)
        navigator.history()
        found.append(navigator.delay)
    (_, exact), noisy = found[0], np.array(found[1:])
    assert noisy[:, 1].min() > 0.6 * exact


@pytest.mark.parametrize(
    ("profile", "seed", "grade", "gps", "arm", "span", "delay", "most"),
    [
        # found in three steps
        ("aircraft_pattern", 9214, "consumer", "dgps", (-1.5, 0.6, -0.9), (396.6, 630.6), 1.0, 0.5),
        # hardly shown: parts of the drive agree on it to 0.19 s
        ("round_trip", 9216, "tactical", "single", (0.0, 0.0, 0.0), (0.0, 900.0), 0.3, 0.6),
    ],
)
def test_a_delay_far_from_where_the_search_begins(profile, seed, grade, gps, arm, span, delay, most):
    """The first step made positions unlikelier, or the filter began surer than the drive shows: 1 and 0.2 s off."""
    plan = plan_of(profiled(profile, seed), {"imu": grade, "gps": replace(load_gps(gps), lever_b=arm), "seed": seed})
    made = plan.measured()
    since = made.imu.time[0]
    imu, fixes = (
        each.rows((each.time > since + span[0]) & (each.time < since + span[1])) for each in (made.imu, made.gps)
    )
    if gps == "single":
        none = np.full_like(fixes.v_n, np.nan)
        fixes = replace(fixes, v_n=none, velocity_sd=none)
    run = insnav.load(imu, replace(fixes, time=fixes.time + delay)).navigate(smooth=False).found.run
    assert abs(run.gps_delay - delay) < 3.0 * run.gps_delay_sd < most
    assert (np.abs(run.lever_b - arm) < 3.0 * run.lever_sd).all()


def test_a_start_that_most_fixes_contradict_is_looked_at_with_doubted_ones():
    """A flight that begins in a turn, its attitude 10 deg off: delay and arm were 7 and 8 sd off, false fixes named."""
    made = plan_of(profiled("aircraft_pattern", 9105), {"imu": "consumer", "gps": "rtk", "seed": 9105}).measured()
    since = made.imu.time[0] + np.array([733.46, 896.19])
    imu, fixes = (each.rows((each.time > since[0]) & (each.time < since[1])) for each in (made.imu, made.gps))
    drive = insnav.load(imu, replace(fixes, time=fixes.time + 0.3))
    assert drive.until("align").ready.alignment.level_method is Code.ALIGN_LEVEL_MOTION_FILTER
    run = drive.navigate(smooth=False).found.run
    assert abs(run.gps_delay - 0.3) < min(3.0 * run.gps_delay_sd, 0.01)
    assert (np.abs(run.lever_b) < 3.0 * run.lever_sd).all()


def test_a_clock_to_which_the_next_look_goes_back_is_not_moved(monkeypatch: pytest.MonkeyPatch):
    """A flight by RTK, no delay: looks at it asked for -32, +34 and -34 ms, each 4 sd sure; it ended 19 ms off."""
    looks = iter((-0.032, 0.034, -0.034))
    monkeypatch.setattr(delay_and_lever, "delay_of", lambda *_: Found(next(looks), 0.006, 0.0, 0.0, 0.0, (1.0,), 0.006))
    ready = recorded()
    moved = list[float]()

    def prepared(clock: float, _: float) -> Aligned:
        moved.append(clock)
        return Aligned(late(ready, 0.0), (), clock)

    assert on_time(prepared, ready.receiver).clock == 0.0
    assert moved == [0.0, -0.032]


def test_a_flight_by_rtk_without_delay_has_none():
    """One look at it asks for -30 ms, 5 sd sure."""
    receiver = replace(load_gps("rtk"), lever_b=(0.8, -0.4, -1.3))
    made = plan_of(profiled("aircraft_pattern", 9108), {"imu": "automotive", "gps": receiver, "seed": 9108}).measured()
    since = made.imu.time[0] + np.array([412.13, 565.57])
    imu, fixes = (each.rows((each.time > since[0]) & (each.time < since[1])) for each in (made.imu, made.gps))
    run = insnav.load(imu, fixes).navigate(smooth=False).found.run
    assert abs(run.gps_delay) < min(run.gps_delay_sd, 0.01)
    assert (np.abs(run.lever_b - receiver.lever_b) < 3.0 * run.lever_sd).all()


@pytest.mark.parametrize("delay", [-0.3, 0.0, 0.2])
def test_fixes_of_another_time_are_as_likely_as_moved_ones(delay):
    """What the error states of one run say of a delay against a run with the samples moved by it."""
    seen = filtered(recorded())
    moved = filtered(late(recorded(), -delay))
    there, here = (LateFixes(each.used, each.epochs) for each in (seen, moved))
    (cost,), (own,), least = (
        each.costs(np.array([at])).sum(axis=1) for each, at in ((there, delay), (here, 0.0), (there, 0.0))
    )
    assert abs(cost - own) < 0.1 * (cost - least[0]) + 30.0


def test_a_trial_that_comes_to_a_pole_is_lost(monkeypatch):
    """As one that diverges: the drive itself may be far from a pole."""

    def astray(*_):
        raise InputError("filter.at_pole", where="t = 0.0 s")

    monkeypatch.setattr(delay_and_lever, "feed", astray)
    seen = filtered(recorded())
    assert seen.epochs is None
    assert seen.misfit == np.inf


ROTATED = np.array([2e-4, -3e-4, 5e-4])  # also the steps of the other states [SI]


@pytest.mark.parametrize("delay", [-0.8, 0.3])
@pytest.mark.parametrize(("state", "column"), [(3, STATE + 3), (6, STATE + 6), (12, CORRECTION + 3), (-1, -1)])
def test_errors_show_in_fixes_of_another_time_as_differences_do(delay, state, column):
    """Of velocity, attitude, bias of the accelerometers and lever arm: the run's own state moved by a little."""
    seen = filtered(recorded())
    epochs, used, firsts = seen.epochs.copy(), seen.used, [state]
    if column == STATE + 6:  # estimated minus true: C_nb is turned back
        turned = (np.eye(3) - skew(ROTATED)) @ dcm_from_quat(epochs[1:, column : column + 4])
        epochs[1:, column : column + 4] = quat_from_dcm(turned)
    elif column < 0:
        firsts = [layout(used.receiver).lever, layout(used.receiver).shaken]  # of turns and of vibration
        used = drives.changed(used, lever_b=used.receiver.lever_arm.value + ROTATED)
    else:
        epochs[1:, column : column + 3] += ROTATED
    runs = (seen.used, seen.epochs), (used, epochs)
    (before, shown), (after, _) = (LateFixes(*each).measured(delay, 0.0, 0.0) for each in runs)
    expected = sum(shown[:, :, first : first + 3] @ ROTATED for first in firsts if first >= 0)
    assert np.abs(expected).max() > 1e-5
    np.testing.assert_allclose(after - before, expected, atol=0.02 * np.abs(expected).max())


def test_a_clock_that_is_off_leaves_the_lever_arm_as_it_is() -> None:
    """A clock was moved rightly, and back as positions became less likely by chance: the arm was 1.7 m off."""
    for off in (0.08, -0.08, 0.05):
        drive = insnav.load(SAMPLE / "imu.csv.gz", gps=SAMPLE / "gps.csv", time_offset=off)
        run = drive.navigate(smooth=False).found.run
        assert (np.abs(run.lever_b - (0.8, -0.3, -1.2)) < 3.0 * run.lever_sd).all()
        assert run.gps_delay == pytest.approx(-off, abs=0.015)


@pytest.mark.parametrize(("arm", "known"), [(0.0, 0.5), (0.2, 0.05), (2.5, 0.3), (3.5, 1.0), (8.0, 0.1)])
def test_the_scale_of_a_lever_arm_is_that_of_the_drive(arm, known):
    """Against sums over arms at random: each scale is as likely as the arms of that scale explain what was measured."""
    opened, measured, seen = 2.0, np.array([arm, -0.3, 0.0]), np.diag([known, 2.0 * known, 5.0]) ** 2
    after = np.linalg.inv(np.linalg.inv(seen) + np.eye(3) / opened**2)
    scales, arms = np.geomspace(0.1, opened, 12), np.random.default_rng(5).standard_normal((100_000, 3))
    off = scales[:, None, None] * arms - measured
    likely = np.mean(np.exp(-0.5 * np.sum(off**2 / np.diag(seen), axis=2)), axis=1)
    found, mean = scale_of(after @ np.linalg.solve(seen, measured), after, opened, scales)
    if arm < 3.0:  # too few at random are farther
        assert mean == pytest.approx(np.sqrt(np.sum(likely * scales**2) / np.sum(likely)), rel=0.05)
        assert np.log(likely[scales == found][0]) == pytest.approx(np.log(likely.max()), abs=0.05)
    else:
        assert found == scales[-1]
        assert mean > 1.5


@pytest.mark.parametrize(("off", "wide"), [(0.3, False), (4.0, True)])
def test_a_lever_arm_that_is_far_off_keeps_the_wide_prior(off, wide):
    ready = drives.changed(recorded(), lever_b=drives.LEVER_B - [off, 0.0, 0.0], lever_sd=1.0)
    assert (filtered(ready).lever_sd > 1.5) == wide


@pytest.mark.parametrize("profile", ["city", "bends"])
def test_noise_of_the_accelerometers_is_no_delay(profile):
    """A velocity at a fix and an acceleration before it have noise in common: of 0.3 m/s^2 it made 14 to 33 ms."""
    drive = insnav.simulate(profile, imu="industrial", gps="rtk", seed=1)
    imu, gps = drive.imu.data, drive.gps.data
    noisy = replace(imu, accel=imu.accel + np.random.default_rng(1).normal(0.0, 0.3, imu.accel.shape))
    end = imu.time[0] + 400.0
    run = insnav.load(noisy.rows(imu.time < end), gps.rows(gps.time < end)).navigate(output_interval=1.0).found.run
    assert abs(run.gps_delay) < min(3.0 * run.gps_delay_sd, 0.01)


def test_a_gap_does_not_make_a_walk_a_rest():
    """After 40 s without fixes a velocity is known to 20 m/s: seven walks had no delay, and headings 35 deg off."""
    seen = filtered(recorded())
    assert LateFixes(seen.used, seen.epochs).moves
    states = layout(seen.used.receiver).states
    covariance = seen.epochs.shape[1] - states * (states + 1) // 2
    unsure = seen.epochs.copy()
    unsure[100:104, covariance + np.array([9, 14, 20])] = 1e6
    assert LateFixes(seen.used, unsure).moves
    unsure[:, covariance + np.array([9, 14, 20])] = 1e6
    assert not LateFixes(seen.used, unsure).moves


@pytest.mark.parametrize("seed", [0, 1])
def test_a_vehicle_at_rest_shows_no_delay(seed):
    """Velocities at rest are noise; taken for motion they made RTK fixes 1.28 ± 0.34 and 1.13 ± 0.34 s early."""
    rng, rate, lat = np.random.default_rng(seed), 100.0, 0.8
    time = (np.arange(30_000) + 1.0) / rate
    earth = OMEGA_EARTH * np.array([np.cos(lat), 0.0, -np.sin(lat)])
    gyro = earth + 5e-4 * rng.normal(size=3) + 1e-3 * rng.normal(size=(time.size, 3))
    accel = np.array([0.0, 0.0, -9.8086]) + 0.05 * rng.normal(size=3) + 0.02 * rng.normal(size=(time.size, 3))
    fixes = np.arange(1.0, 299.0)
    lla = lla_offset(np.array([lat, 0.2, 100.0]), 0.02 * rng.normal(size=(fixes.size, 3)))
    unknown = np.full((fixes.size, 3), np.nan)
    gps = GpsData(fixes, lla, unknown, unknown, unknown)
    found = insnav.load(ImuData(time, gyro, accel, "mean", "end"), gps, heading=0.0).navigate()
    run = found.found.run
    assert run.gps_delay_sd > 0.3
    assert abs(run.gps_delay) < 2.0 * run.gps_delay_sd
    delays = Code.RUN_LATE_FIXES, Code.GIVEN_DELAY_REJECTED, Code.NOISE_HIDES_LEVER_ARM
    assert not any(of_code(found.findings, *delays))
