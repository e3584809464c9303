"""Simulated replicas of tracks: as close as the track is smooth, and doubted where it is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.earth import lla_offset, ned_offset
from insnav.exceptions import InputError
from insnav.findings import Code
from insnav.input import read_reference
from insnav.simulate import Truth, circle, imu_from_truth, reference, straight
from insnav.simulate.truth_from_track import track_residual, truth_from_track
from insnav.types import Trajectory
from tests.refusals import refused
from tests.shared import recorded
from tests.simulate.motions import PLACE, town

SMOOTH = {"velocity_shake": (0.0, 0.0, 0.0), "angle_shake": (0.0, 0.0, 0.0)}
TOWN = town(start=1000.0, **SMOOTH)
UNKNOWN = np.nan


def track_of(truth: Truth, rate: float = 10.0) -> Trajectory:
    time = truth.start + np.arange(round(truth.duration * rate) + 1) / rate
    return reference(truth, time)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(values**2, axis=-1))))


def differences(replica: Truth, original: Truth) -> tuple[float, float, float]:
    """RMS of position [m], velocity [m/s] and attitude [rad], between the rows too."""
    time = original.start + np.arange(1.0, original.duration - 1.0, 0.037)
    a, b = replica.evaluate(time), original.evaluate(time)
    angle = (a.rph - b.rph + np.pi) % (2 * np.pi) - np.pi
    return rms(ned_offset(a.lla, b.lla)), rms(a.v_n - b.v_n), rms(angle)


def test_the_twin_of_a_smooth_track_is_the_motion_itself():
    position, velocity, attitude = differences(truth_from_track(track_of(TOWN)), TOWN)
    print(position, velocity, attitude)
    assert position < 1e-3
    assert velocity < 3e-3
    assert attitude < 2e-3


@pytest.mark.parametrize("motion", [circle(PLACE, 10.0, -0.2, 60.0), straight(PLACE, 20.0, 6.2, 60.0, climb=1.0)])
def test_heading_goes_on_over_north_and_a_twin_is_exact_in_itself(motion):
    replica = truth_from_track(track_of(motion))
    position, velocity, attitude = differences(replica, motion)
    assert position < 1e-3
    assert velocity < 1e-3
    assert attitude < 1e-4
    # what its sensors sum up is the change of its own velocity, whatever the fit is worth
    imu = imu_from_truth(replica, np.array([10.0, 10.01]))
    mean = imu.accel[0] / 0.01
    np.testing.assert_allclose(mean, replica.evaluate(np.array([10.005])).f_b[0], atol=1e-4)


def test_noise_of_a_receiver_is_smoothed_and_its_outliers_lose():
    rng = np.random.default_rng(4)
    track = track_of(TOWN, 5.0)
    noisy = replace(
        track,
        lla=lla_offset(track.lla, 0.02 * rng.standard_normal(track.lla.shape)),
        v_n=track.v_n + 0.03 * rng.standard_normal(track.v_n.shape),
    )
    shift = np.zeros_like(track.lla)
    shift[200:203] = [30.0, 0.0, 0.0]
    jumped = replace(noisy, lla=lla_offset(noisy.lla, shift))
    for each, most in ((noisy, 0.02), (jumped, 0.05)):
        position, velocity, _ = differences(truth_from_track(each), TOWN)
        assert position < most
        assert velocity < 0.08
    residual = track_residual(truth_from_track(jumped), jumped)
    assert residual.farthest == pytest.approx(30.0, abs=0.5)
    assert residual.farthest_time == pytest.approx(track.time[201], abs=0.3)
    far = residual.doubts[0]
    assert far.code is Code.REPLICA_FAR
    assert far["rms_m"] == pytest.approx(2.1, abs=0.1)  # 30 m at three of 601 rows
    assert (far.begin, far["farthest_m"]) == (residual.farthest_time, residual.farthest)
    clean = track_residual(truth_from_track(noisy), noisy)
    (doubt,) = clean.doubts  # a car that turns at more than 1 g, as it does
    assert doubt.code is Code.REPLICA_WILD
    assert doubt["acceleration_m_s2"] == pytest.approx(11.0, abs=0.5)
    assert doubt.begin == pytest.approx(1044.0, abs=0.05)
    hardest = np.linalg.norm(np.gradient(TOWN.evaluate(track.time).v_n, track.time, axis=0), axis=1).max()
    assert clean.acceleration == pytest.approx(hardest, abs=0.5)


def test_without_velocity_and_attitude_the_course_is_the_heading():
    track = track_of(TOWN, 5.0)
    bare = replace(track, v_n=np.full_like(track.v_n, UNKNOWN), rph=np.full_like(track.rph, UNKNOWN))
    replica = truth_from_track(bare)
    at, true = (each.evaluate(1000.0 + np.arange(35.0, 95.0)) for each in (replica, TOWN))
    assert rms(ned_offset(at.lla, true.lla)) < 0.02
    assert rms(at.v_n - true.v_n) < 0.05
    turn = (at.rph[:, 2] - true.rph[:, 2] + np.pi) % (2 * np.pi) - np.pi
    assert np.degrees(np.abs(turn)).max() < 3.0
    assert np.abs(at.rph[:, 0]).max() == pytest.approx(0.0, abs=1e-9)
    climb = np.arctan2(-true.v_n[:, 2], np.hypot(*true.v_n[:, :2].T))
    np.testing.assert_allclose(at.rph[:, 1], climb, atol=0.01)
    assert np.isnan(track_residual(replica, bare).velocity)


def test_a_gap_is_bridged_and_doubted():
    track = track_of(TOWN)
    since = track.time - track.time[0]
    kept = (since < 40.0) | (since > 52.0)
    holed = Trajectory(track.time[kept], track.lla[kept], track.v_n[kept], track.rph[kept])
    replica = truth_from_track(holed)
    residual = track_residual(replica, holed)
    assert residual.gap == pytest.approx(12.2)
    assert residual.gap_time == pytest.approx(1039.9)
    assert residual.doubts[-1].code is Code.REPLICA_GAP
    assert residual.doubts[-1]["gap_s"] == residual.gap
    assert (residual.doubts[-1].begin, residual.doubts[-1].end) == pytest.approx((1039.9, 1052.1))
    # it swings no farther than the rows on either side
    inside = replica.evaluate(1040.0 + np.arange(0.0, 12.0, 0.1))
    for values, rows in ((inside.lla, holed.lla), (inside.rph[:, :2], holed.rph[:, :2])):
        edges = rows[[np.sum(since < 40.0) - 1, np.sum(since < 40.0)]]
        room = 1e-3 * np.ptp(values, axis=0) + [1e-9, 1e-9, 1e-3][: values.shape[1]]
        assert np.all(values >= edges.min(axis=0) - 0.05 * np.ptp(edges, axis=0) - room)
        assert np.all(values <= edges.max(axis=0) + 0.05 * np.ptp(edges, axis=0) + room)


def test_a_track_over_the_date_line_has_a_twin():
    motion = straight(np.array([0.5, np.pi - 1e-5, 10.0]), 20.0, np.pi / 2, 60.0)
    track = track_of(motion)
    assert np.ptp(track.lla[:, 1]) > 6.0
    assert differences(truth_from_track(track), motion)[0] < 1e-3


def test_what_has_no_twin_is_refused():
    track = track_of(TOWN)
    few = Trajectory(*(getattr(track, name)[:10] for name in ("time", "lla", "v_n", "rph")))
    with refused(InputError, "sim.short_track"):
        truth_from_track(few)
    with refused(InputError, "sim.track_near_pole"):
        truth_from_track(track_of(straight(np.array([1.55, 0.0, 0.0]), 10.0, 0.0, 10.0)))
    with refused(InputError, "sim.steep_track"):
        truth_from_track(track_of(straight(PLACE, 10.0, 0.0, 10.0, pitch=1.45)))


def test_the_twin_of_a_recorded_drive_says_where_the_track_is_poor():
    track = read_reference(recorded("ixr_tsukishima_20210412") / "ref.csv").data
    replica = truth_from_track(track)
    residual = track_residual(replica, track)
    print(residual)
    assert residual.position == pytest.approx(2.3, abs=0.2)  # jumps of the receiver between houses
    assert residual.gap == pytest.approx(15.6, abs=0.01)
    assert len(residual.doubts) == 3
    time = replica.start + np.arange(0.0, replica.duration, 0.1)
    at = replica.evaluate(time)
    assert np.degrees(np.abs(at.rph[:, 1])).max() < 60.0
    off = np.linalg.norm(ned_offset(track.lla, replica.evaluate(track.time).lla), axis=1)
    assert np.median(off) < 0.1
