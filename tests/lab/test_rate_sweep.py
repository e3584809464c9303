"""Rate sweeps: the matrix within its printed interval, non-linearity compensated, bad sweeps refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, of_code
from insnav.imu import calibration_to_toml, correct, load_calibration
from insnav.lab.rate_sweep import SweepCalibration, calibrate_sweeps, read_sweeps, sweep_errors
from insnav.sample_statistics import rms
from insnav.types import ImuData
from insnav.units import DEG
from tests.lab.sweeps import RATES, Gyros, asymmetric, broken, cubic, gyros, straight, table, write
from tests.refusals import refused

NOISE = 0.005  # of a dwell [deg/s]


def solve(sensor: Gyros, rng: np.random.Generator, noise: float = NOISE, rates: np.ndarray = RATES) -> SweepCalibration:
    rate = table(rates)
    output = sensor.show(rate, noise, rng) * DEG
    return calibrate_sweeps(rate * DEG, output, np.full(rate.shape, noise * DEG), raw=False)


def test_matrix_and_bias_lie_within_the_printed_interval_as_often_as_it_says() -> None:
    rng, inside, trials = np.random.default_rng(1), np.zeros((3, 4)), 120
    for _ in range(trials):
        sensor = gyros(rng)
        found = solve(sensor, rng, rates=RATES[::6])
        truth = np.column_stack((sensor.matrix, sensor.bias * DEG))
        for i, fit in enumerate(found.fits):
            inside[i] += np.abs(fit.value - truth[i]) < fit.half_width()
    assert inside.mean() / trials == pytest.approx(0.95, abs=0.02)
    assert inside.min() / trials > 0.95 - 3.5 * np.sqrt(0.95 * 0.05 / trials)


@pytest.mark.parametrize("shape", [cubic, asymmetric, broken])
def test_a_known_non_linearity_is_five_times_smaller_after_the_second_step(shape: Callable, tmp_path: Path) -> None:
    """Judged on rates between those of the table, through the calibration file, without noise."""
    rng = np.random.default_rng(2)
    sensor = gyros(rng, (shape, straight, shape))
    found = solve(sensor, rng)
    assert found.pieces[1] is None
    assert rms(found.error_matrix) > 5.0 * rms(found.error_map)
    errors, _ = sweep_errors(found, "deg/s")
    (tmp_path / "calibration.toml").write_text(calibration_to_toml(errors))
    known = load_calibration(tmp_path / "calibration.toml")
    rate = rng.uniform(-300.0, 300.0, (5000, 3))
    shown = ImuData(0.01 * np.arange(5000.0), sensor.show(rate, 0.0, rng) * DEG, np.zeros((5000, 3)))
    first, second = (correct(shown, errors).gyro / DEG - rate for errors in (replace(known, gyro_map=None), known))
    for axis in (0, 2):
        assert np.std(second[:, axis]) < 0.2 * np.std(first[:, axis])
    assert np.sqrt(np.mean(second**2)) < 3.0 * NOISE


def test_borders_of_straight_pieces_are_found() -> None:
    rng = np.random.default_rng(3)
    found = solve(Gyros(np.eye(3), np.zeros(3), (broken, straight, straight)), rng)
    item = found.pieces[0]
    assert item is not None
    np.testing.assert_allclose(item.knot[1:-1] / DEG, [-150.0, 100.0], atol=11.0)


def test_the_non_linearity_is_not_taken_for_scatter_of_the_matrix() -> None:
    rng = np.random.default_rng(4)
    plain, bent = (solve(gyros(rng, (shape,) * 3), rng) for shape in (straight, cubic))
    for a, b in zip(plain.fits, bent.fits, strict=True):
        assert b.sd[3] < 1.5 * a.sd[3]


@pytest.mark.parametrize("shape", [cubic, lambda rate: 900.0 * np.tanh(rate / 900.0) - rate])
def test_the_matrix_of_bent_gyros_is_their_best_straight_line(shape: Callable) -> None:
    """Its interval holds that line through the response without noise, not the slope at rest."""
    rng, inside, trials = np.random.default_rng(12), 0, 40
    for _ in range(trials):
        sensor = gyros(rng, (shape,) * 3)
        rate = table(RATES[::3])
        line = np.linalg.lstsq(np.column_stack((rate, np.ones(len(rate)))), sensor.show(rate, 0.0, rng), rcond=None)[0]
        for axis, fit in enumerate(solve(sensor, rng, rates=RATES[::3]).fits):
            inside += np.count_nonzero(np.abs(fit.value[:3] - line[:3, axis]) < fit.half_width()[:3])
    assert inside / (9 * trials) > 0.92


def test_the_error_at_rest_is_met_best() -> None:
    rng = np.random.default_rng(5)
    sensor = gyros(rng, (asymmetric, cubic, straight))
    found = solve(sensor, rng)
    errors = sweep_errors(found, "deg/s")[0]
    rest = ImuData(np.arange(2.0), np.tile(sensor.bias * DEG, (2, 1)), np.zeros((2, 3)))
    np.testing.assert_allclose(correct(rest, errors).gyro / DEG, 0.0, atol=4.0 * NOISE / np.sqrt(120.0))


@pytest.mark.parametrize(("low", "high"), [(-265.0, 245.0), (-277.0, 243.0), (-262.0, 258.0)])
def test_saturated_rates_are_found_and_only_they(low: float, high: float) -> None:
    rng = np.random.default_rng(6)
    sensor = gyros(rng, (cubic, straight, asymmetric))
    rate = table()
    output = sensor.show(rate, NOISE, rng)
    outside = np.count_nonzero((output[:, 1] < low) | (output[:, 1] > high))
    output[:, 1] = np.clip(output[:, 1], low, high)
    found = calibrate_sweeps(rate * DEG, output * DEG, np.full(rate.shape, NOISE * DEG), raw=False)
    lost = sorted(item.rate for _, item in found.dropped)
    assert {axis for axis, _ in found.dropped} == {1}
    assert lost[0] == -300.0
    assert lost[-1] == 300.0
    # the first rate beyond too, though it may still have grown by more than half a step
    assert len(lost) == outside
    np.testing.assert_allclose(found.matrix, sensor.matrix, atol=2e-3)


def test_perfect_gyros_get_no_pieces_and_few_rates_are_told() -> None:
    rng = np.random.default_rng(11)
    perfect = Gyros(np.eye(3), np.zeros(3), (straight,) * 3)
    assert solve(perfect, rng, noise=0.0).pieces == (None, None, None)
    found = solve(gyros(rng, (cubic,) * 3), rng, rates=RATES[::10])
    assert found.pieces == (None, None, None)
    few = [(each.code, each.subject, each["count"]) for each in found.warnings]
    assert few == [(Code.BENCH_NO_MAP, f"gyro {axis}", 7) for axis in "xyz"]


def test_volts_become_lines_of_the_calibration_file(tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    sensor = gyros(rng)
    volts = Gyros(0.005 * sensor.matrix, 2.5 + 0.0 * sensor.bias, (straight,) * 3)
    paths = write(tmp_path, volts, 1e-5, rng)
    for path in paths:
        path.write_text(path.read_text().replace("_deg_s,gyro", "_deg_s,gyro").replace("gyro_x_deg_s", "gyro_x_v"))
        path.write_text(path.read_text().replace("gyro_y_deg_s", "gyro_y_v").replace("gyro_z_deg_s", "gyro_z_v"))
    record = read_sweeps(paths)
    assert record.raw
    found = calibrate_sweeps(record.dwells.setting, record.dwells.value, record.dwells.sd, raw=True)
    errors, sd = sweep_errors(found, record.unit)
    # 10 uV of noise by 5 mV/(deg/s), over the root of 183 dwells
    np.testing.assert_allclose(sd.gyro_bias / DEG, 0.002 / np.sqrt(183.0), rtol=0.3)
    assert errors.gyro_raw is not None
    rate = np.array([[30.0, -20.0, 10.0]])
    shown = volts.show(rate, 0.0, rng)
    lines = np.column_stack([errors.gyro_raw.value(shown[:, i], i) for i in range(3)])
    imu = ImuData(np.arange(2.0), np.repeat(lines, 2, axis=0), np.zeros((2, 3)))
    np.testing.assert_allclose(correct(imu, errors).gyro[0] / DEG, rate[0], atol=0.01)


def test_one_file_and_three_are_the_same_and_dwells_are_reduced(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    paths = write(tmp_path, gyros(rng), 0.1, rng, samples=20)
    three = read_sweeps(paths)
    rows = [np.genfromtxt(path, delimiter=",", skip_header=1) for path in paths]
    rate = np.vstack([np.outer(part[:, 0], axis) for part, axis in zip(rows, np.eye(3), strict=True)])
    header = "rate_x_deg_s,rate_y_deg_s,rate_z_deg_s,gyro_x_deg_s,gyro_y_deg_s,gyro_z_deg_s"
    both = np.column_stack((rate, np.vstack(rows)[:, 1:]))
    np.savetxt(tmp_path / "all.csv", both, "%.9g", ",", header=header, comments="")
    one = read_sweeps([tmp_path / "all.csv"])
    assert three.dwells.setting.shape == (3 * RATES.size, 3)
    np.testing.assert_allclose(one.dwells.value, three.dwells.value, atol=1e-15)
    np.testing.assert_allclose(one.dwells.setting, three.dwells.setting)
    assert {(each["what"], each["count"]) for each in of_code(three.warnings, Code.BENCH_FEW)} == {
        ("samples of a dwell", 20)
    }


def test_a_zero_that_moved_between_sweeps_is_told() -> None:
    rng = np.random.default_rng(9)
    rate = table()
    output = gyros(rng).show(rate, NOISE, rng)
    output[RATES.size : 2 * RATES.size, 0] += 0.05
    found = calibrate_sweeps(rate * DEG, output * DEG, np.zeros(rate.shape), raw=False)
    (shift,) = found.warnings
    assert (shift.code, shift.subject) == (Code.BENCH_ZERO_SHIFT, "gyro x")
    assert (shift["first"], shift["second"]) == ("y", "z")
    assert shift["shift_rad_s"] / DEG == pytest.approx(0.05, abs=0.003)
    assert solve(gyros(rng), rng).warnings == ()


N = RATES.size


@pytest.mark.parametrize(
    ("spoil", "code", "axis"),
    [
        (lambda rate, out: (rate[: 2 * N], out[: 2 * N]), "lab.no_sweep", "z"),
        (lambda rate, out: (rate, out[:, [1, 0, 2]]), "lab.gyro_crossed", "x"),
        (lambda rate, out: (rate[:, [1, 0, 2]], out), "lab.gyro_crossed", "x"),
        (lambda rate, out: (rate, out / DEG), "lab.output_unit", "gyro x"),
        (lambda rate, out: (rate, out * [1.0, 1.0, -1.0]), "lab.output_reversed", "gyro z"),
        (lambda rate, out: (np.abs(rate), out), "lab.one_sided_sweep", "x"),
        (lambda rate, out: (rate, out * [1.0, 0.0, 1.0]), "lab.output_unit", "gyro y"),
        (lambda rate, out: (rate[2 * N - 3 :], out[2 * N - 3 :]), "lab.no_sweep", "x"),
    ],
)
def test_bad_sweeps_are_refused(spoil: Callable, code: str, axis: str) -> None:
    rng = np.random.default_rng(10)
    rate = table()
    rate, output = spoil(rate, gyros(rng).show(rate, NOISE, rng))
    with refused(InputError, code) as caught:
        calibrate_sweeps(rate * DEG, output * DEG, np.zeros(rate.shape), raw=False)
    assert axis in (caught.value.values.get("axis"), caught.value.values.get("sensor"))


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("rate_deg_s,gyro_x_deg_s,gyro_y_deg_s", "columns.missing"),
        ("rate_deg_s,gyro_x,gyro_y,gyro_z", "lab.no_unit"),
        ("gyro_x_deg_s,gyro_y_deg_s,gyro_z_deg_s", "columns.missing"),
        ("rate_deg_s,gyro_x_v,gyro_y_deg_s,gyro_z_deg_s", "lab.mixed_units"),
    ],
)
def test_files_that_lack_something_are_refused(tmp_path: Path, header: str, expected: str) -> None:
    path = tmp_path / "x.csv"
    rows = np.ones((9, header.count(",") + 1))
    np.savetxt(path, rows, "%.9g", ",", header=header, comments="")
    with pytest.raises(InputError) as caught:
        read_sweeps([path] * 3)
    assert expected in str(caught.value)


def test_two_files_are_not_three_sweeps(tmp_path: Path) -> None:
    with refused(InputError, "lab.not_three_sweeps"):
        read_sweeps([tmp_path / "a.csv"] * 2)


def test_an_intercept_set_by_hand_moves_one_piece_and_leaves_its_neighbours() -> None:
    sensor = Gyros(np.eye(3), np.zeros(3), (broken, straight, straight))
    plain, fitted = solve(sensor, np.random.default_rng(3)), solve(sensor, np.random.default_rng(3))
    item = plain.pieces[0]
    assert item is not None
    for piece in range(item.slope.size):
        given = float(item.intercept[piece]) / DEG + 0.02
        rate = table(RATES)
        output = sensor.show(rate, NOISE, np.random.default_rng(3)) * DEG
        found = calibrate_sweeps(
            rate * DEG, output, np.full(rate.shape, NOISE * DEG), raw=False, intercepts={f"x{piece + 1}": given}
        )
        moved = found.pieces[0]
        assert moved is not None
        np.testing.assert_allclose(moved.slope, item.slope, rtol=1e-9)
        expected = item.intercept / DEG + 0.02 * (np.arange(item.slope.size) == piece)
        np.testing.assert_allclose(moved.intercept / DEG, expected, atol=1e-9)
        (change,) = found.adjusted
        assert change.after > change.before  # the fitted one is the best of all
        assert np.sqrt(change.after**2 - change.before**2) / DEG == pytest.approx(0.02, rel=0.35)
        # what is left changes by as much in the piece, and by nothing far from it
        off = (found.error_map - fitted.error_map)[:, 0] / DEG
        measured = (found.rate + found.error_matrix)[:, 0]  # by the matrix, without the pieces
        own = np.searchsorted(moved.knot[1:-1], measured) == np.searchsorted(item.knot[1:-1], measured)
        inside = own & (np.searchsorted(moved.knot[1:-1], measured) == piece)
        np.testing.assert_allclose(off[inside], -0.02, atol=1e-9)
        np.testing.assert_allclose(off[own & ~inside], 0.0, atol=1e-9)
        np.testing.assert_array_equal(found.matrix, plain.matrix)


def test_intercepts_of_no_piece_and_past_the_neighbours_are_refused() -> None:
    sensor = Gyros(np.eye(3), np.zeros(3), (broken, straight, straight))
    rate = table(RATES)
    output = sensor.show(rate, NOISE, np.random.default_rng(3)) * DEG
    for name, value, code in (
        ("y1", 0.0, "lab.no_piece"),
        ("x9", 0.0, "lab.no_piece"),
        ("2x", 0.0, "lab.no_piece"),
        ("x2", 500.0, "lab.piece_past_neighbours"),
    ):
        with refused(ConfigError, code):
            calibrate_sweeps(rate * DEG, output, np.full(rate.shape, 0.0), raw=False, intercepts={name: value})


def test_the_room_of_an_intercept_ends_where_the_borders_meet() -> None:
    item = solve(Gyros(np.eye(3), np.zeros(3), (broken, straight, straight)), np.random.default_rng(3)).pieces[0]
    assert item is not None
    at = np.zeros(item.residual.size)
    for piece in range(item.slope.size):
        own = item.intercept[piece]
        for end in item.room(piece):
            if np.isfinite(end):
                assert item.with_intercept(piece, own + 0.999 * (end - own), at).knot.size == item.knot.size
                with pytest.raises(ConfigError):
                    item.with_intercept(piece, own + 1.001 * (end - own), at)
