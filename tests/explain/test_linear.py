"""The linear error model of a run, against multivariate normal densities from dense matrices of its definition."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from insnav.kernels.linear import NO_POSITION, NO_VELOCITY, backward, cross, forward, gains

N, EPOCHS, TAU = 32, 12, 2.5
OFFSET, DRIFT = N - 9, N - 6
TOLD = np.array([*range(9), 21, 22, 23])


class Case(NamedTuple):
    system: tuple[np.ndarray, ...]
    measured: tuple[np.ndarray, ...]
    start: tuple[np.ndarray, ...]
    jumps: tuple[np.ndarray, ...]


class Dense(NamedTuple):
    effect: np.ndarray  # of a step before the measurement of an epoch on the states of all, (m, N, m, N)
    mean: np.ndarray  # of all states, (m, N)
    covariance: np.ndarray  # of all states, (m, N, m, N)
    used: np.ndarray  # components that were measured, (m, 6)
    h: np.ndarray  # derivatives of the components used by all states, (j, m N)
    s: np.ndarray  # covariance of the components used
    innovation: np.ndarray  # of these, by no others


@pytest.fixture(params=range(3))
def case(request: pytest.FixtureRequest) -> Case:
    return draw(request.param, EPOCHS)


def draw(seed: int, m: int, stable: float = 1.0) -> Case:
    """A model with few nonzero derivatives, components not measured, jumps, offsets that end, and feedback."""
    random = np.random.default_rng(seed)
    phi = stable * np.eye(9, 21) + 0.05 * stable**50 * random.normal(size=(m, 9, 21))
    root = random.normal(size=(m, 9, 9))
    cleared = np.zeros(m, np.int64)
    cleared[[4, 6, 8]] = NO_POSITION, NO_VELOCITY, NO_POSITION | NO_VELOCITY
    system = (
        random.uniform(0.2, 1.5, m),
        phi,
        random.uniform(0.7, 0.99, (m, N)),
        0.1 * root @ root.swapaxes(1, 2),
        random.uniform(0.0, 0.2, (m, N)),
        cleared,
    )
    h = random.normal(size=(m, 6, N)) * (random.random((m, 6, N)) < 0.2)
    var = random.uniform(0.5, 2.0, (m, 6)) * (random.random((m, 6)) < 0.7)
    var[2] = -1.0
    fed = random.normal(size=(m, N)) * (random.random((m, N)) < 0.3)
    root = random.normal(size=(N, N))
    jumps = np.array([0, 3, 3, 7]), random.normal(size=(4, N, 3)) * (random.random((4, N, 3)) < 0.1)
    return Case(system, (2.0 * random.normal(size=(m, 6)), h, var, fed), (random.normal(size=N), root @ root.T), jumps)


def solve_dense(case: Case) -> Dense:
    """Density of all states and all measurements by the definition, from the transitions between all epochs."""
    span, phi, fade, q, qd, cleared = case.system
    z, h, var, fed = case.measured
    m = len(span)
    mean, noise, effect = np.zeros((m, N)), np.zeros((m, N, N)), np.zeros((m, N, m, N))
    mean[0], noise[0], effect[0, :, 0] = case.start[0], case.start[1], np.eye(N)
    for k in range(1, m):
        f = np.diag(np.r_[np.zeros(9), fade[k, 9:]])
        f[:9, :21] = phi[k]
        f[OFFSET : OFFSET + 3, DRIFT : DRIFT + 3] += span[k] * np.eye(3)
        if cleared[k] & 1:
            f[N - 9 : N - 3] = 0.0
        if cleared[k] & 2:
            f[N - 3 :] = 0.0
        noise[k] = np.diag(qd[k])
        noise[k, :9, :9] = q[k]
        noise[k, :9, 9:21] = 0.5 * phi[k, :, 9:] * qd[k, 9:21]
        noise[k, 9:21, :9] = noise[k, :9, 9:21].T
        mean[k] = f @ (mean[k - 1] - fed[k - 1])
        effect[k] = np.tensordot(f, effect[k - 1], 1)
        effect[k, :, k] = np.eye(N)
    for k, columns in zip(*case.jumps, strict=True):
        noise[k] += columns @ columns.T
    covariance = sum(
        np.einsum("kit,lju,tu->kilj", effect[:, :, k], effect[:, :, k], noise[k], optimize=True) for k in range(m)
    )
    used = var > 0.0
    stacked = np.zeros((m, 6, m, N))
    stacked[np.arange(m), :, np.arange(m)] = h
    of_used = stacked[used].reshape(-1, m * N)
    s = of_used @ covariance.reshape(m * N, m * N) @ of_used.T + np.diag(var[used])
    return Dense(effect, mean, covariance, used, of_used, s, z[used] - of_used @ mean.ravel())


def deviance(innovation: np.ndarray, s: np.ndarray) -> float:
    """-2 log likelihood without its constant."""
    log_density = multivariate_normal(cov=s).logpdf(innovation)
    return float(-2.0 * log_density - len(innovation) * np.log(2.0 * np.pi))


def run(case: Case) -> tuple[float, tuple[np.ndarray, ...]]:
    m = len(case.system[0])
    seen = TOLD, np.full((m, TOLD.size), np.nan), np.full((m, TOLD.size, N), np.nan)
    out = (*np.full((2, m, 6), np.nan), np.full((m, 6, N), np.nan), *seen)
    return forward(*case, out), out


def smooth(case: Case, out: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    return smooth_some(case, out, np.arange(len(case.system[0])), N)[:4]


def smooth_some(case: Case, out: tuple[np.ndarray, ...], rows: np.ndarray, n: int) -> tuple[np.ndarray, ...]:
    m = len(case.system[0])
    found = np.full((rows.size, n), np.nan), np.full((rows.size, n, n), np.nan), *np.full((2, m, 6), np.nan)
    more = np.full((m, 4, TOLD.size), np.nan), np.full(m, np.nan)
    backward(case.system, case.measured, out, rows, *found, *more)
    return *found, *more


def gain(score: np.ndarray, information: np.ndarray) -> float:
    """Change of -2 log likelihood by steps of variance TAU with this score and information."""
    eye = np.eye(len(score))
    return float(
        np.linalg.slogdet(eye + TAU * information)[1] - score @ np.linalg.solve(eye / TAU + information, score)
    )


def test_likelihood_is_the_normal_density(case: Case):
    dense = solve_dense(case)
    value, (innovation, variance, gains, *_) = run(case)
    assert value == pytest.approx(deviance(dense.innovation, dense.s), rel=1e-9)
    assert np.array_equal(variance == -1.0, ~dense.used)
    assert not innovation[~dense.used].any()
    assert not gains[~dense.used].any()
    root = np.linalg.cholesky(dense.s)  # innovations in the order of measurement are those of its factor
    assert variance[dense.used] == pytest.approx(np.diag(root) ** 2, rel=1e-9)
    assert innovation[dense.used] == pytest.approx(np.diag(root) * np.linalg.solve(root, dense.innovation), abs=1e-8)


def test_errors_of_states_before_each_measurement(case: Case):
    """Mean and rows of the covariance by measurements before that epoch alone."""
    dense = solve_dense(case)
    *_, mean, p = run(case)[1]
    epoch = np.nonzero(dense.used)[0]
    for k in range(EPOCHS):
        c, h, own = dense.covariance[k, :, k], dense.h[epoch < k], dense.covariance[k].reshape(N, -1)
        solved = np.linalg.solve(dense.s[np.ix_(epoch < k, epoch < k)], np.c_[dense.innovation[epoch < k], h @ own.T])
        assert mean[k] == pytest.approx((dense.mean[k] + own @ h.T @ solved[:, 0])[TOLD], abs=1e-8)
        assert p[k] == pytest.approx((c - own @ h.T @ solved[:, 1:])[TOLD], abs=1e-8)


def test_gain_of_a_jump(case: Case):
    value, out = run(case)
    r, info, *_ = smooth(case, out)
    random = np.random.default_rng(5)
    for k in range(EPOCHS):
        columns = random.normal(size=(N, 3)) * (random.random((N, 3)) < 0.3)
        expected = gain(columns.T @ r[k], columns.T @ info[k] @ columns)
        at = int(np.searchsorted(case.jumps[0], k))
        rows = np.insert(case.jumps[0], at, k)
        added = case._replace(jumps=(rows, np.insert(case.jumps[1], at, np.sqrt(TAU) * columns, axis=0)))
        assert run(added)[0] - value == pytest.approx(expected, abs=1e-8)


def test_gain_of_two_opposite_steps(case: Case):
    dense, (value, out) = solve_dense(case), run(case)
    r, info, *_ = smooth(case, out)
    random = np.random.default_rng(6)
    g = random.normal(size=(N, 2)) * (random.random((N, 2)) < 0.5)
    for a in range(EPOCHS - 1):
        by_forward = cross(case.system, case.measured, out, info, a, g, EPOCHS - 2)
        assert not by_forward[EPOCHS - 1 :].any()
        assert not by_forward[:a].any()
        for b in range(a + 1, EPOCHS - 1):
            by_backward = cross(case.system, case.measured, out, info, b, g, a)
            assert not by_backward[:a].any()
            assert not by_backward[b + 1 :].any()
            assert by_backward[b] == pytest.approx(g.T @ info[b] @ g, abs=1e-9)
            assert by_forward[b] == pytest.approx(by_backward[a].T, abs=1e-9)
            score = g.T @ (r[a] - r[b])
            information = g.T @ info[a] @ g + g.T @ info[b] @ g - by_backward[a] - by_backward[a].T
            shown = dense.h @ ((dense.effect[:, :, a] - dense.effect[:, :, b]) @ g).reshape(EPOCHS * N, 2)
            expected = deviance(dense.innovation, dense.s + TAU * shown @ shown.T)
            assert value + gain(score, information) == pytest.approx(expected, rel=1e-9)
            score_of_dense = shown.T @ np.linalg.solve(dense.s, dense.innovation)
            assert score == pytest.approx(score_of_dense, abs=1e-8)


def test_smoothed_residuals(case: Case):
    dense, out = solve_dense(case), run(case)[1]
    *_, u, uu = smooth(case, out)
    var = case.measured[2]
    noise = np.diag(var[dense.used])
    mean = noise @ np.linalg.solve(dense.s, dense.innovation)
    assert (var * u)[dense.used] == pytest.approx(mean, abs=1e-8)
    variance = np.diag(noise - noise @ np.linalg.solve(dense.s, noise))
    assert (var - var**2 * uu)[dense.used] == pytest.approx(variance, abs=1e-9)
    assert not u[~dense.used].any()
    assert not uu[~dense.used].any()


def test_smoothed_errors_of_navigation(case: Case):
    dense, out = solve_dense(case), run(case)[1]
    r, info, *_ = smooth(case, out)
    mean_nav, p_nav = out[4][:, :9], out[5][:, :9]
    to = dense.covariance.reshape(EPOCHS * N, -1) @ dense.h.T
    mean = dense.mean + (to @ np.linalg.solve(dense.s, dense.innovation)).reshape(EPOCHS, N)
    assert mean_nav + np.einsum("kij,kj->ki", p_nav, r) == pytest.approx(mean[:, :9], abs=1e-8)
    told = (to @ np.linalg.solve(dense.s, to.T)).reshape(EPOCHS, N, EPOCHS, N)
    for k in range(EPOCHS):
        covariance = p_nav[k, :, :9] - p_nav[k] @ info[k] @ p_nav[k].T
        assert covariance == pytest.approx((dense.covariance - told)[k, :9, k, :9], abs=1e-8)


@pytest.mark.parametrize("size", [1, 2, 3])
def test_gains_of_steps(size: int):
    random, variances = np.random.default_rng(size), np.array([0.01, 1.0, 1e6])
    root, score = random.normal(size=(20, size, size)), random.normal(size=(20, size))
    information, found = root @ root.swapaxes(1, 2), np.empty((3, 20))
    gains(score, information, variances, found)
    for row, t in zip(found, variances, strict=True):
        whole = np.eye(size) + t * information
        square = t * np.einsum("ki,ki->k", score, np.linalg.solve(whole, score[..., None])[..., 0])
        assert row == pytest.approx(square - np.linalg.slogdet(whole)[1], rel=1e-8, abs=1e-10)


def test_sums_over_states(case: Case):
    """By the definition, from score and information at all epochs."""
    out = run(case)[1]
    r, info, _, _, told, driven = smooth_some(case, out, np.arange(EPOCHS), N)
    assert told[:, 0] == pytest.approx(out[4] + np.einsum("kij,kj->ki", out[5], r), abs=1e-10)
    assert told[:, 1] == pytest.approx(r[:, TOLD], abs=1e-12)
    assert told[:, 2] == pytest.approx(np.einsum("kij,kji->ki", out[5], info[:, :, TOLD]), abs=1e-10)
    assert told[:, 3] == pytest.approx(info[:, TOLD, TOLD], abs=1e-12)
    free = info[:, :9, :9] - r[:, :9, None] * r[:, None, :9]
    assert driven == pytest.approx(np.einsum("kij,kij->k", case.system[3], free), abs=1e-9)


def test_faults_that_have_not_begun_change_nothing(case: Case):
    """Some epochs and the states without faults, beside all."""
    alive = np.arange(N) < N - 9
    start = case.start[0] * alive, case.start[1] * alive * alive[:, None]
    system = (*case.system[:4], case.system[4] * alive, case.system[5])
    none = case._replace(system=system, start=start, jumps=(case.jumps[0], case.jumps[1] * alive[:, None]))
    out = run(none)[1]
    every = smooth_some(none, out, np.arange(EPOCHS), N)
    some = smooth_some(none, out, np.array([0, 5]), N - 9)
    assert some[0] == pytest.approx(every[0][[0, 5], :-9], abs=1e-12)
    assert some[1] == pytest.approx(every[1][[0, 5], :-9, :-9], abs=1e-12)
    for few, all_states in zip(some[2:], every[2:], strict=True):
        rows = np.s_[..., TOLD < N - 9] if few.ndim == 3 else np.s_[:]
        assert few[rows] == pytest.approx(all_states[rows], abs=1e-10)


def test_information_stays_symmetric_and_positive():
    case = draw(9, 5000, stable=0.97)
    out = run(case)[1]
    _, info, *_ = smooth(case, out)
    assert np.array_equal(info, info.swapaxes(1, 2))
    assert np.array_equal(out[5][:, :9, :9], out[5][:, :9, :9].swapaxes(1, 2))
    values = np.linalg.eigvalsh(info[::100])
    assert values[:, -1].min() > 0.01
    assert values.max() < 1e3
    assert values.min() > -1e-12 * values.max()
