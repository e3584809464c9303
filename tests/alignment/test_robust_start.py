"""Fixes that are none, spikes, and rests too short to use do not fool the alignment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.alignment import align_static
from insnav.alignment.in_motion import sure_motion
from insnav.attitude import wrap_pi
from insnav.earth import lla_offset
from insnav.exceptions import AlignmentError
from insnav.filter.fine_alignment import fine_alignment
from insnav.filter.navigate import Navigated, navigate_recording
from insnav.filter.prepare import GivenStart
from insnav.filter.receiver import LeverArm, Receiver
from insnav.findings import Code
from insnav.simulate import corrupt_gps, corrupt_imu, gps_from_truth, reference, straight
from insnav.strapdown import intervals
from insnav.types import Alignment, GpsData
from tests.alignment.test_alignment import (
    CAR,
    PLACE,
    RECEIVER,
    Log,
    aligned,
    error,
    log,
    navigation_grade,
    perfect,
    since,
    started,
)
from tests.filter import drives
from tests.refusals import refused

LONG = np.array([0.0, 100.0, 0.0])  # of a spike [m]


@pytest.fixture(scope="module")
def drive() -> Log:
    """Half a minute at rest, then off; fixes five times a second."""
    truth = started()
    fixes = gps_from_truth(truth, truth.start + np.arange(1.0, truth.duration - 0.5, 0.2), np.zeros(3))
    return replace(log(truth, CAR, 4), gps=corrupt_gps(fixes, RECEIVER, 4))


def navigated(record: Log, gps: GpsData, **options: object) -> Navigated:
    return navigate_recording(record.imu, gps, record.spec, Receiver(), **options)


def assert_from_rest(found: Alignment, record: Log) -> None:
    assert found.level_method is Code.ALIGN_LEVEL_STATIC
    assert found.static is not None
    assert found.static[1] - found.static[0] > 25.0
    assert (np.abs(error(found, record.truth)) <= 4.0 * found.sd).all()


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("velocities", [True, False])
def test_spikes_at_rest_are_no_motion(drive, velocities, count):
    lla, v = drive.gps.lla.copy(), drive.gps.v_n.copy()
    spiked = slice(45, 45 + count)
    lla[spiked] = lla_offset(lla[spiked], LONG)
    v[spiked] = [0.0, 30.0, 0.0]
    if not velocities:
        v[:] = np.nan
    run = navigated(drive, replace(drive.gps, lla=lla, v_n=v)).run
    found = run.alignment
    # the rest may be cut in two, but the start is one at rest and the heading comes from the drive
    assert found.static is not None
    assert found.level_method is Code.ALIGN_LEVEL_STATIC
    assert found.heading_method is Code.ALIGN_HEADING_COURSE
    assert (np.abs(error(found, drive.truth)) <= 4.0 * found.sd).all()
    assert Code.FILTER_RESET not in [event.code for event in run.events]


def test_fixes_that_are_none_make_no_start(drive):
    """The first five rows say so: fix type 0, somewhere in the sea, or a kilometre of standard deviation."""
    n = drive.gps.time.size
    fix, lla, sd = np.ones(n, dtype=np.int64), drive.gps.lla.copy(), drive.gps.position_sd.copy()
    fix[:3], lla[:5], sd[3:5] = 0, [0.1, 0.1, 0.0], 1000.0
    run = navigated(drive, replace(drive.gps, fix=fix, lla=lla, position_sd=sd)).run
    assert run.alignment.time == pytest.approx(drive.gps.time[5])
    assert_from_rest(run.alignment, drive)
    assert np.abs(run.solution.lla[0, :2] - PLACE[:2]).max() < 1e-6  # six metres
    assert Code.FILTER_RESET not in [event.code for event in run.events]


def test_no_good_fix_is_an_error(drive):
    none = replace(drive.gps, fix=np.zeros(drive.gps.time.size, dtype=np.int64))
    poor = replace(drive.gps, position_sd=np.full_like(drive.gps.position_sd, 500.0))
    for gps in (none, poor):
        with pytest.raises(AlignmentError, match=r"gps.no_good_fix") as caught:
            navigated(drive, gps)
        assert caught.value.fix
    assert caught.value.values["sd_m"] == 500.0  # of the poor ones


@pytest.mark.parametrize("span", [(505.0, 505.005), (504.995, 505.1), (9000.0, 9100.0)])
def test_a_static_interval_of_few_samples_is_an_error(drive, span):
    with pytest.raises(AlignmentError, match=r"align.short_static") as caught:
        align_static(intervals(drive.imu), drive.spec, PLACE[0], PLACE[2], span)
    assert caught.value.fix
    with refused(AlignmentError, "align.no_fix_at_rest" if span[0] == 9000.0 else "align.short_static"):
        navigated(drive, drive.gps, known=GivenStart(static_span=span))


def test_a_start_in_motion_is_at_a_fix():
    """Velocities made of positions lie between the fixes; the start must not."""
    record = since(log(started(), CAR, 6), 533.0)
    truth = record.truth
    time = truth.start + np.arange(34.0, truth.duration, 0.8)
    gps = corrupt_gps(gps_from_truth(truth, time, np.zeros(3)), RECEIVER, 6)
    unknown = np.full_like(gps.v_n, np.nan)
    found = aligned(replace(record, gps=replace(gps, v_n=unknown, velocity_sd=unknown)))
    assert found.static is None
    assert np.abs(time - found.time).min() < 1e-9


def test_slow_ships_are_seen_to_move_by_positions_farther_apart():
    """6 m/s, later 8: by positions of 1.75 m two seconds apart it moved from 400 s on only, and the start was there."""
    time = np.arange(1.0, 900.0)
    way = np.cumsum(np.where(time < 400.0, 6.0, 8.0))
    lla = lla_offset(np.tile(PLACE, (time.size, 1)), way[:, None] * np.array([0.8, 0.6, 0.0]))
    unknown = np.full((time.size, 3), np.nan)
    gps = GpsData(time, lla, unknown, np.full((time.size, 3), 1.75), unknown)
    assert sure_motion(gps, 0.0)[1] > 390.0
    assert sure_motion(gps, 0.0, 60.0)[1] < 10.0


@pytest.mark.parametrize("length", [0.05, 0.4, 1.5, 5.0, 11.0])
def test_a_very_short_rest_is_aligned_or_refused(length):
    truth = straight(PLACE, 0.0, 0.3, 60.0)
    imu = corrupt_imu(perfect(truth, 100.0), navigation_grade(), 3).imu
    if length < 0.1:
        with pytest.raises(AlignmentError):
            fine_alignment(imu, navigation_grade(), PLACE, (0.0, length), 0.3)
        return
    found = fine_alignment(imu, navigation_grade(), PLACE, (0.0, length), 0.3)
    best = found.fine or found.coarse
    assert (np.abs(error(best, truth)) <= 4.0 * best.sd).all()
    assert (found.fine is None) == (length < 2.0)


@pytest.mark.parametrize(
    ("begin", "arm"),
    [*((begin, drives.LEVER_B) for begin in (1002.0, 1009.0, 1015.0, 1030.0)), (1009.0, (5.0, 0.0, 0.0))],
)
def test_a_start_in_a_bend_is_as_sure_as_it_says(begin, arm):
    """The course is that of a while, and a wrong heading turns the centripetal acceleration into a wrong level.

    It is that of the antenna, which swings out by some ten degrees where it is five metres ahead.
    """
    ratios, turned = [], []
    for seed in range(3):
        rng = np.random.default_rng([3, seed])
        imu = drives.noisy_imu(drives.perfect_imu(laps=2), drives.MODEL, rng)
        gps = drives.perfect_gps(laps=2)
        there = gps_from_truth(drives.truth(2), gps.time, np.array(arm))
        gps = drives.noisy_gps(replace(gps, lla=there.lla, v_n=there.v_n), rng)
        keep, later = imu.time >= begin, gps.time >= begin + 0.5
        imu = replace(imu, time=imu.time[keep], gyro=imu.gyro[keep], accel=imu.accel[keep])
        gps = GpsData(*(getattr(gps, name)[later] for name in ("time", "lla", "v_n", "position_sd", "velocity_sd")))
        run = navigate_recording(imu, gps, drives.SPEC, Receiver(LeverArm(np.array(arm)))).run
        found = run.alignment
        true = reference(drives.truth(2), np.array([found.time, found.time + 0.1]))
        off = wrap_pi(found.rph - true.rph[0])
        ratios.append(off / found.sd)
        turned.append(abs(off[2]))
        assert run.innovations.used_position.all()
    assert np.sqrt(np.mean(np.square(ratios), axis=0)).max() < 1.0
    assert max(turned) < np.radians(4.0)
