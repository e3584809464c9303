"""Accelerometers in known positions: the known triad is recovered, with a stated uncertainty that holds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import insnav
from insnav.exceptions import InputError
from insnav.imu import load_calibration
from insnav.units import G0
from tests.refusals import refused

FACES = np.vstack([np.eye(3), -np.eye(3)])  # true specific force in g
MATRIX = np.array([[1.01, 0.004, -0.003], [-0.002, 0.985, 0.006], [0.005, -0.001, 1.002]])
BIAS = np.array([0.02, -0.03, 0.05])  # [g]


def table(path: Path, unit: str = "g", scale: float = 1.0, noise: float = 0.0, seed: int = 1, faces=FACES) -> Path:
    """Means as application notes tabulate them: true and measured components, row by row."""
    means = scale * (faces @ MATRIX.T + BIAS + noise * np.random.default_rng(seed).normal(size=faces.shape))
    names = [f"{axis}_{kind}" for axis in "xyz" for kind in ("true (g)", f"mean ({unit})", "std")]
    rows = [
        ",".join(f"{x:.12g}" for pair in zip(a, b, strict=True) for x in (*pair, 0.0))
        for a, b in zip(faces, means, strict=True)
    ]
    path.write_text("\n".join([",".join(names), *rows, ""]))
    return path


@pytest.mark.parametrize(("unit", "scale"), [("g", 1.0), ("m/s^2", G0), ("mg", 1000.0)])
def test_six_means_give_the_matrix_and_the_bias_in_any_unit(tmp_path, unit, scale):
    found = insnav.calibrate("accel", table(tmp_path / "six.csv", unit, scale)).found
    np.testing.assert_allclose(found.errors.accel_matrix, MATRIX, atol=1e-9)
    np.testing.assert_allclose(found.errors.accel_bias, BIAS * G0, atol=1e-9)


def test_local_gravity_scales_forces_in_g(tmp_path):
    found = insnav.calibrate("accel", table(tmp_path / "six.csv", "m/s^2", G0), gravity=9.78).found
    np.testing.assert_allclose(found.errors.accel_matrix, MATRIX * G0 / 9.78, atol=1e-9)


def test_counts_are_converted_by_the_calibration_file(tmp_path):
    """16384 LSB/g: the file maps the outputs back to the true specific forces."""
    result = insnav.calibrate("accel", table(tmp_path / "six.csv", "LSB", 16384.0))
    result.save(tmp_path / "out")
    errors = load_calibration(tmp_path / "out" / "calibration.toml")
    raw, outputs = errors.accel_raw, 16384.0 * (FACES @ MATRIX.T + BIAS)
    assert raw is not None
    forces = np.linalg.solve(errors.accel_matrix, ((outputs - raw.zero) / raw.scale).T).T
    np.testing.assert_allclose(forces, FACES * G0, atol=1e-6)


def test_the_stated_sd_is_the_scatter_of_repeated_tests(tmp_path):
    faces = np.vstack([FACES] * 4)
    runs = [
        insnav.calibrate("accel", table(tmp_path / "six.csv", noise=0.002, seed=k, faces=faces)).found
        for k in range(60)
    ]
    scatter = np.std([run.errors.accel_matrix for run in runs], axis=0)
    stated = np.mean([run.sd.accel_matrix for run in runs], axis=0)
    np.testing.assert_allclose(stated / scatter, 1.0, atol=0.3)


def test_means_that_do_not_determine_the_triad_are_refused(tmp_path):
    with refused(InputError, "lab.few_measurements"):
        insnav.calibrate("accel", table(tmp_path / "six.csv", faces=FACES[:4]))
    with refused(InputError, "lab.output_reversed"):
        insnav.calibrate("accel", table(tmp_path / "six.csv", scale=-1.0))


def test_six_means_alone_give_their_faces_and_their_unit(tmp_path):
    """Only the outputs, in any order: in each position one axis is vertical. The scale then is that of the same file."""
    whole = table(tmp_path / "whole.csv", noise=1e-3)
    lines = [line.split(",") for line in whole.read_text().splitlines()]
    kept = [1, 4, 7]  # without the true ones and the scatter
    bare = tmp_path / "bare.csv"
    named = [["ax_mean", "ay_mean", "az_mean"], *([row[i] for i in kept] for row in lines[:0:-1])]
    bare.write_text("\n".join(map(",".join, named)) + "\n")
    one, other = (insnav.calibrate("accel", each).found.errors for each in (whole, bare))
    np.testing.assert_allclose(other.accel_matrix, one.accel_matrix, atol=1e-9)
    np.testing.assert_allclose(other.accel_bias, one.accel_bias, atol=1e-9)
    bare.write_text("\n".join(map(",".join, named[:-1])) + "\n")  # five faces
    with refused(InputError, "columns.missing"):
        insnav.calibrate("accel", bare)
