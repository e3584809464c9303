"""Acceptance figures: published arithmetic, closed forms, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, of_code
from insnav.lab.acceptance import acceptance, scale_of, spread_of, stability_of
from insnav.lab.bench_data import Channel, read_powerups, read_static, read_steps
from insnav.units import DEG, G0
from tests.lab.published import lab_file
from tests.refusals import refused

RATES = np.array([0.0, 10.0, 20.0, 40.0, 60.0, 80.0, -10.0, -20.0, -40.0, -60.0, -80.0])


def written(path: Path, header: str, *columns: object) -> Path:
    rows = np.column_stack([np.broadcast_to(column, np.shape(columns[0])) for column in columns])
    np.savetxt(path, rows, "%.12g", ",", header=header, comments="")
    return path


def only(found, axis="gyro x"):
    return next(item for item in found.sensors if item.axis == axis)


def test_published_repeatability_is_its_arithmetic():
    """Variance 8.666e-5, standard deviation 0.00931; published without the root, and of the noise within a record."""
    values = np.loadtxt(lab_file("gyro_bias_repeatability.csv"), delimiter=",", skiprows=1)[:, 1]
    found = spread_of(values)
    assert found.variance == pytest.approx(8.666e-5, abs=0.5e-8)
    assert found.sd == pytest.approx(0.00931, abs=0.5e-5)


def test_biases_as_given_are_warned_about(tmp_path):
    biases = np.array([0.18789, 0.17844, 0.16965, 0.18459, 0.19401])
    file = written(tmp_path / "p.csv", "powerup,gyro_x_bias_deg_s", np.arange(5), biases)
    found = acceptance([], None, [read_powerups(file)])
    assert only(found).repeatability.sd / DEG == pytest.approx(np.std(biases, ddof=1), rel=1e-12)
    assert found.warnings[0].code == Code.ACCEPTANCE_GIVEN_BIASES
    assert "gyro x" in found.warnings[0].subject


def test_scale_factor_and_bias_of_the_published_sensor(tmp_path):
    file = written(tmp_path / "r.csv", "rate_x_deg_s,gyro_x_deg_s", RATES, 0.9901 * RATES + 0.0358)
    scale = only(acceptance([read_steps(file)], None, [])).scale
    assert scale.k == pytest.approx(0.9901, rel=1e-12)
    assert scale.bias / DEG == pytest.approx(0.0358 / 0.9901, rel=1e-9)


def test_forward_and_reverse_are_apart_and_their_mean_counts(tmp_path):
    output = 0.02 + RATES * np.where(RATES > 0.0, 1.01, 0.99)
    file = written(tmp_path / "r.csv", "rate_y_deg_s,gyro_y_deg_s", RATES, output)
    scale = only(acceptance([read_steps(file)], None, []), "gyro y").scale
    assert scale.table.forward.value[1] == pytest.approx(1.01, rel=1e-12)
    assert scale.table.reverse.value[1] == pytest.approx(0.99, rel=1e-12)
    assert scale.k == pytest.approx(1.0, rel=1e-12)
    assert scale.bias / DEG == pytest.approx(0.02, rel=1e-9)


def test_turning_about_another_axis_does_not_count(tmp_path):
    settings = np.vstack([np.column_stack([RATES, 0 * RATES]), np.column_stack([0 * RATES, RATES])])
    output = 0.1 + settings @ [1.02, 0.05]  # as much misalignment as scale factor error
    file = written(tmp_path / "r.csv", "rate_x_deg_s,rate_y_deg_s,gyro_x_deg_s", *settings.T, output)
    scale = only(acceptance([read_steps(file)], None, [])).scale
    assert scale.k == pytest.approx(1.02, rel=1e-12)
    assert scale.table.rate.size == RATES.size + 1  # one dwell at rest in each half


def test_six_positions_make_three_accelerometers(tmp_path):
    force = np.vstack([np.eye(3), -np.eye(3)])
    k, bias = np.array([1.001, 0.999, 1.002]), np.array([0.01, -0.02, 0.03])
    header = "force_x_g,force_y_g,force_z_g,accel_x_g,accel_y_g,accel_z_g"
    file = written(tmp_path / "p.csv", header, *force.T, *(bias + force * k).T)
    found = acceptance([read_steps(file)], None, [])
    for i, axis in enumerate("xyz"):
        scale = only(found, f"accel {axis}").scale
        assert scale.k == pytest.approx(k[i], rel=1e-12)
        assert scale.bias / G0 == pytest.approx(bias[i] / k[i], rel=1e-9)
        assert scale.table.forward is None


def test_printed_uncertainty_is_that_of_many_benches():
    rng = np.random.default_rng(5)
    scores = []
    for _ in range(500):
        output = 0.3 + 0.98 * RATES + 0.02 * rng.standard_normal(RATES.size)
        scale = scale_of(Channel("gyro x", RATES * DEG, output * DEG, "rad/s"))
        scores.append([(scale.k - 0.98) / scale.k_sd, (scale.bias / DEG - 0.3 / 0.98) / (scale.bias_sd / DEG)])
    # Student's t with eight degrees of freedom is within 2.31 in 95 % of all cases; one sd of that count is 1 %
    assert np.all(np.abs(np.mean(np.abs(scores) < 2.31, axis=0) - 0.95) < 0.03)


def test_stability_is_the_scatter_of_the_means(tmp_path):
    time = 0.1 * np.arange(4000)
    steps = np.where((time // 100.0) % 2 == 0, 0.5, -0.5)  # constant in every part of 100 s
    file = written(tmp_path / "s.csv", "time_s,gyro_x_deg_s", time, steps)
    stable = only(acceptance([], read_static(file), [])).stability
    assert [each.length for each in stable] == [1.0, 10.0, 100.0]
    assert [each.spread.values.size for each in stable] == [400, 40, 4]
    for each, n in zip(stable, (400, 40, 4), strict=True):
        assert each.spread.sd / DEG == pytest.approx(0.5 * np.sqrt(n / (n - 1)), rel=1e-9)


def test_stability_of_white_noise_falls_with_the_root_of_the_time():
    noise = np.random.default_rng(3).standard_normal(200_000)
    for length in (1.0, 10.0, 100.0):
        spread = stability_of(0.01 * np.arange(noise.size), noise, length).spread
        expected = 0.1 / np.sqrt(length)
        assert abs(spread.sd / expected - 1.0) < 3.0 / np.sqrt(2.0 * spread.values.size)
        assert spread.low < spread.sd < spread.high


def test_parts_that_lack_samples_do_not_count_and_too_short_records_have_none():
    time = np.concatenate([0.1 * np.arange(100), 15.0 + 0.1 * np.arange(150)])
    kept = stability_of(time, np.ones(time.size), 5.0)
    np.testing.assert_allclose(kept.time, [2.5, 7.5, 17.5, 22.5, 27.5])
    assert stability_of(time, np.ones(time.size), 20.0) is None
    assert stability_of(time, np.ones(time.size), 0.05) is None


def powerups(tmp_path, bias, k=1.02, rates=(40.0, -40.0), name="gyro_x_deg_s", setting="rate_x_deg_s"):
    rows = [(q, w, each + k * w) for q, each in enumerate(bias) for w in rates for _ in range(3)]
    return read_powerups(written(tmp_path / "p.csv", f"powerup,{setting},{name}", *np.array(rows).T))


def test_repeatability_is_of_biases_free_of_the_scale_factor(tmp_path):
    bias = np.array([0.1, 0.13, 0.07, 0.12])
    line = written(tmp_path / "r.csv", "rate_x_deg_s,gyro_x_deg_s", RATES, 1.02 * RATES)
    found = only(acceptance([read_steps(line)], None, [powerups(tmp_path, bias)]))
    np.testing.assert_allclose(found.repeatability.values / DEG, bias / 1.02, rtol=1e-9)
    assert found.repeatability.sd / DEG == pytest.approx(np.std(bias, ddof=1) / 1.02, rel=1e-9)


def test_volts_and_millivolts_of_one_sensor_go_together(tmp_path):
    volts = 0.2 + 0.05 * RATES
    line = written(tmp_path / "r.csv", "rate_x_deg_s,gyro_x_v", RATES, volts)
    time = np.arange(300.0)
    rest = written(tmp_path / "s.csv", "time_s,gyro_x_mv", time, 200.0 + np.where(time % 2 == 0, 1.0, -1.0))
    found = only(acceptance([read_steps(line)], read_static(rest), [], (1.0,)))
    assert found.scale.bias / DEG == pytest.approx(4.0, rel=1e-9)
    assert found.stability[0].spread.sd / DEG == pytest.approx(0.02 * np.sqrt(300 / 299), rel=1e-9)


def test_a_steady_drift_is_pointed_out(tmp_path):
    time = 0.1 * np.arange(2000)
    rest = read_static(written(tmp_path / "s.csv", "time_s,gyro_x_deg_s,gyro_y_deg_s", time, 1e-3 * time, time % 7))
    trends = list(of_code(acceptance([], rest, []).warnings, Code.ACCEPTANCE_TREND))
    assert [each.subject for each in trends] == ["gyro x"]
    assert trends[0]["share"] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("header", "columns", "code"),
    [
        ("rate_x_deg_s,gyro_x_deg_s", (RATES[:2], RATES[:2]), "lab.few_settings"),
        ("rate_x_deg_s,gyro_x_rad_s", (RATES, RATES), "lab.scale_implausible"),
        ("rate_x_deg_s,gyro_x_deg_s", (RATES, -RATES), "lab.scale_implausible"),
        ("rate_x_deg_s,gyro_x_v", (0.2 + 0.0486 * RATES + 1e-3 * RATES**2, RATES), "lab.columns_exchanged"),
        ("rate_y_deg_s,gyro_x_deg_s", (RATES, RATES), "lab.no_setting"),
        ("rate_x_deg_s,gyro_x", (RATES, RATES), "lab.no_unit"),
        ("rate_x_deg_s,other", (RATES, RATES), "lab.no_sensor"),
        ("rate_x_deg_s,gyro_x_deg_s", (RATES, np.where(RATES == 10.0, np.nan, RATES)), "lab.value_missing"),
    ],
)
def test_rate_tables_that_cannot_be_are_refused(tmp_path, header, columns, code):
    with refused(InputError, code):
        acceptance([read_steps(written(tmp_path / "r.csv", header, *columns))], None, [])


def test_powerups_that_cannot_be_are_refused(tmp_path):
    with refused(InputError, "lab.powerup_settings"):
        acceptance([], None, [powerups(tmp_path, [0.1, 0.2], rates=(40.0,))])
    with refused(InputError, "lab.no_scatter"):
        acceptance([], None, [powerups(tmp_path, [0.1])])
    with refused(ConfigError, "lab.scale_unknown"):
        acceptance([], None, [powerups(tmp_path, [0.1, 0.2], name="gyro_x_v")])
    good = powerups(tmp_path, [0.1, 0.2])
    with refused(ConfigError, "lab.sensor_twice"):
        acceptance([], None, [good, good])
    line = written(tmp_path / "r.csv", "rate_x_deg_s,gyro_x_lsb", RATES, 100.0 * RATES + 3.0)
    with refused(ConfigError, "lab.two_units"):
        acceptance([read_steps(line)], None, [good])
    with refused(InputError, "lab.times_not_increasing"):
        read_static(written(tmp_path / "s.csv", "time_s,gyro_x_deg_s", np.array([1.0, 0.0, 2.0]), 0.0))


def test_a_record_of_little_more_than_one_part_has_the_moving_average_alone(tmp_path):
    """1,000 s smoothing of a record of 1,200 s, against its definition."""
    walk = np.cumsum(np.random.default_rng(7).normal(size=1200))
    found = stability_of(np.arange(1200.0), walk, 1000.0)
    moving = np.convolve(walk - walk.mean(), np.full(1000, 1e-3), mode="valid")
    assert found.sliding == pytest.approx(np.std(moving, ddof=1), rel=1e-9)
    assert np.isnan(found.spread.sd)
    assert found.spread.values.size == 1
    assert found.parts == pytest.approx(1.2)
    file = written(tmp_path / "s.csv", "time_s,gyro_x_deg_s", np.arange(1200.0), walk)
    (part,) = of_code(acceptance((), read_static(file), (), (1000.0,)).warnings, Code.ACCEPTANCE_ONE_PART)
    assert (part["parts"], part["length_s"]) == (pytest.approx(1.2), 1000.0)
