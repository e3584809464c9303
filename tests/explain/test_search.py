"""The search for faults, on records whose errors are drawn from their own linear model with a fault of known time."""

from __future__ import annotations

import weakref
from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import insnav
from insnav import spill
from insnav.explain import explanation
from insnav.explain import record as record_module
from insnav.explain.explanation import _least_found, faults_in
from insnav.explain.kinds import KINDS, RETURN, cost_of_end
from insnav.explain.proposals import Proposal, _pairs, misfit_of
from insnav.explain.record import FAULTS, TAILS, WEIGHTED, LinearRecord, Noise, Step
from insnav.explain.search import ACCEPT, Fit, Search, _Searcher, form_of, forms_of, matters, same, search, search_part
from insnav.filter.filter_input import FilterInput
from insnav.filter.navigator import Navigator
from insnav.kernels.dynamics import NAV
from insnav.kernels.errorstate import STATES
from insnav.kernels.smoother import CORRECTION
from insnav.steps import PREPARE, run_steps
from insnav.types import ImuData, RoundingChange

BEGIN, END = 120, 170  # epochs
NEAR = 3  # epochs by which a time may be off
OF = {kind.name: kind for kind in KINDS}
# size of the drawn fault in each of its states: some ten times what the drive resolves
LASTING = {"gyro_z": 0.01, "accel_x": 0.3, "delay": 0.3, "turned": 0.1}
PASSING = {"offset": 15.0, "drag": 1.0, "followed_drag": 1.0, "velocity_offset": 1.0}


@lru_cache(maxsize=1)
def prepared() -> FilterInput:
    drive = insnav.simulate("figure_eight", imu="automotive", seed=1)
    ready = run_steps(PREPARE[:1], drive.recording, drive.model)[1].ready
    assert ready is not None
    return ready


@lru_cache(maxsize=1)
def nominal() -> LinearRecord:
    return next(LinearRecord.of(prepared()))


def drawn(seed: int, step: Step | None = None, size: float = 0.0, weak: int = 0) -> LinearRecord:
    """The nominal record with errors of states and fixes from its model, and one fault."""
    record, random = nominal(), np.random.default_rng(seed)
    (span, phi, fade, q, qd, _), _, start = record._with((), Noise())
    _, h, fed = record.measured
    m, n = fed.shape
    e = random.multivariate_normal(np.zeros(n), start, method="svd")
    z, sd = np.zeros((m, 6)), np.sqrt(record.variance * [*[1.0 - Noise().share] * 3, 1.0, 1.0, 1.0])
    change = size * record.columns(step.kind).sum(axis=1) if step else np.zeros(n)
    moving = step.kind.name in ("offset", "velocity_offset") if step else False
    values, vectors = np.linalg.eigh(q)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None]
    for k in range(m):
        if k > 0:
            position = slice(n - FAULTS, n - FAULTS + 3)
            drift = span[k] * e[n - FAULTS + 3 : n - FAULTS + 6]
            e = np.concatenate([phi[k] @ e[: phi.shape[2]], fade[k, NAV:] * e[NAV:]])
            e[position] += drift
            e[:NAV] += root[k] @ random.normal(size=NAV)
            e[NAV:] += np.sqrt(qd[k, NAV:]) * random.normal(size=n - NAV)
        if step and k == step.begin:
            e += change
        if step and step.end and k == step.end:
            e = np.where(change != 0.0, 0.0, e) if moving else e - change
        z[k] = h[k] @ e + sd[k] * random.normal(size=6)
    if weak:
        z[weak, :3] += 300.0
    z[record.variance <= 0.0] = 0.0
    return replace(record, measured=(z, h, np.zeros_like(fed)))


def told(found: Search) -> list[tuple[str, int, int]]:
    return [(step.kind.name, step.begin, step.end) for step in found.best.steps]


def test_the_noise_of_a_span_is_that_of_the_random_walks() -> None:
    """Integrals of white noise over a second, of a level vehicle at constant speed: 0.3 deg/√h and 0.05 m/s/√h."""
    span, _, _, q, _ = nominal().system
    moving = span[1:] == pytest.approx(1.0, abs=0.1)
    assert moving
    variance = np.median(np.diagonal(q, axis1=1, axis2=2)[1:], axis=0) / np.median(span)
    angle, speed = np.radians(0.3) / 60.0, 0.05 / 60.0
    assert np.sqrt(variance[6:9]) == pytest.approx(angle, rel=0.02)
    # tilt noise turns gravity within the second: its share is g^2 dt^2 / 3 of the variance of the angle
    assert np.sqrt(variance[3:5]) == pytest.approx(np.hypot(speed, 9.8 * angle / np.sqrt(3.0)), rel=0.05)
    assert np.sqrt(variance[5]) == pytest.approx(speed, rel=0.2)


def test_biases_are_driven_as_gauss_markov_processes() -> None:
    """Of 90 deg/h and 0.25 mg with a correlation time of an hour: 2 sd^2 / T (A. Gelb, 1974, section 3.6)."""
    span, *_, qd = nominal().system
    sd = np.repeat([np.radians(90.0 / 3600.0), 0.25e-3 * 9.80665], 3)
    # in motion, more noise is added to accelerometers
    assert np.median(qd[1:, NAV : NAV + 6], axis=0) == pytest.approx(2.0 * sd**2 * np.median(span) / 3600.0, rel=1e-3)


def test_misalignments_are_constant_states_with_their_prior() -> None:
    record = nominal()
    found = record.with_axes(prepared().imu, np.array([1e-3, 2e-3]))
    own = slice(STATES, STATES + 12)
    np.testing.assert_allclose(found.start[own, own], np.diag(np.repeat([1e-6, 4e-6], 6)), atol=1e-20)
    assert np.all(found.system[2][:, own] == 1.0)
    np.testing.assert_array_equal(
        np.delete(found.start, range(*own.indices(99)), axis=0)[:, :STATES], record.start[:, :STATES]
    )


def test_each_of_two_faults_has_a_gain_of_its_own() -> None:
    """It is the loss without that fault alone."""
    plain, kinds = drawn(7), (OF["drag"], OF["velocity_offset"])
    steps = Step(kinds[0], 60, 1.0, 90), Step(kinds[1], 180, 1.0, 220)
    parts = [drawn(7, step, PASSING[step.kind.name]) for step in steps]
    z = sum(each.measured[0] for each in parts) - plain.measured[0]  # the record is linear
    record = replace(plain, measured=(z, *plain.measured[1:]))
    found = search(record, kinds)
    assert [kind for kind, _, _ in told(found)] == ["drag", "velocity_offset"]
    drag, velocity = found.gains  # of 30 positions that move by 1 m/s, and of 40 velocities that are off by 10 sd
    assert 20.0 < drag < 0.5 * velocity


@pytest.mark.parametrize("seed", range(3))
def test_nothing_is_found_where_nothing_is_wrong(seed: int) -> None:
    found = search(drawn(seed), KINDS)
    assert told(found) == []
    assert found.passes <= 150


def test_a_single_false_fix_is_weak_and_no_fault() -> None:
    found = search(drawn(5, weak=100), KINDS)
    assert told(found) == []
    assert found.best.weights[100, 0] < 1e-3
    # the density of Student's t at d sd in each of three axes, of which a normal distribution would cost d^2 each
    noise = found.best.noise
    white = nominal().variance[100, :3] * (1.0 - noise.share) * np.exp(2.0 * noise.figures[0])
    distance = (300.0**2 / white).sum()
    assert found.best.weights[100, 0] == pytest.approx((TAILS + 3.0) / (TAILS + distance), rel=0.1)


def test_a_long_record_is_made_and_searched_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Memory is that of one block of samples, and of one part besides the first, however long the drive is."""
    ready, known, living, rows = prepared(), list[Any](), list[int](), list[int]()
    monkeypatch.setattr(spill, "ROWS", 2000)
    monkeypatch.setattr(record_module, "LONGEST", 64)
    monkeypatch.setattr(record_module, "SHORTEST", 32)
    fed = Navigator.feed

    def feed(self: Navigator, imu: ImuData) -> None:
        rows.append(imu.time.size)
        fed(self, imu)

    def part(record: LinearRecord, *rest: Any) -> tuple[LinearRecord, Search]:
        known.append(weakref.ref(record.system[1]))
        living.append(sum(each() is not None for each in known))
        return search_part(record, *rest)

    monkeypatch.setattr(Navigator, "feed", feed)
    monkeypatch.setattr(explanation, "search_part", part)
    found = explanation.explain_faults(ready, KINDS)[1]
    assert (max(rows), sum(rows)) == (2000, ready.imu.time.size)
    assert len(living) >= 4
    assert max(living) == 2
    assert found.between[0].size > 4 * 32


def test_a_return_ends_displacements_of_the_fixes_alone() -> None:
    record = nominal()
    steps = (
        Step(OF["gyro_z"], 40, 1e-4),
        Step(OF["drag"], 60, 0.25, 80),
        Step(OF["offset"], 90, 100.0, 95),
        Step(OF["offset"], 100, 100.0),
        Step(RETURN, 150, 0.0),
    )
    weights = np.ones((record.time.size, WEIGHTED.size))
    best = Fit(steps, weights, Noise(), 0.0, record.run(steps, weights, Noise()), np.eye(5))
    gyro, drag, passing, jump = faults_in(record, Search(best, (), (), 0, (1.0,) * len(steps)))
    assert np.isinf(gyro.end)
    assert (drag.end, drag.back) == (record.time[80], record.time[150])
    assert (passing.end, passing.back) == (record.time[95], record.time[95])
    assert (jump.end, jump.back) == (record.time[150], record.time[150])
    seen = [fault.displaces(record.time).sum() for fault in (gyro, drag, passing, jump)]
    assert seen == [0, 70, 0, 0]  # fixes inside a passing jump are left out instead


@pytest.mark.parametrize("column", range(3))
def test_expected_squares_are_the_derivative_of_the_likelihood_by_the_weights(column: int) -> None:
    """Fisher's identity, with differences of the likelihood of the forward pass alone."""
    record, random, by = drawn(3), np.random.default_rng(3), 1e-4
    weights = random.uniform(0.2, 1.2, (record.time.size, WEIGHTED.size))
    squares = record.run((), weights, Noise()).squares
    for row in (1, 57, 200):
        changed = np.ones_like(weights)
        changed[row, column] = np.exp(by)
        more, less = (record.run((), weights * changed**sign, Noise()).cost for sign in (1, -1))
        expected = weights[row, column] * squares[row, column] - WEIGHTED[column]
        assert (more - less) / (2.0 * by) == pytest.approx(expected, rel=1e-3, abs=1e-3)


def dense_cost(record: LinearRecord, steps: tuple[Step, ...], weights: np.ndarray, noise: Noise) -> float:
    """-2 ln of the normal density of all fixes at once, and the prior of the noise, by the definition of the record."""
    (span, phi, fade, q, qd, cleared), (rows, columns), start = record._with(steps, noise)
    z, h, fed = record.measured
    m, n = fed.shape
    by = np.exp(2.0 * np.array(noise.figures[:2])) * [1.0 - noise.share, 1.0]
    mean, errors, roots = np.zeros(n), np.zeros((m, 6)), [np.linalg.cholesky(start + 1e-12 * np.eye(n))]
    effect, shown = roots[0], []
    for k in range(m):
        if k > 0:
            f = np.diag(np.r_[np.zeros(NAV), fade[k, NAV:]])
            f[:NAV, : phi.shape[2]] = phi[k]
            f[n - FAULTS : n - FAULTS + 3, n - FAULTS + 3 : n - FAULTS + 6] = span[k] * np.eye(3)
            f[n - FAULTS : n - 3] *= cleared[k] & 1 == 0
            f[n - 3 :] *= cleared[k] & 2 == 0
            driven = np.diag(qd[k])
            driven[:NAV, :NAV] = q[k] / weights[k, 2]
            driven[:NAV, NAV:21] = 0.5 * phi[k, :, NAV:21] * qd[k, NAV:21]
            driven[NAV:21, :NAV] = driven[:NAV, NAV:21].T
            values, vectors = np.linalg.eigh(driven)
            mean, effect = f @ (mean - fed[k - 1]), np.hstack([f @ effect, vectors * np.sqrt(np.maximum(values, 0.0))])
        effect = np.hstack([effect, *columns[rows == k]])
        errors[k] = z[k] - h[k] @ mean
        shown.append(h[k] @ effect)
    used = record.variance > 0.0
    white = record.variance * np.repeat(by / weights[:, :2], 3, axis=1)
    every = np.vstack([np.pad(each, ((0, 0), (0, effect.shape[1] - each.shape[1]))) for each in shown])[used.ravel()]
    s, innovation = every @ every.T + np.diag(white[used]), errors[used]
    return float(np.linalg.slogdet(s)[1] + innovation @ np.linalg.solve(s, innovation)) + noise.cost


def test_slopes_by_the_noise_figures_are_those_of_the_dense_density() -> None:
    whole, random, by = drawn(3), np.random.default_rng(4), 1e-3
    record = whole.until(40)
    steps = Step(OF["offset"], 10, 100.0, 20), Step(OF["gyro_z"], 25, 1e-4), Step(OF["rough"], 28, 1.0, 35)
    weights = random.uniform(0.2, 1.2, (40, WEIGHTED.size))
    assert record.from_fix
    for each in (record, replace(record, from_fix=False)):
        figures = np.array([0.3, -0.02, -0.4, 0.7, 0.5])
        told = each.run(steps, weights, Noise(tuple(figures)))
        assert told.cost + Noise(tuple(figures)).cost == pytest.approx(
            dense_cost(each, steps, weights, Noise(tuple(figures))), abs=1e-4
        )
        for number, change in enumerate(by * np.eye(5)):
            more, less = (dense_cost(each, steps, weights, Noise(tuple(figures + sign * change))) for sign in (1, -1))
            assert told.slope[number] == pytest.approx((more - less) / (2.0 * by), rel=1e-3, abs=0.01), number


@pytest.mark.parametrize("sd", [0.2, 2.0])
def test_a_fault_of_the_stated_size_is_detected_nine_times_in_ten(sd: float) -> None:
    """Estimates of a jump with a known standard deviation are drawn; its evidence is that of normal densities."""
    random, kind, count = np.random.default_rng(6), OF["offset"], 4000
    least = _least_found(np.eye(3) / sd**2, kind, 1.0, 0.0, 0.0)
    estimate = least * np.eye(3)[0] + sd * random.normal(size=(count, 3))
    prior = kind.size**2 * np.geomspace(1e-2, 1e4, 25)[:, None]  # variances
    ratio = np.sum(estimate**2, axis=1) * (1.0 / sd**2 - 1.0 / (sd**2 + prior)) - 3.0 * np.log(1.0 + prior / sd**2)
    evidence = (ratio - kind.cost(prior, 1.0)).max(axis=0)
    # tested sizes are 12 % apart, and noise of the other axes helps
    assert 0.88 < np.mean(evidence > 6.0) < 0.985


def test_a_fault_matters_where_it_moves_the_solution_by_its_sd_or_doubles_its_variance() -> None:
    weights = np.ones((4, WEIGHTED.size))

    def fit(moved: float = 0.0, variance: float = 1.0) -> Any:
        return SimpleNamespace(
            seen=SimpleNamespace(nav=np.full(4, moved), nav_variance=np.full(4, variance)), weights=weights
        )

    for after, expected in ((fit(0.9), False), (fit(-1.1), True), (fit(0.0, 1.8), False), (fit(0.0, 2.2), True)):
        assert matters(fit(), after, np.ones((4, 2), dtype=bool)) is expected


def plain_fit(record: LinearRecord) -> Fit:
    weights = np.ones((record.time.size, WEIGHTED.size))
    return Fit((), weights, Noise(), 0.0, record.run((), weights, Noise()), np.eye(5))


def test_a_fault_needs_more_gain_than_the_misfit_of_the_model_has() -> None:
    """Fixes that are ten times worse than stated; the gain counts the prior, and the misfit has none."""
    z, h, fed = drawn(8).measured
    record = replace(nominal(), measured=(10.0 * z, h, fed))
    fit, searcher, step = plain_fit(record), _Searcher(record, KINDS, 0), Step(OF["offset"], 60, 100.0, 90)
    prior = float(step.kind.cost(step.variance, record.interval)) + cost_of_end(record.interval)
    needed = misfit_of(record, fit.seen, step.kind, [60, 90]) - prior
    assert needed > 2.0 * ACCEPT
    assert searcher.least(fit, (step,)) == pytest.approx(needed)
    for other in (Step(OF["rough"], 60, 1.0, 90), Step(RETURN, 90, 0.0)):  # neither is a step of a state
        assert searcher.least(fit, (other,)) == ACCEPT


@pytest.mark.parametrize(("gain", "moved", "real"), [(7.0, 1.1, True), (5.0, 1.1, False), (7.0, 0.9, False)])
def test_a_real_fault_gains_and_moves_the_solution(gain: float, moved: float, real: bool) -> None:
    searcher = _Searcher(nominal(), KINDS, 0)
    size = nominal().time.size

    def fit(cost: float, nav: float) -> Any:
        seen = SimpleNamespace(nav=np.full(size, nav), nav_variance=np.ones(size))
        return SimpleNamespace(cost=cost, seen=seen, weights=np.ones((size, WEIGHTED.size)))

    assert searcher.is_real(fit(100.0, 0.0), fit(100.0 - gain, moved), ()) is real


@pytest.mark.parametrize("interval", [1.0, 0.25])
@pytest.mark.parametrize("size", [10.0, 400.0])
def test_the_best_episode_from_its_begin_has_its_end_and_its_size(size: float, interval: float) -> None:
    kind = OF["offset"]
    record = replace(drawn(3, Step(kind, BEGIN, 1.0, END), size), interval=interval)
    seen = plain_fit(record).seen
    begin, end, _, variance = max(
        _pairs(record, seen, kind, record.project(seen, kind), [BEGIN]), key=lambda one: one[2]
    )
    assert (begin, end) == (BEGIN, END)
    assert size / 2.0 < np.sqrt(variance) < 2.0 * size


def test_the_form_of_a_proposal_is_that_of_its_new_fault() -> None:
    known, new = Step(OF["drag"], 30, 1.0, 40), Step(OF["gyro_z"], 90, 1e-4)
    assert form_of(Proposal(1.0, (known, new)), (known,)) == ("gyro_z", False)
    assert form_of(Proposal(1.0, (known,)), ()) == ("drag", True)


def test_a_change_of_rounding_that_changed_no_estimate_adds_no_feedback() -> None:
    """The estimates of the run fade over the span before the change, as the record assumes."""
    ready = prepared()
    navigator = Navigator(ready.keep_history())
    navigator.feed(ready.imu)
    history = np.concatenate(list(navigator.history().blocks()))
    plain = LinearRecord._from_history(history, False, ready)
    change = RoundingChange(float(plain.time[BEGIN]), np.full(3, 1e-12), np.full(3, 1e-12))
    changed = LinearRecord._from_history(history, False, replace(ready, rounding=(change,)))
    difference = np.abs(changed.measured[2] - plain.measured[2])[:, NAV:STATES]
    sensors = np.abs(history[BEGIN, CORRECTION : CORRECTION + STATES - NAV])
    assert (sensors[:6] > 0.0).all()
    assert (difference.max(axis=0) < 1e-6 * sensors).all()


def test_faults_of_the_imu_have_forms_and_those_of_fixes_none() -> None:
    steps = Step(OF["offset"], 30, 1.0, 40), Step(OF["gyro_z"], 90, 1e-4, 95), Step(OF["accel_x"], 50, 0.1)
    assert forms_of(steps) == [("accel_x", False), ("gyro_z", True)]


@pytest.mark.parametrize("part", [30.0, 100.0])
def test_standard_deviations_of_positions_far_too_small_are_no_fault(part: float) -> None:
    record = drawn(8)
    variance = record.variance / ([part**2] * 3 + [1.0] * 3)
    found = search(replace(record, variance=variance, correlated_sd=record.correlated_sd / part), KINDS)
    assert told(found) == []


@pytest.mark.parametrize(("name", "size"), [("velocity_offset", 50.0), ("gyro_z", 1.0)])
def test_a_fault_that_makes_most_fixes_weak_is_still_found(name: str, size: float) -> None:
    begin = 25
    assert told(search(drawn(8, Step(OF[name], begin, 1.0), size), KINDS)) == [(name, begin, 0)]


@pytest.mark.parametrize("name", LASTING)
def test_a_step_that_stays_is_found_at_its_time(name: str) -> None:
    record = drawn(7, Step(OF[name], BEGIN, 1.0), LASTING[name])
    found = search(record, KINDS)
    if not found.complete:  # another run of the filter leaves a linear record as it is
        found = search(record, KINDS, found)
    ((kind, begin, end),) = told(found)
    assert kind == name
    assert abs(begin - BEGIN) <= NEAR
    assert end == 0
    assert np.sqrt(found.best.steps[0].variance) == pytest.approx(LASTING[name], rel=0.5)


@pytest.mark.parametrize("name", PASSING)
def test_an_episode_is_found_with_its_end(name: str) -> None:
    found = search(drawn(8, Step(OF[name], BEGIN, 1.0, END), PASSING[name]), KINDS)
    ((kind, begin, end),) = told(found)
    assert kind == name
    assert abs(begin - BEGIN) <= NEAR
    assert abs(end - END) <= NEAR


def test_fixes_may_be_ten_times_worse_than_stated_but_not_better() -> None:
    """Each costs 1, as does one standard deviation of a normal distribution: a factor of 10, and of 0.97."""
    for number in (0, 1):
        for factor in (10.0, 0.97):
            noise = Noise(tuple(np.log(factor) * np.eye(5)[number]))
            assert noise.cost == pytest.approx(1.0, rel=0.05)
            assert noise.sd[number] == pytest.approx(abs(np.log(factor)), rel=0.05)


def test_figures_of_noise_stay_near_their_prior() -> None:
    noise = Noise()
    for number, most in enumerate((np.log(100.0), np.log(100.0), 3.0, 3.0, 2.0)):
        assert abs(noise.moved(50.0 * np.eye(5)[number]).figures[number]) <= most
        assert abs(noise.moved(-50.0 * np.eye(5)[number]).figures[number]) <= most
    lost = [noise.moved(size * np.eye(5)[2]) for size in (2.9, 50.0)]  # noise of the IMU at its limit of a factor of 20
    weights = np.ones((nominal().time.size, WEIGHTED.size))
    fits = [Fit((), weights, each, 0.0, nominal().run((), weights, each), np.eye(5)) for each in lost]
    assert [fit.is_lost for fit in fits] == [False, True]


def test_faults_of_which_one_record_has_more_are_not_the_same():
    """Only faults of the IMU were counted, and all compared in pairs: a drive ended with a ValueError."""
    imu, fix = Step(OF["gyro_z"], 40, 1e-4), Step(OF["offset"], 90, 100.0)
    assert same((imu, fix), (imu, fix))
    assert not same((imu,), (imu, fix))
    assert not same((imu, fix), (replace(imu, variance=1.0), fix))
