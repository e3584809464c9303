"""Every kind of segment against its closed form: how far, how long, how round, how gently."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import welch
from scipy.spatial.transform import Rotation

from insnav.simulate.motion import load_profile
from tests.refusals import problems_of
from tests.simulate.profiles import HEAD, Motion, motion, profile

G = 9.8062  # at 45 deg and 100 m, to 1e-4 [m/s^2]
# a rate of change that rises and falls as a polynomial of degree eight has its peak this far above its mean
PEAK = 315.0 / 128.0
NORTH = 'heading = "0 deg"\nspeed = "{} m/s"'


def near_end(m: Motion) -> slice:
    return slice(int(0.9 * len(m.time)), None)


# ---- speed


@pytest.mark.parametrize(
    ("to", "acceleration", "jerk"), [(20.0, 2.0, 2.0), (20.0, 4.0, 10.0), (1.0, 2.0, 2.0), (0.3, 3.0, 0.5)]
)
def test_speed_changes_at_its_acceleration_and_no_faster_than_its_jerk(tmp_path, to, acceleration, jerk):
    made = profile(
        tmp_path, f'accelerate: to = "{to} m/s", acceleration = "{acceleration} m/s^2", jerk = "{jerk} m/s^3"'
    )
    ramp = PEAK * acceleration / jerk  # time to the full acceleration
    reached = acceleration * min(1.0, np.sqrt(to / (acceleration * ramp)))
    duration = to / reached + ramp * reached / acceleration
    assert made.duration == pytest.approx(duration, rel=1e-12)
    m = motion(made)
    assert m.at.v_n[-1, 0] == pytest.approx(to, abs=1e-6)
    assert m.ned[-1, 0] == pytest.approx(0.5 * to * duration, rel=1e-5)  # even about its middle
    assert m.acceleration.max() == pytest.approx(reached, rel=1e-3)
    assert m.acceleration.min() > -1e-3 * reached
    assert np.abs(m.jerk).max() == pytest.approx(jerk, rel=0.02)


def test_braking_mirrors_accelerating_and_a_stop_waits(tmp_path):
    up = motion(profile(tmp_path, 'accelerate: to = "15 m/s"'))
    down = motion(profile(tmp_path, 'stop: wait = "7 s"', start=NORTH.format(15)))
    moving = down.time < up.time[-1]
    np.testing.assert_allclose(down.speed[moving], 15.0 - np.interp(down.time, up.time, up.speed)[moving], atol=1e-4)
    assert down.time[-1] == pytest.approx(up.time[-1] + 7.0)
    assert np.abs(down.at.v_n[down.time > up.time[-1] + 0.5]).max() < 1e-6


def test_cruising_goes_on_for_its_time_or_its_distance(tmp_path):
    assert profile(tmp_path, 'cruise: duration = "12.5 s"', start=NORTH.format(8)).duration == 12.5
    m = motion(profile(tmp_path, 'cruise: distance = "100 m"', start=NORTH.format(8)))
    assert m.time[-1] == 12.5
    assert m.ned[-1, 0] == pytest.approx(100.0, abs=1e-4)


# ---- turns


@pytest.mark.parametrize(("keys", "rate"), [('rate = "20 deg/s"', np.radians(20.0)), ('radius = "25 m"', 10.0 / 25.0)])
@pytest.mark.parametrize("angle", [200.0, -400.0])
def test_a_turn_has_its_angle_rate_and_radius(tmp_path, keys, rate, angle):
    m = motion(profile(tmp_path, f'turn: angle = "{angle} deg", {keys}, jerk = "8 m/s^3"', start=NORTH.format(10)))
    ramp = PEAK * rate * 10.0 / 8.0
    assert m.time[-1] == pytest.approx(np.radians(abs(angle)) / rate + ramp, rel=1e-9)
    assert np.degrees(m.heading[-1] - m.heading[0]) == pytest.approx(angle, abs=1e-6)
    np.testing.assert_allclose(m.speed, 10.0, rtol=1e-5)
    steady = (m.time > ramp + 0.1) & (m.time < m.time[-1] - ramp - 0.1)
    np.testing.assert_allclose(np.gradient(m.heading, m.time)[steady], np.sign(angle) * rate, rtol=1e-5)
    # a circle through all the places of the steady part: x^2 + y^2 = 2 a x + 2 b y + c
    x, y = m.ned[steady, :2].T
    a, b, c = np.linalg.lstsq(np.column_stack([2 * x, 2 * y, np.ones_like(x)]), x * x + y * y, rcond=None)[0]
    assert np.sqrt(c + a * a + b * b) == pytest.approx(10.0 / rate, rel=1e-5)
    # in a car the force to the right is all that changes
    assert np.abs(np.gradient(m.at.f_b[:, 1], m.time)).max() < 8.0 * 1.15  # the body leans, and gravity comes in


def test_an_arc_is_a_turn_on_a_radius(tmp_path):
    start = NORTH.format(10)
    arc, turn = (
        profile(tmp_path, f'{kind}: angle = "90 deg", radius = "25 m"', start=start) for kind in ("arc", "turn")
    )
    assert arc.duration == turn.duration
    time = np.array([3.0])
    np.testing.assert_array_equal(arc.truth(0).evaluate(time).lla, turn.truth(0).evaluate(time).lla)


def test_an_aircraft_banks_so_that_nothing_pulls_sideways_and_a_car_leans_outwards(tmp_path):
    line, start = 'turn: angle = "120 deg", rate = "6 deg/s"', NORTH.format(60)
    m = motion(profile(tmp_path, line, vehicle="aircraft", start=start))
    middle = len(m.time) // 2
    assert m.at.rph[middle, 0] == pytest.approx(np.arctan(60.0 * np.radians(6.0) / 9.80665), rel=1e-6)
    assert np.abs(m.at.f_b[:, 1]).max() < 0.03  # Coriolis, and gravity that is not the standard one
    assert m.at.f_b[middle, 2] == pytest.approx(-np.hypot(G, 60.0 * np.radians(6.0)), rel=1e-3)
    car = motion(profile(tmp_path, 'turn: angle = "90 deg", rate = "20 deg/s"', start=NORTH.format(10)))
    middle = len(car.time) // 2
    assert car.at.rph[middle, 0] < -0.02
    assert car.at.f_b[middle, 1] > 10.0 * np.radians(20.0)  # the seat pushes, and the lean adds to it


def test_a_slide_turns_on_the_spot(tmp_path):
    m = motion(profile(tmp_path, 'turn: angle = "-90 deg", rate = "30 deg/s"', vehicle="slide"))
    assert np.degrees(m.heading[-1] - m.heading[0]) == pytest.approx(-90.0, abs=1e-6)
    assert np.abs(m.ned).max() < 1e-9


@pytest.mark.parametrize("offset", [3.5, -3.5])
def test_a_lane_change_ends_in_the_lane_and_in_its_direction(tmp_path, offset):
    m = motion(profile(tmp_path, f'lane_change: offset = "{offset} m", duration = "5 s"', start=NORTH.format(25)))
    assert m.time[-1] == 5.0
    assert m.ned[-1, 1] == pytest.approx(offset, abs=1e-4)
    assert np.degrees(m.heading[-1]) == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(m.speed, 25.0, rtol=1e-5)
    # the path is y(t) with y' = offset / T * PEAK * (4 x (1 - x))^4
    x = m.time / 5.0
    np.testing.assert_allclose(m.at.v_n[:, 1], offset / 5.0 * PEAK * (4 * x * (1 - x)) ** 4, atol=1e-4)
    largest = np.abs(np.gradient(m.at.v_n[:, 1], m.time)).max()
    assert largest == pytest.approx(3.808 / 0.4063 * abs(offset) / 5.0**2, rel=1e-3)  # as limited for a vehicle


# ---- heights


@pytest.mark.parametrize(
    ("line", "height", "angle"),
    [
        ('climb: height = "60 m", angle = "4 deg"', 60.0, 4.0),
        ('descend: height = "60 m", angle = "4 deg"', -60.0, 4.0),
        ('climb: height = "60 m"', 60.0, 3.0),
    ],
)
def test_a_climb_has_its_height_and_its_angle(tmp_path, line, height, angle):
    m = motion(profile(tmp_path, line, start=NORTH.format(20)))
    assert m.at.lla[-1, 2] - 100.0 == pytest.approx(height, abs=1e-4)
    up = np.degrees(np.arcsin(-m.at.v_n[:, 2] / m.speed)) * np.sign(height)
    assert up.max() == pytest.approx(angle, rel=1e-5)
    assert up[-1] == pytest.approx(0.0, abs=1e-5)
    assert up.min() > -1e-5
    np.testing.assert_allclose(m.speed, 20.0, rtol=1e-5)
    across = np.linalg.norm(m.acceleration, axis=1)
    assert across.max() == pytest.approx(0.5, rel=0.01)  # how a car takes the bend of a hill
    # between its bends, which are even about their middles, the way up is straight
    assert np.linalg.norm(m.jerk, axis=1).max() == pytest.approx(2.0, rel=0.02)
    bend = np.radians(angle) / (0.5 / 20.0) + PEAK * 0.5 / 2.0
    whole = abs(height) / (20.0 * np.sin(np.radians(angle))) + bend
    assert m.time[-1] == pytest.approx(whole, rel=2e-3)


def test_a_small_hill_is_climbed_less_steeply(tmp_path):
    m = motion(profile(tmp_path, 'climb: height = "1 m", angle = "20 deg"', start=NORTH.format(20)))
    assert m.at.lla[-1, 2] - 100.0 == pytest.approx(1.0, abs=1e-4)
    assert np.degrees(np.arcsin(-m.at.v_n[:, 2] / m.speed)).max() < 4.0


@pytest.mark.parametrize(("turns", "height"), [(2.0, 200.0), (-1.5, -150.0)])
def test_a_helix_is_round_and_ends_at_its_height(tmp_path, turns, height):
    line = f'helix: radius = "400 m", turns = {turns}, height = "{height} m"'
    m = motion(profile(tmp_path, line, vehicle="aircraft", start=NORTH.format(60)))
    assert m.at.lla[-1, 2] - 100.0 == pytest.approx(height, abs=1e-3)
    assert (m.heading[-1] - m.heading[0]) / (2 * np.pi) == pytest.approx(turns, abs=1e-9)
    middle = slice(len(m.time) // 2, len(m.time) // 2 + 500)
    rate = np.gradient(m.heading, m.time)[middle]
    over_ground = np.hypot(*m.at.v_n[middle, :2].T)
    np.testing.assert_allclose(np.abs(rate), 60.0 / 400.0, rtol=1e-4)
    np.testing.assert_allclose(over_ground / np.abs(rate), 400.0, rtol=0.01)  # a slope shortens the way over ground
    np.testing.assert_allclose(m.speed, 60.0, rtol=1e-4)


# ---- laboratory


@pytest.mark.parametrize(
    ("length", "acceleration", "speed", "reached"),
    [(2.0, 0.5, 0.8, True), (2.0, 1.0, 1.0, True), (2.0, 5.0, 2.0, True), (0.5, 0.5, 2.0, False)],
)
def test_a_slide_goes_its_length_in_a_trapezoid_of_speed(tmp_path, length, acceleration, speed, reached):
    line = f'slide: length = "{length} m", acceleration = "{acceleration} m/s^2", speed = "{speed} m/s"'
    made = profile(tmp_path, line, vehicle="slide")
    jerk = max(5.0, 10.0 * acceleration)
    ramp = PEAK * acceleration / jerk
    if not reached:  # a triangle, v (v / a + ramp) = length, of its rounded kind
        speed = 0.5 * acceleration * (-ramp + np.sqrt(ramp**2 + 4.0 * length / acceleration))
    assert made.duration == pytest.approx(length / speed + speed / acceleration + ramp, rel=1e-9)
    m = motion(made, step=0.002)
    assert m.ned[-1, 0] == pytest.approx(length, abs=1e-6)
    assert m.speed.max() == pytest.approx(speed, rel=1e-5)
    assert np.abs(m.acceleration).max() == pytest.approx(acceleration, rel=2e-3)
    assert np.abs(m.jerk).max() == pytest.approx(jerk, rel=0.05)
    assert m.speed[-1] < 1e-6


def test_a_slide_comes_back_without_turning_round(tmp_path):
    there = 'slide: length = "2 m", acceleration = "1 m/s^2"'
    m = motion(profile(tmp_path, there, f"{there}, back = true", vehicle="slide"))
    np.testing.assert_allclose(m.ned[-1], 0.0, atol=1e-6)
    assert m.ned[:, 0].max() == pytest.approx(2.0, abs=1e-6)
    np.testing.assert_allclose(m.heading, 0.0, atol=1e-9)
    assert m.at.v_n[:, 0].min() == pytest.approx(-1.0, rel=1e-5)


LIMITS = 'speed = "0.5 m/s", acceleration = "1 m/s^2", rate = "30 deg/s", ramp = "60 deg/s/s"'


def attitude(m: Motion) -> Rotation:
    return Rotation.from_euler("ZYX", m.at.rph[:, ::-1])


def test_axes_in_a_straight_line_start_and_stop_together_within_their_limits(tmp_path):
    """Four axes: what each has done is the same share at any time, and one of them is at its limit."""
    lines = [
        f'linear: x = "0.4 m", y = "-0.3 m", pitch = "50 deg", yaw = "-80 deg", {LIMITS}',
        'static: duration = "1 s"',
    ]
    m = motion(profile(tmp_path, *lines, vehicle="slide"), 0.002)
    yaw, pitch, roll = attitude(m).as_euler("ZYX").T
    shares = np.column_stack([m.ned[:, 0] / 0.4, m.ned[:, 1] / -0.3, pitch / np.radians(50), yaw / np.radians(-80)])
    np.testing.assert_allclose(shares - shares[:, :1], 0.0, atol=2e-7)
    np.testing.assert_allclose(roll, 0.0, atol=1e-9)
    np.testing.assert_allclose(shares[-1], 1.0, atol=1e-6)
    rate = np.abs(np.gradient(yaw, m.time))
    assert np.degrees(rate.max()) == pytest.approx(30.0, rel=1e-4)
    assert np.degrees(np.abs(np.gradient(rate, m.time)).max()) == pytest.approx(60.0, rel=5e-3)
    assert np.abs(m.at.v_n[:, :2]).max() < 0.5


def test_a_table_keeps_its_axes_from_move_to_move(tmp_path):
    """Roll, then pitch: about the axis of the table, not that of the body that has rolled; and any number of turns."""
    lines = [
        f'linear: roll = "90 deg", {LIMITS}',
        f'linear: pitch = "30 deg", {LIMITS}',
        f'linear: yaw = "800 deg", {LIMITS}',
    ]
    m = motion(profile(tmp_path, *lines, vehicle="slide"))
    np.testing.assert_allclose(attitude(m)[-1].as_euler("ZYX", degrees=True), [80.0, 30.0, 90.0], atol=1e-5)


@pytest.mark.parametrize("angle", [360.0, -90.0])
def test_a_slide_goes_round_a_circle(tmp_path, angle):
    line = f'circular: axes = ["x", "y"], radius = "0.2 m", angle = "{angle} deg", start = "90 deg", {LIMITS}'
    m = motion(profile(tmp_path, line, vehicle="slide"), 0.002)
    np.testing.assert_allclose(np.linalg.norm(m.ned[:, :2] - [0.0, -0.2], axis=1), 0.2, atol=1e-6)
    end = np.radians(90.0 + angle)
    np.testing.assert_allclose(m.ned[-1, :2], [0.2 * np.cos(end), 0.2 * np.sin(end) - 0.2], atol=1e-6)
    whole = np.linalg.norm(np.gradient(m.at.v_n, m.time, axis=0), axis=1)
    assert 0.9 < whole.max() < 1.005  # along and across together
    assert np.linalg.norm(m.at.v_n, axis=1).max() < 0.5


def test_a_table_goes_round_a_circle_of_two_axes(tmp_path):
    line = f'circular: axes = ["roll", "pitch"], radius = "20 deg", {LIMITS}'
    m = motion(profile(tmp_path, line, vehicle="slide"))
    yaw, pitch, roll = attitude(m).as_euler("ZYX", degrees=True).T
    np.testing.assert_allclose(np.hypot(roll + 20.0, pitch), 20.0, atol=1e-5)
    np.testing.assert_allclose(yaw, 0.0, atol=1e-6)


@pytest.mark.parametrize(
    ("axis", "vector"), [('"y"', [0, 1, 0]), ('"-z"', [0, 0, -1]), ("[1, 1, 1]", [0.57735027, 0.57735027, 0.57735027])]
)
def test_a_spin_turns_the_body_about_its_own_axis(tmp_path, axis, vector):
    lines = [
        'spin: axis = "x", angle = "90 deg", rate = "60 deg/s"',
        f'spin: axis = {axis}, turns = 1.25, rate = "90 deg/s"',
    ]
    m = motion(profile(tmp_path, *lines, vehicle="slide"))
    assert m.time[-1] == pytest.approx(1.5 + PEAK * 0.5 + 5.0 + PEAK * 0.5)
    first = Rotation.from_rotvec([np.pi / 2, 0, 0])
    last = first * Rotation.from_rotvec(2.5 * np.pi * np.array(vector))
    found = Rotation.from_euler("ZYX", m.at.rph[-1, ::-1])
    assert (last.inv() * found).magnitude() < 1e-7
    rate = np.radians(90.0) * np.array(vector)
    steady = (m.time > 1.5 + PEAK * 0.5 + 1.5) & (m.time < m.time[-1] - 1.5)
    np.testing.assert_allclose(m.at.w_ib_b[steady], np.tile(rate, (steady.sum(), 1)), atol=8e-5)  # and the Earth
    assert np.abs(m.ned).max() < 1e-6


def test_coning_drifts_as_the_solid_angle_says(tmp_path):
    m = motion(
        profile(tmp_path, 'coning: angle = "3 deg", frequency = "2 Hz", duration = "20 s"', vehicle="slide"), 0.001
    )
    steady = (m.time >= 6.0 - 1e-9) & (m.time < 14.0 - 1e-9)
    C_nb = Rotation.from_euler("ZYX", m.at.rph[steady][:, ::-1])
    x_axis = C_nb.as_matrix()[:, :, 0]
    np.testing.assert_allclose(np.degrees(np.arccos(x_axis[:, 0])), 3.0, rtol=1e-5)
    turned = np.unwrap(np.arctan2(x_axis[:, 2], x_axis[:, 1]))
    np.testing.assert_allclose(np.diff(turned), np.diff(turned)[0], rtol=1e-4)
    assert np.abs(np.diff(turned)[0]) == pytest.approx(2 * np.pi * 2.0 * 0.001, rel=1e-6)
    # Goodman and Robinson (1958): mean rate about x = rate of the cone times its solid angle / 2 pi
    earth = 7.292115e-5 * np.cos(np.radians(45.0)) * np.cos(np.radians(3.0))
    drift = -2 * np.pi * 2.0 * (1.0 - np.cos(np.radians(3.0)))
    assert m.at.w_ib_b[steady, 0].mean() == pytest.approx(drift + earth, abs=1e-6)
    assert np.abs(m.ned).max() < 1e-6


def test_sculling_rolls_and_pushes_in_phase(tmp_path):
    line = 'sculling: angle = "0.5 deg", acceleration = "2 m/s^2", frequency = "4 Hz", duration = "20 s"'
    m = motion(profile(tmp_path, line, vehicle="slide"), 0.001)
    steady = (m.time >= 6.0 - 1e-9) & (m.time < 14.0 - 1e-9)
    omega = 2 * np.pi * 4.0
    phase = np.sin(omega * m.time[steady])
    np.testing.assert_allclose(m.at.rph[steady, 0], np.radians(0.5) * phase, atol=1e-7)
    np.testing.assert_allclose(m.acceleration[steady, 1], 2.0 * phase, atol=2e-3)
    assert np.ptp(m.ned[steady, 1]) == pytest.approx(2 * 2.0 / omega**2, rel=1e-3)
    # rectified: mean of the force down the body is - g (1 - a^2 / 4) + ..., of that across zero in navigation axes
    assert m.acceleration[steady, 1].mean() == pytest.approx(0.0, abs=1e-6)
    # what a body that senses f_y takes for a constant push down: mean of roll times force, a A / 2
    tilted = (m.at.f_b[steady, 2] - m.at.f_b[0, 2] * np.cos(m.at.rph[steady, 0])).mean()
    assert tilted == pytest.approx(-0.5 * np.radians(0.5) * 2.0, abs=3e-4)


# ---- smoothness


def test_acceleration_goes_on_from_segment_to_segment(tmp_path):
    lines = [
        'accelerate: to = "15 m/s"',
        'turn: angle = "90 deg", rate = "15 deg/s"',
        'climb: height = "5 m"',
        'lane_change: offset = "3 m", duration = "5 s"',
        'arc: angle = "-90 deg", radius = "60 m"',
        'brake: to = "5 m/s"',
        "stop",
    ]
    made = profile(tmp_path, *lines)
    m = motion(made)
    # no jump: half the step halves every change of acceleration, and half the change of jerk
    fine = motion(made, step=0.005)
    coarse_step, fine_step = (np.abs(np.diff(each.acceleration[2:-2], axis=0)).max() for each in (m, fine))
    assert fine_step == pytest.approx(0.5 * coarse_step, rel=0.02)
    sharpest, sharper = (np.abs(np.diff(each.jerk[4:-4], axis=0)).max() for each in (m, fine))
    assert sharper == pytest.approx(0.5 * sharpest, rel=0.1)
    assert np.linalg.norm(m.jerk, axis=1).max() < 2.6  # of a car 2 m/s^3; a lane change of 3 m in 5 s has 2.3


# ---- vibration


def test_a_band_of_vibration_has_its_density(tmp_path):
    band = '[vibration]\nband = [{ low = "10 Hz", high = "30 Hz", density = "0.02 (m/s^2)^2/Hz" }]\n'
    truth = profile(tmp_path, 'static: duration = "200 s"', vehicle="slide", vibration=band).truth(5)
    time = np.arange(200 * 200) / 200.0
    f_b = truth.evaluate(time).f_b
    frequency, density = welch(f_b - f_b.mean(axis=0), 200.0, nperseg=400, axis=0)
    inside, outside = (frequency > 11.0) & (frequency < 29.0), (frequency < 8.0) | (frequency > 32.0)
    np.testing.assert_allclose(density[inside].mean(axis=0), 0.02, rtol=0.1)
    assert density[outside].max() < 1e-4
    np.testing.assert_allclose(f_b.var(axis=0), 0.02 * 20.0, rtol=0.02)


def test_an_engine_hums_at_its_frequency(tmp_path):
    hum = '[vibration]\nengine = [{ frequency = "25 Hz", acceleration = "0.4 m/s^2" }]\n'
    truth = profile(tmp_path, 'static: duration = "20 s"', vehicle="slide", vibration=hum).truth(5)
    f_b = truth.evaluate(np.arange(20 * 200) / 200.0).f_b
    spectrum = np.abs(np.fft.rfft(f_b - f_b.mean(axis=0), axis=0)) * 2.0 / len(f_b)
    assert spectrum.argmax(axis=0).tolist() == [500] * 3  # 25 Hz
    np.testing.assert_allclose(spectrum.max(axis=0), 0.4, rtol=1e-3)


def test_the_suspension_shakes_as_much_as_told(tmp_path):
    sizes = []
    for size in (1.0, 2.0):
        made = profile(
            tmp_path,
            'cruise: duration = "60 s"',
            start=NORTH.format(20),
            vibration=f"[vibration]\nsuspension = {size}\n",
        )
        sizes.append(made.truth(1).evaluate(np.arange(0.0, 60.0, 0.02)).f_b.std(axis=0))
    np.testing.assert_allclose(sizes[1] / sizes[0], 2.0, rtol=0.01)
    assert sizes[0][2] > 0.3


# ---- waypoints


POINTS = [(0.0, 0.0, 0.0, 0.0), (200.0, 0.0, 2.0, 12.0), (350.0, 150.0, 4.0, 10.0), (350.0, 400.0, 1.0, 0.0)]


def way(tmp_path, points=POINTS, vehicle: str = "car"):
    scale = float(np.degrees(1.0)) / 6378137.0
    wide = float(np.cos(np.radians(45.0)))
    text = f'purpose = "to test"\nvehicle = "{vehicle}"\n[vibration]\nsuspension = 0\n'
    for north, east, height, speed in points:
        text += f'[[waypoint]]\nlat = "{45 + north * scale!r} deg"\nlon = "{9 + east * scale / wide!r} deg"\n'
        text += f'height = "{height} m"\nspeed = "{speed} m/s"\n'
    (tmp_path / "way.toml").write_text(text)
    return load_profile(tmp_path / "way.toml")


@pytest.mark.parametrize("first", [0.0, 10.0])
def test_a_way_goes_through_its_points_at_their_speeds(tmp_path, first):
    points = [(*POINTS[0][:3], first), *POINTS[1:]]
    m = motion(way(tmp_path, points))
    scale = 6378137.0
    for north, east, height, speed in points:
        lat, lon = np.radians(45.0) + north / scale, np.radians(9.0) + east / scale / np.cos(np.radians(45.0))
        off = np.hypot((m.at.lla[:, 0] - lat) * 6.37e6, (m.at.lla[:, 1] - lon) * 6.39e6 * np.cos(lat))
        nearest = int(np.argmin(off))
        assert off[nearest] < 0.2
        assert m.at.lla[nearest, 2] == pytest.approx(height, abs=0.05)
        assert m.speed[nearest] == pytest.approx(speed, abs=0.7)  # changes of acceleration are spread over 2 s
    np.testing.assert_allclose(m.speed[[0, -1]], [first, 0.0], atol=0.02 if first else 1e-6)
    moving = m.speed > 1.0
    course = np.arctan2(m.at.v_n[moving, 1], m.at.v_n[moving, 0])
    np.testing.assert_allclose(np.cos(course - m.heading[moving]), 1.0, atol=1e-6)
    assert np.abs(m.jerk).max() < 5.0


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        ([POINTS[0], POINTS[0]], "waypoints 1 and 2: sim.same_place"),
        ([(0, 0, 0, 0), (100, 0, 0, 0)], "waypoints 1 and 2: sim.no_speed"),
        ([(0, 0, 0, 0), (10, 0, 0, 30)], "waypoints 1 and 2: sim.too_fast_acceleration"),
        ([(0, 0, 0, 120), (1000, 0, 0, 120)], "waypoint 1: sim.too_fast"),
        ([(0, 0, 0, 20), (30, 0, 0, 20), (30, 30, 0, 20)], "near waypoint 2: sim.sideways_at_waypoint"),
        ([(0, 0, 0, 0)], "waypoint: sim.one_waypoint"),
    ],
)
def test_a_way_that_cannot_be_driven_is_refused_with_its_points(tmp_path, points, expected):
    from insnav.exceptions import ConfigError

    with pytest.raises(ConfigError) as caught:
        way(tmp_path, points)
    assert any(each.endswith(expected) for each in problems_of(caught.value))


def test_a_motion_has_segments_or_waypoints(tmp_path):
    from insnav.exceptions import ConfigError

    way(tmp_path)
    text = HEAD.format(vehicle="car", start="", lat="45 deg") + (tmp_path / "way.toml").read_text().split("\n", 2)[2]
    (tmp_path / "both.toml").write_text(f'segment = [{{ kind = "stop" }}]\n{text}')
    with pytest.raises(ConfigError) as caught:
        load_profile(tmp_path / "both.toml")
    assert problems_of(caught.value) == [
        "segment, waypoint: sim.segments_and_waypoints",
        "start: sim.start_and_waypoints",
    ]
