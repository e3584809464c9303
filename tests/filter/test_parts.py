"""A record with long gaps of the IMU: navigated in parts, each aligned anew, sensor errors carried across."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.attitude import dcm_from_quat, dcm_from_rph, wrap_pi
from insnav.earth import gravity_n, ned_offset
from insnav.exceptions import AlignmentError
from insnav.filter.error_model import first_state, initial_state
from insnav.filter.estimate import Across, Estimate
from insnav.filter.filter_input import Output
from insnav.filter.navigate import Navigated, navigate_prepared, navigate_recording
from insnav.filter.navigator import Navigator
from insnav.filter.prepare import GivenStart, Start, prepare
from insnav.filter.receiver import Delay, LeverArm, Receiver
from insnav.findings import Code, of_code
from insnav.kernels.dynamics import NAV
from insnav.simulate import reference
from insnav.types import Alignment, GpsData, ImuData
from insnav.units import DEG
from tests.filter import drives

LAPS = 4
START = drives.truth(LAPS).start
RECEIVER, OUTPUT = Receiver(LeverArm(drives.LEVER_B)), Output(0.5)


def recording(seed: int, *gaps: tuple[float, float]) -> tuple[ImuData, GpsData]:
    """Samples and fixes, without the samples of some spans after the start [s]."""
    rng = np.random.default_rng([73, seed])
    imu = drives.noisy_imu(drives.perfect_imu(laps=LAPS), drives.MODEL, rng)
    gps = drives.noisy_gps(drives.perfect_gps(laps=LAPS), rng)
    keep = np.ones(imu.time.shape[0], dtype=bool)
    for begin, end in gaps:
        keep &= (imu.time <= START + begin) | (imu.time > START + end)
    return imu.rows(keep), gps


def navigated(seed: int, *gaps: tuple[float, float]) -> Navigated:
    return navigate_recording(*recording(seed, *gaps), drives.SPEC, RECEIVER, output=OUTPUT)


@pytest.mark.parametrize("gaps", [[(100.0, 105.0)], [(83.0, 160.0)], [(60.0, 64.0), (150.0, 200.0)]])
def test_every_part_is_as_good_as_it_says(gaps):
    inside = []
    for seed in range(3):
        run = navigated(seed, *gaps).run
        for solution in (run.solution, run.smoothed.solution):
            true = reference(drives.truth(LAPS), solution.time)
            error = np.hstack(
                [
                    ned_offset(solution.lla, true.lla),
                    solution.v_n - true.v_n,
                    wrap_pi(solution.rph - true.rph),
                ]
            )
            inside.append(np.abs(error) <= 3.0 * solution.sd)
            for begin, end in gaps:
                assert not np.any((solution.time > START + begin + 0.1) & (solution.time < START + end))
            after = solution.time > START + gaps[-1][1] + 30.0
            assert np.hypot(error[after, 0], error[after, 1]).max() < 3.0
            assert np.abs(error[after, 8]).max() < 4.0 * DEG
        assert Code.FILTER_RESET not in {event.code for event in run.events}
    shares = np.mean(np.concatenate(inside), axis=0)
    print(np.round(shares, 4))
    assert shares.min() > 0.98


def test_parts_are_listed_and_what_was_assumed():
    found = navigated(0, (100.0, 105.0), (150.0, 200.0), (204.0, 210.0))
    (gaps,) = of_code(found.notes, Code.FILTER_PARTS)
    assert (gaps["count"], gaps["limit_s"]) == (3, 3.0)
    assert gaps["gap_s"] == pytest.approx(50.0, abs=0.05)
    events = [event for event in found.run.events if not event.code.startswith("gate.")]
    headings = {Code.ALIGN_HEADING_COURSE, Code.ALIGN_HEADING_GIVEN, Code.ALIGN_HEADING_GYROCOMPASS}
    levels = {Code.ALIGN_LEVEL_STATIC, Code.ALIGN_LEVEL_MOTION}
    assert [event.code for event in of_code(events, Code.FILTER_PART, Code.FILTER_PART_SHORT)] == [
        *(Code.FILTER_PART, Code.FILTER_PART, Code.FILTER_PART_SHORT, Code.FILTER_PART)
    ]
    assert len([*of_code(events, *headings)]) == len([*of_code(events, *levels)]) == 3
    (short,) = of_code(events, Code.FILTER_PART_SHORT)
    assert (short["number"], short["duration_s"]) == (3, pytest.approx(4.0, abs=0.05))
    parts = [*of_code(events, Code.FILTER_PART)]
    assert [part["number"] for part in parts] == [1, 2, 4]
    assert [part["gap_s"] for part in parts] == pytest.approx([np.nan, 5.0, 60.0], abs=0.1, nan_ok=True)
    fixes = found.run.innovations.time - START
    assert not np.any((fixes > 150.1) & (fixes < 210.0))


def test_a_later_part_tells_of_the_sensors_in_an_earlier_one():
    short = navigate_recording(*(each.rows(each.time < START + 100.0) for each in recording(1)), drives.SPEC, RECEIVER)
    both = navigated(1, (100.0, 105.0))
    alone, joined = short.run.smoothed.sensor_errors, both.run.smoothed.sensor_errors
    row = int(np.searchsorted(joined.time, START + 60.0))
    less = joined.sd[row] / alone.sd[np.searchsorted(alone.time, START + 60.0)]
    print(np.round(less, 2))
    assert np.all(less < 1.001)
    assert less[2] < 0.9


def test_sensor_errors_fade_in_the_gap_as_gauss_markov_processes_do():
    ready, _ = prepare(*recording(0), drives.SPEC, RECEIVER)
    first = first_state(ready.initial, ready.receiver)
    first.covariance[NAV:, NAV:] *= 0.01
    before = np.diag(first.covariance)[NAV:21].copy()
    estimate = Estimate(ready, first, note=print, coast=1.0)
    estimate.go_on(ready.initial, 200.0)
    stationary = ready.model.noise[6:18] / (2.0 * ready.model.decay)
    fade = np.exp(-2.0 * ready.model.decay * 200.0)
    expected = before * fade + stationary * (1.0 - fade)
    np.testing.assert_allclose(np.diag(estimate.covariance)[NAV:21], expected, rtol=1e-9)


def test_the_covariance_of_a_new_alignment_is_that_of_first_state_where_nothing_is_known():
    """With the sensor errors as uncertain as at the start, going on is starting anew."""
    ready, _ = prepare(*recording(0), drives.SPEC, replace(RECEIVER, delay=Delay(sd=0.05)))
    first = first_state(ready.initial, ready.receiver)
    estimate = Estimate(ready, first, note=print, coast=1.0)
    estimate.go_on(ready.initial, 0.0)
    np.testing.assert_allclose(estimate.covariance[NAV:, NAV:], first.covariance[NAV:, NAV:], atol=1e-18)
    np.testing.assert_allclose(estimate.covariance[3:NAV, :21], first.covariance[3:NAV, :21], rtol=1e-9, atol=1e-16)
    np.testing.assert_allclose(estimate.x, first.x, rtol=0, atol=1e-12)


def test_a_bias_that_is_known_by_now_corrects_the_level():
    """Levelling takes the accelerometer bias for a tilt: a bias known by now takes the tilt back."""
    rph = np.array([0.02, -0.03, 0.4])
    methods = Code.ALIGN_LEVEL_STATIC, Code.ALIGN_HEADING_GIVEN
    alignment = Alignment(START, rph, np.full(3, 0.01), np.zeros(3), np.full(3, np.inf), None, *methods)
    initial = initial_state(alignment, drives.MODEL, drives.PLACE, np.zeros(3), np.ones(3), np.full(3, 0.1))
    g = gravity_n(drives.PLACE[0], drives.PLACE[2])
    assert np.linalg.norm(Across.of(initial).slope[6:9, 3:6], axis=1).max() == pytest.approx(1.0 / g[2], rel=1e-3)
    first = first_state(initial, RECEIVER)
    known = np.array([0.05, -0.03, 0.0])
    first.correction[3:6] = known
    ready = drives.ready(*recording(0), drives.Begin(initial, alignment))
    estimate = Estimate(ready, first, note=print, coast=1.0)
    estimate.go_on(initial, 0.0)
    force = dcm_from_rph(rph).T @ -g  # as sensed at rest, bias and all
    level = dcm_from_quat(estimate.x[6:]) @ (force - known)
    np.testing.assert_allclose(level[:2], 0.0, atol=2e-3)


def test_a_given_start_holds_for_its_part_only():
    imu, gps = recording(0, (100.0, 105.0))
    at = reference(drives.truth(LAPS), np.array([START + 20.0]))
    start = Start(START + 20.0, at.lla[0], at.v_n[0], at.rph[0], np.ones(3), np.full(3, 0.1), np.full(3, DEG))
    ready, _ = prepare(imu, gps, drives.SPEC, RECEIVER, known=GivenStart(start))
    assert ready.alignment.heading_method is Code.ALIGN_HEADING_GIVEN
    assert [part.alignment.heading_method for part in ready.starts[1:]] == [Code.ALIGN_HEADING_COURSE]


def test_no_part_that_can_be_aligned_is_refused_with_the_first_reason():
    imu, gps = recording(0, (5.0, 295.0))
    with pytest.raises(AlignmentError, match=r"align.part_short"):
        prepare(imu, gps, drives.SPEC, RECEIVER)


def test_blocks_make_no_difference():
    ready, _ = prepare(*recording(2, (100.0, 105.0), (150.0, 200.0)), drives.SPEC, RECEIVER)
    whole = navigate_prepared(ready, drives.SPEC, aiding="off").run
    navigator = Navigator(ready)
    for first in range(0, ready.imu.time.shape[0], 97):
        navigator.feed(ready.imu.rows(slice(first, first + 97)))
    pieces = navigator.finish()
    np.testing.assert_array_equal(whole.solution.lla, pieces.solution.lla)
    np.testing.assert_array_equal(whole.smoothed.solution.lla, pieces.smoothed.solution.lla)


def test_without_a_gap_there_are_no_parts():
    ready, _ = prepare(*recording(0), drives.SPEC, RECEIVER)
    assert len(ready.starts) == 1
    assert ready.longest_part() is ready
    assert ready.unbroken_until(START + 10.0) == ready.imu.time[-1]
