"""What a fix should read, and how errors show in it, against a formulation of its own and numerical derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insnav.filter.error_model import layout
from insnav.filter.navigator import forces_about, rates_at, since, turned
from insnav.filter.receiver import Delay, Lag, LeverArm, Receiver
from insnav.kernels.measurements import ARM, FURTHER, SHAKEN, STATE, antenna, assess
from insnav.strapdown import Intervals
from tests.physics import equations as eq

LEVER, LAG, DELAY = np.array([1.2, -0.7, -1.5]), 0.02, 0.03
RATE, ACCELERATION = np.array([0.2, -0.1, 0.4]), np.array([1.0, -2.0, 0.3])
# since the velocity was measured: turned [rad], gained by specific force [m/s], time [s]
OLDER = np.array([0.004, -0.003, 0.008, 0.3, -0.5, -2.9, 0.3])
CASES = {
    "car": ([0.8, 0.2, 300.0], [12.0, -7.0, 0.5], [0.05, -0.03, 5.7]),
    "date line": ([-0.5, np.pi - 1e-8, 10.0], [-3.0, 9.0, 0.1], [0.6, 0.2, 2.2]),
}


def kernel(
    x: eq.State,
    delay: float,
    lever: np.ndarray,
    rate: np.ndarray,
    fix: np.ndarray,
    v: np.ndarray,
    older: np.ndarray = OLDER,
    n: int = 22,
):
    state = np.concatenate([x.lla, x.v, Rotation.from_matrix(x.c).as_quat(scalar_first=True)])
    z, h = np.empty(6), np.empty((6, n))
    antenna(state, np.concatenate([rate, ACCELERATION]), older, lever, delay, LAG, fix, v, z, h)
    return z, h


def predicted(x: eq.State, delay: float, rate: np.ndarray, older: np.ndarray = OLDER) -> tuple[np.ndarray, np.ndarray]:
    """Antenna position [rad, rad, m] and velocity [m/s], `delay` ago, written out independently."""
    arm = x.c @ LEVER
    earlier = x.c @ Rotation.from_rotvec(-older[:3]).as_matrix()
    w_ie = eq.OMEGA * np.array([np.cos(x.lla[0]), 0, -np.sin(x.lla[0])])
    velocity = x.v + earlier @ np.cross(rate, LEVER) - np.cross(w_ie, arm)
    gained = x.c @ older[3:6] + older[6] * np.array([0.0, 0.0, eq.gravity(x.lla[0], x.lla[2])[2]])
    return x.lla + (arm - delay * velocity) / eq.metres(x), velocity - gained - (delay + LAG) * ACCELERATION


def felt(x: eq.State) -> np.ndarray:
    """Specific force in body axes [m/s^2] of the acceleration; the north part of gravity is less than 1e-5 of it."""
    return x.c.T @ (ACCELERATION - [0.0, 0.0, eq.gravity(x.lla[0], x.lla[2])[2]])


def case(name: str) -> eq.State:
    lla, v, rph = (np.array(part) for part in CASES[name])
    return eq.State(lla, v, Rotation.from_euler("ZYX", rph[::-1]).as_matrix())


@pytest.mark.parametrize("name", CASES)
def test_a_perfect_fix_leaves_nothing(name):
    x = case(name)
    lla, v = predicted(x, DELAY, RATE)
    lla[1] = (lla[1] + np.pi) % (2 * np.pi) - np.pi
    z, _ = kernel(x, DELAY, LEVER, RATE, lla, v)
    assert np.abs(z).max() < 1e-6


@pytest.mark.parametrize("axis", range(3))
def test_predicted_minus_measured(axis):
    x = case("car")
    lla, v = predicted(x, 0.0, RATE)
    off = np.eye(3)[axis] * 5.0
    z, _ = kernel(x, 0.0, LEVER, RATE, lla - off / eq.metres(x), v - off)
    np.testing.assert_allclose(z, [*off, *off], atol=1e-5)


@pytest.mark.parametrize("since_velocity", [0.0, 1.0])
@pytest.mark.parametrize("name", CASES)
def test_h_is_the_derivative(name, since_velocity):
    x, before = case(name), since_velocity * OLDER
    lla, v = predicted(x, DELAY, RATE, before)
    lla[1] = (lla[1] + np.pi) % (2 * np.pi) - np.pi
    _, h = kernel(x, DELAY, LEVER, RATE, lla, v, before)
    step = np.concatenate([np.repeat([1.0, 0.1, 1e-4, 1e-4, 1.0, 1e-4, 1e-4], 3), [1e-3]])
    numerical = np.empty((6, 22))
    for j in range(22):
        ends = []
        for sign in (-1, 1):
            error = np.zeros(22)
            error[j] = sign * step[j]
            # w_hat = (w_measured - b_hat) / (1 + s_hat); the delay error is of the estimated delay
            rate, older = (RATE - error[9:12]) / (1 + error[15:18]), before.copy()
            older[3:6] = (older[3:6] - older[6] * error[12:15]) / (1 + error[18:21])
            ends.append(kernel(eq.disturbed(x, error[:9]), DELAY + error[21], LEVER, rate, lla, v, older)[0])
        numerical[:, j] = (ends[1] - ends[0]) / (2 * step[j])
    # the delay of 0.03 s leaves its own small share of velocity and attitude in position, which is left out of H
    tolerance = np.full((6, 22), 2e-4)
    share = numerical[3:].copy()  # of the velocity at the fix, without what was gained since
    share[:, 6:9] -= h[3:, 6:9] - kernel(x, DELAY, LEVER, RATE, lla, v, np.append(before[:3], np.zeros(4)))[1][3:, 6:9]
    tolerance[:3] += DELAY * 1.01 * np.abs(share) + 1e-3 * (np.arange(22) < 3)
    assert (np.abs(h - numerical) <= tolerance).all(), np.argwhere(np.abs(h - numerical) > tolerance)


def test_without_a_delay_state_there_is_no_column_for_it():
    x = case("car")
    lla, v = predicted(x, 0.0, RATE)
    z22, h22 = kernel(x, 0.0, LEVER, RATE, lla, v)
    z21, h21 = kernel(x, 0.0, LEVER, RATE, lla, v, n=21)
    np.testing.assert_array_equal(h21, h22[:, :21])
    np.testing.assert_array_equal(z21, z22)


def estimated(state: np.ndarray, receiver: Receiver) -> np.ndarray:
    """Array of all estimates with this state (10,), and the values of the receiver."""
    values = [block.value for block in layout(receiver).blocks if block.name != "lever"]
    found = np.concatenate([np.zeros(FURTHER), *values])
    found[STATE], found[ARM][:3] = state, receiver.lever_arm.value
    return found


class Assessed:
    """`assess` of a fix on a car in a bend; `NOISE`: square of accelerations that may be noise [m^2/s^4]."""

    NOISE = 0.0

    def __init__(
        self, p: np.ndarray, v: np.ndarray, sd_p: np.ndarray, sd_v: np.ndarray, jitter: float = 0.0, n: int = 21
    ):
        x = case("car")
        lla, velocity = predicted(x, 0.0, RATE, np.zeros(7))
        state = np.concatenate([x.lla, x.v, Rotation.from_matrix(x.c).as_quat(scalar_first=True)])
        motion = np.concatenate([RATE, ACCELERATION, np.zeros(8), felt(x), [self.NOISE], np.zeros(7)])
        self.z, self.h, self.r, self.s, self.sd = found = [np.empty(n) for n in (6, (6, n), (6, 6), (6, 6), 6)]
        receiver = Receiver(LeverArm(LEVER), Delay(sd=1.0 * (n > 21)), Lag(LAG))
        self.nis_position, self.nis_velocity, self.distance, self.change = assess(
            *(estimated(state, receiver), p, motion, *(each[None] for each in (lla, velocity + v, sd_p, sd_v))),
            *(0, True, 0.0, jitter, 0.0, layout(receiver).places, *found),
        )


def test_statistics_are_those_of_the_innovation():
    a = np.random.default_rng(3).standard_normal((21, 21)) * 0.3
    p, sd_p, sd_v, jitter = a @ a.T, np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.3]), 0.01
    found = Assessed(p, np.array([-1.0, 2.0, 0.5]), sd_p, sd_v, jitter)
    noise = np.zeros((6, 6))
    noise[:3, :3] = np.diag(sd_p**2) + jitter**2 * np.outer(case("car").v, case("car").v)
    noise[3:, 3:] = np.diag(sd_v**2) + jitter**2 * np.outer(ACCELERATION, ACCELERATION)
    np.testing.assert_allclose(found.r, noise, rtol=1e-12)
    np.testing.assert_allclose(found.s, found.h @ p @ found.h.T + noise, rtol=1e-10)
    np.testing.assert_allclose(found.sd, np.sqrt(np.diag(found.s)))
    z, s = found.z, found.s
    assert found.nis_position == pytest.approx(z[:3] @ np.linalg.inv(s[:3, :3]) @ z[:3], rel=1e-9, abs=1e-12)
    assert found.nis_velocity == pytest.approx(z[3:] @ np.linalg.inv(s[3:, 3:]) @ z[3:], rel=1e-9)
    np.testing.assert_allclose(z[3:], [1.0, -2.0, -0.5], atol=1e-9)
    assert found.change == pytest.approx(np.sqrt(5.25), rel=1e-6)


@pytest.mark.parametrize("part", [0.0, 0.5, 2.0])
def test_an_acceleration_shows_a_delay_as_far_as_it_is_beyond_noise(monkeypatch, part):
    monkeypatch.setattr(Assessed, "NOISE", part * float(ACCELERATION @ ACCELERATION))
    found = Assessed(np.eye(22), np.zeros(3), np.ones(3), np.ones(3), n=22)
    np.testing.assert_allclose(found.h[3:, 21], -ACCELERATION / (1.0 + part), rtol=1e-9)
    np.testing.assert_allclose(found.z[3:], 0.0, atol=1e-9)  # what is predicted is by all of it


@pytest.mark.parametrize("instant", [False, True])
def test_the_force_about_a_fix_is_the_mean_of_samples_before_and_after(instant):
    dt = np.full(100, 0.01)
    f = np.random.default_rng(2).standard_normal((100, 3))
    none = np.zeros((100, 3))
    parts = Intervals(np.cumsum(dt), dt, none, f if instant else f * 0.01, np.zeros(100, int), 0.0 * dt, instant)
    found = forces_about(np.array([0.3, 0.304, 0.999]), parts, 5)
    np.testing.assert_allclose(found[0], f[25:35].mean(axis=0))
    np.testing.assert_allclose(found[1], f[26:36].mean(axis=0))
    assert np.isfinite(found).all()  # at the end of the record, too


@pytest.mark.parametrize("late", [0.283, 0.004, -0.117])
@pytest.mark.parametrize("instant", [False, True])
def test_what_was_turned_and_gained_since_is_that_of_the_motion(instant, late):
    """Of a body that turns about a moving axis and feels gravity, against small steps of exact rotations."""
    fine = 1e-4 * np.arange(10_001)
    rate = np.column_stack([0.5 * np.sin(2.0 * fine), 0.3 * np.cos(2.0 * fine), 0.4 + 0.2 * np.sin(fine)])
    force = np.column_stack([np.sin(5.0 * fine), 2.0 * np.cos(3.0 * fine), -9.8 + np.sin(9.0 * fine)])
    end, dt = fine[100::100], np.full(100, 0.01)
    gyro, accel = (each[1:].reshape(100, 100, 3).mean(axis=1) * (1.0 if instant else 0.01) for each in (rate, force))
    parts = Intervals(end, dt, gyro, accel, np.zeros(100, int), 0.0 * dt, instant)
    times = np.array([0.5, 0.7031])
    for time, found in zip(times, since(times, np.full(2, late), parts), strict=True):
        first, last = np.sort(np.round(1e4 * np.array([time, time - late])).astype(int))
        steps = Rotation.from_rotvec(1e-4 * rate[first + 1 : last + 1])
        sign, turn, gain = np.sign(late), Rotation.identity(), np.zeros(3)
        for step, f in zip(
            steps[::-1] if late > 0.0 else steps, force[first + 1 : last + 1][:: -int(sign)], strict=True
        ):
            turn = step * turn if late > 0.0 else turn * step
            gain += sign * 1e-4 * (turn.inv() if late > 0.0 else turn).apply(f)
        # the angle lacks the turn of its axis in the time: rate cross its change, time^3 / 12 (Bortz)
        np.testing.assert_allclose(found[:3], sign * turn.as_rotvec(), atol=0.05 * abs(late) ** 3 + 1e-4)
        np.testing.assert_allclose(found[3:], gain, atol=5e-4)


def test_a_fix_without_velocity_has_no_statistics_of_it():
    unknown = np.full(3, np.nan)
    found = Assessed(np.eye(21), unknown, np.ones(3), unknown)
    assert found.nis_position == pytest.approx(0.0, abs=1e-6)
    assert np.isnan(found.nis_velocity)
    assert np.isfinite(found.sd[:3]).all()
    assert np.isnan(found.sd[3:]).all()


@pytest.mark.parametrize("column", range(6))
def test_lever_arms_of_turns_and_of_vibration_show_in_position_and_velocity(column):
    """A rigid antenna is moved by both parts of the rate; here by 2 m more about one axis of one of them."""
    x, vibration, off = case("car"), np.array([-0.3, 0.5, 0.2]), 2.0 * np.eye(6)[column]
    lla, velocity = predicted(x, 0.0, RATE + vibration, np.zeros(7))
    state = np.concatenate([x.lla, x.v, Rotation.from_matrix(x.c).as_quat(scalar_first=True)])
    motion = np.concatenate([RATE, ACCELERATION, vibration, np.zeros(5), felt(x), np.zeros(8)])
    receiver = Receiver(LeverArm(LEVER, sd=1.0, shaken=1.0), Delay(), Lag(LAG))
    z, h, *rest = (np.empty(n) for n in (6, (6, 28), (6, 6), (6, 6), 6))
    values = estimated(state, receiver)
    values[ARM][:3] += off[:3]
    values[SHAKEN] += off[3:]
    fix = (each[None] for each in (lla, velocity, np.ones(3), np.ones(3)))
    assess(values, np.eye(28), motion, *fix, 0, True, 0.0, 0.0, 0.0, layout(receiver).places, z, h, *rest)
    expected = np.concatenate([x.c @ off[:3], x.c @ (np.cross(RATE, off[:3]) + np.cross(vibration, off[3:]))])
    np.testing.assert_allclose(z, expected, atol=1e-3)
    np.testing.assert_allclose(h[:, 22 + column] * 2.0, expected, atol=1e-3)


@pytest.mark.parametrize("instant", [False, True])
def test_the_rate_without_vibration_is_the_mean_about_a_fix(instant):
    """Of a rate that grows, and vibrates with 10 Hz; before the first sample and after the last nothing is known."""
    end = 0.01 * np.arange(301.0)
    angle, rate = 0.1 * end**2 + 0.003 * np.sin(20.0 * np.pi * end), 0.2 * end
    gyro = rate + 0.06 * np.pi * np.cos(20.0 * np.pi * end) if instant else np.diff(angle, prepend=0.0)
    dt = np.diff(end, prepend=0.0)
    parts = Intervals(
        end, dt, np.outer(gyro, [1.0, -2.0, 0.5]), np.zeros((301, 3)), np.zeros(301, int), 0.0 * dt, instant
    )
    times = np.array([0.5, 1.7, 2.9])
    np.testing.assert_allclose(
        rates_at(times, parts.end, turned(parts)), np.outer(0.2 * times, [1.0, -2.0, 0.5]), atol=2e-3
    )
