"""Non-holonomic constraint and ZUPT aid where fixes are missing, and only where the data support them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insnav
from insnav.alignment.in_motion import Velocity, velocity
from insnav.attitude import dcm_from_rph, quat_from_rotvec, quat_from_rph, quat_multiply, wrap_pi
from insnav.earth import lla_offset, ned_offset
from insnav.filter.gps_noise import CorrelatedNoise
from insnav.filter.measurements import measurements_from_drive
from insnav.filter.measurements.measurement import FirstPass, Measurement
from insnav.filter.measurements.sensors import NonHolonomic, ZeroVelocity, find_stops
from insnav.filter.navigate import aided, feed, navigate_recording
from insnav.filter.navigator import Navigator
from insnav.filter.prepare import GivenStart, Start
from insnav.filter.receiver import DELAY_SD, LeverArm, Receiver
from insnav.findings import CONTRADICTIONS, Code, of_code
from insnav.kernels import measurements as kernel
from insnav.kernels.errorstate import STATES
from insnav.simulate import GpsErrors, Truth, reference, without_fixes
from insnav.types import GpsData, ImuData
from insnav.units import DEG
from tests.filter import drives
from tests.simulate.motions import Segment, drive, measured

ROLL, PITCH, YAW = 0.02, -0.03, 0.0  # of the IMU in the car of `drives`


def state(rng: np.random.Generator) -> np.ndarray:
    rph = np.array([0.2, -0.1, 2.0])
    return np.concatenate([[0.8, 0.1, 200.0], 10.0 * rng.standard_normal(3), quat_from_rph(rph)])


def moved(x: np.ndarray, error: np.ndarray) -> np.ndarray:
    """State with a small error put on: estimate = truth + error, C_hat = (I - [phi x]) C."""
    y = x.copy()
    y[3:6] += error[3:6]
    y[6:] = quat_multiply(quat_from_rotvec(-error[6:9]), x[6:])
    return y


def test_derivatives_of_the_vehicle_velocity_are_those_of_differences():
    rng = np.random.default_rng(1)
    x, rate, lever = state(rng), rng.standard_normal(3), np.array([-1.2, 0.1, 0.4])
    to_vehicle = dcm_from_rph(np.array([0.05, 0.1, -0.2]))
    z, h = np.empty(6), np.empty((6, STATES))
    kernel.vehicle_velocity(x, rate, to_vehicle, lever, 3.0, z, h)
    truth, unused = z.copy(), np.empty((6, STATES))
    for j in range(3, 12):
        error = np.zeros(STATES)
        error[j] = 1e-6
        # the rate is measured minus the estimated bias
        kernel.vehicle_velocity(moved(x, error), rate - error[9:12], to_vehicle, lever, 3.0, z, unused)
        np.testing.assert_allclose((z[:3] - truth[:3]) / 1e-6, h[:3, j], atol=1e-4)


def test_derivatives_of_zero_velocity_are_those_of_differences():
    rng = np.random.default_rng(2)
    x, bias, rate = state(rng), 0.01 * rng.standard_normal(3), 0.01 * rng.standard_normal(3)
    z, h = np.empty(6), np.empty((6, STATES))
    kernel.zero_velocity(x, bias, rate, z, h)
    truth, unused = z.copy(), np.empty((6, STATES))
    for j in range(3, 12):
        error = np.zeros(STATES)
        error[j] = 1e-3
        kernel.zero_velocity(moved(x, error), bias + error[9:12], rate, z, unused)
        np.testing.assert_allclose((z - truth) / 1e-3, h[:, j], atol=1e-7)


def test_nis_is_that_of_the_matrix_formula():
    rng = np.random.default_rng(3)
    a = rng.standard_normal((STATES, STATES))
    p, h, z = a @ a.T, rng.standard_normal((6, STATES)), rng.standard_normal(6)
    r = rng.uniform(0.5, 2.0, 6)
    s = np.empty((2, 2))
    nis = kernel.innovation(p, z, h, r, 1, 3, s)
    expected = h[1:3] @ p @ h[1:3].T + np.diag(r[1:3])
    np.testing.assert_allclose(s, expected)
    assert nis == pytest.approx(z[1:3] @ np.linalg.inv(expected) @ z[1:3])


def recording(seed: int, gps=None):
    rng = np.random.default_rng([31, seed])
    imu = drives.noisy_imu(drives.perfect_imu(), drives.MODEL, rng)
    return imu, drives.noisy_gps(drives.perfect_gps() if gps is None else gps, rng), drives.begin(drives.MODEL, rng)


def run(imu, gps, start, aiding=None, **settings):
    return drives.navigate(imu, gps, start, drives.MODEL, **{"aiding": aiding, "output_interval": 0.1, **settings})


def first_pass(seed: int, gps=None):
    imu, fixes, start = recording(seed, gps)
    first = run(imu, fixes, start)
    return imu, fixes, start, FirstPass(first.smoothed.solution, imu, fixes, drives.SPEC), first


def kind(first: FirstPass, name: str) -> Measurement | None:
    return next((each for each in measurements_from_drive(first)[0] if each.name == name), None)


def zupt(stretches, rate_sd) -> tuple[Measurement, ...]:
    return (ZeroVelocity(stretches, np.array([0.02, 0.02, 0.02, *rate_sd])),)


def test_mounting_angles_are_found_within_a_tenth_of_a_degree():
    for seed in range(5):
        found = first_pass(seed)[3]
        # the car moves along its own forward axis: seen from the IMU, which is rolled and pitched in it
        ahead = dcm_from_rph(np.array([ROLL, PITCH, YAW])).T @ [1.0, 0.0, 0.0]
        expected = np.array([np.arctan2(-ahead[2], ahead[0]), np.arctan2(ahead[1], ahead[0])])
        error = found.mounting.angles - expected
        print(f"mounting {found.mounting.angles / DEG}, error {error / DEG}, sd {found.mounting.sd / DEG} deg")
        assert np.abs(error).max() < 0.1 * DEG
        assert np.all(np.abs(error) < 3.0 * found.mounting.sd)


def test_heading_by_nhc_is_no_surer_than_straight_ahead_is_known():
    """What is taken for straight ahead is off by the mean heading of the pass it was found in: alike in all of a drive.

    So one drive tells one number, and the four of them that are far off, of eight, are taken together.
    """
    squares = []
    for seed in (1, 3, 5, 6):
        drive = insnav.simulate("motorway", imu="tactical", seed=seed)
        run, true = drive.navigate(aiding="on", output_interval=1.0).found.run, drive.reference.data
        smoothed = run.smoothed.solution.rows(slice(60, -1))
        error = wrap_pi(smoothed.rph[:, 2] - np.interp(smoothed.time, true.time, np.unwrap(true.rph[:, 2])))
        assert {use.name for use in run.aiding} >= {"nhc"}
        squares.append(np.mean((error / smoothed.sd[:, 8]) ** 2))
    assert 0.1 < np.mean(squares) < 1.25


def test_nhc_and_zupt_reduce_the_drift_and_know_it():
    motion = drives.truth()
    begin, length = motion.start + 180.0, 30.0
    plain, helped, inside = [], [], []
    for seed in range(8):
        imu, fixes, start, found, first = first_pass(seed, without_fixes(drives.perfect_gps(), begin, begin + length))
        assert kind(found, "nhc") is not None
        second = run(imu, fixes, start, measurements_from_drive(found)[0])
        for kept, each in ((plain, first), (helped, second)):
            row = int(np.searchsorted(each.solution.time, begin + length - 1e-3))
            error = ned_offset(each.solution.lla[row], reference(motion, each.solution.time[row : row + 1]).lla[0])
            kept.append(float(np.hypot(error[0], error[1])))
        inside.append(np.abs(error[:2]) < 3.0 * second.solution.sd[row, :2])
        assert {use.name for use in second.aiding} >= {"nhc"}
    print("after 30 s without fixes:", np.round(plain, 2), "with NHC:", np.round(helped, 2))
    assert np.sqrt(np.mean(np.square(helped))) < 0.5 * np.sqrt(np.mean(np.square(plain)))
    assert np.mean(inside) >= 0.9


def test_a_vehicle_that_drifts_sideways_has_no_non_holonomic_constraint():
    imu, fixes, start = recording(0)
    first = run(imu, fixes, start)
    solution = first.smoothed.solution
    wind = 1.0 * np.sin(0.05 * (solution.time - solution.time[0]))
    adrift = replace(solution, v_n=solution.v_n + np.column_stack([wind, wind, 0.0 * wind]))
    found, notes = measurements_from_drive(FirstPass(adrift, imu, fixes, drives.SPEC))
    assert "nhc" not in {each.name for each in found}
    assert Code.NHC_LATERAL in {note.code for note in notes}


def test_a_skid_is_rejected_by_name():
    imu, fixes, start, found, _ = first_pass(1)
    nhc = kind(found, "nhc")
    assert isinstance(nhc, NonHolonomic)
    askew = replace(nhc, to_vehicle=dcm_from_rph(np.array([0.0, 0.0, 20 * DEG])) @ nhc.to_vehicle)
    second = run(imu, fixes, start, (askew,))
    (use,) = second.aiding
    assert use.rejected > 0.3 * use.processed
    assert any(event.subject == "nhc" for event in of_code(second.events, Code.GATE_AIDING))


def test_stops_are_those_of_the_drive():
    imu, fixes, _ = recording(2)
    stretches, rate_sd, note = find_stops(imu, velocity(fixes), drives.SPEC)
    print(note)
    motion = drives.truth()
    middle = 0.5 * stretches.sum(axis=1)
    speed = np.linalg.norm(motion.evaluate(middle).v_n, axis=1)
    assert stretches.shape[0] >= 3
    assert speed.max() < 0.05
    assert np.isfinite(rate_sd).all()


def test_stops_are_the_same_in_increments_and_in_rates():
    imu, fixes, _ = recording(2)
    step = np.median(np.diff(imu.time))
    assert imu.sampling == "increment"
    rates = replace(imu, gyro=imu.gyro / step, accel=imu.accel / step, sampling="rate")
    (stops, sd, _), (same, same_sd, _) = (find_stops(each, velocity(fixes), drives.SPEC) for each in (imu, rates))
    np.testing.assert_array_equal(same, stops)
    np.testing.assert_allclose(same_sd, sd, rtol=1e-6)


def test_what_stops_softly_is_no_stop_before_it_stands():
    """Speed dies away by e in 1.2 s, without vibration below a metre a second; with it stops began at 0.8 m/s."""
    rng, step, lap = np.random.default_rng(4), 0.01, 90.0
    time = np.arange(step, 4 * lap, step)
    into = time % lap
    speed = 12.0 * np.where(into < 30.0, 1.0, np.exp((30.0 - into) / 1.2) + np.exp((into - 60.0) / 1.2))
    speed = np.minimum(speed, 12.0)
    shaken = rng.normal(size=(time.size, 6)) * np.repeat([0.3, 0.01], 3) * (speed > 1.0)[:, None]
    noise = rng.normal(size=(time.size, 6)) * np.repeat([0.01, 0.001], 3)
    force = np.column_stack([np.gradient(speed, step), np.zeros(time.size), np.full(time.size, -9.8)])
    imu = ImuData(time, (shaken + noise)[:, 3:], force + (shaken + noise)[:, :3])
    seen = np.arange(1.0, time[-1])
    v_n = np.column_stack([np.interp(seen, time, speed), np.zeros((seen.size, 2))])
    stops, _, note = find_stops(imu, Velocity(seen, v_n, np.full(seen.size, 0.05)), drives.SPEC)
    print(note)
    inside = np.any((time[:, None] > stops[:, 0]) & (time[:, None] <= stops[:, 1]), axis=1)
    assert speed[inside].max() < 0.1
    assert inside.sum() * step > 0.7 * (speed < 0.05).sum() * step


def test_zupt_holds_the_velocity_and_finds_the_gyro_bias():
    imu, fixes, start = recording(3)
    stretches, rate_sd, _ = find_stops(imu, velocity(fixes), drives.SPEC)
    wide = replace(fixes, velocity_sd=10.0 * fixes.velocity_sd, position_sd=10.0 * fixes.position_sd)
    plain, helped = run(imu, wide, start), run(imu, wide, start, zupt(stretches, rate_sd))
    last = stretches[-1]
    for each in (plain, helped):
        rows = (each.solution.time > last[0] + 1.0) & (each.solution.time < last[1])
        print(np.abs(each.solution.v_n[rows]).max(), each.sensor_errors.sd[-1, :3])
    assert np.abs(helped.solution.v_n[rows]).max() < 0.05
    assert np.all(helped.sensor_errors.sd[-1, :3] < plain.sensor_errors.sd[-1, :3])


def test_aiding_changes_nothing_in_the_result_for_other_block_sizes():
    imu, fixes, start, found, _ = first_pass(4)
    whole = run(imu, fixes, start, measurements_from_drive(found)[0])
    parts = run(imu, fixes, start, measurements_from_drive(found)[0], blocks=777)
    np.testing.assert_allclose(whole.solution.lla, parts.solution.lla, rtol=0, atol=1e-15)


def test_the_lever_arm_of_the_axle_shows_only_in_turns():
    x = np.concatenate([[0.8, 0.1, 200.0, 10.0, 0.0, 0.0], quat_from_rph(np.zeros(3))])
    z, h = np.empty(6), np.empty((6, STATES))
    axle = np.array([-1.5, 0.0, 0.0])
    kernel.vehicle_velocity(x, np.zeros(3), np.eye(3), axle, np.nan, z, h)
    assert z[1] == 0.0
    kernel.vehicle_velocity(x, np.array([0.0, 0.0, 0.2]), np.eye(3), axle, np.nan, z, h)
    assert z[1] == pytest.approx(-0.3)


def test_position_error_moves_with_the_fixes_after_all():
    """Aiding has not cut the filter off from its fixes: a step of all of them is followed."""
    imu, fixes, start, found, _ = first_pass(5)
    late = fixes.time > drives.truth().start + 150.0
    lla = fixes.lla.copy()
    lla[late] = lla_offset(lla[late], np.array([0.8, 0.0, 0.0]))
    a, b = (run(imu, replace(fixes, lla=each), start, measurements_from_drive(found)[0]) for each in (fixes.lla, lla))
    moved_by = ned_offset(b.solution.lla[-200:], a.solution.lla[-200:])
    assert moved_by[:, 0] == pytest.approx(0.8, abs=0.15)


def test_a_lever_arm_of_a_metre_and_a_half_is_found():
    """Within 0.1 m on a drive with turns, told nothing of it; with its true uncertainty."""
    errors, sds = [], []
    for seed in range(6):
        imu, fixes, start = recording(seed)
        unaware = run(imu, fixes, start, lever_b=np.array([0.0, 0.0, 0.0]), lever_sd=2.0)
        errors.append(unaware.lever_b - drives.LEVER_B)
        sds.append(unaware.lever_sd)
    print("lever arm errors:", np.round(errors, 3), "sd", np.round(sds, 3))
    horizontal = np.array(errors)[:, :2]
    assert np.sqrt(np.mean(horizontal**2)) < 0.1
    assert np.all(np.abs(errors) < 4.0 * np.array(sds))


def test_a_lever_arm_is_a_third_set_of_states_beside_the_others():
    imu, fixes, start = recording(1)
    lasting = CorrelatedNoise(share=0.2, time=60.0, sd=np.array([0.2, 0.2, 0.4]))
    found = run(imu, fixes, start, lever_b=np.zeros(3), lever_sd=2.0, delay_sd=0.05, correlated=lasting)
    assert np.abs(found.lever_b - drives.LEVER_B)[:2].max() < 0.3
    assert abs(found.gps_delay) < 4.0 * found.gps_delay_sd


@pytest.mark.parametrize("late", [0.1, 0.3])
def test_a_delay_of_the_fixes_is_found_within_twenty_milliseconds(late):
    for seed in range(3):
        imu, fixes, start = recording(seed)
        stamped = replace(fixes, time=fixes.time + late)
        found = run(imu, stamped, start, delay_sd=DELAY_SD)
        print(f"delay {found.gps_delay:.4f} ± {found.gps_delay_sd:.4f} s, {late} s in truth")
        assert found.gps_delay == pytest.approx(late, abs=0.02)


def test_derivatives_of_the_heading_are_those_of_differences():
    rng = np.random.default_rng(4)
    x = state(rng)
    z, h = np.empty(6), np.empty((6, STATES))
    kernel.body_heading(x, 1.9, z, h)
    truth, unused = z[0], np.empty((6, STATES))
    assert truth == pytest.approx(0.1)
    for j in range(6, 9):
        error = np.zeros(STATES)
        error[j] = 1e-6
        kernel.body_heading(moved(x, error), 1.9, z, unused)
        assert (z[0] - truth) / 1e-6 == pytest.approx(h[0, j], abs=1e-4)
    kernel.body_heading(x, 1.9 + 2.0 * np.pi, z, h)
    assert z[0] == pytest.approx(0.1)


def test_a_heading_of_two_antennas_is_followed():
    imu, fixes, start = recording(6)
    rng = np.random.default_rng(9)
    true = reference(drives.truth(), fixes.time).rph[:, 2]
    sd = 0.2 * DEG
    with_heading = replace(fixes, heading=(true + sd * rng.standard_normal(true.shape)) % (2.0 * np.pi))
    plain, helped = run(imu, with_heading, start), run(imu, with_heading, start, heading_sd=sd)
    errors = []
    for each in (plain, helped):
        phi = drives.attitude_error(each.epochs.q_nb, reference(drives.truth(), each.epochs.time).rph)
        errors.append(np.sqrt(np.mean(phi[5:, 2] ** 2)))
    assert errors[1] < 0.5 * errors[0]
    (use,) = helped.aiding
    assert use.name == "heading"
    assert use.nis == pytest.approx(1.0, abs=0.3)
    assert use.rejected == 0


def test_a_barometer_holds_the_height_without_fixes():
    motion = drives.truth()
    begin = motion.start + 150.0
    imu, fixes, start = recording(7, without_fixes(drives.perfect_gps(), begin, begin + 60.0))
    height = reference(motion, imu.time).lla[:, 2]
    rng = np.random.default_rng(2)
    imu = replace(imu, baro=height - 37.0 + 0.2 * rng.standard_normal(height.shape))
    first = run(imu, fixes, start)
    height_aiding = kind(FirstPass(first.smoothed.solution, imu, fixes, drives.SPEC), "height")
    assert height_aiding is not None
    second = run(imu, fixes, start, (height_aiding,))
    row = int(np.searchsorted(first.solution.time, begin + 59.0))
    true = reference(motion, first.solution.time[row : row + 1]).lla[0, 2]
    errors = [abs(each.solution.lla[row, 2] - true) for each in (first, second)]
    print("height error after 59 s:", errors, "sd", second.solution.sd[row, 2])
    assert errors[1] < max(0.3 * errors[0], 0.5)
    assert errors[1] < 4.0 * second.solution.sd[row, 2]


def test_rows_at_the_epochs_hold_what_came_of_them():
    """Where fix and rest are used at the same time, too: the smoother counts on it."""
    _, fixes, start = recording(3)
    imu = drives.perfect_imu(100.0)  # rest is used four times a second: at every fix, too
    stretches, rate_sd, _ = find_stops(imu, velocity(fixes), drives.SPEC)
    ready = drives.ready(imu, fixes, start, nominal=0.01, aiding=zupt(stretches, rate_sd))
    every = range(fixes.time.shape[0])
    navigator = Navigator(ready, marks=every)
    navigator.feed(imu)
    solution = navigator.finish().solution
    kept = list(navigator.kept.values())
    rows = np.searchsorted(solution.time, [state.time - 1e-6 for state in kept])
    assert len(kept) > 200
    np.testing.assert_allclose(solution.time[rows], [state.time for state in kept], rtol=0, atol=1e-6)
    np.testing.assert_array_equal(solution.v_n[rows], [state.x[3:6] for state in kept])
    np.testing.assert_array_equal(solution.lla[rows], [state.x[:3] for state in kept])


@pytest.mark.parametrize(("late", "given"), [(0.0, 0.0), (0.3, 0.0), (-0.2, 0.0), (2.0, 2.0)])
def test_aiding_is_calibrated_in_the_time_of_the_samples(late, given):
    """However late the fixes are: an odometer stamped like the samples has no lag, and the axle is where the IMU is."""
    motion = drives.truth(laps=0)
    rng = np.random.default_rng(12)
    imu = drives.noisy_imu(drives.perfect_imu(laps=0), drives.MODEL, rng)
    inside = np.minimum(imu.time, motion.start + motion.duration - 0.05)
    imu = replace(imu, odometer=np.linalg.norm(reference(motion, inside).v_n, axis=1))
    fixes = drives.noisy_gps(drives.perfect_gps(laps=0), rng)
    start = drives.begin(drives.MODEL, rng, laps=0)
    ready = drives.ready(imu, replace(fixes, time=fixes.time + late), start, delay=given, delay_sd=DELAY_SD)
    done = aided(ready, drives.SPEC)
    found = {each.name: each for each in done.aiding.measurements}
    assert np.abs(found["odometer"].time - imu.time).max() < 0.03
    assert np.linalg.norm(found["nhc"].lever_b) < 0.1
    stops, _, _ = find_stops(imu, velocity(fixes), drives.SPEC)
    np.testing.assert_allclose(found["zupt"].stops, stops, rtol=0, atol=0.6)
    run = Navigator(done)
    feed(run, imu)
    (use,) = [each for each in run.finish().aiding if each.name == "odometer"]
    assert use.innovation_rms < 0.15
    assert use.rejected < 0.01 * use.processed


def test_every_solution_is_in_the_time_of_the_fixes():
    """Also its first rows, from when the filter did not know yet how late the fixes are."""
    late = 0.3
    motion = drives.truth()
    imu, fixes, start = recording(2)
    found = run(imu, replace(fixes, time=fixes.time + late), start, delay_sd=DELAY_SD)
    for name, time, lla in (
        ("filtered", found.solution.time, found.solution.lla),
        ("smoothed", found.smoothed.solution.time, found.smoothed.solution.lla),
        ("epochs", found.epochs.time, found.epochs.lla),
        ("smoothed epochs", found.smoothed.epochs.time, found.smoothed.epochs.lla),
    ):
        inside = (time - late > motion.start + 0.5) & (time - late < motion.start + motion.duration)
        error = np.linalg.norm(ned_offset(lla[inside], reference(motion, time[inside] - late).lla)[:, :2], axis=1)
        early = time[inside] < motion.start + 15.0
        print(name, "RMS", np.sqrt(np.mean(error**2)), "at first", np.sqrt(np.mean(error[early] ** 2)))
        assert np.sqrt(np.mean(error**2)) < 0.5
        assert np.sqrt(np.mean(error[early] ** 2)) < 1.0
    np.testing.assert_array_equal(found.sensor_errors.time, found.epochs.time)
    np.testing.assert_array_equal(found.smoothed.sensor_errors.time, found.smoothed.epochs.time)


def test_velocities_that_lag_are_expected_where_they_were():
    motion, lag = drives.truth(), 0.2
    rng = np.random.default_rng(8)
    imu = drives.noisy_imu(drives.perfect_imu(), drives.MODEL, rng)
    perfect = drives.perfect_gps()
    perfect = perfect.rows(perfect.time > motion.start + 1.0)
    behind = reference(motion, perfect.time - lag)
    shifted = replace(perfect, v_n=perfect.v_n + behind.v_n - reference(motion, perfect.time).v_n)
    fixes = drives.noisy_gps(shifted, rng)
    at = reference(motion, np.array([motion.start]))
    begin = Start(motion.start, at.lla[0], at.v_n[0], at.rph[0], np.ones(3), 0.1 * np.ones(3), 0.5 * DEG * np.ones(3))
    receiver, known = Receiver(LeverArm(drives.LEVER_B)), GivenStart(begin)
    done = navigate_recording(imu, fixes, drives.SPEC, receiver, known=known, aiding="off")
    print(done.notes)
    (lag,) = of_code(done.notes, Code.GPS_VELOCITY_LAG)
    assert lag["lag_s"] == pytest.approx(0.195, abs=0.005)
    nis = done.run.innovations.nis_velocity
    print("velocity NIS/3:", np.mean(nis) / 3.0)
    assert np.mean(nis) / 3.0 < 1.5


LAP = [Segment(6.0, speed=13.0), Segment(15.0), Segment(6.0, turn=80 * DEG), Segment(12.0), Segment(7.0, speed=0.0)]
MULTIPATH = GpsErrors((0.3, 0.3, 0.5), (1.0, 1.0, 2.0), 80.0, velocity_noise=(0.05, 0.05, 0.05))


def shaken(motion: Truth, seed: int) -> tuple[ImuData, GpsData]:
    """A car that shakes where it is faster than half a metre a second, and its fixes."""
    imu, gps = measured(motion, 50.0, "automotive", MULTIPATH, seed)
    size = np.where(np.linalg.norm(motion.evaluate(imu.time[1:]).v_n, axis=1) > 0.5, 0.006, 0.0)
    rough = np.random.default_rng(seed).normal(size=(imu.time.size, 3)) * np.concatenate([[0.0], size])[:, None]
    return replace(imu, accel=imu.accel + rough, gyro=imu.gyro + 0.03 * rough), gps


def test_false_fixes_after_a_gap_make_no_stop_a_creep():
    """30 m for half a minute: three stops were taken for creeping, the gap before was 0.8 m off, now 0.4 m."""
    motion = drive([Segment(20.0), *[*LAP, Segment(10.0)] * 7], drives.PLACE, seed=2)
    imu, gps = shaken(motion, 2)
    false = (gps.time > 306.0) & (gps.time < 336.0)
    lla = np.where(false[:, None], lla_offset(gps.lla, np.tile([30.0, 0.0, 0.0], (gps.time.size, 1))), gps.lla)
    seen = np.flatnonzero((gps.time < 282.0) | (gps.time > 306.0))
    done = insnav.load(imu, replace(gps, lla=lla).rows(seen)).navigate()
    (note,) = of_code(done.findings, Code.ZUPT_USED)
    assert note["count"] == 8
    track = done.found.run.smoothed.solution
    track = track.rows((track.time > 282.0) & (track.time < 306.0))
    off = ned_offset(track.lla, reference(motion, track.time).lla)[:, :2]
    assert np.sqrt(np.mean(off**2)) < 0.6


@pytest.mark.parametrize("seed", [1, 2])
def test_a_car_that_creeps_without_shaking_does_not_stand(seed):
    """0.35 m/s for 40 s without fixes: positions after them "drifted by 18 m", and those before were 3 m off."""
    creep = [Segment(6.0, speed=13.0), Segment(9.0), Segment(8.0, speed=0.35), Segment(40.0), Segment(8.0, speed=12.0)]
    motion = drive([Segment(20.0), *[*LAP, Segment(10.0)] * 4, *creep, Segment(14.0), *LAP], drives.PLACE, seed=seed)
    imu, gps = shaken(motion, seed)
    done = insnav.load(imu, gps.rows(np.flatnonzero((gps.time < 266.0) | (gps.time > 314.0)))).navigate()
    track = done.found.run.smoothed.solution
    track = track.rows(track.time < 370.0)
    off = ned_offset(track.lla, reference(motion, track.time).lla)[:, :2]
    assert np.sqrt(np.mean(off**2)) < 1.2
    assert {note.code for note in done.findings if note.code.startswith("zupt.")} == {Code.ZUPT_PARTLY}
    assert not any(of_code(done.found.run.events, *CONTRADICTIONS))
