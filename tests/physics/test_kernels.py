"""Kernels of the mechanization and of error budgets, each against an independent computation of the same thing."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from insnav.attitude import dcm_from_rph, quat_from_rph
from insnav.kernels import dynamics, error_propagation, gimbal, mechanization
from tests.physics import equations as eq

RATE, FORCE = np.array([0.3, -0.2, 0.4]), np.array([4.0, -3.0, -9.0])
RPH, VELOCITY = np.array([0.5, -0.4, 1.9]), np.array([120.0, -90.0, 15.0])
AWAY = {"mid latitude": 0.8, "polar axes, North": 1.5535, "polar axes, South": -1.5535}


def navigated(x, dt, rate, force, *, height=None, v_down=None):
    """States (n, 10) after each interval of constant rate and specific force (n, 3)."""
    n, hold = len(dt), height is not None
    out, none = np.empty((n, 10)), np.zeros((n, 3))
    given = (height, v_down) if hold else (np.zeros(n), np.zeros(n))
    increments = dt[:, None] * rate, dt[:, None] * force, none, none
    mechanization.free_inertial(x.copy(), dt, *increments, 1.0, hold, *given, 1, out)
    return out


@pytest.mark.parametrize("lat", AWAY.values(), ids=AWAY.keys())
def test_steps_follow_the_equations_of_motion(lat):
    """Two seconds of turns and accelerations about all axes; the equations are integrated by Runge-Kutta."""
    n, dt = 200, np.full(200, 0.01)
    lla = np.array([lat, 0.2, 4000.0])
    start = np.concatenate([lla, VELOCITY, quat_from_rph(RPH)])
    found = navigated(start, dt, np.tile(RATE, (n, 1)), np.tile(FORCE, (n, 1)))[-1]
    end = eq.advance(eq.State(lla, VELOCITY, dcm_from_rph(RPH)), RATE, FORCE, 2.0, 400)
    np.testing.assert_allclose(found[3:6], end.v, rtol=0, atol=1e-6)
    np.testing.assert_allclose((found[:3] - end.lla) * eq.metres(end), 0.0, rtol=0, atol=1e-4)
    turned = Rotation.from_quat(found[[7, 8, 9, 6]]).as_matrix() @ end.c.T
    np.testing.assert_allclose(turned, np.eye(3), rtol=0, atol=1e-9)


@pytest.mark.parametrize("lat", AWAY.values(), ids=AWAY.keys())
def test_errors_of_long_steps_are_of_second_order(lat):
    """All forces at mid-interval: with half the step, a quarter of the error, of a fast and slowly turning vehicle."""
    lla, velocity = np.array([lat, 0.2, 9000.0]), np.array([800.0, -600.0, 30.0])
    rate, force, rph = 0.003 * RATE, np.array([0.3, -0.2, -9.7]), 0.02 * RPH
    start = np.concatenate([lla, velocity, quat_from_rph(rph)])
    end = eq.advance(eq.State(lla, velocity, dcm_from_rph(rph)), rate, force, 32.0, 320)
    errors = []
    for n in (4, 8):  # shorter steps show that the radii are those of the start of a step, a part in 1e7
        found = navigated(start, np.full(n, 32.0 / n), np.tile(rate, (n, 1)), np.tile(force, (n, 1)))[-1]
        turn = Rotation.from_quat(found[[7, 8, 9, 6]]) * Rotation.from_matrix(end.c).inv()
        errors.append([(found[:3] - end.lla) * eq.metres(end), found[3:6] - end.v, turn.as_rotvec()])
    sizes = np.linalg.norm(errors, axis=2)
    np.testing.assert_allclose(sizes[0] / sizes[1], 4.0, rtol=0.03)


@pytest.mark.parametrize("angle", [1e-3, 0.3, 0.59999, 0.60001, 3.0])
def test_a_step_of_the_attitude_is_a_product_of_rotations(angle):
    body, frame = angle * np.array([2.0, -1.0, 2.0]) / 3.0, np.array([2e-4, -1e-4, 3e-4])
    x = np.concatenate([np.zeros(6), quat_from_rph(RPH)])
    mechanization.quaternion_step(x, *frame, *body)
    wanted = Rotation.from_rotvec(-frame) * Rotation.from_matrix(dcm_from_rph(RPH)) * Rotation.from_rotvec(body)
    found = Rotation.from_quat(x[[7, 8, 9, 6]])
    np.testing.assert_allclose((found * wanted.inv()).as_rotvec(), 0.0, rtol=0, atol=1e-13)
    assert np.linalg.norm(x[6:]) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("lat", AWAY.values(), ids=AWAY.keys())
def test_a_held_height_of_the_free_solution_changes_nothing(lat):
    """Coriolis forces of a climb of 80 m/s push sideways by 0.01 m/s^2; they need the climb that is held."""
    n, dt = 100, np.full(100, 0.01)
    start = np.concatenate([[lat, 0.2, 4000.0], [120.0, -90.0, -80.0], quat_from_rph(RPH)])
    samples = np.tile(RATE, (n, 1)), np.tile(FORCE, (n, 1))
    free = navigated(start, dt, *samples)
    held = navigated(start, dt, *samples, height=free[:, 2].copy(), v_down=free[:, 5].copy())
    np.testing.assert_allclose(held[:, 3:], free[:, 3:], rtol=0, atol=1e-7)
    np.testing.assert_allclose(held[:, :2], free[:, :2], rtol=0, atol=1e-13)
    np.testing.assert_array_equal(held[:, [2, 5]], free[:, [2, 5]])


@pytest.mark.parametrize("instant", [True, False])
def test_runge_kutta_joins_samples_by_straight_lines(instant):
    """Rate and specific force change linearly, which samples of both forms show exactly."""
    edges = np.cumsum([0.0, 0.02, 0.03, 0.025, 0.02])
    slope = np.array([4.0, -3.0, 5.0]), np.array([20.0, -30.0, 10.0])
    at = edges if instant else 0.5 * (edges[1:] + edges[:-1])
    dt = np.diff(edges, prepend=0.0) if instant else np.diff(edges)
    samples = [first + at[:, None] * change for first, change in zip((RATE, FORCE), slope, strict=True)]
    given = samples if instant else [dt[:, None] * each for each in samples]
    dtheta, dvel, coning, sculling = out = np.full((4, len(dt), 3), np.nan)
    mechanization.increments(mechanization.RK4, instant, dt, *given, *out)
    row = 2  # it has neighbours on both sides
    begin, steps = edges[row - 1 if instant else row], 100
    h, turn, velocity = dt[row] / steps, Rotation.identity(), np.zeros(3)
    for k in range(steps):  # midpoints
        rate, force = (
            value + (begin + (k + 0.5) * h) * change for value, change in zip((RATE, FORCE), slope, strict=True)
        )
        velocity += h * (turn * Rotation.from_rotvec(0.5 * h * rate)).apply(force)
        turn = turn * Rotation.from_rotvec(h * rate)
    middle = begin + 0.5 * dt[row]
    np.testing.assert_allclose(dtheta[row], dt[row] * (RATE + middle * slope[0]), rtol=1e-12)
    np.testing.assert_allclose(dvel[row], dt[row] * (FORCE + middle * slope[1]), rtol=1e-12)
    np.testing.assert_allclose(dtheta[row] + coning[row], turn.as_rotvec(), rtol=0, atol=2e-9)
    whole = dtheta[row]
    angle = np.linalg.norm(whole)
    by = np.eye(3) + (1 - np.cos(angle)) / angle**2 * eq.cross(whole)
    by += (1 - np.sin(angle) / angle) / angle**2 * eq.cross(whole) @ eq.cross(whole)
    np.testing.assert_allclose(by @ dvel[row] + sculling[row], velocity, rtol=0, atol=2e-7)


def at_one_place(hold):
    """State, specific force and error dynamics of a moving vehicle; a held vertical channel leaves the dynamics."""
    x = np.concatenate([[0.8, 0.2, 3000.0], VELOCITY, quat_from_rph(RPH)])
    f_n, f = dcm_from_rph(RPH) @ FORCE, np.empty((9, 9))
    dynamics.system_matrix(x, f_n, f)
    if hold:
        f[[2, 5]] = 0.0
    return x, f_n, f


SCALE = np.repeat([1.0, 0.1, 1e-3], 3)  # typical errors: position, velocity, attitude
ENTRY = np.array([1e-5, -2e-5, 3e-5, 0.02, -0.01, 0.03, 0.04, -0.02, 0.01])  # attitude, velocity, position per second


@pytest.mark.parametrize("hold", [False, True])
def test_known_disturbances_add_up_as_in_a_constant_system(hold):
    """Matrix exponential of the dynamics with the disturbance as a tenth state."""
    n, dt = 400, 0.05
    x, f_n, f = at_one_place(hold)
    state = np.array([SCALE, np.zeros(9)])
    state[:, [2, 5]] *= not hold
    given = np.tile(dt * np.array([0.0 * ENTRY, ENTRY]), (n, 1, 1))
    big = np.zeros((10, 10))
    big[:9, :9], big[:9, 9] = f, ENTRY[[6, 7, 8, 3, 4, 5, 0, 1, 2]]
    big[[2, 5], 9] *= not hold
    middle, end = (expm(big * span) for span in (0.5 * n * dt, n * dt))
    wanted = [[by[:9, :9] @ state[0], by[:9, 9]] for by in (middle, end)]
    out = np.full((2, 2, 9), np.nan)
    rows = np.array([n // 2, n])
    error_propagation.sensitivities(
        np.tile(x, (n, 1)), np.tile(f_n, (n, 1)), np.full(n, dt), given, state, hold, rows, out
    )
    np.testing.assert_allclose(out / SCALE, wanted / SCALE, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("hold", [False, True])
def test_noises_have_the_covariance_of_van_loan(hold):
    """White noise, a random constant, a random walk and a Gauss-Markov process, each on both channels."""
    n, dt = 80, 0.1
    x, f_n, f = at_one_place(hold)
    channels = np.array([ENTRY, ENTRY[[1, 2, 0, 4, 5, 3, 7, 8, 6]]])
    white, drive = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.3, 0.2]])
    decay, first = np.array([[0.0, 0.0, 0.0, 0.15], [0.0, 2.0, 0.0, 0.7]])
    axis = np.repeat([0, 1], 4)
    out, wanted = np.full((1, 8, 9, 9), np.nan), np.empty((8, 9, 9))
    for k in range(8):
        b, i = channels[axis[k]][[6, 7, 8, 3, 4, 5, 0, 1, 2]], k % 4
        b[[2, 5]] *= not hold
        a, q, p = np.zeros((10, 10)), np.zeros((10, 10)), np.zeros((10, 10))
        a[:9, :9], a[:9, 9], a[9, 9] = f, b, -decay[i]
        q[:9, :9], q[9, 9], p[9, 9] = white[i] * np.outer(b, b), drive[i], first[i]
        big = expm(np.block([[-a, q], [np.zeros((10, 10)), a.T]]) * n * dt)
        phi = big[10:, 10:].T
        wanted[k] = (phi @ p @ phi.T + phi @ big[:10, 10:])[:9, :9]
    given = np.tile(dt * channels, (n, 1, 1))
    numbers = np.tile([white, drive, decay, first], 2)
    error_propagation.noises(
        np.tile(x, (n, 1)), np.tile(f_n, (n, 1)), np.full(n, dt), given, axis, *numbers, hold, np.array([n]), out
    )
    sd = np.sqrt(np.maximum(np.diagonal(wanted, axis1=1, axis2=2), 1e-12))
    np.testing.assert_allclose(
        out[0] / (sd[:, :, None] * sd[:, None]), wanted / (sd[:, :, None] * sd[:, None]), atol=2e-3
    )


def corrupted(count, dt, *, rng=None, hold=False, **errors):
    """Last state of a run with errors, which are zero where none are given."""
    start = np.concatenate([[0.8, 0.2, 3000.0], VELOCITY, quat_from_rph(RPH)])
    none, rows = np.zeros((count, 3)), np.arange(1, count + 1)
    known = {"more": np.zeros((0, 6)), "bias": np.zeros(6), "matrix": np.array([np.eye(3)] * 2)}
    known |= {
        "bend": np.zeros((2, 2, 3)),
        "g_sensitivity": np.zeros((3, 3)),
        "noise": np.zeros(6),
        "drift": np.zeros(6),
    }
    known |= {"decay": np.zeros(2), "walk": np.zeros(6), "gravity": np.zeros(3)}
    vertical = np.full(count, 3000.0), np.zeros(count)
    out, samples = np.empty((count, 10)), (np.tile(RATE, (count, 1)), np.tile(FORCE, (count, 1)))
    source = rng or np.random.default_rng(1)
    state, steps, given = start.copy(), np.full(count, dt), (known | errors).values()
    error_propagation.corrupted_run(source, state, steps, *samples, none, none, *given, hold, *vertical, rows, out)
    return start, out


@pytest.mark.parametrize("hold", [False, True])
def test_a_run_with_errors_is_that_of_the_samples_with_errors(hold):
    rng = np.random.default_rng(5)
    bias, more = rng.normal(0.0, 0.01, 6), rng.normal(0.0, 0.01, (20, 6))
    matrix, bend = np.eye(3) + rng.normal(0.0, 0.01, (2, 3, 3)), rng.normal(0.0, 0.01, (2, 2, 3))
    g_sensitivity = rng.normal(0.0, 0.01, (3, 3))
    start, found = corrupted(
        20, 0.01, hold=hold, bias=bias, more=more, matrix=matrix, bend=bend, g_sensitivity=g_sensitivity
    )
    seen = []
    for of, (own, true) in enumerate(zip(matrix, (RATE, FORCE), strict=True)):
        through = own @ true
        seen.append(through + bend[of, 0] * np.abs(through) + bend[of, 1] * through**2)
    rate, force = (each + bias[3 * k : 3 * k + 3] + more[:, 3 * k : 3 * k + 3] for k, each in enumerate(seen))
    given = {"height": np.full(20, 3000.0), "v_down": np.zeros(20)} if hold else {}
    wanted = navigated(start, np.full(20, 0.01), rate + g_sensitivity @ FORCE, force, **given)
    np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("hold", [False, True])
def test_an_error_of_gravity_accelerates_along_level_axes(hold):
    count, gravity = 10, np.array([0.02, -0.03, 0.05])
    without, found = (corrupted(count, 0.1, hold=hold, gravity=each)[1][-1] for each in (np.zeros(3), gravity))
    off = (found - without)[:6] * np.append(eq.metres(eq.State(found[:3], VELOCITY, np.eye(3))), np.ones(3))
    wanted = np.concatenate([0.5 * gravity, gravity]) * (1.0, 1.0, not hold, 1.0, 1.0, not hold)  # after one second
    np.testing.assert_allclose(off, wanted, rtol=0, atol=3e-5)


@pytest.mark.parametrize("name", ["noise", "drift", "walk"])
def test_random_errors_of_a_run_have_their_variances(name):
    """Turn and velocity after a second of white noise, of in-run bias or of random walk, in 100 runs."""
    count, dt, rng, decay, size = 20, 0.05, np.random.default_rng(8), np.array([2.0, 5.0]), np.array([1e-4, 0.1])
    times = dt * np.arange(count)
    lag = np.abs(times[:, None] - times)
    sums = {  # of the covariances of all pairs of samples
        "noise": np.full(2, count / dt),
        "drift": np.exp(-decay[:, None, None] * lag).sum(axis=(1, 2)),
        "walk": np.minimum(times[:, None] + dt, times + dt).sum(),
    }
    still, off = corrupted(count, dt)[1][-1], []
    for _ in range(100):
        end = corrupted(count, dt, rng=rng, decay=decay, **{name: np.repeat(size, 3)})[1][-1]
        turn = Rotation.from_quat(still[[7, 8, 9, 6]]).inv() * Rotation.from_quat(end[[7, 8, 9, 6]])
        off.append([turn.as_rotvec(), end[3:6] - still[3:6]])
    found = np.mean(np.sum(np.square(off), axis=2), axis=0)
    np.testing.assert_allclose(found, 3.0 * size**2 * dt**2 * sums[name], rtol=0.3)  # 3.7 sd


def test_a_platform_with_errors_turns_as_matrices_do():
    """The rate of its quaternion in another form: ``C' = C [p x] - [r x] C``, with finite differences of scipy."""
    rng = np.random.default_rng(2)
    turn, errors = Rotation.random(rng=rng), rng.normal(0.0, 1e-4, 6)
    own, computed = ([0.7, 0.1, 500.0, *v, 0.0] for v in ((90.0, -60.0, 2.0), (91.0, -58.0, 1.0)))
    q = turn.as_quat()[[3, 0, 1, 2]]
    y, rate = np.array([*own, *computed, *q]), np.zeros(18)
    force = np.array([[0.3, -0.2, -9.7, 500.0]])
    gimbal.derivative(y, force, 0, gimbal.FREE, np.full(4, np.nan), True, errors, rate)

    def inertial(state):
        c, w = np.eye(3), np.zeros(3)
        moved = eq.derivative(eq.State(np.array(state[:3]), np.array(state[3:6]), c), w, w)
        turned = moved.c  # minus the rate of the axes
        return moved, np.array([turned[1, 2], turned[2, 0], turned[0, 1]])

    (true, axes), (seen, commanded) = inertial(own), inertial(computed)
    c = turn.as_matrix()
    wanted = c @ eq.cross(commanded + errors[:3]) - eq.cross(axes) @ c
    step = 1e-3
    ends = [Rotation.from_quat((q + sign * step * rate[14:])[[1, 2, 3, 0]]).as_matrix() for sign in (1.0, -1.0)]
    np.testing.assert_allclose((ends[0] - ends[1]) / (2.0 * step), wanted, rtol=0, atol=1e-10)
    for first, each, pushed in ((0, true, force[0, :3]), (7, seen, c.T @ force[0, :3] + errors[3:])):
        np.testing.assert_allclose(rate[first : first + 3], each.lla, rtol=1e-9, atol=1e-15)
        np.testing.assert_allclose(rate[first + 3 : first + 6], each.v + pushed, rtol=0, atol=1e-8)
