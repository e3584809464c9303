"""What several benches find wrong with a measurement: when, about what, and that there are words for it."""

from __future__ import annotations

import numpy as np

from insnav.findings import Code, of_code
from insnav.lab.bench_data import dwell_warnings, reduce_dwells
from insnav.lab.calibration import about, badly_conditioned, few, linear_fit
from insnav.lab.noise.static_noise import static_noise
from insnav.lab.rate_sweep import check_rates
from insnav.messages import catalogue, language, sentence
from insnav.types import ImuData
from insnav.units import DEG
from tests.lab.signals import at_rest


def test_a_fit_of_settings_close_together_is_ill_conditioned() -> None:
    fits = {}
    for name, start in (("gyro x", 0.0), ("gyro y", 100.0)):
        x = start + np.arange(5.0)
        fits[name] = linear_fit(np.column_stack((np.ones(5), x)), x, ("zero", "scale factor"))
    (found,) = badly_conditioned(fits)
    assert (found.code, found.subject) == (Code.BENCH_CONDITION, "gyro y")
    assert found["condition"] == fits["gyro y"].condition > found["limit"]
    assert all(text in sentence(found) for text in ("gyro y", f"{found['condition']:.0f}"))


def test_few_are_fewer_than_usual_and_subjects_name_sensor_and_file() -> None:
    assert few("poses", 20, 20) == ()
    (found,) = about("rates.csv", few("rates", 4, 10, "gyro x"))
    assert (found["count"], found["limit_count"], found.subject) == (4, 10, "gyro x (rates.csv)")
    assert about("gyro x", few("rates", 4, 10))[0].subject == "gyro x"


def test_a_dwell_with_many_spikes_is_named() -> None:
    settings = np.repeat([10.0, 20.0], 100)[:, None]
    samples = settings / 100.0 + 1e-4 * np.random.default_rng(1).normal(size=settings.shape)
    samples[110:170:6] += 0.05
    (found,) = dwell_warnings(reduce_dwells(settings, samples, 0.01), ("gyro x",), None)
    assert (found.code, found.subject, found["dwell"], found["share"]) == (Code.BENCH_SPIKES, "gyro x", 2, 0.1)
    assert "10 %" in sentence(found)


def test_a_sweep_to_one_side_is_named() -> None:
    rate = np.zeros((3 * 40, 3))
    for axis, start in enumerate((-20.0, -5.0, -20.0)):
        rate[40 * axis : 40 * (axis + 1), axis] = DEG * (start + np.arange(40.0))
    own = [np.flatnonzero(~np.delete(rate, axis, axis=1).any(axis=1)) for axis in range(3)]
    (found,) = check_rates(rate, own, "")
    assert (found.code, found.subject) == (Code.BENCH_ONE_SIDED, "gyro y")
    np.testing.assert_allclose([found["low_rad_s"], found["high_rad_s"]], [-5.0 * DEG, 34.0 * DEG])
    assert all(text in sentence(found) for text in ("-5 deg/s", "34 deg/s"))


def test_spikes_in_a_record_at_rest_are_counted() -> None:
    rest = at_rest(10_000, 0.01)
    gyro = 1e-4 * np.random.default_rng(2).normal(size=(10_000, 3))
    gyro[[500, 900, 1300], 1] += 10.0
    accel = rest.accel + 1e-3 * np.random.default_rng(3).normal(size=(10_000, 3))
    (found,) = of_code(static_noise(ImuData(rest.time, gyro, accel)).warnings, Code.ALLAN_DAMAGED)
    assert (found["what"], found["count"]) == (Code.IMU_SPIKE, 3)
    assert catalogue(language())["words"][Code.IMU_SPIKE] in sentence(found)
