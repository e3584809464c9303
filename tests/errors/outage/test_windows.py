"""Windows start as the filter was, use nothing inside, and are what free inertial navigation makes of the samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav import strapdown
from insnav.attitude import dcm_from_rph, quat_from_rph, rph_from_quat
from insnav.earth import lla_offset, ned_offset
from insnav.errors.outage.free_inertial import (
    WindowReference,
    Windows,
    forward_start,
    free_window_starts,
    free_windows,
    growth_by_start_error,
    is_stationary,
    navigated_drive,
    reference_from_fixes,
    reference_from_trajectory,
    remove_aiding,
    stationary_fixes,
    uncalibrated_start,
)
from insnav.errors.outage.gnss_outage import COMPONENTS, components, growth, outages, table_times
from insnav.exceptions import ConfigError, InputError
from insnav.simulate import reference
from insnav.types import ImuData, Trajectory
from insnav.units import DEG
from tests.errors.outage import drives

LENGTH = 30.0


@pytest.fixture(scope="module")
def drive():
    ready = drives.injected()
    return navigated_drive(ready, free_window_starts(ready, LENGTH, spacing=25.0))


@pytest.fixture(scope="module")
def both(drive) -> tuple[Windows, Windows]:
    against = reference_from_fixes(drive.ready)
    return tuple(free_windows(drive, against, LENGTH, 25.0, uncalibrated=raw) for raw in (False, True))


def test_a_raw_window_is_free_inertial_navigation_of_the_samples(drive, both):
    # another integrator loop than that of the filter, fed with the samples as they are
    ready, (_, raw) = drive.ready, both
    for number in (1, 6):
        state = drive.states[number]
        imu = ready.imu
        chosen = (imu.time > state.time - 1.0) & (imu.time <= state.time + LENGTH + 1.0)
        parts = strapdown.intervals(ImuData(imu.time[chosen], imu.gyro[chosen], imu.accel[chosen], imu.sampling))
        first = int(np.searchsorted(parts.end, state.time + 1e-6))
        inc = strapdown.increments(parts)
        inc = replace(inc, **{n: getattr(inc, n)[first:] for n in inc.__slots__})
        track = strapdown.navigate(inc, state.x[:3], state.x[3:6], rph_from_quat(state.x[6:]))
        at = int(np.searchsorted(track.time, state.time + LENGTH - 1e-6))
        fix = int(np.searchsorted(ready.gps.time, state.time + LENGTH - 1e-6))
        expected = ned_offset(track.lla[at], ready.gps.lla[fix])
        np.testing.assert_allclose(raw.error[number, -1, :3], expected, atol=1e-4)
        np.testing.assert_allclose(raw.error[number, -1, 3:], track.v_n[at] - ready.gps.v_n[fix], atol=1e-5)


def test_a_calibrated_window_is_an_outage(drive, both):
    windows, _ = both
    ready = drive.ready
    begin = windows.start[2] - ready.initial.time
    (one,) = outages(ready, lengths=[LENGTH], first=begin, spacing=1e4)
    np.testing.assert_allclose(one.error[-1], windows.error[2, -1], atol=1e-9)
    np.testing.assert_allclose(one.sd[-1], np.sqrt(np.diag(windows.covariance[2, -1])), rtol=1e-6)


def test_fixes_inside_a_window_change_nothing(drive, both):
    ready, (windows, _) = drive.ready, both
    number = 3
    begin = windows.start[number]
    wild = (ready.gps.time > begin) & (ready.gps.time <= begin + LENGTH)
    lla = np.where(wild[:, None], lla_offset(ready.gps.lla, np.full((len(wild), 3), 4.0)), ready.gps.lla)
    spoilt = replace(ready, gps=replace(ready.gps, lla=lla))
    again = navigated_drive(spoilt, windows.start[: number + 1])
    found = free_windows(again, reference_from_fixes(ready), LENGTH, 25.0)
    np.testing.assert_array_equal(found.error[number], windows.error[number])


def test_errors_are_as_large_as_predicted(both):
    for windows in both:
        error, variance, against = components(windows)
        ratio = error[:, :, :2] ** 2 / (variance + against)[:, :, :2]
        print(f"raw {windows.uncalibrated}: mean square by prediction {ratio.mean():.2f}")
        assert 0.3 < ratio.mean() < 2.5
    calibrated, raw = (growth(w) for w in both)
    assert raw.predicted[-1, 0] > 5.0 * calibrated.predicted[-1, 0]
    assert raw.rms[-1, 5] > 5.0 * calibrated.rms[-1, 5]


def test_turning_on_keeps_how_errors_go_together():
    ready = drives.injected()
    state = navigated_drive(ready, free_window_starts(ready, LENGTH, spacing=200.0)).states[0]
    first = forward_start(state, remove_aiding(ready, own_fixes=True).receiver, None)
    raw = uncalibrated_start(first, ready.model)
    np.testing.assert_array_equal(raw.covariance[:9], first.covariance[:9])
    np.testing.assert_allclose(np.diag(raw.covariance)[9:21], ready.model.sd**2, rtol=1e-12)
    assert np.linalg.eigvalsh(raw.covariance[:15, :15]).min() > 0.0
    np.testing.assert_array_equal(raw.correction, 0.0)
    np.testing.assert_array_equal(raw.x, first.x)


def test_first_errors_show_as_the_formulas_say():
    rph, lla = np.array([0.02, -0.03, 1.1]), drives.PLACE
    shows = growth_by_start_error(quat_from_rph(rph), lla)
    gravity, c = 9.806, dcm_from_rph(rph)
    # an accelerometer bias taken off too much pushes the other way; a tilt about East pushes North
    np.testing.assert_allclose(shows[0, 1, 12:15], -c[0])
    assert shows[0, 1, 7] == pytest.approx(gravity, abs=0.02)
    assert shows[1, 1, 6] == pytest.approx(-gravity, abs=0.02)
    np.testing.assert_allclose(shows[1, 2, 9:12], -shows[0, 1, 7] * c[0])


def test_motion_is_told(both):
    windows, _ = both
    truth = reference(drives.motion(), np.arange(0.0, drives.motion().duration, 0.5))
    for start, kind in zip(windows.start, windows.motion, strict=True):
        inside = (truth.time >= start) & (truth.time <= start + LENGTH)
        turned = np.ptp(np.unwrap(truth.rph[inside, 2]))
        assert kind == ("turning" if turned > 15.0 * DEG else "straight")
    assert {"straight", "turning"} <= set(windows.motion)


def test_along_and_cross_turn_with_the_course(both):
    windows, _ = both
    error, variance, _ = components(windows)
    north, east, along, cross = (error[:, :, COMPONENTS.index(n)] for n in ("north", "east", "along", "cross"))
    np.testing.assert_allclose(along**2 + cross**2, north**2 + east**2, rtol=1e-9)
    np.testing.assert_allclose(variance[..., 3] + variance[..., 4], variance[..., 5], rtol=1e-9)
    course = np.unwrap(windows.course, axis=1)
    truth = reference(drives.motion(), windows.start + LENGTH)
    moving = np.linalg.norm(truth.v_n[:, :2], axis=1) > 2.0
    apart = np.angle(np.exp(1j * (course[:, -1] - np.arctan2(truth.v_n[:, 1], truth.v_n[:, 0]))))
    assert np.abs(apart[moving]).max() < 0.05


def test_windows_touching_a_hole_are_left_out_and_counted(drive):
    ready, whole = drive.ready, reference_from_fixes(drive.ready)
    gps = whole.fixes
    hole = (gps.time > 150.0) & (gps.time < 175.0)
    torn = WindowReference(
        gps.rows(~hole),
        "torn",
    )
    windows = free_windows(drive, torn, LENGTH, 25.0)
    assert windows.dropped == {"reference_gap": len(drive.states) - windows.count}
    assert 1 <= windows.dropped["reference_gap"] <= 4
    assert not ((windows.start < 175.0) & (windows.start + LENGTH > 151.0)).any()
    keep = ~((ready.imu.time > 200.0) & (ready.imu.time < 200.5))
    imu = ready.imu.rows(keep)
    broken = free_windows(replace(drive, ready=replace(ready, imu=imu)), whole, LENGTH, 25.0)
    assert set(broken.dropped) == {"imu_gap"}


def test_a_short_gap_of_the_reference_leaves_the_window_and_its_other_times(drive):
    gps = reference_from_fixes(drive.ready).fixes
    start = navigated_drive(drive.ready, free_window_starts(drive.ready, LENGTH, spacing=25.0)).states[2].time
    gone = (gps.time > start + 8.5) & (gps.time < start + 12.5)
    few = gps.rows(~gone)
    windows = free_windows(drive, WindowReference(few, "few"), LENGTH, 25.0)
    row = int(np.argmin(np.abs(windows.start - start)))
    assert np.isnan(windows.error[row, 9, 0])
    assert np.isfinite(windows.error[row, 19, 0])
    assert growth(windows).known[0, 5] == windows.count - 1
    assert np.isfinite(growth(windows).rms).all()


def test_reference_variance_is_subtracted(drive):
    truth = reference(drives.motion(), drive.ready.gps.time)
    exact = reference_from_trajectory(truth, "truth", position_sd=1e-3, velocity_sd=1e-3)
    by_truth = growth(free_windows(drive, exact, LENGTH, 25.0))
    rng = np.random.default_rng(0)
    noisy = replace(truth, lla=lla_offset(truth.lla, 0.5 * rng.standard_normal(truth.lla.shape)))
    by_noise = growth(
        free_windows(drive, reference_from_trajectory(noisy, "noisy", position_sd=0.5, velocity_sd=1e-3), LENGTH, 25.0)
    )
    print(by_truth.corrected[:, 5], by_noise.corrected[:, 5], by_noise.rms[:, 5])
    assert by_noise.rms[0, 5] > 2.0 * by_truth.corrected[0, 5]
    # 0.5 m of noise on either axis leave little of a smaller error, or nothing
    left = by_noise.corrected[0, 5]
    assert by_noise.below_noise[0, 5] or abs(left - by_truth.corrected[0, 5]) < 0.35 * by_noise.rms[0, 5]
    assert by_noise.corrected[-1, 5] == pytest.approx(by_truth.corrected[-1, 5], rel=0.1)
    assert by_noise.low[-1, 5] < by_truth.corrected[-1, 5] < by_noise.high[-1, 5]


@pytest.mark.parametrize("length", [5.0, 301.0, np.nan])
def test_lengths_have_limits(length: float):
    with pytest.raises(ConfigError, match=r"budget.window_length"):
        free_window_starts(drives.injected(), length)


def test_a_window_longer_than_the_drive_is_refused():
    ready = drives.injected()
    short = replace(
        ready,
        imu=ImuData(*(v[: int(90 * drives.RATE)] for v in (ready.imu.time, ready.imu.gyro, ready.imu.accel)), "mean"),
    )
    with pytest.raises(InputError, match=r"outage.drive_too_short"):
        free_window_starts(short, 120.0)
    assert len(free_window_starts(short, 60.0)) >= 1  # but the first minute is given up for a window that fits


def test_no_reference_is_an_error(drive):
    gps = reference_from_fixes(drive.ready).fixes
    early = gps.time < 40.0
    few = gps.rows(early)
    with pytest.raises(InputError, match=r"budget.no_window"):
        free_windows(drive, WindowReference(few, "few"), LENGTH, 25.0)


def test_times_of_the_tables(both):
    windows, _ = both
    np.testing.assert_array_equal(table_times(windows), [10.0, 20.0, 30.0])
    np.testing.assert_array_equal(table_times(replace(windows, length=300.0)), np.arange(50.0, 301.0, 50.0))


def test_a_bench_that_never_moves():
    lla = np.array([0.6, 1.9, 380.0])
    twice = Trajectory(np.array([0.0, 1000.0]), np.tile(lla, (2, 1)), np.zeros((2, 3)), np.full((2, 3), np.nan))
    assert is_stationary(twice, 0.0, 1001.0)
    assert not is_stationary(twice, 0.0, 3000.0)
    assert not is_stationary(replace(twice, lla=np.stack([lla, lla + 1e-6])), 0.0, 1000.0)
    fixes = stationary_fixes(lla, 10.0, 20.0, 0.01, 0.005)
    assert len(fixes.time) == 11
    np.testing.assert_array_equal(fixes.position_sd, 0.01)
