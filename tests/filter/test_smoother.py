"""The smoother is the least-squares estimate of the whole record, and its uncertainty is true."""

from __future__ import annotations

import numpy as np
import pytest

from insnav import spill
from insnav.earth import ned_offset
from insnav.filter import smoother
from insnav.kernels import smoother as kernel
from insnav.kernels.errorstate import STATES
from insnav.simulate import reference, without_fixes
from tests.filter import drives

NAV = 9
EPOCHS = 7
SPACING = 20.0  # of them: a minute of drag is three [s]
KINDS = (kernel.COAST, kernel.POSITION, kernel.COAST, kernel.VELOCITY, kernel.POSITION, kernel.COAST, 63)


def random_system(rng: np.random.Generator, n: int) -> dict[str, list[np.ndarray]]:
    """Transitions of the form the filter has, noise, measurements; and the filter's pass over them, closed loop."""
    phi, q, h, r = [], [], [], []
    for _ in range(EPOCHS):
        f = np.eye(n)
        f[:NAV, :NAV] += 0.1 * rng.standard_normal((NAV, NAV))
        f[:NAV, NAV:STATES] = 0.1 * rng.standard_normal((NAV, STATES - NAV))
        f[np.arange(NAV, n), np.arange(NAV, n)] = rng.uniform(0.8, 1.0, n - NAV)
        phi.append(f)
        a = 0.3 * rng.standard_normal((n, n))
        q.append(a @ a.T + 0.1 * np.eye(n))
        h.append(rng.standard_normal((6, n)))
        a = 0.3 * rng.standard_normal((6, 6))
        r.append(a @ a.T + 0.5 * np.eye(6))
    return {"phi": phi, "q": q, "h": h, "r": r}


def used(kind: int) -> slice:
    return {kernel.COAST: slice(0, 0), kernel.POSITION: slice(0, 3), kernel.VELOCITY: slice(3, 6)}.get(
        kind, slice(0, 6)
    )


def filtered(system, y, n, start):
    """Kalman filter written as in textbooks; its history for the smoother and its open-loop estimates."""
    rows, states = [], []
    x, p = np.zeros(n), start.copy()
    for k in range(EPOCHS):
        if k:
            x, p = system["phi"][k] @ x, system["phi"][k] @ p @ system["phi"][k].T + system["q"][k]
        row = np.zeros(kernel.width(n))
        kernel.keep(row, SPACING * k, np.zeros(10), np.zeros(12), np.zeros(12), system["phi"][k] if k else np.eye(n), p)
        part = used(KINDS[k])
        if part.stop:
            h, r = system["h"][k], system["r"][k]
            z = h @ x - y[k]
            kernel.keep_measurement(row, KINDS[k], kernel.FIX, z, h, r)
            gain = p @ h[part].T @ np.linalg.inv(h[part] @ p @ h[part].T + r[part, part])
            x = x - gain @ z[part]
            p = p - gain @ h[part] @ p
        rows.append(row)
        states.append(x)
    return np.array(rows), np.array(states)


def batch(system, y, n, start, part_of=slice(0), change=()):
    """All epochs at once by the normal equations; also what the weighted squares are smaller by than those of `y`.

    `change`: what a further vector adds to the states of `part_of` in each transition; it is estimated, too.
    """
    size = EPOCHS * n + 3
    normal, right = np.zeros((size, size)), np.zeros(size)
    normal[:n, :n] += np.linalg.inv(start)
    some = np.eye(3)[: part_of.stop - (part_of.start or 0)]
    normal[EPOCHS * n :, EPOCHS * n :] += np.eye(3) - some.T @ some
    for k in range(EPOCHS):
        here = slice(k * n, (k + 1) * n)
        if k:
            a = np.zeros((n, size))
            a[:, here], a[:, (k - 1) * n : k * n] = np.eye(n), -system["phi"][k]
            if change:
                a[part_of, EPOCHS * n :] = -change[k] * some
            normal += a.T @ np.linalg.inv(system["q"][k]) @ a
        part = used(KINDS[k])
        h, weight = system["h"][k][part], np.linalg.inv(system["r"][k][part, part])
        normal[here, here] += h.T @ weight @ h
        right[here] += h.T @ weight @ y[k][part]
    covariance = np.linalg.inv(normal)
    best = covariance @ right
    return best, [covariance[k * n : k * n + n, k * n : k * n + n] for k in range(EPOCHS)], right @ best


def backward(rows, n):
    """Smoothed errors after and before the measurements, their covariances, and comparison with fixes."""
    out = [np.empty((len(rows), *shape)) for shape in ((STATES,), (STATES,), (NAV, NAV), (12,), (25,))]
    kernel.backward(rows, n, 0.0, np.zeros(n), np.zeros((n, n)), *out)
    return out


@pytest.mark.parametrize("n", [21, 22, 25])
def test_agrees_with_least_squares_over_all_epochs(n):
    rng = np.random.default_rng(5)
    system, y = random_system(rng, n), rng.standard_normal((EPOCHS, 6))
    start = np.diag(rng.uniform(0.5, 2.0, n))
    rows, states = filtered(system, y, n, start)
    after, _, covariance, variance, _ = backward(rows, n)
    best, spread, _ = batch(system, y, n, start)
    np.testing.assert_allclose(states[:, :STATES] - after, best[:-3].reshape(EPOCHS, n)[:, :STATES], atol=1e-9)
    for k in range(EPOCHS):
        np.testing.assert_allclose(covariance[k], spread[k][:NAV, :NAV], atol=1e-10)
        np.testing.assert_allclose(variance[k], spread[k].diagonal()[NAV:STATES], atol=1e-10)


def test_nothing_is_carried_across_a_restart():
    rng = np.random.default_rng(6)
    n = STATES
    system, y = random_system(rng, n), rng.standard_normal((EPOCHS, 6))
    rows, _ = filtered(system, y, n, np.eye(n))
    rows[3, kernel.KIND] = kernel.RESTART
    out = backward(rows, n), backward(rows[:3], n)
    for whole, part in zip(out[0], out[1], strict=True):
        np.testing.assert_array_equal(whole[:3], part)


def errors(epochs, motion):
    true = reference(motion, epochs.time)
    phi = drives.attitude_error(epochs.q_nb, true.rph)
    return np.column_stack([ned_offset(epochs.lla, true.lla), epochs.v_n - true.v_n, phi])


def drive(seed: int, gps=None, **settings):
    rng = np.random.default_rng([77, seed])
    imu = drives.noisy_imu(drives.perfect_imu(), drives.MODEL, rng)
    fixes = drives.noisy_gps(drives.perfect_gps() if gps is None else gps, rng)
    return drives.navigate(
        imu, fixes, drives.begin(drives.MODEL, rng), drives.MODEL, gates=drives.UNFAILING, **settings
    )


def test_uncertainty_is_true_over_many_seeds():
    nees = []
    for seed in range(30):
        epochs = drive(seed).smoothed.epochs
        error = errors(epochs, drives.truth())
        nees.append(
            [
                np.einsum("ni,nij,nj->n", error[:, p], np.linalg.inv(epochs.covariance[:, p, p]), error[:, p]) / 3
                for p in (slice(0, 3), slice(3, 6), slice(6, 9))
            ]
        )
    mean = np.mean(nees, axis=(0, 2))
    print("NEES/3 of smoothed position, velocity, attitude:", mean)
    assert np.all((mean > 0.9) & (mean < 1.1))


def test_far_better_than_the_filter_across_an_outage():
    motion = drives.truth()
    begin = motion.start + 120.0
    ratios = []
    for seed in range(6):
        run = drive(seed, without_fixes(drives.perfect_gps(), begin, begin + 60.0))
        found = []
        for solution in (run.solution, run.smoothed.solution):
            out = (solution.time > begin) & (solution.time <= begin + 60.0)
            true = reference(motion, solution.time[out])
            found.append(np.hypot(*ned_offset(solution.lla[out], true.lla)[:, :2].T).max())
        ratios.append(found[0] / found[1])
    print("largest error of the filter by that of the smoother:", np.round(ratios, 1))
    assert np.median(ratios) >= 8.0


def test_smoothed_is_better_and_knows_it():
    run = drive(3, output_interval=0.1)
    true = reference(drives.truth(), run.solution.time)
    rms = [np.sqrt(np.mean(ned_offset(s.lla, true.lla)[:, :2] ** 2)) for s in (run.solution, run.smoothed.solution)]
    assert rms[1] < 0.6 * rms[0]
    # between epochs the variance is a chord; only in the last second, where the filter's own sd bends, is it above that
    inner = run.solution.time < run.innovations.time[-1] - 1.0
    assert np.all(run.smoothed.solution.sd[inner] <= run.solution.sd[inner] * (1 + 1e-9))


def test_filter_itself_is_the_same_with_and_without():
    with_it, without = drive(1), drive(1, smooth=False)
    assert without.smoothed is None
    np.testing.assert_array_equal(with_it.solution.lla, without.solution.lla)
    np.testing.assert_array_equal(with_it.epochs.covariance, without.epochs.covariance)


def test_same_result_when_the_history_is_on_the_disk(monkeypatch, tmp_path):
    in_memory = drive(2).smoothed
    monkeypatch.setattr(smoother, "ROWS", 50)
    monkeypatch.setattr(spill, "LARGE", 0)
    monkeypatch.setattr(spill.tempfile, "tempdir", str(tmp_path))
    on_disk = drive(2).smoothed
    np.testing.assert_array_equal(in_memory.solution.lla, on_disk.solution.lla)
    np.testing.assert_array_equal(in_memory.epochs.covariance, on_disk.epochs.covariance)
    assert not list(tmp_path.iterdir())


def test_rows_after_the_last_fix_are_those_of_the_filter():
    gps = without_fixes(drives.perfect_gps(), drives.truth().start + 280.0, np.inf)
    run = drive(4, gps)
    late = run.solution.time > run.innovations.time[-1] + 0.5
    assert late.any()
    # coasting epochs follow the last fix: they add nothing
    np.testing.assert_allclose(run.smoothed.solution.lla[late], run.solution.lla[late], rtol=0, atol=1e-15)
    np.testing.assert_allclose(run.smoothed.solution.sd[late], run.solution.sd[late], rtol=0.01)


def test_between_epochs_the_position_error_follows_the_velocity_errors_at_both_ends():
    """A cubic error in time, whose derivative is the velocity error, is taken off exactly."""
    coefficients = np.array([0.4, -0.3, 0.2, 0.7])  # of t^0 ... t^3 [m], [m/s], ...
    times = np.linspace(0.0, 2.0, 21)
    position = np.polynomial.polynomial.polyval(times, coefficients)
    velocity = np.polynomial.polynomial.polyval(times, np.polynomial.polynomial.polyder(coefficients))
    ends = np.array([0.0, 2.0])
    error = np.zeros((2, STATES))
    for axis in range(3):
        error[:, axis], error[:, 3 + axis] = position[[0, -1]], velocity[[0, -1]]
    place = np.array([0.8, 0.2, 100.0])
    state = np.tile(np.concatenate([place, np.zeros(3), [1.0, 0.0, 0.0, 0.0]]), (times.size, 1))
    kernel.correct(times, state, ends, error, error)
    moved = ned_offset(state[:, :3], place)
    np.testing.assert_allclose(moved, -np.tile(position[:, None], 3), atol=1e-6)
