"""Noise from innovations: the likelihood is that of a filter, and known densities lie in their intervals."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

import insnav
from insnav.earth import lla_offset, ned_offset
from insnav.filter import noise_estimate
from insnav.filter.error_model import error_model, layout
from insnav.filter.filter_input import FilterInput
from insnav.filter.gates import Gates
from insnav.filter.gps_noise import CorrelatedNoise
from insnav.filter.innovation_likelihood import LARGEST, SHARE, InnovationLikelihood, thinned
from insnav.filter.navigator import Navigator
from insnav.filter.noise_estimate import NoiseEstimate
from insnav.filter.noise_identification import (
    ENOUGH,
    NO_NOISE,
    Posterior,
    _begun,
    _turned,
    identify,
    identify_noise,
    known_likelihood,
    maximise,
    with_noise,
)
from insnav.findings import Code, Severity, of_code
from insnav.imu.specification import ImuSpec, SensorSpec, level_bias
from insnav.kernels import noise_likelihood as kernel
from insnav.kernels.smoother import RESIDUAL
from insnav.session.simulation import plan_of, profiled
from insnav.simulate import GpsErrors, corrupt_gps
from insnav.simulate.recording import parse_fault
from insnav.simulate.sensor_errors import gauss_markov
from insnav.types import FloatArray, GpsData, ImuData, RoundingChange
from tests.filter import drives

LAPS = 16  # twenty minutes
KEYS = ("random_walk", "bias_instability", "scale_factor")
OFF = {
    "gyro.random_walk": 3.0,
    "gyro.bias_instability": 3.0,
    "gyro.scale_factor": 1 / 3,
    "accel.random_walk": 1 / 2,
    "accel.bias_instability": 3.0,
    "accel.scale_factor": 4.0,
}  # of the prior, by the truth


def wrong_spec() -> ImuSpec:
    sensors = {
        name: replace(
            getattr(drives.SPEC, name),
            **{key: getattr(getattr(drives.SPEC, name), key) * OFF[f"{name}.{key}"] for key in KEYS},
        )
        for name in ("gyro", "accel")
    }
    return replace(drives.SPEC, **sensors)


def prepared(imu: ImuData, gps: GpsData, spec: ImuSpec, seed: int, laps: int = LAPS) -> FilterInput:
    model = error_model(spec, 21)
    start = drives.begin(model, np.random.default_rng([5, seed]), laps)
    return drives.ready(imu, gps, start, model, gates=drives.UNFAILING)


def recorded(seed: int, errors: GpsErrors | None = None, laps: int = LAPS) -> tuple[ImuData, GpsData]:
    rng = np.random.default_rng([31, seed])
    imu = drives.noisy_imu(drives.perfect_imu(laps=laps), drives.MODEL, rng)
    gps = drives.perfect_gps(laps=laps)
    return imu, drives.noisy_gps(gps, rng) if errors is None else corrupt_gps(gps, errors, seed)


def settled_attitude(ready: FilterInput) -> FloatArray:
    """Mean roll, pitch and heading after a quarter of a drive."""
    navigator = Navigator(ready)
    navigator.feed(ready.imu)
    rph = np.unwrap(navigator.finish().solution.rph, axis=0)
    return np.asarray(rph[rph.shape[0] // 4 :].mean(axis=0))


def random_run(rng: np.random.Generator, n: int, m: int) -> tuple[FloatArray, ...]:
    """Epochs of no filter in particular: some with a position, some with a position and a velocity, some with none."""
    span = np.where(np.arange(m) == 0, 0.0, rng.uniform(0.1, 1.0, m))
    kind = np.array([0, 7, 63, 7, 0, 56] * m)[:m]
    phi = np.zeros((m, 9, 21))
    phi[:, :, :9] = np.eye(9)
    phi += 0.1 * rng.standard_normal(phi.shape)
    root = 0.3 * rng.standard_normal((m, 2, 9, 9))
    white = root @ np.swapaxes(root, 2, 3)
    bridge = rng.uniform(0.0, 0.1, (m, 9))
    z, h = rng.standard_normal((m, 6)), rng.standard_normal((m, 6, n))
    fed = 0.1 * rng.standard_normal((m, n)) * (kind[:, None] > 0)
    share, correction = rng.uniform(0.0, 1.0, (m, 2)), rng.standard_normal((m, 2, 12))
    drawn = np.where(rng.random((m, 1, 3)) < 0.2, rng.uniform(0.0, 1.0, (m, 2, 3)), np.nan)
    return span, kind, phi, white, share, bridge, z, h, fed, correction, np.zeros((m, kernel.OPENED)), drawn


def test_the_likelihood_is_that_of_a_textbook_filter():
    """Brown and Hwang, Random Signals and Applied Kalman Filtering, with a known input, all rows at once."""
    rng = np.random.default_rng(3)
    n, m, lasting = 28, 40, 22
    run = random_run(rng, n, m)
    span, kind, phi, white, share, bridge, z, h, fed, correction, _, drawn = run
    decay = rng.uniform(0.0, 0.1, 12)
    density, driving = rng.uniform(0.1, 1.0, 4), rng.uniform(0.1, 1.0, 12)
    sd, time = rng.uniform(0.5, 0.9, 6), np.repeat([3.0, 7.0], 3)
    variance = rng.uniform(0.5, 2.0, (m, 6))
    root, first = rng.standard_normal((n, n)), rng.standard_normal(n)
    out = np.empty((3, 6 * m))
    push = rng.standard_normal((2, m, 9))
    pushed = push.copy()
    count = kernel.innovations(
        run, density, driving, decay, lasting, sd, time, variance, (first, root @ root.T), push, 1e9, out
    )
    found = np.sum(np.log(out[1, :count]) + out[0, :count] ** 2 / out[1, :count])

    slope = np.sum(2.0 * out[0, :count] * out[2, :count] / out[1, :count])

    mean, by, p, total, by_push, rows = first, np.zeros(n), root @ root.T, 0.0, 0.0, 0
    bias, unknown = np.zeros((2, 3)), np.ones(3)  # of gyros, and its variance
    for k in range(m):
        dt = span[k]
        if dt > 0.0:
            f, q = np.eye(n), np.zeros((n, n))
            f[:9, :21] = phi[k]
            f[np.arange(9, 21), np.arange(9, 21)] = np.exp(-decay * dt)
            fade = np.exp(-dt / time)
            f[lasting:, lasting:], q[lasting:, lasting:] = np.diag(fade), np.diag((1.0 - fade**2) * sd**2)
            for i in range(3):
                q[3 + i, 3 + i] += bridge[k, i]
                q[6 + i, 6 + i] += bridge[k, 3 + i]
            q[:9, :9] += np.einsum("g,gij->ij", density[:2] + density[2:] * share[k], white[k])
            q[9:21, 9:21] = np.diag(driving * dt)
            moved, tilted, more_tilted = bridge[k, 6:]
            spread = p[8, 8] + mean[8] ** 2
            q[3:5, 3:5] += moved * np.eye(2) * (1.5 - 2.0 * np.exp(-spread / 2.0) + 0.5 * np.exp(-2.0 * spread))
            q[12:15, 12:15] += (tilted * np.trace(p[12:15, 12:15]) + more_tilted) * np.eye(3)
            q[:9, 9:21] = 0.5 * dt * phi[k][:, 9:] * driving
            q[9:21, :9] = q[:9, 9:21].T
            known, more = np.concatenate([pushed[:, k], np.zeros((2, n - 9))], axis=1)
            known[9:21] = correction[k, 0] - np.exp(-decay * dt) * (correction[k - 1, 1] if k else 0.0)
            mean, by, p = f @ mean + known, f @ by + more, f @ p @ f.T + q
            unknown += dt * driving[:3]
            for j in np.flatnonzero(~np.isnan(drawn[k, 0])):  # bias regressed on the sum of bias and rounding error
                both = np.array([[unknown[j], unknown[j]], [unknown[j], unknown[j] + drawn[k, 0, j]]])
                gain, rest = both[0, 1] / both[1, 1], both[0, 0] - both[0, 1] ** 2 / both[1, 1]
                to, used = np.eye(n), correction[k, 0, j]
                to[9 + j, 9 + j] = gain
                bias[:, j] += gain * (np.array([mean[9 + j] - used, by[9 + j]]) - bias[:, j])
                mean, by, p = mean.copy(), by.copy(), to @ p @ to
                mean[9 + j], by[9 + j] = bias[:, j] + [used, 0.0]
                unknown[j] = p[9 + j, 9 + j] + rest
                p[9 + j, 9 + j] = unknown[j] + drawn[k, 1, j]
        used = [i for i in range(6) if kind[k] >> i & 1]
        if used:
            hk, r = h[k][used], np.diag(variance[k, used])
            s = hk @ p @ hk.T + r
            e = z[k, used] - hk @ mean
            total += np.linalg.slogdet(s)[1] + e @ np.linalg.solve(s, e)
            by_push -= 2.0 * e @ np.linalg.solve(s, hk @ by)
            gain = p @ hk.T @ np.linalg.inv(s)
            keep = np.eye(n) - gain @ hk
            mean, by, p = mean + gain @ e - fed[k], keep @ by, keep @ p @ keep.T + gain @ r @ gain.T
            rows += len(used)
        np.testing.assert_allclose(push[:, k], [mean[:9], by[:9]], rtol=1e-9, atol=1e-9)
    assert count == rows
    assert (found, slope) == pytest.approx((total, by_push), rel=1e-9)


@pytest.mark.parametrize(("of_velocities", "coarse"), [(False, False), (True, False), (False, True)])
def test_with_its_own_noise_the_innovations_are_those_of_the_filter(of_velocities, coarse):
    imu, gps = recorded(1, GpsErrors((0.5, 0.5, 1.0), (1.0, 1.0, 1.5), 40.0, (0.1, 0.1, 0.15)), laps=4)
    ready = prepared(imu, gps, drives.SPEC, 1, laps=4)
    if coarse:
        sizes = itertools.pairwise(1e-6 * np.random.default_rng(2).uniform(0.0, 1.0, (12, 3)))
        rounding = tuple(RoundingChange(float(gps.time[20 + 15 * i]), *each) for i, each in enumerate(sizes))
        ready = replace(ready, rounding=rounding)
    drive = InnovationLikelihood(ready, drives.SPEC)
    if of_velocities:
        drive = drive.with_correlated_velocities()
    at = np.array([p.middle for p in drive.parameters])
    innovation, variance = drive.normalised(at)
    correlated = drive.fixes_of(at)[2]
    assert correlated.sds.size == 3 + 3 * of_velocities
    navigator = Navigator(ready.replace_correlated(correlated))
    navigator.feed(imu)
    run = navigator.finish()
    assert run.innovations.used_position.all()
    first = innovation.reshape(-1, 6)[:, 0]  # of each fix, north; those after it know it
    scale = np.sqrt(variance.reshape(-1, 6)[:, 0])
    np.testing.assert_allclose(scale, run.innovations.sd[:, 0], rtol=0.02)
    # the filter linearises about another trajectory
    assert np.std(first + run.innovations.innovation[:, 0]) < 0.02 * np.std(first)


@pytest.fixture(scope="module")
def epochs() -> tuple[FloatArray, int, FloatArray]:
    """History of a lap with misalignments in the model, number of states, and noise of the run."""
    sensors = {name: replace(getattr(drives.SPEC, name), misalignment=np.full(3, 8e-3)) for name in ("gyro", "accel")}
    ready = prepared(*recorded(1, laps=1), replace(drives.SPEC, **sensors), 1, laps=1)
    navigator = Navigator(ready.keep_history())
    navigator.feed(ready.imu)
    return navigator.history().rows(), layout(ready.receiver).states, ready.model.noise


def test_a_bridged_span_shows_no_misalignment(epochs):
    """All noise of attitude beyond white noise is from misalignments, or of the gap; the first epoch ends no span."""
    rows, noise = epochs[0], epochs[2]
    at, bridged = 30, np.zeros(len(epochs[0]), bool)
    span, _, _, _, share, bridge, *_ = kernel.tape(*epochs, bridged)
    bridged[at] = True
    _, _, _, _, other, gap, *_ = kernel.tape(*epochs, bridged)
    assert (share[1:] > 0.0).all()
    assert not share[0].any()
    assert not other[at].any()
    assert not bridge[:, :6].any()
    assert gap[at, 3:6].sum() == pytest.approx(3.0 * noise[18] * share[at, 0] * span[at], rel=1e-6)
    kept = np.arange(len(rows)) != at
    np.testing.assert_array_equal(other[kept], share[kept])


def test_a_tilt_correction_counts_in_the_next_span_only(epochs):
    rows, at = epochs[0].copy(), 30
    rows[np.arange(len(rows)) != at, RESIDUAL : RESIDUAL + 6] = 0.0
    fed, squares = (kernel.tape(rows, *epochs[1:], np.zeros(len(rows), bool))[i] for i in (8, 5))
    assert np.flatnonzero(fed.any(axis=1)).tolist() == [at]
    assert np.flatnonzero(squares[:, 7]).tolist() == [at + 1]
    assert squares[at + 1, 7] == pytest.approx(np.sum(fed[at, 6:8] ** 2))
    assert squares[at + 1, 8] == pytest.approx(np.sum(fed[at, 6:8] ** 2) * np.sum(fed[at, 12:15] ** 2))


def test_the_beginning_of_a_drive_has_the_first_of_its_innovations():
    imu, gps = recorded(1, laps=4)
    drive = InnovationLikelihood(prepared(imu, gps, drives.SPEC, 1, laps=4), drives.SPEC)
    at = np.array([p.middle for p in drive.parameters])
    whole, part = drive.normalised(at), drive.beginning(100.0).normalised(at)
    assert 0.9 * 6 * 100 < part[0].size * (gps.time[1] - gps.time[0]) <= 6 * 100
    for all_of_them, first in zip(whole, part, strict=True):
        np.testing.assert_array_equal(all_of_them[: first.size], first)


@pytest.mark.parametrize(("rate", "between"), [(1, [1.0]), (5, [0.2, 1.6])])
def test_fixes_that_are_looked_at_come_in_pairs_once_a_second_on_average(rate, between):
    time = np.arange(0.0, 90.0, 1.0 / rate)
    three = np.zeros((time.size, 3))
    found = thinned(GpsData(time, three, three, three, three)).time
    assert np.unique(np.diff(found).round(6)) == pytest.approx(between)
    assert found.size == pytest.approx(90.0 / np.mean(between), abs=2.0)


def test_memory_that_nothing_was_written_to_is_not_looked_at(monkeypatch):
    def poisoned(shape, dtype=np.float64):
        signalling = np.full(shape, 0x7FF4000000000000, np.int64)  # a NaN of which every sum warns
        return signalling.view(np.float64) if dtype is np.float64 else np.zeros(shape, dtype)

    imu, gps = recorded(1, laps=4)
    gap = np.abs(np.arange(gps.time.size) - 100) > 10  # epochs without a measurement
    ready = prepared(imu, gps.rows(gap), drives.SPEC, 1, laps=4)
    monkeypatch.setattr("insnav.filter.smoother.spill.empty", poisoned)
    drive = InnovationLikelihood(ready, drives.SPEC)
    at = np.array([p.middle for p in drive.parameters])
    with np.errstate(invalid="raise"):
        assert np.isfinite(drive.normalised(at)).all()


@pytest.fixture(scope="module")
def found() -> list[NoiseEstimate]:
    estimates = []
    for seed in range(4):
        imu, gps = recorded(seed)
        estimate = identify_noise(prepared(imu, gps, wrong_spec(), seed), wrong_spec())
        assert estimate is not None
        estimates.append(estimate)
    return estimates


def test_known_densities_are_found_within_their_intervals(found):
    inside, seen = [], set()
    for estimate in found:
        for figure in estimate.figures:
            if figure.key in OFF and figure.observable:
                inside.append(figure.low <= figure.prior / OFF[figure.key] <= figure.high)
                seen.add(figure.key)
    assert seen >= {"gyro.bias_instability", "gyro.random_walk", "accel.scale_factor"}
    assert len(inside) > 10
    assert np.mean(inside) >= 0.85  # 95 % of them, by chance a few less


def precise(laps: int) -> tuple[InnovationLikelihood, ImuData]:
    """Fixes that drift by decimetres, with millimetres of scatter, whose stated sd is metres."""
    imu, gps = recorded(2, GpsErrors((0.002, 0.002, 0.004), (0.5, 0.5, 1.0), 900.0, (0.05, 0.05, 0.05)), laps=laps)
    gps = replace(gps, position_sd=np.full_like(gps.lla, 1.5))
    return InnovationLikelihood(prepared(imu, gps, drives.SPEC, 2, laps=laps), drives.SPEC), imu


def test_the_search_ends_where_the_cost_is_flat():
    """The maximum is sharp. Central differences with small steps give the gain that Newton's method expects there."""
    posterior = Posterior([precise(laps=8)[0]])
    top, _, seen = posterior.climb(_begun(posterior))
    steps = 1e-4 * np.eye(top.size)
    up, down = (np.array([posterior.innovations(top + sign * step)[2] for step in steps]) for sign in (1.0, -1.0))
    slope, curvature = (up - down) / 2e-4, (up + down - 2.0 * seen[2]) / 1e-8
    sharp = curvature > 1.0
    assert curvature.max() > 2e3  # a difference of costs over a step of the search contains 10 of it
    assert np.max(0.5 * slope[sharp] ** 2 / curvature[sharp]) < ENOUGH


def test_the_prior_of_the_share_is_that_of_jeffreys():
    share = np.random.default_rng(3).beta(0.5, 0.5, 1_000_000)
    share = share[(share > 0.0) & (share < 1.0)]
    assert np.std(np.log(share) - np.log1p(-share)) == pytest.approx(SHARE[1], rel=0.01)


def test_another_kind_of_imu_is_not_kept_if_it_explains_less(monkeypatch):
    imu, gps = recorded(1, laps=4)
    drive = InnovationLikelihood(prepared(imu, gps, drives.SPEC, 1, laps=4), drives.SPEC)
    sensors = (replace(each, random_walk=30.0 * each.random_walk) for each in (drives.SPEC.gyro, drives.SPEC.accel))
    noisy = ImuSpec("far too noisy", *sensors)
    monkeypatch.setattr("insnav.filter.noise_identification.kind_of", lambda found, kinds: kinds[0])
    assert identify([drive], [noisy]).seen[0].prior is drives.SPEC


def test_white_fixes_stay_white_and_keep_their_size(found):
    true = drives.perfect_gps(laps=LAPS).lla
    for seed, estimate in enumerate(found):
        gps = recorded(seed)[1]
        north, east, down = np.mean((ned_offset(gps.lla, true) / gps.position_sd) ** 2, axis=0)
        size = np.sqrt([(north + east) / 2.0, (north + east) / 2.0, down])  # of the errors these fixes have
        np.testing.assert_allclose(estimate.position_factor, size, atol=0.05)
        np.testing.assert_allclose(estimate.velocity_factor, 1.0, atol=0.05)
        assert estimate.correlated.share < 0.1
        value = {figure.key: figure.value for figure in estimate.figures}  # as used, and as told in notes
        assert value["gps.horizontal"] == pytest.approx(estimate.position_factor[0])
        assert value["gps.correlation_time"] == pytest.approx(estimate.correlated.time)
        assert estimate.gain > 10.0
        assert estimate.mean_after == pytest.approx(1.0, abs=0.05)


def test_time_correlated_errors_are_found_without_velocities():
    errors = GpsErrors((0.5, 0.5, 1.0), (1.2, 1.2, 2.4), 60.0)
    imu, gps = recorded(3, errors)
    n = gps.time.size
    sd = np.tile(errors.position_sd, (n, 1))
    gps = replace(gps, v_n=np.full((n, 3), np.nan), velocity_sd=np.full((n, 3), np.nan), position_sd=sd)
    estimate = identify_noise(prepared(imu, gps, drives.SPEC, 3), drives.SPEC)
    assert estimate is not None
    assert estimate.correlated.share == pytest.approx(1.2**2 / 1.3**2, abs=0.06)
    assert estimate.correlated.time == pytest.approx(60.0, rel=0.5)


def test_the_white_part_of_fast_fixes_is_as_small_as_it_is():
    """Five fixes a second, wrong by a metre for minutes, alike to 8 mm: five per cent white would be 0.22 m."""
    errors = GpsErrors((0.008, 0.008, 0.016), (1.0, 1.0, 2.0), 300.0)
    imu = recorded(3, laps=4)[0]
    gps = corrupt_gps(drives.perfect_gps(0.2, laps=4), errors, 3)
    gps = replace(gps, position_sd=np.tile(errors.position_sd, (gps.time.size, 1)))
    estimate = identify_noise(prepared(imu, gps, drives.SPEC, 3, laps=4), drives.SPEC)
    assert estimate is not None
    white = np.sqrt(1.0 - estimate.correlated.share) * estimate.position_factor * errors.position_sd
    assert (white > 0.5 * np.array(errors.position_noise)).all()
    assert (white < 2.5 * np.array(errors.position_noise)).all()  # 0.014 m: the prior is of a larger one


def test_a_share_that_is_the_largest_has_finite_log_odds():
    imu, gps = recorded(2, laps=2)
    ready = prepared(imu, gps, drives.SPEC, 2, laps=2)
    ready = ready.replace_correlated(CorrelatedNoise(0.95, 300.0, np.ones(3)))
    seen = known_likelihood(ready, drives.SPEC)  # a division by zero
    assert seen is not None
    found = seen[0].fixes_of(seen[1])[2]
    assert found.share == pytest.approx(0.95, abs=1e-5)
    assert found.time == pytest.approx(300.0)


def test_velocities_that_are_off_for_minutes_do_not_lead_heights_away():
    """Rising by 0.15 m/s for a hundred seconds: integrated, that is more than the heights of the fixes are off."""
    imu, gps = recorded(4)
    off = gauss_markov(np.random.default_rng(4), gps.time, np.full(3, 0.15), 100.0)
    gps = replace(gps, v_n=gps.v_n + off)
    ready = prepared(imu, gps, drives.SPEC, 4)
    estimate = identify_noise(ready, drives.SPEC)
    assert estimate is not None
    assert estimate.correlated.velocity_sd is not None
    np.testing.assert_allclose(estimate.correlated.velocity_sd, 0.15, rtol=0.4)
    assert estimate.correlated.velocity_time == pytest.approx(100.0, rel=0.6)
    ready, _ = with_noise(ready, estimate)
    navigator = Navigator(ready)
    navigator.feed(imu)
    found = navigator.finish().smoothed.solution
    error = found.lla[:, 2] - drives.truth(LAPS).evaluate(found.time).lla[:, 2]
    assert np.sqrt(np.mean(error**2)) < 0.6
    assert np.mean(np.abs(error) < 3.0 * found.sd[:, 2]) > 0.97


def test_errors_that_last_as_long_as_the_drive_are_stated_as_large_as_they_may_be():
    """Of ten simulated drives in a city, none with any option, the one whose fixes are off by most, 5 m in height."""
    drive = insnav.simulate("city", imu="automotive", seed=8)
    run, true = insnav.load(drive.imu.data, gps=drive.gps.data).navigate(output_interval=1.0).found.run, drive.reference
    for each in (run.solution, run.smoothed.solution):
        settled = each.rows(slice(60, -1))
        lla = np.column_stack([np.interp(settled.time, true.data.time, column) for column in true.data.lla.T])
        assert np.mean(np.abs(ned_offset(settled.lla, lla)) < 3.0 * settled.sd[:, :3]) > 0.97


def test_false_fixes_do_not_decide():
    imu, gps = recorded(2)
    rng = np.random.default_rng(8)
    false = rng.random(gps.time.size) < 0.02
    lla = gps.lla.copy()
    lla[false, :2] += rng.standard_normal((false.sum(), 2)) * 30.0 / 6.4e6
    spoilt = identify_noise(prepared(imu, replace(gps, lla=lla), wrong_spec(), 2), wrong_spec())
    clean = identify_noise(prepared(imu, gps, wrong_spec(), 2), wrong_spec())
    assert spoilt is not None
    assert clean is not None
    np.testing.assert_allclose(spoilt.position_factor, clean.position_factor, rtol=0.1)
    ratio = spoilt.spec.gyro.bias_instability / clean.spec.gyro.bias_instability
    np.testing.assert_allclose(ratio, 1.0, atol=0.2)


def test_the_filter_is_set_up_with_what_was_found(found):
    imu, gps = recorded(0)
    ready = prepared(imu, gps, wrong_spec(), 0)
    after, _ = with_noise(ready, found[0])
    np.testing.assert_allclose(after.model.noise, error_model(found[0].filter_spec, 21).noise)
    np.testing.assert_allclose(after.gps.position_sd, gps.position_sd * found[0].position_factor)
    # attitude and position at the start do not depend on the IMU where the start was given
    np.testing.assert_allclose(np.diag(after.initial.covariance)[6:9], drives.START_SD[6:] ** 2, rtol=1e-6)


@pytest.mark.parametrize(("true", "low", "high"), [(8e-3, 0.4, 2.5), (0.0, 0.0, 0.3)])
def test_the_size_of_misalignments_is_found_and_the_axes_are_no_surer(true, low, high):
    """Constants, which are noise for the filter; 8 mrad in the specification, one size for all in the truth.

    None at all, where 8 mrad are usual, is less likely than 2: what no drive tells may be there.
    """
    sensors = {name: replace(getattr(drives.SPEC, name), misalignment=np.full(3, 8e-3)) for name in ("gyro", "accel")}
    spec, sizes, off = replace(drives.SPEC, **sensors), [], []
    for seed in range(4):
        imu, gps = recorded(seed, laps=8)
        rng = np.random.default_rng([9, seed])
        gyro, accel = (np.eye(3) + true * rng.standard_normal((3, 3)) * (1.0 - np.eye(3)) for _ in range(2))
        exact = prepared(imu, gps, spec, seed, laps=8)
        ready = replace(exact, imu=replace(imu, gyro=imu.gyro @ gyro.T, accel=imu.accel @ accel.T))
        estimate = identify_noise(ready, spec)
        assert estimate is not None
        assert (estimate.axes.evidence > 0.0) == (true > 0.0)
        size = estimate.spec.gyro.misalignment / 8e-3
        after, _ = with_noise(ready, estimate)
        assert np.all(estimate.axes.attitude_sd < 8e-3 * size)
        off.append(np.abs(settled_attitude(after) - settled_attitude(exact)) / after.model.axes_sd)
        assert np.all(level_bias(estimate.spec.accel) > 0.999 * level_bias(estimate.filter_spec.accel))
        sizes.append(float(size[0]))
    assert low < np.sqrt(np.mean(np.square(sizes))) < high, sizes
    assert true == 0.0 or np.mean(np.square(off)) < 1.25, off


def test_what_a_misalignment_does_is_what_the_regression_says():
    """Simulated with 5 mrad of z in the rate of y, the regression finds it."""
    imu, gps = recorded(5, laps=8)
    turned = np.eye(3)
    turned[1, 2] = 5e-3
    slopes, attitudes = [], []
    for each in (imu, replace(imu, gyro=imu.gyro @ turned.T)):
        ready = prepared(each, gps, drives.SPEC, 5, laps=8)
        drive = InnovationLikelihood(ready, drives.SPEC)
        fisher, slope, does, _ = drive.by_axes(np.array([p.middle for p in drive.parameters]))
        slopes.append(slope)
        attitudes.append(settled_attitude(ready))
    row = noise_estimate.TERMS.index((1, 2))
    # the regression says what the filter itself does: an attitude that is off by most of the term
    np.testing.assert_allclose(attitudes[1] - attitudes[0], 5e-3 * does[row].mean(axis=0), atol=0.1 * 5e-3)
    assert np.abs(does[row].mean(axis=0)).max() > 0.5
    np.testing.assert_allclose(slopes[1] - slopes[0], 5e-3 * fisher[row], atol=0.1 * 5e-3 * fisher[row, row])


def test_false_fixes_that_reset_the_filter_do_not_make_it_forget_the_axes():
    """At rest after a reset, what a misalignment had done seemed nothing, and no attitude was as sure as stated."""
    imu, gps = recorded(5, laps=8)
    false = (gps.time > gps.time[0] + 60.0) & (gps.time < gps.time[0] + 80.0)
    false_lla = lla_offset(gps.lla, np.array([40.0, -30.0, 20.0]))
    ready = prepared(imu, replace(gps, lla=np.where(false[:, None], false_lla, gps.lla)), drives.SPEC, 5, laps=8)
    ready = replace(ready, gates=Gates())
    assert InnovationLikelihood(ready, drives.SPEC).reset
    drive, at = known_likelihood(ready, drives.SPEC)
    assert not drive.reset
    does = drive.by_axes(at)[2]
    assert np.abs(does[noise_estimate.TERMS.index((1, 2))].mean(axis=0)).max() > 0.5


@pytest.mark.parametrize(("together", "plain"), [(1, 1.0), (12, 12.0)])
def test_innovations_that_err_together_say_less_of_the_axes(together, plain):
    """Errors that come as many at a time, as in multipath: squares of what is found wrong, by those that are stated."""
    rng = np.random.default_rng(8)
    n, sd, squares = 2400, np.full(4, 0.01), []
    for _ in range(200):
        by = 30.0 * np.repeat(rng.standard_normal((4, n // 12)), 12, axis=1)
        error = np.repeat(rng.standard_normal(n // together), together)
        truth = sd * rng.standard_normal(4)
        innovation, before = error - truth @ by, np.diag(sd**-2.0)
        said = noise_estimate.informed(innovation, by, np.ones(n), sd)
        squares.append([])
        for fisher, slope in (said, (by @ by.T, -by @ innovation)):
            off = np.linalg.solve(fisher + before, slope) - truth
            squares[-1].append(off @ (fisher + before) @ off / 4.0)
    mean, mean_plain = np.mean(squares, axis=0)
    print(f"{mean:.2f} times those stated, without that {mean_plain:.2f}")
    assert mean_plain == pytest.approx(plain, rel=0.3)
    assert 0.8 < mean < 1.6


@pytest.mark.parametrize("prior_sd", [0.0, 1.0])
def test_the_size_is_averaged_over_what_is_plausible(prior_sd):
    """Exact: terms seen without error; the posterior of one size is an integral that is done here by quadrature."""
    x = np.array([0.3, -1.2, 0.5])
    fisher, slope = np.diag(np.full(3, 1e8)), 1e8 * x
    found = noise_estimate.misalignment(fisher, slope, np.ones((3, 1, 3)), np.ones(3), prior_sd)
    np.testing.assert_allclose(found.terms, x, rtol=1e-6)
    np.testing.assert_allclose(found.attitude, x.sum(), rtol=1e-6)
    assert (found.attitude_sd < 1e-3).all()
    if prior_sd == 0.0:
        assert found.size == (1.0, 1.0, 1.0)
        variance = np.array([1e-8, 1.0 + 1e-8])[:, None]  # of what is seen, without misalignments and with them
        log = -0.5 * np.sum(x**2 / variance + np.log(variance), axis=1)
        assert found.evidence == pytest.approx(log[1] - log[0], rel=1e-6)
        return
    k = np.exp(np.linspace(-6.0, 6.0, 20001))
    density = k**-3.0 * np.exp(-0.5 * np.sum(x**2) / k**2 - 0.5 * np.log(k) ** 2)  # by log k
    rms, low, high = found.size
    assert rms == pytest.approx(np.sqrt(np.sum(density * k**2) / np.sum(density)), rel=0.01)
    assert low < np.sqrt(np.mean(x**2)) < high


def test_what_no_drive_tells_stays_as_specified():
    """Each term turns all three angles by as much: their variances add up."""
    found = noise_estimate.misalignment(np.zeros((4, 4)), np.zeros(4), np.ones((4, 5, 3)), np.full(4, 2e-3), 0.0)
    np.testing.assert_allclose(found.attitude_sd, 2e-3 * np.sqrt(4.0))
    assert not found.terms.any()


def test_samples_lose_what_misalignments_make_of_them_beside_a_bias():
    rng = np.random.default_rng(4)
    imu = recorded(5, laps=1)[0]
    terms = 5e-3 * rng.standard_normal(12)
    turned = []
    for k, values in enumerate((imu.gyro, imu.accel)):
        askew = np.zeros((3, 3))
        askew[tuple(np.transpose(noise_estimate.TERMS))] = terms[6 * k : 6 * k + 6]
        turned.append(values + values @ askew.T)
    found = noise_estimate.Misalignment((1.0, 1.0, 1.0), terms, np.zeros(3), np.zeros(3), 1.0)
    mended = found.corrected(replace(imu, gyro=turned[0], accel=turned[1]))
    for each, true, askew in ((mended.gyro, imu.gyro, turned[0]), (mended.accel, imu.accel, turned[1])):
        assert np.std(each - true, axis=0).max() < 0.02 * np.std(askew - true, axis=0).max()
    # a mean rate, too: the biases of good gyros are far smaller than what is made of it
    np.testing.assert_allclose(
        mended.gyro.sum(axis=0), imu.gyro.sum(axis=0), atol=0.02 * np.abs(imu.gyro.sum(axis=0)).max() * 5e-3
    )


def test_a_run_that_is_far_off_is_run_again_with_the_noise_it_showed():
    """In-run biases a hundred times those of the preset turn the heading by tens of degrees."""
    gyro = drives.SPEC.gyro
    far = replace(drives.SPEC, gyro=replace(gyro, bias_instability=100.0 * gyro.bias_instability))
    imu = drives.noisy_imu(drives.perfect_imu(laps=8), error_model(far, 21), np.random.default_rng([31, 2]))
    ready = prepared(imu, recorded(2, laps=8)[1], drives.SPEC, 2, laps=8)
    first = InnovationLikelihood(ready, drives.SPEC)
    once, found = maximise([first]), identify_noise(ready, drives.SPEC)
    assert found is not None
    assert once.far_off
    widths = []
    for estimate in (once, found):
        (figure,) = (each for each in estimate.figures if each.key == "gyro.bias_instability")
        assert figure.low < 100.0 * figure.prior < figure.high
        widths.append(np.log(figure.high / figure.low))
    assert widths[1] < 0.8 * widths[0]


def test_no_figure_is_larger_than_any_sensor_has():
    """Where a gyro was off for a while a search ended at accelerometer biases of 4e6 m/s^2."""
    imu, gps = recorded(1, laps=4)
    one = np.ones(3)
    sensors = {
        name: SensorSpec(
            random_walk=1e-3 * one,
            bias=0.5 * LARGEST["bias"][name] * one,
            scale_factor=2.0 * one,
            misalignment=0.01 * one,
        )
        for name in ("gyro", "accel")
    }
    spec = ImuSpec("of any kind", **sensors)
    drive = InnovationLikelihood(prepared(imu, gps, spec, 1, laps=4), spec)
    larger = drive.spec(np.full(len(drive.parameters), 15.0))
    for name in ("gyro", "accel"):
        found = getattr(larger, name)
        np.testing.assert_array_equal(found.bias, LARGEST["bias"][name])
        np.testing.assert_array_equal(found.misalignment, LARGEST["misalignment"][name])
        np.testing.assert_array_equal(found.scale_factor, 2.0)  # as the preset has it
        assert found.random_walk[0] == pytest.approx(1e-3 * np.exp(15.0))


def test_the_kind_of_imu_is_that_whose_figures_the_drive_shows():
    """Whether it is taken for one with errors thirty times as large, or may be one."""
    imu, gps = recorded(1, laps=4)
    worse = replace(
        drives.SPEC,
        **{
            name: replace(sensor, **{key: 30.0 * getattr(sensor, key) for key in KEYS})
            for name, sensor in (("gyro", drives.SPEC.gyro), ("accel", drives.SPEC.accel))
        },
    )
    for taken, other in ((worse, drives.SPEC), (drives.SPEC, worse)):
        estimate = identify_noise(prepared(imu, gps, taken, 1, laps=4), taken, (other,))
        assert estimate is not None
        assert estimate.seen is not None
        assert estimate.seen[0].prior is drives.SPEC


def test_a_short_drive_tells_little_and_a_shorter_one_nothing():
    imu, gps = recorded(0, laps=1)
    found = identify_noise(prepared(imu, gps, drives.SPEC, 0, laps=1), drives.SPEC)
    assert found is not None
    for figure in found.figures:
        assert figure.low <= figure.prior <= figure.high or not figure.key.startswith(("gyro", "accel"))
    few = gps.rows(gps.time < gps.time[0] + 29.0)
    assert identify_noise(prepared(imu, few, drives.SPEC, 0, laps=1), drives.SPEC) is None


@pytest.mark.parametrize("velocities", [True, False])
@pytest.mark.parametrize("part", [5.0, 100.0])
def test_positions_far_worse_than_they_say_are_taken_for_what_they_are(part, velocities):
    """White and lasting errors both: of the latter the innovations of ten minutes show next to nothing."""
    drive = insnav.simulate("city", imu="industrial", gps="single", seed=4)
    gps, true = drive.gps.data, drive.reference.data
    gps = replace(gps, position_sd=gps.position_sd / part)
    if not velocities:
        unknown = np.full_like(gps.v_n, np.nan)
        gps = replace(gps, v_n=unknown, velocity_sd=unknown)
    result = insnav.load(drive.imu.data, gps).navigate(output_interval=1.0)
    (warned,) = of_code(result.findings, Code.NOISE_SD_UNDERSTATED, Code.NOISE_SD_IMPLAUSIBLE)
    assert warned.severity is Severity.WARNING
    assert warned.code is (Code.NOISE_SD_IMPLAUSIBLE if part > NO_NOISE else Code.NOISE_SD_UNDERSTATED)
    assert warned["position_factor"] > warned["limit_factor"]
    at = result.found.run.smoothed.solution
    off = ned_offset(at.lla, np.column_stack([np.interp(at.time, true.time, column) for column in true.lla.T]))
    assert np.mean(np.abs(off) < 3.0 * at.sd[:, :3]) > 0.97
    assert np.median(at.sd[:, 0]) < 3.0  # of 1.5 m


def test_drives_of_one_imu_together_tell_more_than_one(found):
    pool = []
    for seed in range(4):
        imu, gps = recorded(seed)
        pool.append(InnovationLikelihood(prepared(imu, gps, wrong_spec(), seed), wrong_spec()))
    together = {figure.key: figure for figure in maximise(pool).figures}
    alone = {figure.key: figure for figure in found[0].figures}
    for key in ("gyro.random_walk", "gyro.bias_instability", "accel.bias_instability", "accel.scale_factor"):
        by_truth = together[key].value / together[key].prior * OFF[key]
        assert 0.7 < by_truth < 1.4
        widths = [np.log(each[key].high / each[key].low) for each in (together, alone)]
        assert widths[0] < 0.7 * widths[1]


@pytest.mark.parametrize("model", [None, "consumer"])
def test_where_rounding_decides_what_misalignments_do_the_drive_tells_no_noise(monkeypatch, model):
    """Consumer gyros at rest for five minutes, then RTK positions: effects of 1e20 m ended with a singular matrix."""
    plain = InnovationLikelihood.normalised

    def endless(self: InnovationLikelihood, at: FloatArray, push: FloatArray | None = None) -> FloatArray:
        found = plain(self, at, push)
        found[2:] *= 1e25
        return found

    monkeypatch.setattr(InnovationLikelihood, "normalised", endless)
    drive = insnav.simulate("bends", imu="consumer", gps="dgps", seed=3)
    found = insnav.load(drive.imu.data, drive.gps.data, imu=model).navigate().found
    assert found.noise is None
    sd = found.run.solution.sd
    assert sd is not None
    assert np.isfinite(sd).all()


def test_larger_misalignments_leave_the_bias_of_level_accelerometers() -> None:
    """What gravity adds through them is taken out of the bias: 9.8 m/s^2 times 1.5 mrad, of 0.04 m/s^2."""
    prior = ImuSpec("prior", SensorSpec(misalignment=1e-3 * np.ones(3)), SensorSpec(misalignment=1e-3 * np.ones(3)))
    found = replace(prior, accel=SensorSpec(bias=0.04 * np.ones(3)))
    turned = _turned(prior, found, 1.5).accel
    np.testing.assert_allclose(turned.misalignment, 1.5e-3)
    np.testing.assert_allclose(turned.bias**2, 0.04**2 - (9.80665 * 1.5e-3) ** 2, rtol=1e-9)


def test_one_false_fix_changes_no_standard_deviation():
    """A search that ended a standard deviation of its figures early gave 12 % less without the first fix."""
    made = plan_of(profiled("city", 51), {"imu": "automotive", "seed": 51}).measured()
    false = parse_fault("gps-spike:1100m@0s").apply(made.imu, made.gps)[1]
    first, second = (insnav.load(made.imu, gps).until("noise").ready.gps.position_sd for gps in (made.gps, false))
    np.testing.assert_allclose(np.median(second, axis=0), np.median(first, axis=0), rtol=0.05)


def test_the_search_crosses_a_barrier(monkeypatch):
    """Two minima of a cost, the lower one a factor of e away: the climb alone ends at the nearer one."""
    places = np.array([[0.0, 0.0], [1.1, 0.3]])

    def cost(at):
        far = np.sum((at - places) ** 2, axis=1)
        return float(min(far[0], 4.0 * far[1] - 5.0))

    def climb(_, at):
        nearest = places[int(np.argmin([np.sum((at - places[0]) ** 2), 4.0 * np.sum((at - places[1]) ** 2) - 5.0]))]
        return nearest, np.eye(2), (at, at, cost(nearest))

    monkeypatch.setattr(Posterior, "climb", climb)
    monkeypatch.setattr(Posterior, "_side_by_side", lambda _, cases: [(at, at, cost(at)) for at in cases])
    search = Posterior.__new__(Posterior)
    assert climb(search, np.array([-1.0, 0.0]))[2][2] == 0.0
    np.testing.assert_array_equal(search.find_top(np.array([-1.0, 0.0]))[0], places[1])
    monkeypatch.setattr(Posterior, "_side_by_side", lambda _, cases: [(at, at, np.nan) for at in cases])
    np.testing.assert_array_equal(search.find_top(np.array([-1.0, 0.0]))[0], places[0])  # where costs are no numbers
