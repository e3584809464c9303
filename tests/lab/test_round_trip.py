"""A known IMU on simulated benches: what is corrected by the calibration lies within the printed uncertainty."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insnav.imu import ImuErrors, calibration_to_toml, correct, load_calibration
from insnav.lab.calibration import BenchOptions, CalibrationSd, carried_over, coverage_factor
from insnav.lab.nine_position import calibrate_nine
from insnav.lab.rate_sweep import calibrate_sweeps, sweep_errors
from insnav.lab.single_axis import rate_table as gyro_method
from insnav.lab.single_axis import tumble as accel_method
from insnav.lab.single_axis.rate_table import read_record
from insnav.types import ImuData
from insnav.units import DEG
from tests.lab.modules import NINE, make
from tests.lab.sweeps import RATES, gyros, table
from tests.lab.test_nine_position import true_triad

G = 9.81
TRIALS, POINTS = 60, 40


def motion(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Rates up to 200 deg/s and specific forces up to 1 g, (n, 3)."""
    return 200.0 * DEG * rng.uniform(-1.0, 1.0, (POINTS, 3)), G * rng.uniform(-1.0, 1.0, (POINTS, 3))


def through_the_file(errors: ImuErrors, folder: Path) -> ImuErrors:
    (folder / "calibration.toml").write_text(calibration_to_toml(errors))
    return load_calibration(folder / "calibration.toml")


def shown(gyro: np.ndarray, accel: np.ndarray) -> ImuData:
    return ImuData(np.arange(float(len(gyro))), gyro, accel)


def covered(shares: list[float]) -> None:
    """Points of a trial are not independent: the trials scatter, and with them their mean."""
    spread = np.std(shares) / np.sqrt(len(shares))
    assert spread < 0.03
    assert np.mean(shares) == pytest.approx(0.95, abs=max(0.02, 3.0 * spread))


def test_raw_volts_of_rate_table_and_tumble(tmp_path: Path) -> None:
    rng, rates, angles = np.random.default_rng(1), np.arange(-80.0, 81.0, 20.0), np.arange(0.0, 360.0, 30.0)
    of_rate, of_force = [], []
    for _ in range(TRIALS):
        zero, scale = rng.normal(size=6), rng.uniform(0.04, 0.06, 6)
        records = []
        for i in range(6):
            x, header, schema = (
                (rates, "rate_deg_s", gyro_method.SCHEMA) if i < 3 else (angles, "angle_deg", accel_method.SCHEMA)
            )
            felt = rates if i < 3 else 40.0 * np.sin(np.radians(angles))
            volts = zero[i] + scale[i] * felt + 2e-3 * rng.normal(size=x.size)
            path = tmp_path / f"{i}.csv"
            np.savetxt(path, np.column_stack((x, volts)), "%.9g", ",", header=f"{header},output_v", comments="")
            records.append(read_record(path, schema))
        gyro = gyro_method.fit(tuple(records[:3]), BenchOptions(keep=(-80.0, 80.0)))
        accel = accel_method.fit(tuple(records[3:]), BenchOptions(gravity=G))
        assert gyro.errors is not None
        assert accel.errors is not None
        known = through_the_file(carried_over(gyro.errors, accel.errors, "accel"), tmp_path)
        rate, force = motion(rng)
        rate *= 0.4  # within the table
        volts = zero + scale * np.column_stack((rate / DEG, 40.0 * force / G))
        assert known.gyro_raw is not None
        assert known.accel_raw is not None
        read = [known.gyro_raw.value(volts[:, i], i) for i in range(3)]
        read += [known.accel_raw.value(volts[:, 3 + i], i) for i in range(3)]
        got = correct(shown(np.column_stack(read[:3]), np.column_stack(read[3:])), known)
        rate_sd, _ = gyro.sd.corrected(gyro.errors, rate, force)
        _, force_sd = accel.sd.corrected(accel.errors, rate, force)
        limit = coverage_factor(gyro.detail[0].fit.dof), coverage_factor(accel.detail[0].fit.dof)
        of_rate.append(np.mean(np.abs(got.gyro - rate) < limit[0] * rate_sd))
        of_force.append(np.mean(np.abs(got.accel - force) < limit[1] * force_sd))
    covered(of_rate)
    covered(of_force)


def test_gyro_matrix_of_rate_sweeps(tmp_path: Path) -> None:
    rng, inside = np.random.default_rng(2), []
    for _ in range(TRIALS):
        sensor, at = gyros(rng), table(RATES[::10])
        found = calibrate_sweeps(at * DEG, sensor.show(at, 0.05, rng) * DEG, np.full(at.shape, 0.05 * DEG), raw=False)
        errors, sd_of = sweep_errors(found, "deg/s")
        rate, force = motion(rng)
        got = correct(shown(sensor.show(rate / DEG, 0.0, rng) * DEG, force), through_the_file(errors, tmp_path))
        sd, _ = sd_of.corrected(errors, rate, force)
        inside.append(np.mean(np.abs(got.gyro - rate) < coverage_factor(found.fits[0].dof) * sd))
    covered(inside)


def test_accelerometers_of_nine_positions(tmp_path: Path) -> None:
    rng, inside = np.random.default_rng(3), []
    for _ in range(TRIALS):
        modules = make(rng, 0.002, 0.002)
        found = calibrate_nine(*NINE.T, modules.measure(NINE, 0.005, rng), G)
        errors = ImuErrors(gyro_matrix=found.gyro_matrix, accel_bias=found.accel_bias, accel_matrix=found.accel_matrix)
        sd_of = CalibrationSd(accel_bias=found.accel_bias_sd, accel_matrix=found.accel_matrix_sd)
        rate, force = motion(rng)
        bias = [0.5 * (modules.bias[a] + modules.bias[b]) for a, b in ((3, 4), (0, 5), (1, 2))]
        got = correct(shown(rate, force @ true_triad(modules).T + bias), through_the_file(errors, tmp_path))
        _, sd = sd_of.corrected(errors, rate, force)
        inside.append(np.mean(np.abs(got.accel - force) < coverage_factor(found.dof) * sd))
    covered(inside)
