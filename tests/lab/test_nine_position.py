"""Nine positions of simulated modules: recovered within the printed uncertainty, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from insnav.exceptions import InputError
from insnav.lab.calibration import BenchOptions
from insnav.lab.nine_position import AXIS, SENSORS, NinePositions, calibrate_nine, fit, ideal_force, read
from tests.lab.modules import NINE, UPRIGHT, G, Modules, make
from tests.refusals import refused

SEEDS = 200
OFF = ~np.eye(3, dtype=bool)


def solve(modules: Modules, noise: float, rng: np.random.Generator, positions: np.ndarray = NINE) -> NinePositions:
    return calibrate_nine(*positions.T, modules.measure(positions, noise, rng), G)


def true_triad(modules: Modules) -> np.ndarray:
    a = modules.accel
    return 0.5 * np.array([a[3] + a[4], a[0] + a[5], a[1] + a[2]])


def true_gyro(modules: Modules) -> np.ndarray:
    return modules.gyro / np.diag(modules.gyro)[:, None]


@pytest.mark.parametrize(
    ("positions", "seeds"), [(NINE, SEEDS), (np.vstack((NINE, UPRIGHT)), SEEDS // 2)], ids=["nine", "nine and upright"]
)
def test_everything_is_recovered_within_the_printed_interval(positions: np.ndarray, seeds: int) -> None:
    rng = np.random.default_rng(1)
    inside = {"bias": [], "accel": [], "gyro": []}
    for _ in range(seeds):
        modules = make(rng, 0.002, 0.002)
        found = solve(modules, 0.005, rng, positions)
        inside["bias"].append(np.abs(found.bias - modules.bias) < found.half_width(found.bias_sd, first_order=False))
        error = found.accel_matrix - true_triad(modules)
        inside["accel"].append(np.abs(error) < found.half_width(found.accel_matrix_sd, first_order=False))
        error = found.gyro_matrix - true_gyro(modules)
        inside["gyro"].append((np.abs(error) < found.half_width(found.gyro_matrix_sd, first_order=True))[OFF])
    for name, hits in inside.items():
        share = np.mean(hits, axis=0)
        # neither too narrow nor too wide; the mean scatters with the number of seeds
        assert np.mean(share) == pytest.approx(0.95, abs=0.025 * np.sqrt(SEEDS / seeds)), name
        assert share.min() > 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / seeds), name


def test_large_misalignments_stay_within_the_interval_for_second_order() -> None:
    rng = np.random.default_rng(2)
    hits = []
    for _ in range(SEEDS // 3):
        modules = make(rng, 0.02, 0.005)
        found = solve(modules, 0.002, rng)
        error = np.abs(found.gyro_matrix - true_gyro(modules))
        hits.append((error < found.half_width(found.gyro_matrix_sd, first_order=True))[OFF])
    assert np.mean(hits) > 0.95


def test_the_inverse_of_the_gyro_matrix_reduces_the_error_and_the_matrix_itself_doubles_it() -> None:
    rng = np.random.default_rng(3)
    modules = make(rng, 0.005, 0.003)
    found = solve(modules, 0.001, rng)
    rate = rng.normal(size=(100, 3))
    shown = rate @ modules.gyro.T
    before = np.linalg.norm(shown - rate)
    after = np.linalg.norm(np.linalg.solve(found.gyro_matrix, shown.T).T - rate)
    wrong = np.linalg.norm(shown @ found.gyro_matrix.T - rate)
    assert after < 0.1 * before
    assert wrong == pytest.approx(2.0 * before, rel=0.05)


def test_the_diagonal_holds_accelerometer_scale_and_is_not_used() -> None:
    rng = np.random.default_rng(4)
    modules = make(rng, 0.0, 0.0, bias=0.0)
    scaled = Modules(1.01 * modules.accel, modules.bias, modules.gyro)
    found = solve(scaled, 1e-9, rng)
    np.testing.assert_allclose(found.gyro_diagonal, 1.01**-2, rtol=1e-6)
    np.testing.assert_allclose(found.gyro_matrix, np.eye(3), atol=1e-6)


def test_opposite_positions_give_the_bias_where_there_are_some() -> None:
    rng = np.random.default_rng(5)
    modules = make(rng, 0.01, 0.01)
    values = modules.measure(np.vstack((NINE, UPRIGHT)), 0.001, rng)
    found = calibrate_nine(*np.vstack((NINE, UPRIGHT)).T, values, G)
    assert all(found.bias_opposite)
    np.testing.assert_allclose(found.bias[1], 0.5 * (values[0, 1] + values[9, 1]), atol=1e-12)  # level and upside down
    assert not any(solve(modules, 0.001, rng).bias_opposite)


def test_ideal_force_is_gravity_seen_from_the_body() -> None:
    np.testing.assert_allclose(
        ideal_force(*NINE.T, G),
        make(np.random.default_rng(0), 0.0, 0.0, 0.0).measure(NINE, 0.0, np.random.default_rng(0))[:, [3, 0, 1]],
        atol=1e-12,
    )


@pytest.mark.parametrize(
    ("positions", "code", "expected"),
    [
        (np.delete(NINE, 6, axis=0), "lab.positions_asymmetric", "35°/-40°"),
        (NINE[:5], "lab.positions_undetermined", "35°/35°"),
        (NINE[5:], "lab.positions_undetermined", None),
        (np.vstack((NINE, np.radians([(10, 0), (-10, 0)]))), "lab.table_angle", None),
    ],
)
def test_positions_that_do_not_do_are_refused(positions: np.ndarray, code: str, expected: str | None) -> None:
    rng = np.random.default_rng(6)
    with refused(InputError, code) as caught:
        solve(make(rng, 0.01, 0.01), 0.001, rng, positions)
    assert expected is None or expected in caught.value.values["positions"]


def test_what_is_told_to_add_is_enough() -> None:
    from insnav.lab.nine_position import _to_add

    for positions in (NINE[:5], NINE[5:], NINE[:1]):
        added = np.vstack((positions, np.radians(_to_add(*positions.T))))
        rng = np.random.default_rng(7)
        solve(make(rng, 0.01, 0.01), 0.001, rng, added)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda values: values[:, [1, 0, 2, 3, 4, 5]],
        lambda values: values / 9.81,
        lambda values: -values,
    ],
    ids=["exchanged", "g", "signs"],
)
def test_columns_that_are_not_what_they_are_called_are_refused(spoil: Callable[[np.ndarray], np.ndarray]) -> None:
    rng = np.random.default_rng(8)
    values = make(rng, 0.01, 0.01).measure(NINE, 0.001, rng)
    with refused(InputError, "lab.accel_crossed"):
        calibrate_nine(*NINE.T, spoil(values), G)


K = np.array([0.21, 0.19, -0.2, 0.205, 0.198, 0.202])  # [V/(m/s^2)], one of them mounted upside down
ZERO = np.array([2.5, 2.45, 2.52, 2.48, 2.5, 2.51])
GYRO_BIAS = np.radians([0.5, -0.3, 0.1])
FELT = np.radians([[0.1, 0.02, 0.0], [0.0, 0.05, -0.03], [0.01, 0.0, 0.08]]) / 9.80665


def volts(modules: Modules, positions: np.ndarray, noise: float, rng: np.random.Generator, tmp_path: Path) -> Path:
    """Twelve channels of nine positions: angles, six voltages, three rates (and as many positions as are wanted)."""
    forces = modules.measure(positions, noise, rng)
    ideal = ideal_force(*positions.T, G)
    rates = GYRO_BIAS + ideal @ FELT.T + np.radians(0.01) * rng.normal(size=(len(positions), 3))
    names = [f"{name}_v" for name in SENSORS] + [f"gyro_{a}_deg_s" for a in "xyz"]
    rows = np.column_stack((np.degrees(positions), ZERO + K * forces, np.degrees(rates)))
    np.savetxt(tmp_path / "v.csv", rows, "%.12g", ",", header=",".join(["roll_deg", "pitch_deg", *names]), comments="")
    return tmp_path / "v.csv"


def test_bias_voltage_is_the_mean_of_the_extremes(tmp_path: Path) -> None:
    """``(V_max + V_min) / 2`` of each accelerometer over positions that have it up and down."""
    rng = np.random.default_rng(11)
    positions = np.vstack((NINE, UPRIGHT))
    path = volts(make(rng, 0.004, 0.003, 0.0), positions, 0.001, rng, tmp_path)
    found = fit(read([path], BenchOptions(gravity=G)), BenchOptions(gravity=G))
    output = np.loadtxt(path, delimiter=",", skiprows=1)[:, 2:8]
    mean = 0.5 * (output.max(axis=0) + output.min(axis=0))
    biases = [next(each for each in found.parameters if each.key == f"{name}_bias") for name in SENSORS]
    np.testing.assert_allclose([each.value for each in biases], mean, atol=1e-9)
    assert {each.unit for each in biases} == {"V"}
    np.testing.assert_array_equal(found.errors.accel_bias, 0.0)


def test_volts_and_gyros_are_recovered_within_their_intervals(tmp_path: Path) -> None:
    rng = np.random.default_rng(12)
    inside = []
    for _ in range(40):
        modules = make(rng, 0.002, 0.0, 0.0)
        path = volts(modules, NINE, 0.005, rng, tmp_path)
        found = fit(read([path], BenchOptions(gravity=G)), BenchOptions(gravity=G))
        value = {each.key: each for each in found.parameters}
        own = np.diag(modules.accel[:, AXIS])  # what each senses along its axis
        truth = {f"{name}_bias": zero for name, zero in zip(SENSORS, ZERO, strict=True)}
        truth |= {f"{name}_scale_factor": k * s * 9.80665 for name, k, s in zip(SENSORS, K, own, strict=True)}
        truth |= {f"gyro_{a}_bias": bias for a, bias in zip("xyz", GYRO_BIAS, strict=True)}
        truth |= {f"gyro_{a}_feels_{b}": FELT[i, j] for i, a in enumerate("xyz") for j, b in enumerate("xyz")}
        inside.append([value[key].interval[0] < true < value[key].interval[1] for key, true in truth.items()])
    assert np.mean(inside) == pytest.approx(0.95, abs=0.03)
    assert np.mean(inside, axis=0).min() > 0.8
    np.testing.assert_allclose(found.errors.gyro_bias, GYRO_BIAS, atol=1e-3)
    np.testing.assert_allclose(found.errors.gyro_terms.g_sensitivity, FELT, atol=1e-4)


def test_a_dead_channel_is_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(13)
    path = volts(make(rng, 0.004, 0.003, 0.0), NINE, 0.001, rng, tmp_path)
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    rows[:, 5] = 2.5 + 1e-5 * rng.normal(size=len(rows))
    np.savetxt(path, rows, "%.12g", ",", header=path.read_text().splitlines()[0], comments="")
    with refused(InputError, "lab.accel_dead") as caught:
        fit(read([path], BenchOptions(gravity=G)), BenchOptions(gravity=G))
    assert caught.value.values["column"] == "y_ax"


def test_exchanged_rows_are_refused() -> None:
    rng = np.random.default_rng(3)
    positions = np.vstack((NINE, UPRIGHT))
    measured = make(rng, 0.002, 0.002).measure(positions, 0.005, rng)
    for a, b in combinations(range(len(positions)), 2):
        if np.allclose(positions[a], positions[b]):
            continue
        wrong = measured.copy()
        wrong[[a, b]] = wrong[[b, a]]
        with pytest.raises(InputError) as caught:
            calibrate_nine(*positions.T, wrong, G)
        assert caught.value.code in ("lab.accel_crossed", "lab.positions_misfit")
