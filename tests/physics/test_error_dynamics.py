"""The filter's linear model against a nonlinear formulation that shares nothing with it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from insnav.attitude import dcm_from_rph, quat_from_rph
from insnav.kernels import dynamics, errorstate
from tests.physics import equations as eq

# size of one typical error: position, velocity, attitude, gyro bias, accelerometer bias, scale factors
SIZE = np.repeat([1.0, 0.1, 1e-3, 1e-5, 1e-2, 1e-3, 1e-3], 3)

CASES = {
    "car": ([0.8, 0.2, 300.0], [12.0, -7.0, 0.5], [0.05, -0.03, 5.7]),
    "aircraft": ([-0.6, 2.9, 11000.0], [-180.0, 160.0, -12.0], [0.6, 0.2, 2.2]),
    "far north": ([1.35, -1.0, 9000.0], [150.0, 200.0, 8.0], [-0.3, 0.1, 0.9]),
    "equator": ([0.0, 0.0, 0.0], [0.0, 300.0, 0.0], [0.0, 0.0, 1.57]),
}
FORCE, RATE = np.array([1.5, -2.0, -10.5]), np.array([0.1, -0.2, 0.3])


def case(name: str) -> tuple[eq.State, np.ndarray]:
    """State for the equations, and the same for the kernels."""
    lla, v, rph = (np.array(part) for part in CASES[name])
    return eq.State(lla, v, dcm_from_rph(rph)), np.concatenate([lla, v, quat_from_rph(rph)])


def rate_of_error(x: eq.State, error: np.ndarray) -> np.ndarray:
    """Time derivative of the error, without integrating anything."""
    estimate = eq.disturbed(x, error)
    true_rate, rate = eq.derivative(x, RATE, FORCE), eq.derivative(estimate, RATE, FORCE)
    # (metres)' times the coordinate error: the measure itself changes along the way
    d = 1e-3
    moved = (eq.metres(x.plus(true_rate, d)) - eq.metres(x.plus(true_rate, -d))) / (2 * d)
    position = (rate.lla - true_rate.lla) * eq.metres(x) + (estimate.lla - x.lla) * moved
    turn = -(rate.c @ x.c.T + estimate.c @ true_rate.c.T)
    phi = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return np.concatenate([position, rate.v - true_rate.v, phi])


@pytest.mark.parametrize("name", CASES)
def test_system_matrix_is_the_derivative(name):
    x, kernel_x = case(name)
    numerical = np.empty((9, 9))
    for j in range(9):
        error = np.zeros(9)
        error[j] = 0.1 * SIZE[j]
        numerical[:, j] = (rate_of_error(x, error) - rate_of_error(x, -error)) / (2 * error[j])
    found = np.empty((9, 9))
    dynamics.system_matrix(kernel_x, x.c @ FORCE, found)
    # every element as the growth in 1 s of one typical error by another
    difference = np.abs(found - numerical) * SIZE[:9] / SIZE[:9, None]
    wanted = np.abs(numerical) * SIZE[:9] / SIZE[:9, None]
    # left out on purpose: how radii and surface gravity change with latitude, how gravity's north component changes
    # with height, and all but g / A of how gravity changes with height: parts in 1e-8 of velocity by position
    left_out = np.zeros((9, 9))
    left_out[3:6, [0, 2]] = 1.2e-8 / SIZE[3]
    left_out[5, 2] = 2.2e-8 / SIZE[3]
    left_out[6:9, 0] = 1e-13 / SIZE[6]
    beyond = np.argwhere(difference > 1e-3 * wanted + left_out + 1e-10)
    assert beyond.size == 0, [(tuple(at), found[tuple(at)], numerical[tuple(at)]) for at in beyond]


class Interval:
    """`propagate` over one stretch of constant rate and specific force."""

    def __init__(self, kernel_x, span, rate_hz, rate=RATE, force=FORCE, *, noise=None, decay=None, correction=None):
        n = round(span * rate_hz)
        dt = np.full(n, 1 / rate_hz)
        self.x = kernel_x.copy()
        self.phi, self.q = np.eye(21), np.zeros((21, 21))
        self.correction = np.zeros(12) if correction is None else correction.copy()
        zero, empty, none = np.zeros((n, 3)), np.empty(0), np.zeros(0, np.int64)
        model = errorstate.Model(
            np.array([0.1, 1e9, -np.inf, -np.inf]),
            np.zeros(20) if noise is None else noise,
            np.zeros(2),
            np.zeros(12) if decay is None else decay,
            np.zeros((1, 2)),
        )
        turned, pushed = np.tile(rate / rate_hz, (n, 1)), np.tile(force / rate_hz, (n, 1))
        stop = errorstate.propagate(
            0,
            n,
            True,
            *errorstate.Samples(np.cumsum(dt), dt, turned, pushed, zero, zero, np.zeros(n)),
            *errorstate.Carried(self.x, self.correction, np.zeros(6), np.zeros(errorstate.SUMS), np.zeros(1)),
            *model,
            self.phi,
            self.q,
            *errorstate.Outputs(
                np.array([np.inf, 1.0, 0.0]), empty, none, empty, empty, np.empty((0, 10)), none, np.empty((0, 6))
            ),
            *errorstate.scratch(),
        )
        assert stop == n


@pytest.mark.parametrize("name", CASES)
def test_transition_is_the_derivative_of_the_nonlinear_motion(name):
    """Also the signs: what the sensors measure is (1 + s) w + b, and the estimate takes b_hat and s_hat off."""
    span, tau = 2.0, 200.0
    x, kernel_x = case(name)
    end = eq.advance(x, RATE, FORCE, span, 40)

    def final(error: np.ndarray) -> np.ndarray:
        # sensor errors decay; freeze them over pieces of a fortieth of the span, at their middle
        estimate, steps = eq.disturbed(x, error[:9]), 40
        for k in range(steps):
            s = error[9:] * np.exp(-(k + 0.5) * span / steps / tau)
            w = (RATE - s[0:3]) / (1 + s[6:9])
            f = (FORCE - s[3:6]) / (1 + s[9:12])
            estimate = eq.advance(estimate, w, f, span / steps, 1)
        return eq.error_of(estimate, end)

    numerical = np.empty((9, 21))
    for j in range(21):
        error = np.zeros(21)
        error[j] = 0.3 * SIZE[j]
        numerical[:, j] = (final(error) - final(-error)) / (2 * error[j])
    found = Interval(kernel_x, span, 100.0, decay=np.full(12, 1 / tau)).phi
    difference = (found[:9] - numerical) * SIZE / SIZE[:9, None]
    # C_nb is taken at the start of each sample: half a sample of 0.37 rad/s is 0.002 of what the sensors do
    assert np.abs(difference[:, :9]).max() < 1e-4
    assert np.abs(difference[:, 9:]).max() < 1.5e-3
    np.testing.assert_allclose(found[9:, 9:], np.exp(-span / tau) * np.eye(12), atol=1e-12)
    assert (found[9:, :9] == 0.0).all()


def test_sensor_corrections_are_applied_as_the_errors_are_defined():
    x, kernel_x = case("car")
    correction = np.array([1e-3, -2e-3, 3e-3, 0.1, -0.2, 0.3, 0.01, -0.02, 0.03, -0.01, 0.02, 0.01])
    found = Interval(kernel_x, 1.0, 200.0, correction=correction)
    w = (RATE - correction[:3]) / (1 + correction[6:9])
    f = (FORCE - correction[3:6]) / (1 + correction[9:])
    end = eq.advance(x, w, f, 1.0, 50)
    assert np.abs(found.x[3:6] - end.v).max() < 1e-4
    assert np.abs((found.x[:3] - end.lla) * eq.metres(end)).max() < 1e-4


def test_accumulated_transition_and_noise_are_those_of_a_constant_system():
    """Van Loan (1978): at rest the system is constant and a matrix exponential gives both exactly."""
    x = case("car")[0]
    lla, rph = x.lla, np.array([0.05, -0.03, 5.7])
    c = dcm_from_rph(rph)
    w_ie = eq.OMEGA * np.array([np.cos(lla[0]), 0, -np.sin(lla[0])])
    rate, force = c.T @ w_ie, -c.T @ eq.gravity(lla[0], lla[2])
    kernel_x = np.concatenate([lla, np.zeros(3), quat_from_rph(rph)])
    noise = np.repeat([1e-8, 1e-6, 1e-13, 1e-9, 1e-9, 1e-9], 3) * np.linspace(1.0, 1.7, 18)
    decay = np.linspace(1e-4, 2e-3, 12)

    f = np.zeros((21, 21))
    f9 = np.empty((9, 9))
    dynamics.system_matrix(kernel_x, c @ force, f9)
    f[:9, :9] = f9
    f[6:9, 9:12], f[6:9, 15:18] = c, c * rate
    f[3:6, 12:15], f[3:6, 18:21] = -c, -c * force
    f[9:, 9:] = -np.diag(decay)
    g = np.zeros((21, 21))
    g[3:6, 3:6] = c @ np.diag(noise[3:6]) @ c.T
    g[6:9, 6:9] = c @ np.diag(noise[:3]) @ c.T
    g[9:, 9:] = np.diag(noise[6:])
    span = 10.0
    big = expm(np.block([[-f, g], [np.zeros((21, 21)), f.T]]) * span)
    phi = big[21:, 21:].T
    q = phi @ big[:21, 21:]

    found = Interval(kernel_x, span, 100.0, rate, force, noise=np.append(noise, [0.0, 0.0]), decay=decay)
    assert np.abs((found.phi - phi) * SIZE / SIZE[:, None]).max() < 1e-4 * np.abs(phi * SIZE / SIZE[:, None]).max()
    sd = np.sqrt(np.diag(q))
    np.testing.assert_allclose(found.q / np.outer(sd, sd), q / np.outer(sd, sd), atol=1e-3)
    np.testing.assert_allclose(found.q, found.q.T, atol=0)
    assert (np.linalg.eigvalsh(found.q / np.outer(sd, sd)) > -1e-12).all()


@pytest.mark.parametrize("turns", [True, False])
def test_misalignment_is_white_noise_in_proportion_to_the_motion(turns):
    """Over a time T: attitude ``m |w|^2 T`` about each axis, or velocity ``m |f_level|^2 T``."""
    kernel_x, span, noise = case("car")[1], 2.0, np.zeros(20)
    noise[18 if turns else 19] = 1e-6
    rate, level = RATE * turns, (dcm_from_rph(np.array(CASES["car"][2])) @ FORCE)[:2]
    size, first = (rate @ rate, 6) if turns else (level @ level, 3)
    found = Interval(kernel_x, span, 100.0, rate, noise=noise).q[first : first + 3, first : first + 3]
    np.testing.assert_allclose(found, 1e-6 * size * span * np.eye(3), rtol=2e-3, atol=1e-10)


def test_feeding_back_an_error_takes_it_off():
    x, _ = case("aircraft")
    error = np.concatenate([[3.0, -4.0, 5.0, 0.1, -0.2, 0.3, 2e-3, -1e-3, 3e-3], np.arange(1.0, 13.0) * 1e-3])
    estimate = eq.disturbed(x, error[:9])
    fed = np.concatenate([estimate.lla, estimate.v, Rotation.from_matrix(estimate.c).as_quat(scalar_first=True)])
    correction = np.zeros(12)
    errorstate.feed_back(fed, correction, error)
    left = eq.error_of(eq.State(fed[:3], fed[3:6], Rotation.from_quat(fed[6:], scalar_first=True).as_matrix()), x)
    # the order neglected: metres by metres over the Earth's radius, and the square of the angles
    assert np.abs(left[:6]).max() < 1e-5
    assert np.abs(left[6:]).max() < 1e-5
    np.testing.assert_array_equal(correction, -error[9:])


@pytest.mark.parametrize("turns", [1, -1, 10**12])
def test_whole_turns_are_fed_back_as_none(turns):
    """A smoother that is lost may find a milliard of them: a part of a turn at a time they took minutes."""
    x, _ = case("aircraft")
    start = np.concatenate([x.lla, x.v, Rotation.from_matrix(x.c).as_quat(scalar_first=True)])
    axis, angle = np.array([0.6, 0.0, -0.8]), 0.5
    fed = [start.copy(), start.copy()]
    for state, total in zip(fed, (angle, angle + 2.0 * np.pi * turns), strict=True):
        error = np.zeros(21)
        error[6:9] = axis * total
        errorstate.feed_back(state, np.zeros(12), error)
    rotated = Rotation.from_rotvec(axis * angle).as_matrix() @ x.c
    found = Rotation.from_quat(fed[1][6:], scalar_first=True).as_matrix()
    np.testing.assert_allclose(found, rotated, atol=1e-9 if abs(turns) == 1 else 1e-2)  # of 1e12 turns 3e-4 are known
    np.testing.assert_allclose(fed[0][6:], fed[1][6:], atol=1e-9 if abs(turns) == 1 else 1e-2)
