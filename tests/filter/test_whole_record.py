"""Fixes that the whole record contradicts are found and left out; a drive without contradictions stays as it was."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from insnav.earth import lla_offset, ned_offset
from insnav.errors.metrics import position_errors
from insnav.filter import FilterSettings, navigate
from insnav.filter.gates import Trust
from insnav.filter.measurements.measurement import NOTHING, FilterView
from insnav.filter.measurements.non_holonomic import NonHolonomic
from insnav.filter.navigate import Navigated, feed, navigate_recording
from insnav.filter.prepare import DELAY_SD, prepare
from insnav.filter.whole_record import WEAKER, of_moments, residuals, without_ends
from insnav.findings import CONTRADICTIONS, NOT_MEASURED, Code, Finding, Severity, of_code
from insnav.imu import load_imu
from insnav.simulate import gps_from_truth
from insnav.simulate.faults import gps_jump, gps_spike
from insnav.simulate.gps_file import load_gps
from insnav.simulate.motion import load_profile
from insnav.simulate.recording import MOTION_STREAM, Recording, simulate_recording
from insnav.types import FloatArray, GpsData

SETTINGS = FilterSettings(delay_sd=DELAY_SD)
AT = 200.0  # begin of the faults, after the first sample [s]


@lru_cache(maxsize=3)
def recording(seed: int) -> Recording:
    truth = load_profile("city").truth((seed, MOTION_STREAM))
    return simulate_recording(truth, load_imu("automotive"), load_gps("single"), seed)


def navigated(seed: int, gps: GpsData) -> Navigated:
    return navigate_recording(recording(seed).imu, gps, load_imu("automotive"), SETTINGS)


@lru_cache(maxsize=2)
def undisturbed(seed: int) -> Navigated:
    """The run over its own fixes, which several tests begin from."""
    return navigated(seed, recording(seed).gps)


def without_passes(seed: int, gps: GpsData) -> FloatArray:
    ready = prepare(recording(seed).imu, gps, load_imu("automotive"), SETTINGS)
    navigator = ready.navigator()
    feed(navigator, ready.imu)
    return navigator.finish().solution.lla


def horizontal(seed: int, done: Navigated) -> FloatArray:
    assert done.run.smoothed is not None
    errors = position_errors(done.run.smoothed.solution, recording(seed).reference)
    return np.hypot(errors.position[:, 0], errors.position[:, 1])


def span(gps: GpsData, length: float) -> tuple[float, float]:
    return gps.time[0] + AT, gps.time[0] + AT + length


def frozen(gps: GpsData, length: float) -> GpsData:
    """Position that stays while the velocity goes on."""
    begin, end = span(gps, length)
    inside = (gps.time >= begin) & (gps.time < end)
    lla = gps.lla.copy()
    lla[inside] = lla[np.flatnonzero(inside)[0]]
    return replace(gps, lla=lla)


def told(done: Navigated) -> list[Finding]:
    return list(of_code(done.run.events, *CONTRADICTIONS, *NOT_MEASURED))


def false(done: Navigated) -> list[float]:
    """Times of positions left out; each event tells how far the filter was from it."""
    events = [event for event in done.run.events if event.code is Code.GATE_RECORD_POSITION]
    found = done.run.innovations
    rows = np.searchsorted(found.time, [event.begin for event in events])
    off = np.linalg.norm(found.innovation[rows, :3], axis=1)
    np.testing.assert_allclose([event.value for event in events], off)
    return [event.begin for event in events]


@pytest.mark.parametrize("seed", [5, 6])
def test_nothing_changes_where_nothing_is_contradicted(seed):
    done = undisturbed(seed)
    np.testing.assert_array_equal(done.run.solution.lla, without_passes(seed, recording(seed).gps))
    assert false(done) == []


@pytest.mark.parametrize(("seed", "metres"), [(5, 30.0), (5, 1000.0), (6, 100.0)])
def test_a_row_of_shifted_fixes_is_left_out(seed, metres):
    gps = recording(seed).gps
    done = navigated(seed, gps_jump(gps, metres, span(gps, 30.0)))
    assert horizontal(seed, done).max() < 5.0
    assert len(false(done)) == 30
    assert not any(event.code is Code.FILTER_RESET for event in done.run.events)
    (left_out,) = of_code(told(done), Code.RECORD_FALSE_POSITIONS)
    assert left_out.severity is Severity.WARNING
    assert left_out["count"] == 30
    assert left_out["residual_m"] == pytest.approx(metres, rel=0.2)
    assert left_out.end - left_out.begin == pytest.approx(29.0, abs=0.1)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_false_first_fix_is_found(seed):
    gps = recording(seed).gps
    clean = horizontal(seed, undisturbed(seed)).max()
    done = navigated(seed, gps_spike(gps, 1100.0, (gps.time[0], gps.time[0])))
    assert horizontal(seed, done).max() < clean + 2.0
    assert [each["count"] for each in of_code(done.notes, Code.ALIGN_FALSE_START)] == [1]


@pytest.mark.parametrize("seconds", [30.0, 120.0])
def test_positions_that_freeze_are_left_out(seconds):
    gps = frozen(recording(5).gps, seconds)
    jitter = np.random.default_rng(1).standard_normal(gps.lla.shape) * [1.0, 1.0, 0.0]
    for size in (0.0, 1e-9):
        done = navigated(5, replace(gps, lla=gps.lla + size * jitter))
        assert horizontal(5, done).max() < 5.0
        assert len(list(of_code(told(done), Code.GPS_FROZEN))) == 1
    done = navigated(5, replace(gps, lla=gps.lla + 2e-7 * jitter))  # by a metre: as others that are false
    assert horizontal(5, done).max() < 5.0
    assert len(false(done)) >= 0.9 * seconds


def test_a_velocity_that_lags_contradicts_nothing():
    """A velocity 0.8 s older than its position, as the filter knows, is compared with the track of that time."""
    gps = recording(5).gps
    shift = 0.8  # [s]
    v_n = np.column_stack(
        [np.interp(gps.time - shift, recording(5).reference.time, v) for v in recording(5).reference.v_n.T]
    )
    noise = np.random.default_rng(3).standard_normal(v_n.shape) * 0.1
    late = replace(gps, v_n=v_n + noise, velocity_sd=np.full_like(v_n, 0.1))
    done = navigated(5, late)
    np.testing.assert_array_equal(done.run.solution.lla, without_passes(5, late))
    assert not any(of_code(told(done), *CONTRADICTIONS))


@pytest.mark.parametrize("metres", [10.0, 100.0])
def test_shifted_fixes_of_a_receiver_good_to_centimetres_are_left_out(metres):
    """Weights count in reported standard deviations: with few of them, a ramp between two tracks would be cheap."""
    truth = load_profile("motorway").truth((7, MOTION_STREAM))
    spec = load_imu("automotive")
    made = simulate_recording(truth, spec, load_gps("rtk"), 7)
    gps = gps_jump(made.gps, metres, span(made.gps, 30.0))
    done = navigate_recording(made.imu, gps, spec, SETTINGS)
    assert done.run.smoothed is not None
    errors = position_errors(done.run.smoothed.solution, made.reference)
    assert np.hypot(errors.position[:, 0], errors.position[:, 1]).max() < 0.5


def test_velocities_are_compared_at_the_antenna():
    """Two metres ahead of the IMU the antenna swings by a metre per second in a bend: no velocity is false there."""
    made, ahead = recording(5), np.array([2.0, 0.0, 0.0])
    truth = load_profile("city").truth((5, MOTION_STREAM))
    exact = gps_from_truth(truth, made.gps.time, ahead), gps_from_truth(truth, made.gps.time, np.zeros(3))
    moved = ned_offset(exact[0].lla, exact[1].lla)
    gps = replace(made.gps, lla=lla_offset(made.gps.lla, moved), v_n=made.gps.v_n + exact[0].v_n - exact[1].v_n)
    settings = replace(SETTINGS, lever_b=ahead)
    run = navigate_recording(made.imu, gps, load_imu("automotive"), settings).run
    left = residuals(run, gps, settings)[0][1]
    assert np.abs(left[np.isfinite(left)]).max() < 0.5


def test_true_fixes_about_those_of_a_jump_are_used():
    """What is left out about them, too, ends where the smoothed track supports the fixes."""
    gps = recording(5).gps
    begin, end = span(gps, 30.0)
    jumped, track = gps_jump(gps, 100.0, (begin, end)), undisturbed(5).run
    left_out = (gps.time >= begin - 15.0) & (gps.time < end + 15.0) | (gps.time < 30.0)
    left = without_ends(left_out, track, jumped, SETTINGS)
    np.testing.assert_array_equal(left, np.any(jumped.lla != gps.lla, axis=1))


def test_velocities_that_are_false_for_a_moment_are_no_change_of_what_lasts():
    """They stay left out where lasting changes are looked for: in a recorded flight these stood for them, 1.6 km."""
    gps = recording(1).gps
    false = np.zeros((2, gps.time.size), dtype=bool)
    false[1, [20, 40, 41, 42]] = True  # one, and three of two seconds
    moments = false[1].copy()
    false[:, 60:80] = True  # twenty seconds may be a change that passes
    found = of_moments(Trust(false, np.zeros(false.shape)), gps)
    assert found is not None
    assert not found.false[0].any()
    assert (found.false[1] == moments).all()
    false[1, moments] = False
    assert of_moments(Trust(false, np.zeros(false.shape)), gps) is None
    assert of_moments(None, gps) is None


class Sliding(NonHolonomic):
    """A vehicle that slides sideways for a while, and is assumed not to."""

    def observe(self, at: FilterView, z: FloatArray, h: FloatArray) -> slice:
        rows = super().observe(at, z, h)
        if rows != NOTHING and AT < at.time < AT + 15.0:
            z[1] += 0.6
        return rows


def test_fixes_do_not_part_from_the_imu_where_a_vehicle_slides():
    """A change of the velocity of the fixes was found for it, and standard deviations held 24 m of nothing."""
    made = recording(5)
    settings = replace(SETTINGS, aiding=(Sliding(np.eye(3), np.zeros(3), np.array([0.05, 0.05])),))
    done = navigate_recording(made.imu, made.gps, load_imu("automotive"), settings, aiding="off")
    print(told(done), done.run.smoothed.solution.sd[:, :2].max())
    assert [each.code for each in told(done)] == [Code.RECORD_MOTION]
    assert told(done)[0]["sd_factor"] == WEAKER
    assert done.run.smoothed.solution.sd[:, :2].max() < 3.0


def test_a_lever_arm_is_no_surer_where_no_fix_is_false(monkeypatch):
    """Fixes that agree when all are weighed are used by a last run, and its lever arm is not known for that."""
    gps = recording(1).gps
    none = Trust(np.zeros((2, gps.time.size), dtype=bool), np.zeros((2, gps.time.size)))
    monkeypatch.setattr(navigate, "decided", lambda first, fixes, settings, again: (again(fixes, trust=none), ()))
    free = replace(SETTINGS, lever_sd=1.0)
    done = navigate_recording(recording(1).imu, gps, load_imu("automotive"), free)
    assert (done.run.lever_sd > 0.02).all()
