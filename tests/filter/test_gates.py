"""Each gate rejects what it is for, and nothing else; every rejection has its name, and a reset is one event."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.earth import lla_offset, ned_offset
from insnav.filter.gates import Gates, aside, pass_quality
from insnav.findings import Code, Severity
from insnav.simulate import reference
from insnav.types import GpsData, Run
from tests.filter import drives

SPIKED = 100  # the fix that is tampered with: 101 s into the drive, moving


@pytest.fixture(scope="module")
def recorded():
    rng = np.random.default_rng(21)
    imu = drives.noisy_imu(drives.perfect_imu(laps=3), drives.MODEL, rng)
    return imu, drives.noisy_gps(drives.perfect_gps(laps=3), rng), drives.begin(drives.MODEL, rng, laps=3)


def run_with(recorded, change=None, **settings) -> Run:
    imu, gps, start = recorded
    return drives.navigate(imu, gps if change is None else change(gps), start, drives.MODEL, **settings)


@pytest.fixture(scope="module")
def untouched(recorded) -> Run:
    return run_with(recorded)


def kinds(run: Run) -> list[Code]:
    return [event.code for event in run.events]


def apart(one: Run, other: Run) -> np.ndarray:
    """Distance of two solutions [m]."""
    return np.linalg.norm(ned_offset(one.solution.lla, other.solution.lla), axis=1)


def moved(gps: GpsData, rows, offset) -> GpsData:
    lla = gps.lla.copy()
    lla[rows] = lla_offset(lla[rows], offset)
    return replace(gps, lla=lla)


def test_nothing_is_rejected_from_an_honest_drive(untouched):
    assert kinds(untouched) == []
    assert untouched.innovations.used_position.all()
    assert untouched.innovations.used_velocity.all()
    true = reference(drives.truth(3), untouched.solution.time)
    late = untouched.solution.time > 1060.0
    error = ned_offset(untouched.solution.lla, true.lla)[late]
    assert np.sqrt(np.mean(error**2, axis=0)) == pytest.approx([0.17, 0.17, 0.3], abs=0.15)


@pytest.mark.parametrize("size", [10.0, 100.0, 1e4, 1e5])
def test_a_single_spike_is_rejected_and_only_it(recorded, untouched, size):
    run = run_with(recorded, lambda gps: moved(gps, [SPIKED], [size, 0.0, 0.0]))
    expected = Code.GATE_PHYSICAL_POSITION if size > 400.0 else Code.GATE_POSITION
    assert kinds(run) == [expected]
    (event,) = run.events
    assert event.begin == pytest.approx(recorded[1].time[SPIKED])
    unit = "m" if size > 400.0 else "nis"
    assert event["distance_m" if size > 400.0 else "nis"] > event[f"limit_{unit}"] > 0.0
    assert np.flatnonzero(~run.innovations.used_position).tolist() == [SPIKED]
    assert run.innovations.used_velocity.all()
    assert apart(run, untouched).max() <= 0.5


def test_a_row_of_spikes_is_rejected_whole(recorded, untouched):
    rows = np.arange(SPIKED, SPIKED + 8)
    run = run_with(recorded, lambda gps: moved(gps, rows, [0.0, 60.0, 0.0]))
    assert kinds(run) == [Code.GATE_POSITION] * 8
    assert np.flatnonzero(~run.innovations.used_position).tolist() == rows.tolist()
    assert apart(run, untouched).max() <= 3.0


def test_a_permanent_jump_leads_to_one_reset(recorded):
    offset = [300.0, -400.0, 0.0]
    run = run_with(recorded, lambda gps: moved(gps, slice(SPIKED, None), offset))
    resets = [event for event in run.events if event.code == Code.FILTER_RESET]
    assert len(resets) == 1
    waited = resets[0].begin - recorded[1].time[SPIKED]
    assert 10.0 <= waited <= 12.0
    assert resets[0]["limit_s"] == 10.0
    assert resets[0].severity is Severity.WARNING
    assert resets[0]["distance_m"] == pytest.approx(500.0, abs=5.0)
    before = [event.code for event in run.events if event.begin <= resets[0].begin]
    assert set(before) <= {Code.GATE_PHYSICAL_POSITION, Code.GATE_POSITION, Code.FILTER_RESET}
    # afterwards it believes the fixes again
    later = run.innovations.time > resets[0].begin
    assert run.innovations.used_position[later].mean() > 0.97
    true = reference(drives.truth(3), run.solution.time)
    end = run.solution.time > resets[0].begin + 30.0
    assert np.abs(ned_offset(run.solution.lla, true.lla)[end] - offset).max() < 2.5


def test_rejections_do_not_widen_the_covariance(recorded):
    """A row of rejected fixes leaves the covariance exactly as if there had been no fix."""
    rows = np.arange(SPIKED, SPIKED + 9)

    def without(gps):
        keep = np.ones(gps.time.size, dtype=bool)
        keep[rows] = False
        return GpsData(*(getattr(gps, name)[keep] for name in ("time", "lla", "v_n", "position_sd", "velocity_sd")))

    def blind(gps):  # no velocity, so that nothing of these fixes is used
        v = gps.v_n.copy()
        v[rows] = np.nan
        return moved(replace(gps, v_n=v), rows, [0.0, 0.0, 5000.0])

    rejected, absent = run_with(recorded, blind), run_with(recorded, without)
    assert len(rejected.events) == 9
    np.testing.assert_allclose(rejected.solution.sd, absent.solution.sd, rtol=1e-3)
    np.testing.assert_allclose(rejected.epochs.covariance[-1], absent.epochs.covariance[-1], rtol=1e-2, atol=1e-8)


@pytest.mark.parametrize(("size", "kind"), [(24.0, Code.GATE_VELOCITY), (1000.0, Code.GATE_PHYSICAL_VELOCITY)])
def test_a_false_velocity_is_rejected_and_its_position_used(recorded, untouched, size, kind):
    def change(gps):
        v = gps.v_n.copy()
        v[SPIKED] += [0.0, size, 0.0]
        return replace(gps, v_n=v)

    run = run_with(recorded, change)
    assert kinds(run) == [kind]
    assert run.innovations.used_position.all()
    assert np.flatnonzero(~run.innovations.used_velocity).tolist() == [SPIKED]
    assert apart(run, untouched).max() <= 0.2


def test_a_small_innovation_is_weighted_down_not_rejected(recorded):
    def change(gps):  # millimetre fixes, one of them 0.3 m off
        gps = replace(drives.perfect_gps(laps=3), position_sd=np.full_like(gps.position_sd, 0.005))
        return moved(gps, [SPIKED], [0.0, 0.3, 0.0])

    run = run_with(recorded, change)
    at = [event.code for event in run.events if event.begin == pytest.approx(recorded[1].time[SPIKED])]
    assert at == [Code.DEWEIGHTED_POSITION]
    assert run.innovations.used_position[SPIKED]


def test_a_fix_of_type_none_is_not_used_at_all(recorded):
    def change(gps):
        fix = np.ones(gps.time.size, dtype=np.int64)
        fix[SPIKED] = 0
        return replace(gps, fix=fix)

    run = run_with(recorded, change)
    assert set(kinds(run)) == {Code.GATE_QUALITY}
    assert [event.begin for event in run.events] == pytest.approx([recorded[1].time[SPIKED]] * len(run.events))
    assert not run.innovations.used_position[SPIKED]
    assert not run.innovations.used_velocity[SPIKED]


def test_a_fix_that_admits_to_be_poor_is_not_used(recorded):
    def change(gps):
        sd = gps.position_sd.copy()
        sd[SPIKED] = 300.0
        return replace(gps, position_sd=sd)

    run = run_with(recorded, change)
    assert kinds(run) == [Code.GATE_QUALITY]
    assert (run.events[0]["sd_m"], run.events[0]["limit_m"]) == (300.0, 100.0)
    assert run.innovations.used_velocity[SPIKED]


def test_an_outage_is_not_a_reason_to_reject(recorded):
    """The physical gate grows with the gap, and the covariance with it: the first fix after a minute is used."""

    def change(gps):
        keep = (gps.time < 1100.0) | (gps.time > 1160.0)
        return GpsData(*(getattr(gps, name)[keep] for name in ("time", "lla", "v_n", "position_sd", "velocity_sd")))

    run = run_with(recorded, change)
    assert kinds(run) == []
    true = reference(drives.truth(3), run.solution.time)
    error = ned_offset(run.solution.lla, true.lla)
    gap = (run.solution.time > 1101.0) & (run.solution.time < 1160.0)
    before = (run.solution.time > 1060.0) & (run.solution.time < 1100.0)
    assert run.solution.sd[gap, 0].max() > 20 * run.solution.sd[before, 0].max()
    assert (np.abs(error[gap]) <= 3.5 * run.solution.sd[gap, :3]).all()


def test_the_limit_follows_from_the_probability():
    # chi-square with 3 degrees of freedom: 16.27 at 0.999, 7.815 at 0.95 (any table)
    assert Gates(probability=0.999).nis_limit == pytest.approx(16.266, abs=1e-3)
    assert Gates(probability=0.95).nis_limit == pytest.approx(7.815, abs=1e-3)


def test_a_stricter_gate_rejects_more(recorded):
    strict = run_with(recorded, gates=Gates(probability=0.9, small_position=0.0, small_velocity=0.0))
    share = 1 - strict.innovations.used_position.mean()
    assert 0.05 < share < 0.2


def test_a_step_within_the_whole_error_of_a_fix_is_no_false_fix():
    """Where the white part is centimetres, positions that step by two metres of their 1.5 are de-weighted, not lost."""
    gates = Gates()
    assert gates.small_of(np.full(3, 0.1)) == gates.small_position
    assert gates.small_of(np.array([1.5, 1.5, 3.0])) == pytest.approx(4.5)


@pytest.mark.parametrize(("every", "diverged"), [(12, False), (1, True)])
def test_fixes_that_gates_de_weight_are_a_divergence_where_they_are_the_rule(recorded, every, diverged):
    """Five fixes a minute off by 0.35 m, claimed to 1 cm, hardly move the solution; all off by 0.17 m do."""
    rng, rows = np.random.default_rng(7), slice(SPIKED, None, every)
    perfect = drives.perfect_gps(laps=3)
    sure = replace(perfect, position_sd=np.full_like(perfect.position_sd, 0.01))
    off = (0.1 if diverged else 0.2) * rng.choice([-1.0, 1.0], (len(sure.time[rows]), 3))
    run = run_with(recorded, lambda _: moved(sure, rows, off), smooth=False)
    assert (Code.FILTER_DIVERGED in kinds(run)) is diverged


def turning(time: np.ndarray, rate: float) -> GpsData:
    """Fixes good to 1 cm on a circle, on which 50 m/s are 2 g."""
    circle = (
        50.0 / (2.0 * 9.8 / 50.0) * np.column_stack([np.sin(rate * time), np.cos(rate * time), np.zeros_like(time)])
    )
    size = np.full((time.size, 3), 0.01)
    nothing = np.full_like(size, np.nan)
    return GpsData(time, lla_offset(np.array([0.8, 0.1, 300.0]), circle), nothing, size, nothing)


@pytest.mark.parametrize("gap", [0.2, 1.0])
def test_false_fixes_between_true_ones_are_told_from_turns_and_jumps(gap):
    time = 500.0 + gap * np.arange(200)
    fixes = turning(time, 2.0 * 9.8 / 50.0)
    assert not aside(Gates(), fixes).any()
    rng, off = np.random.default_rng(3), np.zeros((200, 3))
    for rows in ([20], [40, 42], [60, 61], [80, 81, 82], [100, 103], [197]):
        off[rows] = 60.0 * rng.standard_normal((1, 3)) / np.sqrt(3.0) + rng.standard_normal((len(rows), 3)) + 90.0
    false = off.any(axis=1)
    assert (aside(Gates(), replace(fixes, lla=lla_offset(fixes.lla, off))) == false).all()


def test_fixes_that_are_none_leave_none_beside_them_aside():
    """Rows without a fix hold zeros: what is between two of them is not beside their line."""
    fixes = turning(500.0 + 0.25 * np.arange(60), 0.1)
    none = np.arange(60) % 7 < 5
    lla = np.where(none[:, None], 0.0, fixes.lla)
    assert not aside(Gates(), replace(fixes, lla=lla, fix=np.where(none, 0, 1))).any()
    assert aside(Gates(), replace(fixes, lla=lla)).any()


@pytest.mark.parametrize("count", range(7))
def test_a_few_fixes_are_not_aside(count):
    assert aside(Gates(), turning(500.0 + np.arange(count), 0.1)).tolist() == [False] * count


@pytest.mark.parametrize("size", np.geomspace(1.0, 1e4, 17))
def test_a_jump_that_stays_leaves_no_fix_aside(size):
    time = 500.0 + 0.25 * np.arange(60)
    fixes = turning(time, 0.1)
    off = size * np.outer(time > 507.0, [0.6, 0.8, 0.0])
    assert not aside(Gates(), replace(fixes, lla=lla_offset(fixes.lla, off))).any()


def test_fixes_without_a_position_and_poor_ones_are_no_fixes() -> None:
    """GGA quality 0 means invalid, 1 autonomous, 2 differential, 4 fixed, 6 estimated."""
    sd = np.array([[1.0, 1.0, 2.0]] * 5 + [[1.0, 1.0, 60.0]])
    gps = GpsData(np.arange(6.0), np.zeros((6, 3)), np.zeros((6, 3)), sd, sd, fix=np.array([0, 1, 2, 4, 6, 4]))
    assert pass_quality(Gates(max_sd=50.0), gps).tolist() == [False, True, True, True, True, False]
    assert pass_quality(Gates(max_sd=50.0), replace(gps, fix=None)).tolist() == [True] * 5 + [False]
