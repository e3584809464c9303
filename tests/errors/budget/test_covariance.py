"""The covariance budget: against everything at once, matrix exponentials, the closed laws, published figures."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.linalg import expm

from insnav.earth import ned_offset
from insnav.errors.budget.predicted import (
    analytic,
    at_start,
    covariance,
    disturbance,
    last_step,
    processes,
    steps_of,
    unit_of,
    worst_case,
)
from insnav.errors.budget.sources import (
    SampledMotion,
    Source,
    at_rest,
    families,
    first_movement,
    only,
    sampled,
    sources_of,
)
from insnav.exceptions import ConfigError
from insnav.imu import ClockSpec
from insnav.kernels.dynamics import system_matrix
from insnav.simulate import circle, straight
from tests.errors.budget.imus import plain, whole
from tests.simulate.motions import PLACE, town


@pytest.fixture(scope="module")
def driving() -> SampledMotion:
    """A car that sets off, turns and climbs."""
    return sampled(town(), 11.0, 40.0)


def sd_of(found: np.ndarray, sources: tuple[Source, ...], family: str, row: int = -1) -> np.ndarray:
    of = [k for k, source in enumerate(sources) if source.family == family]
    return np.sqrt(np.diagonal(found[row, of].sum(axis=0)))


def all_at_once(sources: tuple[Source, ...], motion: SampledMotion, rows: np.ndarray) -> np.ndarray:
    """One covariance of the errors and of every source together, ``P <- A P A' + Q``, in plain matrices."""
    steps = steps_of(motion, rows)
    constants = [s for s in sources if s.kind in ("constant", "ramp") and s.group != "initial"]
    noises = [(s, p) for s in sources if s.kind not in ("constant", "ramp") for p in processes(s, motion)]
    quantised = [s for s in sources if s.kind == "quantisation"]
    n = 9 + len(constants) + len(noises)
    white = np.array([p[0] for _, p in noises])
    given = [disturbance(s, motion) for s in constants]
    given += [disturbance(unit_of(s), motion) for s, _ in noises]
    p = np.zeros((n, n))
    for s in sources:
        if s.group == "initial":
            p[:9, :9] += s.sd**2 * np.diag(at_start(s))
    p[range(9, n), range(9, n)] = [s.sd**2 for s in constants] + [q[3] for _, q in noises]
    found, f9 = [], np.empty((9, 9))
    for k, dt in enumerate(steps.dt):
        first, last = steps.edges[k : k + 2]
        system_matrix(steps.state[k], steps.force_n[k], f9)
        u = np.zeros((9, n - 9))
        for j, values in enumerate(given):
            total = values[first:last].T @ motion.dt[first:last]
            u[6:9, j], u[3:6, j], u[:3, j] = total[:3], total[3:6], total[6:]
        a = np.eye(n)
        a[:9, :9] += f9 * dt + f9 @ f9 * dt**2 / 2
        a[:9, 9:] = u + f9 @ u * dt / 2
        gone = dt * np.array([p_[2] for _, p_ in noises])
        a[range(n - len(noises), n), range(n - len(noises), n)] = np.exp(-gone)
        a[:9, n - len(noises) :] *= [(1 - np.exp(-x)) / x if x else 1.0 for x in gone]
        q = np.zeros((n, n))
        w = u[:, len(constants) :]
        q[:9, :9] = w @ np.diag(white) @ w.T / dt
        q[range(n - len(noises), n), range(n - len(noises), n)] = [p_[1] * dt for _, p_ in noises]
        p = a @ (p + q / 2) @ a.T + q / 2
        if last in rows:
            steps_left = [s.sd * last_step(s, motion, np.array([last]), False)[0] for s in quantised]
            found.append(p[:9, :9] + sum((np.outer(b, b) for b in steps_left), np.zeros((9, 9))))
    return np.array(found)


def test_the_sum_of_the_parts_is_the_whole(driving):
    rows = np.array([250, 603, 1000])
    sources = sources_of(whole(), 2e-5)
    parts = covariance(sources, driving, rows)
    total = all_at_once(sources, driving, rows)
    sd = np.sqrt(np.einsum("kii->ki", total))
    difference = np.abs(parts.sum(axis=1) - total) / (sd[:, :, None] * sd[:, None, :])
    print("largest difference", difference.max())
    assert difference.max() < 1e-9
    # and no part is idle: without any one family the whole is another one
    for family in families(sources):
        assert np.max(sd_of(parts, sources, family) / sd[-1]) > 1e-5, family


def test_at_rest_the_parts_are_those_of_the_matrix_exponential():
    """Van Loan (1978): the system is constant, and the exponential takes no steps."""
    motion, rows, time = at_rest(60.0), np.array([3000, 6000]), np.array([30.0, 60.0])
    sources = sources_of(whole(), 2e-5)
    found = covariance(sources, motion, rows)
    f9 = np.empty((9, 9))
    state = np.concatenate([motion.lla[0], motion.v_n[0], np.zeros(4)])
    system_matrix(state, motion.force_n[0], f9)
    for k, source in enumerate(sources):
        if source.kind in ("flicker", "quantisation") or source.group == "timing":
            continue
        for row, t in enumerate(time):
            f, q, first = np.zeros((10, 10)), np.zeros((10, 10)), np.zeros((10, 10))
            f[:9, :9] = f9
            if source.group == "initial":
                first[:9, :9] = source.sd**2 * np.diag(at_start(source))
            else:
                unit = replace(source, kind="constant", term="bias") if source.kind != "constant" else source
                u = disturbance(unit, motion)[0]
                driven = np.zeros(10)
                driven[6:9], driven[3:6] = u[:3], u[3:6]
                first[9, 9] = source.sd**2
                f[:9, 9] = driven[:9]
                if source.kind == "white":
                    first[9, 9], f[:9, 9] = 0.0, 0.0
                    q = source.sd**2 * np.outer(driven, driven)
                elif source.kind == "random walk":
                    first[9, 9], q[9, 9] = 0.0, source.sd**2
                elif source.kind == "Gauss-Markov":
                    f[9, 9], q[9, 9] = -1.0 / source.correlation_time, 2.0 * source.sd**2 / source.correlation_time
            if source.kind == "ramp":
                steep = np.zeros((11, 11))
                steep[:10, :10], steep[9, 10] = f, source.sd
                answer = expm(steep * t)[:9, 10]
                wanted = np.outer(answer, answer)
            else:
                big = expm(np.block([[-f, q], [np.zeros((10, 10)), f.T]]) * t)
                phi = big[10:, 10:].T
                wanted = (phi @ first @ phi.T + phi @ big[:10, 10:])[:9, :9]
            sd = np.sqrt(np.maximum(np.diag(wanted), 0.0))
            group = np.repeat([sd[:3].max(), sd[3:6].max(), sd[6:].max()], 3)
            scale = np.maximum(sd, 1e-4 * group + 1e-15)
            np.testing.assert_allclose(
                found[row, k] / np.outer(scale, scale),
                wanted / np.outer(scale, scale),
                atol=2e-4,
                err_msg=source.name,
            )


@pytest.mark.parametrize(("time", "bias", "drift"), [(60, -0.047, -0.028), (120, -0.19, None), (300, -1.2, None)])
def test_how_far_the_short_forms_are_off(time, bias, drift):
    """Per cent, as measured by simulation with another package."""
    motion = at_rest(float(time))
    sources = tuple(Source(group, "bias", axis, "constant", 1e-6) for group in ("gyro", "accel") for axis in "xyz")
    found = covariance(sources, motion, np.array([len(motion.dt)]))
    g = -motion.force_n[0, 2]
    accel = 100.0 * (sd_of(found, sources, "accel bias")[:2] / (0.5e-6 * time**2) - 1.0)
    gyro = 100.0 * (sd_of(found, sources, "gyro bias")[:2] / (g * 1e-6 * time**3 / 6.0) - 1.0)
    unit = 10.0 ** -len(f"{bias}".split(".")[1])  # in the last digit: the place was another one
    np.testing.assert_allclose(accel, bias, atol=unit)
    if drift is not None:
        np.testing.assert_allclose(gyro, drift, atol=unit)


@pytest.mark.parametrize(("time", "within"), [(60.0, 0.0025), (600.0, 0.012)])
def test_on_paper_and_predicted_agree_at_rest(time, within):
    motion = at_rest(time)
    rows = np.array([round(50 * time), round(100 * time)])
    spec = replace(whole(), clock=ClockSpec())  # at rest a wrong clock does nothing
    if time > 100.0:  # what makes up flicker noise is tested on the minute
        spec = replace(
            spec, gyro=replace(spec.gyro, flicker=np.zeros(3)), accel=replace(spec.accel, flicker=np.zeros(3))
        )
    sources = sources_of(spec, 2e-5)
    predicted = covariance(sources, motion, rows)
    paper = analytic(sources, motion, rows)
    for family in families(sources):
        of = [k for k, source in enumerate(sources) if source.family == family]
        wanted = sd_of(predicted, sources, family)
        found = np.sqrt(np.sum(paper[-1, of] ** 2, axis=0))
        # what the laws say about: the rest is what the turning of the Earth makes of it,
        # and what Coriolis acceleration takes over from an unstable vertical
        level = np.flatnonzero(found[:2] > max(0.2 * wanted[:2].max(), 0.05 * wanted[2]))
        np.testing.assert_allclose(found[level], wanted[level], rtol=within, err_msg=family)
        down = 2 if time < 100.0 and wanted[2] > 0.2 * wanted[:2].max() else None
        if down:
            np.testing.assert_allclose(found[2], wanted[2], rtol=0.01, err_msg=family)


def test_on_paper_with_turns_and_accelerations(driving):
    """The motion's own integrals make scale factors, misalignment and heading what they are on the way."""
    rows = np.array([4000])
    sources = sources_of(whole())
    predicted = covariance(sources, driving, rows)
    paper = analytic(sources, driving, rows)
    for family in families(sources):
        of = [k for k, source in enumerate(sources) if source.family == family]
        found = np.hypot(*np.sqrt(np.sum(paper[-1, of] ** 2, axis=0))[:2])
        wanted = np.hypot(*sd_of(predicted, sources, family)[:2])
        assert found == pytest.approx(wanted, rel=0.015), family


def test_heading_turns_the_change_of_velocity():
    motion = sampled(town(), 11.0, 40.0)
    sources = (Source("initial", "heading", "down", "constant", 1e-3),)
    found = covariance(sources, motion, np.array([1000, 2500]))
    for row, at in enumerate((1000, 2500)):
        gained = motion.truth.v_n[at] - motion.truth.v_n[0]
        # phi x: North by East and East by North, and a part in a thousand for what tilts the Earth's rotation makes
        np.testing.assert_allclose(
            sd_of(found, sources, "initial heading", row)[3:5], 1e-3 * np.abs(gained[[1, 0]]), atol=2e-4
        )


def test_scale_factor_of_a_gyro_counts_turns():
    """Constant turn: heading error is scale factor times angle, and the velocity is turned by it from then on."""
    motion = sampled(circle(PLACE, 10.0, 0.1, 61.0), 0.0, 60.0)
    sources = tuple(s for s in sources_of(only(whole(), "gyro scale factor")) if s.axis == "zz")
    sd = sd_of(covariance(sources, motion, np.array([6000])), sources, "gyro scale factor")
    scale = next(s.sd for s in sources if s.sd > 0.0)
    assert sd[8] == pytest.approx(scale * 0.1 * 60.0, rel=0.02)


def test_late_samples_are_late_motion(driving):
    """All that is sensed comes late: so does the velocity, and the position by as much as that has changed."""
    sources = (Source("timing", "offset", "t", "constant", 1e-3), Source("timing", "drift", "t", "constant", 1e-4))
    rows = np.array([600, 1000, 1400, 1800, 2600])  # straight, and in both bends
    found, true = covariance(sources, driving, rows), driving.truth
    for row, k in enumerate(rows):
        gained = true.v_n[k] - true.v_n[0]
        wanted = 1e-3 * np.abs(gained[:2])
        np.testing.assert_allclose(
            sd_of(found, sources, "timing offset", row)[:2], wanted, atol=0.03 * wanted.max() + 1e-4
        )
    # a clock that gains: what comes later and later, and is integrated over intervals that are too long
    k = 700
    way = ned_offset(true.lla[k], true.lla[0]) - 7.0 * true.v_n[0]
    wanted = 1e-4 * np.abs(7.0 * (true.v_n[k] - true.v_n[0]) - 2.0 * way)[:2]
    sd = sd_of(covariance(sources, driving, np.array([k])), sources, "timing drift")
    np.testing.assert_allclose(sd[:2], wanted, atol=0.05 * wanted.max())


def test_a_held_vertical_has_no_error_and_hardly_changes_the_others():
    motion, rows = at_rest(60.0), np.array([6000])
    sources = sources_of(plain())
    free, held = (covariance(sources, motion, rows, hold=hold)[0].sum(axis=0) for hold in (False, True))
    assert held[2, 2] == held[5, 5] == 0.0
    assert free[2, 2] > 0.0
    np.testing.assert_allclose(np.diag(held)[[0, 1, 3, 4]], np.diag(free)[[0, 1, 3, 4]], rtol=1e-3)
    assert analytic(sources, motion, rows, hold=True)[..., [2, 5]].max() == 0.0


def test_a_motion_that_is_too_short_is_refused():
    truth = straight(PLACE, 10.0, 0.3, 30.0)
    with pytest.raises(ConfigError, match=r"budget.motion_too_short"):
        sampled(truth, 10.0, 21.0)
    with pytest.raises(ConfigError, match=r"budget.motion_too_short"):
        sampled(truth, -1.0, 10.0)


def test_a_pole_is_no_place_for_north_and_east():
    with pytest.raises(ConfigError, match="pole"):
        sampled(straight(np.array([np.radians(89.5), 0.0, 0.0]), 10.0, 0.3, 30.0), 0.0, 10.0)


def test_the_first_movement_is_found():
    assert first_movement(town()) == pytest.approx(11.5, abs=1.1)
    assert first_movement(straight(PLACE, 10.0, 0.3, 30.0)) == 0.0


def test_nothing_within_one_sd_is_worse_than_the_worst_case():
    """All signs of ten constant sources, of any directions, one by one."""
    rng = np.random.default_rng(4)
    error = rng.standard_normal((10, 9)) * 10.0 ** rng.uniform(-1.0, 1.0, (10, 1))
    found = worst_case((error[:, :, None] * error[:, None, :])[None])[0]
    together = np.array(list(product((-1.0, 1.0), repeat=10))) @ error
    np.testing.assert_allclose(found[:3], np.abs(together[:, :3]).max(axis=0), rtol=1e-12)
    assert found[3] == pytest.approx(np.hypot(*together[:, :2].T).max(), rel=3e-6)


def test_of_a_noise_the_worst_case_is_its_ellipse():
    """One noise of unequal axes, 30 deg from north, and one constant along its longer axis."""
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    turn = np.array([[c, -s], [s, c]])
    parts = np.zeros((1, 2, 9, 9))
    parts[0, 0, :2, :2] = turn @ np.diag([9.0, 1.0]) @ turn.T
    parts[0, 1, :2, :2] = 4.0 * np.outer(turn[:, 0], turn[:, 0])
    found = worst_case(parts)[0]
    assert found[3] == pytest.approx(3.0 + 2.0, rel=1e-6)
    assert found[0] == pytest.approx(np.sqrt(9.0 * c * c + s * s) + 2.0 * c, rel=1e-12)
