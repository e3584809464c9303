"""Real parts: every figure has its document, every unit is right, nothing is filled in."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insnav.exceptions import ConfigError
from insnav.imu import PRESETS, load_imu
from insnav.imu.library import PROVENANCE, Part, completed, find_part, parts
from tests.refusals import refused

DEG, G = math.pi / 180.0, 9.80665
# worked out by hand from the document, in SI: part, sensor, field, value
BY_HAND = (
    ("STIM300", "gyro", "bias", 250.0 / 2.0 * 4.8481368e-6),  # +-250 deg/h; 1 deg/h = 4.848e-6 rad/s
    ("STIM300", "gyro", "bias_instability", 0.5 / 0.664 * 4.8481368e-6),
    ("STIM300", "accel", "bias", 0.75e-3 / 2.0 * G),
    ("STIM300", "gyro", "g_sensitivity", 4.8481368e-6 / G),
    ("ADIS16465-1", "gyro", "bias", 0.4 * DEG),
    ("ADIS16465-1", "gyro", "random_walk", 4.3633e-5),  # 0.15 deg/sqrt(h) as NavToolkit converts it
    ("ADIS16465-1", "accel", "bias_instability", 200e-5),  # tuned: 200 mGal; 1 mGal = 1e-5 m/s^2
    ("HG1700", "accel", "random_walk", 3.302e-4),  # 0.065 ft/s/sqrt(h), NavToolkit's own conversion
    ("HG1700", "gyro", "random_walk", 3.6361e-5),
    ("HG9900", "gyro", "bias", 1.6968e-8),
    ("HG9900", "gyro", "random_walk", 5.8178e-7),
    ("SPAN-CPT", "gyro", "random_walk", math.sqrt(3.38802348178723e-09)),
    ("SPAN-CPT", "accel", "random_walk", math.sqrt(2.60420170553977e-06)),
    ("SPAN-CPT", "accel", "rate_random_walk", math.sqrt(1.66067346797506e-09)),
    ("MTi-300", "gyro", "random_walk", 0.01 * DEG),
    ("MTi-300", "accel", "random_walk", 60e-6 * G),
    ("VN-310", "gyro", "random_walk", 5.0 * DEG / 3600.0),
    ("MPU-6000", "accel", "random_walk", 0.24e-3 * G),
    ("Bosch (TEX-CUP)", "gyro", "random_walk", math.sqrt(0.02) * DEG),
    ("OpenRTK330", "gyro", "scale_factor", 0.0005),
    ("IMU-FSAS", "accel", "bias", 1000e-6 * G),
)


def part(name: str) -> Part:
    found = find_part(name)
    assert found is not None
    return found


def test_there_are_forty_and_every_figure_has_its_document() -> None:
    assert len(parts()) >= 40
    for each in parts():
        assert each.grade in PRESETS
        assert each.figures
        for figure in each.figures:
            assert figure.document
            assert figure.where
            assert figure.provenance in PROVENANCE
            assert np.all(figure.value > 0.0)


@pytest.mark.parametrize(("name", "sensor", "field", "value"), BY_HAND)
def test_conversions_are_those_by_hand(name: str, sensor: str, field: str, value: float) -> None:
    got = getattr(getattr(part(name).spec, sensor), field)
    assert np.max(got) == pytest.approx(value, rel=2e-3)  # documents round to three digits


def test_no_figure_is_out_of_the_range_of_its_class() -> None:
    # what a wrong unit does is a factor of 60 or more; classes overlap by less than that
    span = {"gyro.random_walk": (5e-4, 10.0), "accel.random_walk": (2e-3, 1.0)}  # deg/sqrt(h), m/s/sqrt(h)
    for each in parts():
        for key, (low, high) in span.items():
            sensor, field = key.split(".")
            size = float(np.max(getattr(getattr(each.spec, sensor), field)))
            size *= 60.0 / DEG if sensor == "gyro" else 60.0
            assert size == 0.0 or low <= size <= high, (each.name, key, size)


def test_nothing_is_filled_in() -> None:
    for each in parts():
        given = {figure.key for figure in each.figures}
        for name, sensor in (("gyro", each.spec.gyro), ("accel", each.spec.accel)):
            for field in ("bias", "bias_instability", "random_walk", "scale_factor", "misalignment"):
                here = bool(np.any(getattr(sensor, field)))
                assert here == (f"{name}.{field}" in given)
                assert here != (f"{name}.{field}" in each.missing)


def test_of_documents_the_nearest_to_the_sensor_counts() -> None:
    used = {figure.key: figure for figure in part("ADIS16465-1").figures if figure.used}
    assert used["gyro.random_walk"].provenance == "datasheet"
    assert used["gyro.bias_instability"].statistic == "1 sd"  # the lowest point of an Allan deviation promises more
    assert part("ADIS16465-1").provenance == "filter tuning"


@pytest.mark.parametrize("name", ["ADIS16505-3", "adis16505-3", "ADIS 16505 3", "adis165053"])
def test_a_part_goes_where_a_model_does(name: str) -> None:
    assert load_imu(name).name == "ADIS16505-3"
    assert "gyro.bias" in load_imu(name).absent


def test_part_of_a_name_is_not_enough() -> None:
    with refused(ConfigError, "imu.unknown") as caught:
        load_imu("ADIS16505")
    assert "adis16505-3" in caught.value.values["parts"]


def test_a_filter_gets_no_zeros() -> None:
    for each in parts():
        spec, taken = completed(each, load_imu(each.grade))
        assert taken == each.missing
        for sensor in (spec.gyro, spec.accel):
            for field in ("bias", "bias_instability", "random_walk", "scale_factor", "misalignment"):
                assert np.all(getattr(sensor, field) > 0.0)
            assert math.isfinite(sensor.correlation_time)
        if "gyro.random_walk" not in each.missing:
            assert np.array_equal(spec.gyro.random_walk, each.spec.gyro.random_walk)
