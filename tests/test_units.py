"""Units: factors worked out by hand, and what is refused."""

from __future__ import annotations

import math

import pytest

from insnav.config_file import parse_quantity
from insnav.exceptions import ConfigError
from insnav.units import UNITS, units_of
from tests.refusals import refused

# each value in SI, worked out independently of the table
KNOWN = {
    ("360 deg", "angle"): 6.283185307179586,
    ("60 arcmin", "angle"): 0.017453292519943295,
    ("15 deg/h", "rate"): 7.27220521664304e-05,
    ("1 g", "acceleration"): 9.80665,
    ("1e6 ug", "acceleration"): 9.80665,
    ("1000 mg", "acceleration"): 9.80665,
    ("100000 mGal", "acceleration"): 1.0,
    ("60 deg/sqrt(h)", "angle random walk"): 0.017453292519943295,
    ("3600 deg/h/sqrt(Hz)", "angle random walk"): 0.017453292519943295,
    ("1 deg/s/sqrt(Hz)", "angle random walk"): 0.017453292519943295,
    ("60 m/s/sqrt(h)", "velocity random walk"): 1.0,
    ("1e6 ug/sqrt(Hz)", "velocity random walk"): 9.80665,
    # as data sheets write them
    ("7 mdps/√Hz", "angle random walk"): 0.00012217304763960307,
    ("0.007 dps/rtHz", "angle random walk"): 0.00012217304763960307,
    ("0.15 °/√hr", "angle random walk"): 4.363323129985824e-05,
    ("160 µg/√Hz", "velocity random walk"): 0.001569064,
    ("1000 ppm", "ratio"): 1e-3,
    ("5 %", "ratio"): 0.05,
    ("3.6 km/h", "velocity"): 1.0,
    ("1 h", "time"): 3600.0,
    ("-2.5e-1 km", "length"): -250.0,
}


@pytest.mark.parametrize(("text", "dimension"), KNOWN)
def test_known_quantities(text, dimension):
    assert parse_quantity(text, dimension) == pytest.approx(KNOWN[text, dimension], rel=1e-14)


@pytest.mark.parametrize("text", ["1.5deg/h", " 1.5 deg/h ", "+1.5   deg/h", "15e-1 deg/h", "1.50 deg/h"])
def test_spacing_and_number_format_do_not_matter(text):
    assert parse_quantity(text, "rate") == pytest.approx(1.5 * math.pi / 180 / 3600, rel=1e-15)


@pytest.mark.parametrize(
    "text", ["5", "", "deg/h", "5 deg/hour", "5 deg", "nan deg/h", "inf deg/h", "1e400 deg/h", "5,3 deg/h"]
)
def test_anything_else_is_refused_with_the_choices(text):
    with pytest.raises(ConfigError) as caught:
        parse_quantity(text, "rate", where="imu.toml: gyro.bias")
    assert caught.value.exit_code == 2
    assert caught.value.where == "imu.toml: gyro.bias"
    assert caught.value.code.partition(".")[0] == "unit"
    assert caught.value.values["text"] == text


def test_a_unit_of_another_dimension_is_named():
    with refused(ConfigError, "unit.of_other_dimension") as caught:
        parse_quantity("5 deg", "rate")
    assert (caught.value.values["other"], caught.value.values["dimension"]) == ("angle", "rate")


@pytest.mark.parametrize("value", [5, 5.0, None])
def test_a_number_without_unit_is_refused(value):
    with refused(ConfigError, "unit.missing"):
        parse_quantity(value, "rate")


def test_every_unit_is_found_under_its_dimension():
    for name, (dimension, factor) in UNITS.items():
        assert name in units_of(dimension)
        assert parse_quantity(f"2 {name}", dimension) == 2 * factor
