"""The table of error terms: complete, and each signal that drives an error is the one of its definition."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from insnav.imu import SensorSpec
from insnav.imu.specification import TERMS, terms_of
from insnav.units import UNITS

RATE, FORCE = np.array([[0.1, -0.2, 0.3]]), np.array([[1.0, -2.0, -9.8]])
TIME = np.array([[5.0]])


def test_every_size_of_a_sensor_is_a_term() -> None:
    keys = {item.name for item in fields(SensorSpec)} - {"correlation_time"}
    assert {term.key for term in terms_of("gyro")} == keys
    assert {term.key for term in terms_of("accel")} == keys - {"g_sensitivity"}
    assert len({term.family for term in TERMS}) == len(TERMS)


def test_units_are_of_the_dimension() -> None:
    for term in TERMS:
        assert UNITS[term.unit][0] == term.dimension


@pytest.mark.parametrize(
    ("family", "signal"),
    [
        ("gyro bias", [[1.0, 1.0, 1.0]]),
        ("gyro bias ramp", [[5.0, 5.0, 5.0]]),
        ("gyro scale factor", RATE),
        ("accel scale factor", FORCE),
        ("gyro asymmetry", np.abs(RATE)),
        ("accel asymmetry", np.abs(FORCE)),
        ("gyro non-linearity", RATE**2),
        ("accel non-linearity", FORCE**2),
        ("gyro g-sensitivity", FORCE),
    ],
)
def test_signal_that_drives_a_term(family: str, signal: object) -> None:
    term = next(term for term in TERMS if term.family == family)
    assert term.drive is not None
    np.testing.assert_array_equal(term.drive(RATE, FORCE, TIME), signal)


def test_elements_and_integrals() -> None:
    count = {term.family: len(term.elements) for term in TERMS}
    assert (count["gyro bias"], count["accel misalignment"], count["gyro g-sensitivity"]) == (3, 6, 9)
    assert {term.integrals for term in terms_of("gyro")} == {3}
    assert {term.integrals for term in terms_of("accel")} == {2}
    assert {term.key for term in TERMS if not term.in_budget} == {
        *("resolution", "range", "vibration_rectification", "bias_slope", "scale_slope")
    }
