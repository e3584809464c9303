"""Alignment on simulated drives: right, and as uncertain as it says."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pytest

import insnav
from insnav.alignment import align, align_static, find_stationary
from insnav.alignment.align import stationary_of, still_of
from insnav.alignment.in_motion import start_velocity
from insnav.alignment.static import sway
from insnav.attitude import (
    dcm_from_rph,
    quat_conjugate,
    quat_from_dcm,
    quat_from_rph,
    quat_multiply,
    rotvec_from_quat,
    rph_from_quat,
)
from insnav.exceptions import AlignmentError
from insnav.findings import Code
from insnav.imu import load_imu
from insnav.imu.specification import ImuSpec, SensorSpec
from insnav.simulate import (
    GpsErrors,
    Truth,
    corrupt_gps,
    corrupt_imu,
    gps_from_truth,
    imu_from_truth,
    straight,
)
from insnav.simulate.motion.moves import Vehicle
from insnav.strapdown import intervals
from insnav.types import Alignment, GpsData, ImuData
from insnav.units import DEG, DEG_PER_H, DEG_PER_SQRT_H, M_S_PER_SQRT_H, PPM, UG
from tests.filter.drives import without_velocities
from tests.refusals import refused
from tests.simulate.motions import Segment, drive

PLACE = np.array([50.0 * DEG, -4.0 * DEG, 120.0])
AUTOMOTIVE = load_imu("automotive")
# without misalignment: what is tested with it is the heading
CAR = replace(
    AUTOMOTIVE,
    gyro=replace(AUTOMOTIVE.gyro, misalignment=np.zeros(3)),
    accel=replace(AUTOMOTIVE.accel, misalignment=np.zeros(3)),
)
STILL = Vehicle(velocity_shake=(0.0, 0.0, 0.0), angle_shake=(0.0, 0.0, 0.0))
RECEIVER = GpsErrors((1.0, 1.0, 2.0), velocity_noise=(0.1, 0.1, 0.1))


def navigation_grade(bias: float = 0.01) -> ImuSpec:
    """An IMU whose gyros feel the Earth turn."""
    one = np.ones(3)
    return ImuSpec(
        "navigation",
        SensorSpec(bias=bias * DEG_PER_H * one, random_walk=0.002 * DEG_PER_SQRT_H * one, scale_factor=10 * PPM * one),
        SensorSpec(bias=50 * UG * one, random_walk=0.01 * M_S_PER_SQRT_H * one, scale_factor=100 * PPM * one),
    )


@dataclass(frozen=True)
class Log:
    imu: ImuData
    gps: GpsData
    truth: Truth
    spec: ImuSpec


@lru_cache(maxsize=32)
def started(rest: float = 30.0, heading: float = 2.0, seed: int = 5) -> Truth:
    """At rest, then off in a straight line and round a bend."""
    segments = (
        Segment(rest),
        Segment(7.0, speed=12.0),
        Segment(8.0),
        Segment(8.0, turn=70 * DEG),
        Segment(12.0, speed=18.0),
        Segment(10.0, turn=-100 * DEG),
    )
    return drive(segments, PLACE, seed=seed, heading=heading, roll=0.03, pitch=-0.02, start=500.0, body=STILL)


def perfect(truth: Truth, rate: float) -> ImuData:
    return imu_from_truth(truth, truth.start + np.arange(round(truth.duration * rate) + 1) / rate)


def fixes(truth: Truth) -> GpsData:
    return gps_from_truth(truth, truth.start + np.arange(1.0, truth.duration), np.zeros(3))


def log(truth: Truth, spec: ImuSpec, seed: int, rate: float = 50.0) -> Log:
    imu = corrupt_imu(perfect(truth, rate), spec, (seed, 1)).imu
    return Log(imu, corrupt_gps(fixes(truth), RECEIVER, (seed, 2)), truth, spec)


def aligned(record: Log, **options: object) -> Alignment:
    return align(intervals(record.imu), record.spec, record.gps, **options)


def since(record: Log, time: float) -> Log:
    """The part of a log after `time`."""
    late, fix = record.imu.time > time, record.gps.time > time
    imu = replace(record.imu, time=record.imu.time[late], gyro=record.imu.gyro[late], accel=record.imu.accel[late])
    gps = GpsData(*(getattr(record.gps, n)[fix] for n in ("time", "lla", "v_n", "position_sd", "velocity_sd")))
    return replace(record, imu=imu, gps=gps)


def error(found: Alignment, truth: Truth, turned: np.ndarray | None = None) -> np.ndarray:
    """``phi`` about North, East, Down [rad]; `turned` takes the IMU's axes to the vehicle's."""
    c = dcm_from_rph(truth.evaluate(np.array([found.time])).rph[0])
    true = quat_from_dcm(c if turned is None else c @ turned)
    return -rotvec_from_quat(quat_multiply(quat_from_rph(found.rph), quat_conjugate(true)))


def honest(errors: list[np.ndarray], sds: list[np.ndarray]) -> np.ndarray:
    """RMS of error / sd, per axis."""
    ratio = np.array(errors) / np.array(sds)
    print(
        "rms of error / sd:", np.round(np.sqrt(np.mean(ratio**2, axis=0)), 2), "largest", np.abs(ratio).max().round(2)
    )
    return np.sqrt(np.mean(ratio**2, axis=0))


# ---- at rest


def test_levelling_and_gyrocompass_are_as_sure_as_they_say():
    spec, errors, sds = navigation_grade(), [], []
    for seed in range(20):
        heading = 2 * np.pi * seed / 20
        truth = straight(PLACE, 0.0, heading, 120.0, roll=0.2 * np.sin(seed), pitch=0.3 * np.cos(3 * seed), start=7.0)
        imu = corrupt_imu(perfect(truth, 20.0), spec, seed).imu
        found = align_static(intervals(imu), spec, PLACE[0], PLACE[2], (7.0, 127.0))
        assert found.heading_method is Code.ALIGN_HEADING_GYROCOMPASS
        assert found.level_method is Code.ALIGN_LEVEL_STATIC
        errors.append(error(found, truth))
        sds.append(found.sd)
    assert (np.abs(np.array(errors)) <= 3 * np.array(sds)).all()
    rms = honest(errors, sds)
    assert (rms < 1.5).all()
    assert (rms > 0.5).all()  # nor does it hide behind a large one
    # 50 ug is 50 urad of tilt, 0.01 deg/h over 15 deg/h cos(50 deg) is 1 mrad of heading, and the noise another
    assert np.mean(sds, axis=0) == pytest.approx([5e-5, 5e-5, 1.5e-3], rel=0.5)


def test_a_gyrocompass_is_as_unsure_as_its_level():
    """At 70 degrees of latitude 1 mg tilts by as much Earth rate as good gyros err by; without it 1.7 sd."""
    lla, spec = np.deg2rad([70.0, 20.0, 0.0]), navigation_grade()
    gyro = replace(spec.gyro, random_walk=0.1 * spec.gyro.random_walk)
    spec = replace(spec, gyro=gyro, accel=replace(spec.accel, bias=np.full(3, 1000.0 * UG)))
    ratios = []
    for seed in range(200):
        truth = straight(lla, 0.0, 2 * np.pi * seed / 200, 60.0)
        imu = corrupt_imu(perfect(truth, 5.0), spec, seed).imu
        found = align_static(intervals(imu), spec, lla[0], 0.0, (0.0, 60.0))
        ratios.append(error(found, truth)[2] / found.sd[2])
    assert 0.85 < np.sqrt(np.mean(np.square(ratios))) < 1.15


def test_misaligned_accelerometers_make_the_level_less_sure():
    """A misalignment of 2 mrad towards gravity tilts by 2 mrad, whatever the bias does."""
    ratios = []
    truth = straight(PLACE, 0.0, 1.0, 10.0)
    imu = perfect(truth, 20.0)
    for seed in range(100):
        wrong = corrupt_imu(imu, AUTOMOTIVE, seed).imu
        found = align_static(intervals(wrong), AUTOMOTIVE, PLACE[0], PLACE[2], (0.0, 10.0), heading=1.0)
        ratios.append(error(found, truth)[:2] / found.sd[:2])
    rms = np.sqrt(np.mean(np.square(ratios)))
    print(f"rms of tilt error / sd: {rms:.2f}")
    assert 0.85 < rms < 1.15  # 200 numbers: one sd of scatter is 0.05


def test_gyros_that_contradict_the_rotation_of_the_earth_give_no_sure_heading():
    """Biases in an IMU whose model has none, as one from a static record has none: no heading, or an unsure one."""
    truth, stated = straight(PLACE, 0.0, 1.0, 120.0, start=7.0), navigation_grade(0.0)
    for bias, finds in ((0.5, True), (30.0, False)):
        for seed in range(10):
            imu = corrupt_imu(perfect(truth, 20.0), navigation_grade(bias), seed).imu
            found = align_static(intervals(imu), stated, PLACE[0], PLACE[2], (7.0, 127.0))
            assert finds or not np.isfinite(found.sd[2])
            assert abs(error(found, truth)[2]) < 3 * found.sd[2] or not finds


@pytest.mark.parametrize("lat_deg", [-60.0, -20.0, 0.0, 70.0])
def test_gyrocompass_works_on_either_hemisphere(lat_deg):
    place = np.array([lat_deg * DEG, 1.0, 0.0])
    truth = straight(place, 0.0, 4.0, 60.0, roll=-0.1, pitch=0.2)
    found = align_static(intervals(perfect(truth, 20.0)), navigation_grade(), place[0], 0.0, (0.0, 60.0))
    # two degrees of freedom of rounding and half a second of Earth's rotation aside, nothing is left
    assert np.abs(error(found, truth)).max() < 1e-6


def test_samples_that_end_before_the_vehicle_moves_are_named():
    made = insnav.simulate("city", imu="consumer", gps="single", seed=1)
    imu = made.imu.data.rows(made.imu.data.time < made.imu.data.time[0] + 8.0)
    with refused(AlignmentError, "align.no_heading") as caught:
        insnav.load(imu, made.gps.data).until("align")
    assert caught.value.values["before_s"] == pytest.approx(made.gps.data.time[-1] - imu.time[-1], abs=0.02)


def test_a_given_heading_is_taken():
    truth = straight(PLACE, 0.0, 1.0, 30.0)
    imu = corrupt_imu(perfect(truth, 50.0), CAR, 1).imu
    found = align_static(intervals(imu), CAR, PLACE[0], PLACE[2], (0.0, 30.0), heading=1.0)
    assert found.heading_method is Code.ALIGN_HEADING_GIVEN
    assert found.rph[2] == pytest.approx(1.0)
    assert abs(error(found, truth)[0]) <= 3 * found.sd[0]


def test_gyro_bias_at_rest_is_found_and_as_sure_as_it_says():
    ratios = []
    for seed in range(20):
        truth = straight(PLACE, 0.0, 1.0, 60.0)
        sim = corrupt_imu(perfect(truth, 50.0), CAR, seed)
        found = align_static(intervals(sim.imu), CAR, PLACE[0], PLACE[2], (0.0, 60.0), heading=1.0)
        ratios.append((found.gyro_bias - sim.gyro_bias[-1]) / found.gyro_bias_sd)
    rms = np.sqrt(np.mean(np.square(ratios), axis=0))
    print("rms of bias error / sd:", rms.round(2))
    assert (rms < 1.5).all()


@pytest.mark.parametrize("rest", [15.0, 40.0])
def test_the_rest_is_found(rest):
    truth = started(rest)
    record = log(truth, CAR, 3)
    found = find_stationary(intervals(record.imu))
    assert found is not None
    assert found[0] == pytest.approx(500.0, abs=1.1)
    # the car starts off so gently that the first second cannot be told from rest
    assert rest - 3.0 <= found[1] - 500.0 <= rest + 1.5


@pytest.mark.parametrize("noise", [True, False])
def test_a_soft_departure_ends_the_rest_of_a_good_imu(noise):
    """Navigation grade: 0.1 m/s^2 after a minute are no part of it, or its mean would be off by degrees an hour."""
    truth = drive((Segment(60.0), Segment(40.0, speed=4.0), Segment(20.0)), PLACE, seed=3, start=500.0, body=STILL)
    spec = navigation_grade()
    imu = corrupt_imu(perfect(truth, 50.0), spec, 7).imu if noise else perfect(truth, 50.0)
    record = Log(imu, corrupt_gps(fixes(truth), RECEIVER, 8), truth, spec)
    found = stationary_of(intervals(imu), record.gps)
    assert found is not None
    assert found[1] >= 555.0
    assert np.linalg.norm(truth.evaluate(np.array([found[1]])).v_n) < 2e-3
    assert aligned(record).heading_method is Code.ALIGN_HEADING_GYROCOMPASS


def test_a_smooth_drive_is_not_a_rest_where_gps_sees_it():
    """Straight on at constant speed an IMU alone cannot tell; the fixes can."""
    record = since(log(started(), CAR, 3), 533.0)
    parts = intervals(record.imu)
    assert find_stationary(parts) is not None
    assert stationary_of(parts, record.gps) is None


def test_steady_braking_is_not_a_rest_where_positions_go_on():
    """Taken for one it tilts the level by as much as the brakes push: positions see it over its length."""
    made = insnav.simulate("city", imu="consumer", gps="single", seed=2018)  # brakes for 8 s from 106.5 s on
    imu, gps = (each.data.rows((each.data.time >= 100.0) & (each.data.time < 150.0)) for each in (made.imu, made.gps))
    unknown = np.full_like(gps.v_n, np.nan)
    begin, end = stationary_of(intervals(imu), replace(gps, v_n=unknown, velocity_sd=unknown))
    assert 114.5 < begin < end


# ---- heading from motion


def test_course_heading_is_as_sure_as_it_says():
    errors, sds = [], []
    for seed in range(20):
        found = aligned(log(started(heading=0.3 * seed), CAR, seed))
        assert found.heading_method is Code.ALIGN_HEADING_COURSE
        errors.append(error(found, started(heading=0.3 * seed)))
        sds.append(found.sd)
    assert (np.abs(np.array(errors)) <= 3 * np.array(sds)).all()
    assert (honest(errors, sds) < 1.5).all()
    assert np.degrees(np.max(sds, axis=0)[2]) < 6.0


def in_other_axes(record: Log, turned: np.ndarray) -> Log:
    """The IMU mounted so that `turned` takes its axes to the vehicle's."""
    imu = replace(record.imu, gyro=record.imu.gyro @ turned, accel=record.imu.accel @ turned)
    return replace(record, imu=imu)


@pytest.mark.parametrize("seed", range(4))
def test_a_reversing_vehicle_is_seen_to_reverse(seed):
    back = dcm_from_rph([0.0, 0.0, np.pi])
    found = aligned(in_other_axes(log(started(), CAR, seed), back))
    assert found.heading_method is Code.ALIGN_HEADING_REVERSING
    assert (np.abs(error(found, started(), back)) <= 3 * found.sd).all()


@pytest.mark.parametrize("angle_deg", [90.0, -90.0, 120.0])
def test_an_imu_turned_in_the_vehicle_is_seen_to_be(angle_deg):
    turned = dcm_from_rph([0.0, 0.0, angle_deg * DEG])
    errors, sds = [], []
    for seed in range(8):
        found = aligned(in_other_axes(log(started(), CAR, seed), turned))
        assert found.heading_method is Code.ALIGN_HEADING_ACCELERATION
        errors.append(error(found, started(), turned))
        sds.append(found.sd)
    assert (np.abs(np.array(errors)) <= 3.5 * np.array(sds)).all()
    assert (honest(errors, sds) < 1.5).all()


def test_course_from_positions_alone():
    record = log(started(), CAR, 6)
    blind = replace(
        record.gps, v_n=np.full_like(record.gps.v_n, np.nan), velocity_sd=np.full_like(record.gps.v_n, np.nan)
    )
    found = aligned(replace(record, gps=blind))
    assert found.heading_method is Code.ALIGN_HEADING_COURSE
    assert (np.abs(error(found, record.truth)) <= 3 * found.sd).all()


@pytest.mark.parametrize(("velocities", "every"), [(True, 5), (False, 5), (True, 12), (True, 16)])
def test_course_from_fixes_far_apart(velocities, every):
    for seed in range(8):
        record = log(started(heading=0.7 * seed), CAR, seed)
        gps = record.gps.rows(slice(seed % every, None, every))
        if not velocities:
            gps = replace(gps, v_n=np.full_like(gps.v_n, np.nan), velocity_sd=np.full_like(gps.v_n, np.nan))
        found = aligned(replace(record, gps=gps))
        assert found.heading_method is Code.ALIGN_HEADING_COURSE
        assert (np.abs(error(found, record.truth)) <= 3 * found.sd).all()


def test_gyrocompass_needs_no_motion():
    spec = navigation_grade()
    truth = straight(PLACE, 0.0, 5.0, 90.0, roll=0.05)
    found = aligned(log(truth, spec, 2, 20.0))
    assert found.heading_method is Code.ALIGN_HEADING_GYROCOMPASS
    assert (np.abs(error(found, truth)) <= 3 * found.sd).all()


# ---- start in motion


def test_a_start_in_motion_is_as_sure_as_it_says():
    errors, sds = [], []
    for seed in range(20):
        truth = started(heading=0.3 * seed)
        found = aligned(since(log(truth, CAR, seed), 533.0))
        assert found.static is None
        assert found.level_method is Code.ALIGN_LEVEL_MOTION
        errors.append(error(found, truth))
        sds.append(found.sd)
    assert (np.abs(np.array(errors)) <= 3.5 * np.array(sds)).all()
    assert (honest(errors, sds) < 1.5).all()


@pytest.mark.parametrize("begin", [533.0, 545.5])  # straight on, and as a bend begins
def test_a_start_in_motion_from_a_position_every_five_seconds(begin):
    for seed in range(8):
        record = since(log(started(heading=0.3 * seed), CAR, seed), begin)
        gps = record.gps.rows(slice(None, None, 5))
        unknown = np.full_like(gps.v_n, np.nan)
        found = aligned(replace(record, gps=replace(gps, v_n=unknown, velocity_sd=unknown)))
        assert found.static is None
        assert (np.abs(error(found, record.truth)) <= 3.5 * found.sd).all()


@pytest.mark.parametrize("begin", [0.0, 520.0])
def test_poor_positions_alone_show_motion_by_a_longer_way(begin):
    poor = GpsErrors((7.0, 7.0, 12.0))
    for seed in range(8):
        truth = started(heading=0.3 * seed)
        record = since(log(truth, CAR, seed), begin)
        gps = since(replace(record, gps=corrupt_gps(fixes(truth), poor, (seed, 2))), begin).gps
        found = aligned(replace(record, gps=gps))
        assert found.heading_method is Code.ALIGN_HEADING_COURSE
        assert (np.abs(error(found, truth)) <= 3.5 * found.sd).all()


@pytest.mark.parametrize("velocities", [True, False])
@pytest.mark.parametrize("begin", [0.0, 540.0])
def test_a_robot_that_is_never_fast_has_a_course_that_is_less_sure(velocities, begin):
    """1.2 m/s at most, from rest and in motion; it was refused below 2 m/s."""
    receiver, errors, sds = GpsErrors((0.1, 0.1, 0.2), velocity_noise=(0.05, 0.05, 0.05)), [], []
    way = (Segment(30.0), Segment(6.0, speed=1.0), Segment(9.0), Segment(12.0, turn=70 * DEG), Segment(20.0, speed=1.2))
    for seed in range(8):
        truth = drive(way, PLACE, seed=seed, heading=0.3 * seed, roll=0.03, pitch=-0.02, start=500.0, body=STILL)
        record = replace(log(truth, CAR, seed), gps=corrupt_gps(fixes(truth), receiver, (seed, 2)))
        record = since(record, begin)
        found = aligned(record if velocities else replace(record, gps=without_velocities(record.gps)))
        assert found.heading_method is Code.ALIGN_HEADING_COURSE
        errors.append(error(found, truth))
        sds.append(found.sd)
    assert (np.abs(np.array(errors)) <= 3.5 * np.array(sds)).all()
    assert (honest(errors, sds) < 1.5).all()
    assert 5.0 < np.degrees(np.max(sds, axis=0)[2]) < 25.0


@pytest.mark.parametrize(("noise", "least", "begin"), [(0.01, 0.7, 533.0), (0.01, 0.7, 545.5), (2.0, 3.0, 533.0)])
def test_the_velocity_at_a_start_by_positions_alone_is_as_sure_as_it_says(noise, least, begin):
    """A car that gains 1.7 m/s^2: the mean velocity of the positions about its start is metres per second off."""
    errors, sds = [], []
    for seed in range(20):
        truth = started(heading=0.3 * seed)
        record = log(truth, CAR, seed)
        receiver = GpsErrors((noise, noise, noise))
        record = since(replace(record, gps=corrupt_gps(fixes(truth), receiver, (seed, 2))), begin)
        v_n, sd = start_velocity(intervals(record.imu), aligned(record), record.gps, 0.0)
        errors.append(v_n - truth.evaluate(record.gps.time[:1]).v_n[0])
        sds.append(sd)
    assert (np.abs(np.array(errors)) <= 3.5 * np.array(sds)).all()
    assert (honest(errors, sds) < 1.5).all()
    assert (np.array(sds)[:, :2] < least).all()


@pytest.mark.parametrize(("every", "sees"), [(12, True), (20, True), (45, False), (70, False)])
def test_positions_far_apart_make_a_start_in_motion_or_say_that_they_are(every, sees):
    """Mean velocities at both ends of the span may be the same ones: the filter had no covariance that is finite."""
    made = insnav.simulate("motorway", imu="tactical", gps="dgps", seed=3)
    imu, gps = made.imu.data, made.gps.data.rows(slice(0, None, every))
    imu = imu.rows(imu.time > imu.time[0] + 100.0)
    drive = insnav.load(imu, without_velocities(gps))
    if not sees:
        with refused(AlignmentError, "align.fixes_far_apart") as caught:
            drive.until("align")
        assert caught.value.values["interval_s"] == every
        return
    ready, true = drive.until("align").ready, made.reference.data
    wrong = ready.initial.v_n - np.array([np.interp(ready.initial.time, true.time, each) for each in true.v_n.T])
    assert (np.abs(wrong) < 3.5 * np.sqrt(np.diagonal(ready.initial.covariance)[3:6])).all()


def test_the_velocity_at_a_start_is_exact_where_all_else_is():
    truth = started()
    time = truth.start + np.arange(34.506, 60.0)  # between two samples
    gps = gps_from_truth(truth, time, np.zeros(3))
    gps = replace(gps, position_sd=np.full_like(gps.lla, 0.01))
    rph = truth.evaluate(time[:1]).rph[0]
    methods = Code.ALIGN_LEVEL_GIVEN, Code.ALIGN_HEADING_GIVEN
    found = Alignment(float(time[0]), rph, np.full(3, 0.1 * DEG), np.zeros(3), np.zeros(3), None, *methods)
    v_n, sd = start_velocity(intervals(perfect(truth, 50.0)), found, gps, 0.0)
    np.testing.assert_allclose(v_n, truth.evaluate(time[:1]).v_n[0], atol=0.01)
    assert (sd < 0.03).all()


def test_a_rest_that_ends_before_the_first_fix_is_no_start():
    record = log(started(), CAR, 6)
    after = gps_from_truth(record.truth, record.truth.start + np.arange(31.0, record.truth.duration), np.zeros(3))
    late = replace(record, gps=corrupt_gps(after, RECEIVER, (6, 2)))
    rest = stationary_of(intervals(late.imu), late.gps)
    assert rest is not None
    assert rest[1] < late.gps.time[0]
    found = aligned(late)
    assert found.static is None
    assert (np.abs(error(found, record.truth)) <= 3.5 * found.sd).all()


# ---- what cannot be aligned


def test_poor_gyros_and_no_motion_are_an_error_that_says_so():
    truth = straight(PLACE, 0.0, 1.0, 60.0)
    with refused(AlignmentError, "align.no_heading") as caught:
        aligned(log(truth, CAR, 1))
    assert caught.value.exit_code == 3


def test_no_common_time_is_an_error():
    record = log(started(), CAR, 1)
    with pytest.raises(AlignmentError, match=r"align.no_fix_inside") as caught:
        aligned(replace(record, gps=replace(record.gps, time=record.gps.time + 1e5)))
    assert caught.value.exit_code == 3


def test_too_short_a_drive_without_rest_is_an_error():
    record = log(started(), CAR, 1)
    some = (record.imu.time > 535.0) & (record.imu.time < 538.0)
    imu = replace(record.imu, time=record.imu.time[some], gyro=record.imu.gyro[some], accel=record.imu.accel[some])
    with pytest.raises(AlignmentError) as caught:
        aligned(replace(record, imu=imu))
    assert caught.value.fix


def test_a_static_span_without_a_fix_is_an_error():
    record = log(started(), CAR, 1)
    with pytest.raises(AlignmentError, match=r"align.no_fix_at_rest"):
        aligned(record, static_span=(500.1, 500.9))


def test_helpers_agree_on_the_sign_of_phi():
    # C_hat = (I - [phi x]) C: an estimate turned by +0.1 rad of heading has phi_D = -0.1
    truth = straight(PLACE, 0.0, 1.0, 10.0)
    methods = Code.ALIGN_LEVEL_GIVEN, Code.ALIGN_HEADING_GIVEN
    found = Alignment(0.0, np.array([0, 0, 1.1]), np.ones(3), np.zeros(3), np.ones(3), None, *methods)
    np.testing.assert_allclose(error(found, truth), [0, 0, -0.1], atol=1e-12)
    np.testing.assert_allclose(rph_from_quat(quat_from_rph(found.rph)), found.rph)


def test_a_boat_that_swings_and_lists_in_a_long_rest_is_known_to():
    """By 0.2 deg to one side and 9 deg of heading in 20 s, each half way through, beside the mean rate."""
    truth = straight(PLACE, 0.0, 1.0, 600.0)
    imu = corrupt_imu(perfect(truth, 20.0), replace(CAR, gyro=replace(CAR.gyro, bias_instability=np.zeros(3))), 1).imu
    time = imu.time - imu.time[0]
    listed, swung = 0.2 * DEG * (time > 300.0), 9.0 * DEG * np.clip((time - 290.0) / 20.0, 0.0, 1.0)
    c = dcm_from_rph(np.column_stack([listed, np.zeros_like(time), swung]))
    rate = np.einsum("nji,nj->ni", c, imu.gyro)
    rate[:, 2] += np.gradient(swung) / (1.0 if imu.sampling == "increment" else 1.0 / 20.0)
    imu = replace(imu, gyro=rate, accel=np.einsum("nji,nj->ni", c, imu.accel))
    parts = intervals(imu)
    level, heading = np.rad2deg(sway(parts, np.array([[0.0, 590.0]]))[1]).T
    print(f"level {level.max():.3f} deg, heading {heading.max():.2f} deg")
    assert level.shape == (58,)  # windows of ten seconds, from one to the next
    assert level[29] == pytest.approx(0.2, abs=0.01)
    assert np.median(level) < 0.01
    assert heading[[28, 29, 30]] == pytest.approx([2.1, 4.35, 2.1], abs=0.1)  # less 0.15 by the mean rate
    assert np.delete(heading, [28, 29, 30]) == pytest.approx(-0.15, abs=0.1)
    for end in (200.0, 600.0):  # not long, and not left
        assert sway(parts, np.array([[0.0, end]]))[1].size == 0


def test_people_who_board_break_a_long_rest_where_they_do():
    """By 3 deg to one side within two seconds, and 10 deg of heading, which is no bias of the gyros."""
    record = log(straight(PLACE, 0.0, 1.0, 600.0), CAR, 1)
    time = record.imu.time - record.imu.time[0]
    tilt = 3.0 * DEG * np.clip(0.5 * (time - 204.0), 0.0, 1.0)
    c, step = dcm_from_rph(np.column_stack([tilt, 0.0 * tilt, 0.0 * tilt])), np.median(np.diff(time))
    shaken = np.einsum("nji,nj->ni", c, record.imu.gyro)
    turns = np.column_stack([np.gradient(tilt), 0.0 * tilt, 5.0 * DEG * step * ((time > 204.0) & (time < 206.0))])
    shaken += turns / (1.0 if record.imu.sampling == "increment" else step)
    imu = replace(record.imu, gyro=shaken, accel=np.einsum("nji,nj->ni", c, record.imu.accel))
    parts, start = intervals(imu), float(record.imu.time[0])
    rest = stationary_of(parts, record.gps)
    still = still_of(parts, record.gps, rest)
    print("still", (still - start).round(2))
    assert rest[1] - start == pytest.approx(204.0, abs=1.0)
    still[-1, 1] = min(still[-1, 1], start + 598.0)  # as of a vehicle that leaves
    at, changes = sway(parts, still)
    plain = sway(intervals(record.imu), np.array([[start, start + 598.0]]))[0]
    assert np.flatnonzero(np.isnan(changes[:, 0])).tolist() == [19, 20]
    np.testing.assert_allclose(at.rate, plain.rate, atol=3.0 * np.linalg.norm(plain.rate_sd) + 1e-6)
