"""Rate table and tumble: the published figures, what is dropped and why, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from insnav.exceptions import InputError
from insnav.findings import Code, Severity, of_code
from insnav.imu import calibration_to_toml, load_calibration
from insnav.lab.calibration import BenchOptions, carried_over
from insnav.lab.single_axis import rate_table as gyro
from insnav.lab.single_axis import tumble as accel
from insnav.lab.single_axis.rate_table import SCHEMA as RATE_TABLE
from insnav.lab.single_axis.rate_table import Record, calibrate_gyro, rate_table_warnings, read_record
from insnav.lab.single_axis.tumble import SCHEMA as TUMBLE
from insnav.lab.single_axis.tumble import calibrate_accel, tumble_warnings
from tests.lab.published import lab_file
from tests.refusals import refused

RATES = np.array([-80, -60, -40, -20, -10, 0, 10, 20, 40, 60, 80.0])
ANGLES = np.arange(0.0, 360.0, 30.0)


def table(path: Path, header: str, *columns: np.ndarray) -> Path:
    np.savetxt(path, np.column_stack(columns), "%.9g", ",", header=header, comments="")
    return path


def published(name: str, schema: tuple) -> Record:
    return read_record(lab_file(name), schema)


def test_published_range_gives_the_published_line() -> None:
    found = calibrate_gyro(published("gyro_rate_table.csv", RATE_TABLE), (-90.0, 80.0))
    assert np.round(found.fit.value, 4).tolist() == [0.1957, 0.0486]
    assert [item.rate for item in found.dropped] == [90.0]
    assert found.dropped[0].reason.code == Code.BENCH_RATE_EXCLUDED


def test_saturated_rates_are_found_and_only_they() -> None:
    found = calibrate_gyro(published("gyro_rate_table.csv", RATE_TABLE))
    assert np.round(found.fit.value, 4).tolist() == [0.2000, 0.0488]
    assert [item.rate for item in found.dropped] == [80.0, 90.0]
    assert found.dropped[0].reason.code == Code.BENCH_RATE_SATURATED
    assert found.dropped[0].reason["residual_sigma"] == pytest.approx(20.0, abs=0.5)
    assert found.dropped[0].residual == pytest.approx(-0.096, abs=1.5e-3)
    assert (found.dropped[1].reason.code, found.dropped[1].reason["setting"]) == (Code.BENCH_RATE_BEYOND, 80.0)


def test_a_clean_record_keeps_every_rate_as_often_as_stated() -> None:
    from insnav.lab.single_axis.rate_table import FALSE_ALARM, SOFT, calibrate_rate_table

    rng, alarms, trials = np.random.default_rng(5), 0, 1000
    for _ in range(trials):
        found = calibrate_rate_table(RATES, 0.2 + 0.05 * RATES + 0.005 * rng.normal(size=RATES.size))
        alarms += bool(found.dropped)
    assert alarms / trials < 1.25 * (FALSE_ALARM + SOFT)


INNER = np.array([0.1, 1, 5, 10, 15, 20, 30, 40, 50, 60, 70, 80])


def abrupt(rate: np.ndarray) -> np.ndarray:
    """13 mV less at 80 deg/s alone."""
    return np.where(rate == 80.0, -0.013, 0.0)


def gradual(rate: np.ndarray) -> np.ndarray:
    """Falling short over three rates, 13 mV in the end."""
    return -0.013 * np.maximum(0.0, 1.0 - (80.0 - rate) / 30.0) ** 2


def knee(range_: float) -> Callable[[np.ndarray], np.ndarray]:
    """Both ends near their limit from three quarters of the range on, with 0.0488 V/(deg/s)."""

    def shape(rate: np.ndarray) -> np.ndarray:
        beyond = np.maximum(np.abs(rate) - 0.75 * range_, 0.0)
        return 0.0488 * np.sign(rate) * (0.25 * range_ * -np.expm1(-beyond / (0.25 * range_)) - beyond)

    return shape


@pytest.mark.parametrize(
    ("shape", "count"),
    [(abrupt, 12), (gradual, 12), (knee(1e3), 12), (knee(1e3), 5), *((knee(at), 12) for at in (104.5, 103.0, 101.0))],
)
def test_the_interval_of_the_scale_factor_holds_where_an_end_saturates_softly(shape: Callable, count: int) -> None:
    """11 or 25 rates, noise 3 mV. Knees fall short by 0.8, 2.3 and 5.5 times that; at 1000 deg/s they do not matter."""
    from insnav.lab.single_axis.rate_table import calibrate_rate_table

    inner = INNER if count == INNER.size else INNER[[3, 5, 7, 9, 11]]
    rate = np.concatenate((-inner[::-1], [0.0], inner))
    rng, held, trials = np.random.default_rng(9), 0, 400
    for _ in range(trials):
        found = calibrate_rate_table(rate, 0.2 + 0.0488 * rate + shape(rate) + 0.003 * rng.normal(size=rate.size))
        held += bool(abs(found.fit.value[1] - 0.0488) <= found.fit.half_width()[1])
    assert held / trials > 0.92


def test_the_doubt_of_bent_rates_does_not_double_the_interval_of_a_clean_table() -> None:
    """Eleven rates: 2.1 times as wide as Student's interval of the slope, when Schwarz's criterion weighed them."""
    from insnav.lab.single_axis.rate_table import calibrate_rate_table

    rate, rng, wider = np.concatenate((-INNER[3::2][::-1], [0.0], INNER[3::2])), np.random.default_rng(10), []
    for _ in range(100):
        output = 0.2 + 0.0488 * rate + 0.003 * rng.normal(size=rate.size)
        student = stats.linregress(rate, output).stderr * stats.t.ppf(0.975, rate.size - 2)
        found = calibrate_rate_table(rate, output)
        wider += [found.fit.half_width()[1] / student] * bool(found.used.all())
    assert np.median(wider) < 1.8


def test_harmonics_are_the_model_of_an_even_tumble() -> None:
    from insnav.lab.single_axis.tumble import harmonics

    record = published("accel_tumble_12.csv", TUMBLE)
    found, series = calibrate_accel(record), harmonics(record.setting, record.output)
    np.testing.assert_allclose(series.model, found.fit.value, rtol=0.0, atol=1e-14)
    assert np.round(series.model, 4).tolist() == [-0.1847, -2.4121, 0.0113, -0.0211]
    # the discrete Fourier transform of numpy, and what a table that is off by 1 mrad shows
    wanted = np.fft.rfft(record.output) / 12
    np.testing.assert_allclose(series.cosine[1:], 2.0 * wanted.real[1:5], atol=1e-14)
    np.testing.assert_allclose(series.sine[1:], -2.0 * wanted.imag[1:5], atol=1e-14)
    turned = harmonics(record.setting, 0.1 + 2.4 * np.sin(record.setting + 1e-3))
    assert turned.misalignment == pytest.approx(1e-3, rel=1e-5)


def test_forward_reverse_and_average_of_an_asymmetric_gyro(tmp_path: Path) -> None:
    volts = 0.1 + RATES * np.where(RATES > 0.0, 0.0505, 0.0495)
    path = table(tmp_path / "x.csv", "rate_deg_s,output_v", RATES, volts)
    found = calibrate_gyro(read_record(path, RATE_TABLE), (-100.0, 100.0))
    assert found.forward is not None
    assert found.reverse is not None
    assert found.average is not None
    np.testing.assert_allclose(found.forward.value, [0.1, 0.0505], atol=1e-9)
    np.testing.assert_allclose(found.reverse.value, [0.1, 0.0495], atol=1e-9)
    np.testing.assert_allclose(found.average[0], [0.1, 0.05], atol=1e-9)
    assert found.asymmetry == pytest.approx(0.02, abs=1e-9)


def test_raw_dwells_are_cleaned_of_drift_and_spikes(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    n = 400
    rate = np.repeat(RATES, n)
    volts = 0.2 + 0.05 * rate + 0.001 * rng.normal(size=rate.size)
    spiked = rng.random(rate.size) < 0.02
    volts[spiked] += 0.08
    path = table(tmp_path / "raw.csv", "time_s,rate_deg_s,output_v", 0.01 * np.arange(rate.size), rate, volts)
    record = read_record(path, RATE_TABLE)
    found = calibrate_gyro(record)
    assert record.dwells.dropped.sum() == spiked.sum()
    assert np.all(np.abs(found.fit.value - [0.2, 0.05]) < 4.0 * found.fit.sd + 1e-6)
    kept = read_record(path, RATE_TABLE, BenchOptions(spike_limit=1.0))
    assert calibrate_gyro(kept).fit.value[0] - 0.2 > 1e-3  # the spikes all go one way


def test_what_is_unusual_about_a_rate_table_is_told(tmp_path: Path) -> None:
    usual = calibrate_gyro(published("gyro_rate_table.csv", RATE_TABLE), (-75.0, 75.0))
    assert rate_table_warnings(usual) == ()
    (left_out,) = rate_table_warnings(calibrate_gyro(published("gyro_rate_table.csv", RATE_TABLE)))
    assert (left_out.code, left_out["count"], left_out["total"]) == (Code.BENCH_LEFT_OUT, 2, 27)
    assert left_out.severity == Severity.WARNING
    path = table(tmp_path / "x.csv", "rate_deg_s,output_v", RATES[5:], 0.2 + 0.05 * RATES[5:])
    few, one_sense = rate_table_warnings(calibrate_gyro(read_record(path, RATE_TABLE)))
    assert (few.code, few["what"], few["count"]) == (Code.BENCH_FEW, "rates", 6)
    assert one_sense.code == Code.BENCH_ONE_SENSE


def test_published_tumble() -> None:
    found = calibrate_accel(published("accel_tumble_12.csv", TUMBLE))
    assert np.round(found.fit.value, 4).tolist() == [-0.1847, -2.4121, 0.0113, -0.0211]
    assert round(found.fit.rms, 4) == 0.0260
    assert found.fit.sigma == pytest.approx(0.0318, abs=5e-5)  # the same sum of squares over 8, not 12
    assert tumble_warnings(found) == ()


def test_tumble_uncertainty_holds_the_truth_as_often_as_it_says(tmp_path: Path) -> None:
    from insnav.lab.single_axis.tumble import calibrate_tumble

    rng, truth, inside, trials = np.random.default_rng(7), np.array([-0.2, 2.4, 0.01, -0.02]), 0, 1500
    angle = np.radians(ANGLES)
    sine, cosine = np.sin(angle), np.cos(angle)
    output = np.column_stack([np.ones(12), sine, sine**2, sine * cosine]) @ truth
    for _ in range(trials):
        fit = calibrate_tumble(angle, output + 0.01 * rng.normal(size=12)).fit
        inside += int(np.sum(np.abs(fit.value - truth) < fit.half_width(0.95)))
    assert inside / (4 * trials) == pytest.approx(0.95, abs=0.01)


def test_an_outlying_position_is_pointed_out(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    volts = 2.0 * np.sin(np.radians(ANGLES)) + 0.002 * rng.normal(size=12)
    volts[4] += 0.2
    found = calibrate_accel(read_record(table(tmp_path / "a.csv", "angle_deg,output_v", ANGLES, volts), TUMBLE))
    outliers = {round(np.degrees(each["angle_rad"])) for each in of_code(tumble_warnings(found), Code.BENCH_OUTLIER)}
    assert 120 in outliers


def test_volts_become_lines_and_rates_become_bias_and_scale(tmp_path: Path) -> None:
    volts = read_record(table(tmp_path / "v.csv", "rate_deg_s,output_mv", RATES, 200.0 + 50.0 * RATES), RATE_TABLE)
    digital = read_record(table(tmp_path / "d.csv", "rate_deg_s,output_deg_s", RATES, 0.5 + 1.01 * RATES), RATE_TABLE)
    raw = gyro.fit((volts,), BenchOptions()).errors.gyro_raw
    assert raw is not None
    assert raw.unit == "mV"
    np.testing.assert_allclose(raw.value(np.array([250.0]), 2), np.radians(1.0))
    errors = gyro.fit((digital,) * 3, BenchOptions()).errors
    np.testing.assert_allclose(np.degrees(errors.gyro_bias), 0.5, atol=1e-9)
    np.testing.assert_allclose(errors.gyro_matrix, 1.01 * np.eye(3), atol=1e-9)


def test_both_triads_fit_into_one_file(tmp_path: Path) -> None:
    rates = read_record(table(tmp_path / "g.csv", "rate_deg_s,output_v", RATES, 0.2 + 0.05 * RATES), RATE_TABLE)
    force = 0.1 + 2.0 * np.sin(np.radians(ANGLES))
    angles = read_record(table(tmp_path / "a.csv", "angle_deg,output_v", ANGLES, force), TUMBLE)
    first = gyro.fit((rates,), BenchOptions()).errors
    (tmp_path / "c.toml").write_text(calibration_to_toml(first))
    second = accel.fit((angles,), BenchOptions(gravity=9.81)).errors
    both = carried_over(second, load_calibration(tmp_path / "c.toml"), "gyro")
    assert both.gyro_raw is not None
    assert both.accel_raw is not None
    np.testing.assert_allclose(both.accel_raw.value(np.array([2.1]), 0), 9.81)
    np.testing.assert_allclose(both.gyro_raw.value(np.array([0.25]), 0), np.radians(1.0))


@pytest.mark.parametrize(
    ("header", "columns", "expected"),
    [
        ("output_v,rate_deg_s", (RATES, 0.2137 + 0.04877 * RATES), "lab.columns_exchanged"),
        ("rate_deg_s,output", (RATES, RATES), "lab.no_unit"),
        ("rate_deg_s,output_m", (RATES, RATES), "columns.missing"),
        ("rate_deg_s,output_deg_s", (RATES, np.radians(RATES)), "lab.output_unit"),
        ("rate_deg_s,output_deg_s", (RATES, -RATES), "lab.output_reversed"),
        ("rate_deg_s,output_v", (RATES[:4], RATES[:4]), "lab.few_rates"),
        ("rate_deg_s,output_v", (RATES, 0.01 * np.cos(RATES)), "lab.rate_ignored"),
        ("rate_deg_s,output_v", (RATES, np.where(RATES == 20.0, np.nan, RATES)), "lab.value_missing"),
    ],
)
def test_bad_rate_tables_are_refused(tmp_path: Path, header: str, columns: tuple, expected: str) -> None:
    with pytest.raises(InputError) as caught:
        calibrate_gyro(read_record(table(tmp_path / "x.csv", header, *columns), RATE_TABLE))
    assert expected in str(caught.value)


VOLTS = 2.0 * np.sin(np.radians(ANGLES))


@pytest.mark.parametrize(
    ("header", "columns", "code"),
    [
        ("angle_deg,output_v", (np.delete(ANGLES, 7), np.delete(VOLTS, 7)), "lab.position_missing"),
        ("angle_deg,output_v", (np.radians(ANGLES), VOLTS), "lab.angles_not_degrees"),
        ("output_v,angle_deg", (ANGLES, VOLTS), "lab.angles_not_degrees"),
        ("angle_deg,output_v", (ANGLES, np.cos(np.radians(ANGLES))), "lab.gravity_ignored"),
        ("angle_deg,output_m_s2", (ANGLES, np.sin(np.radians(ANGLES))), "lab.output_unit"),
        ("angle_deg,output_v", (ANGLES[::3], VOLTS[::3]), "lab.few_angles"),
    ],
)
def test_bad_tumbles_are_refused(tmp_path: Path, header: str, columns: tuple, code: str) -> None:
    with refused(InputError, code) as caught:
        calibrate_accel(read_record(table(tmp_path / "x.csv", header, *columns), TUMBLE))
    np.testing.assert_allclose(np.degrees(caught.value.values.get("missing_rad", 210.0 * np.pi / 180.0)), 210.0)


def test_a_dwell_of_spikes_is_refused(tmp_path: Path) -> None:
    noisy = np.repeat(RATES, 100) + 0.5 * np.random.default_rng(9).normal(size=1100)
    path = table(tmp_path / "x.csv", "rate_deg_s,output_v", np.repeat(RATES, 100), noisy)
    with refused(InputError, "lab.dwell_of_spikes") as caught:
        read_record(path, RATE_TABLE)
    assert (caught.value.values["begin_row"], caught.value.values["end_row"]) == (1, 100)


def test_temperature_drift_is_pointed_out(tmp_path: Path) -> None:
    path = table(
        tmp_path / "x.csv", "rate_deg_s,output_v,temperature_c", RATES, 0.1 * RATES, np.linspace(20.0, 27.0, RATES.size)
    )
    warming = read_record(path, RATE_TABLE).warnings[0]
    assert (warming.code, warming["low_c"], warming["high_c"]) == (Code.BENCH_TEMPERATURE, 20.0, 27.0)
