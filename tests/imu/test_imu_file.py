"""The IMU file: every unit, every error, and back again."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insnav.exceptions import ConfigError
from insnav.imu import PRESETS, ImuSpec, load_imu, to_toml
from tests.refusals import problems_of, refused

EXAMPLE = """
name = "example"
[gyro]
bias = "50 deg/h"
bias_instability = "5 deg/h"
correlation_time = "1 h"
random_walk = "0.24 deg/sqrt(h)"
scale_factor = "1000 ppm"
misalignment = "0.5 mrad"
[accel]
bias = "250 mGal"
bias_instability = ["40 ug", "50 ug", "60 ug"]
correlation_time = "1 h"
random_walk = "0.24 m/s/sqrt(h)"
scale_factor = "1000 ppm"
misalignment = "0.5 mrad"
[initial]
position = "1 m"
velocity = "0.05 m/s"
tilt = "0.003 deg"
heading = "1 deg"
"""


@pytest.fixture
def load(tmp_path: Path):
    def reader(text: str) -> ImuSpec:
        path = tmp_path / "imu.toml"
        path.write_text(text, encoding="utf-8")
        return load_imu(str(path))

    return reader


def problems(load, text: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        load(text)
    assert "imu.toml" in caught.value.where
    return problems_of(caught.value)


def test_every_key_is_read_in_si(load) -> None:
    spec = load(EXAMPLE)
    hour = 3600.0
    np.testing.assert_allclose(spec.gyro.bias, np.radians(50.0) / hour)
    np.testing.assert_allclose(spec.gyro.bias_instability, np.radians(5.0) / hour)
    np.testing.assert_allclose(spec.gyro.random_walk, np.radians(0.24) / 60.0)
    np.testing.assert_allclose(spec.gyro.scale_factor, 1e-3)
    np.testing.assert_allclose(spec.gyro.misalignment, 5e-4)
    assert spec.gyro.correlation_time == hour
    np.testing.assert_allclose(spec.accel.bias, 2.5e-3)
    np.testing.assert_allclose(spec.accel.bias_instability, np.array([40.0, 50.0, 60.0]) * 9.80665e-6)
    np.testing.assert_allclose(spec.accel.random_walk, 0.24 / 60.0)
    assert spec.initial is not None
    assert spec.initial.position == 1.0
    assert spec.initial.velocity == 0.05
    assert math.isclose(spec.initial.tilt, math.radians(0.003))
    assert math.isclose(spec.initial.heading, math.radians(1.0))
    assert spec.name == "example"
    assert spec.absent == ()


def test_rate_random_walk_is_a_bias_unit_over_root_time(load) -> None:
    spec = load('[gyro]\nrate_random_walk = "6 deg/h/sqrt(h)"\n[accel]\nrate_random_walk = "1 ug/sqrt(s)"\n')
    np.testing.assert_allclose(spec.gyro.rate_random_walk, np.radians(6.0) / 3600.0 / 60.0)
    np.testing.assert_allclose(spec.accel.rate_random_walk, 9.80665e-6)


def test_absent_is_zero_and_listed(load) -> None:
    spec = load('[gyro]\nbias = "1 deg/h"\n[initial]\nposition = "1 m"\n')
    assert not spec.gyro.random_walk.any()
    assert not spec.accel.bias.any()
    assert spec.gyro.correlation_time == math.inf
    assert "gyro.bias" not in spec.absent
    expected = {
        "gyro.random_walk",
        "gyro.correlation_time",
        "accel.bias",
        "accel.misalignment",
        "initial.heading",
    }
    assert expected <= set(spec.absent)
    assert spec.name == "imu"  # of the file


def test_no_number_is_ever_nan(load) -> None:
    for spec in (load('[gyro]\n[accel]\nbias = "1 mg"\n'), *map(load_imu, PRESETS)):
        for sensor in (spec.gyro, spec.accel):
            for item in fields(sensor):
                assert not np.isnan(getattr(sensor, item.name)).any()


def same(first: ImuSpec, second: ImuSpec) -> None:
    for sensor in ("gyro", "accel"):
        a, b = getattr(first, sensor), getattr(second, sensor)
        for item in fields(a):
            np.testing.assert_allclose(getattr(a, item.name), getattr(b, item.name), rtol=1e-14, atol=0.0)
    assert (first.name, first.source, first.absent) == (second.name, second.source, second.absent)
    if first.initial is None:
        assert second.initial is None
    else:
        for item in fields(first.initial):
            assert math.isclose(getattr(first.initial, item.name), getattr(second.initial, item.name), rel_tol=1e-14)


@pytest.mark.parametrize(
    "text",
    [
        EXAMPLE,
        'source = "a \\"quoted\\" = {brace} [x]"\n[gyro]\nbias = ["1 deg/h", "2 deg/s", "3 rad/s"]\n',
        '[accel]\nrate_random_walk = "3 ug/sqrt(h)"\nrandom_walk = "100 ug/sqrt(Hz)"\n[initial]\n',
    ],
)
def test_what_is_written_reads_back(load, text: str) -> None:
    spec = load(text)
    same(spec, load(to_toml(spec)))


def test_keys_are_written_in_the_order_in_which_they_are_read(load) -> None:
    """The digest of a case of the corpus is of this text."""
    text = EXAMPLE.replace("scale_factor", 'rate_random_walk = "1 deg/h/sqrt(h)"\nscale_factor', 1)
    keys = [line.split(" =")[0] for line in to_toml(load(text)).splitlines() if " = " in line]
    assert keys[: keys.index("misalignment") + 1] == [
        *("name", "bias", "bias_instability", "correlation_time", "random_walk", "rate_random_walk"),
        *("scale_factor", "misalignment"),
    ]


@pytest.mark.parametrize("name", PRESETS)
def test_presets_read_back(load, name: str) -> None:
    spec = load_imu(name)
    same(spec, load(to_toml(spec)))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('[gyro]\nbiass = "1 deg/h"', "gyro.biass: config.unknown_key"),
        ('[gyro]\nquux = "1 deg/h"', "gyro.quux: config.unknown_key"),
        ('[giro]\nbias = "1 deg/h"', "giro: config.unknown_key"),
        ("[gyro]\nbias = 5", "gyro.bias: config.no_quantity"),
        ("[gyro]\nbias = true", "gyro.bias: config.no_quantity"),
        ("[gyro]\nbias = nan", "gyro.bias: config.no_quantity"),
        ("[gyro]\nbias = 2020-01-01", "gyro.bias: config.no_quantity"),
        ("[gyro]\nbias = {a = 1}", "gyro.bias: config.no_quantity"),
        ('[gyro]\nbias = "nan deg/h"', "gyro.bias: unit.missing"),
        ('[gyro]\nbias = "1e400 deg/h"', "gyro.bias: unit.not_finite"),
        ('[gyro]\nbias = "-1 deg/h"', "gyro.bias: config.negative"),
        ('[gyro]\nbias = "1 mg"', "gyro.bias: unit.of_other_dimension"),
        ('[accel]\nbias = "1 mgg"', "accel.bias: unit.unknown"),
        ('[accel]\nbias = ["1 mg", "2 mg"]', "accel.bias: config.not_by_axis"),
        ('[accel]\nbias = ["1 mg", "2 mg", 3]', "accel.bias: config.no_quantity"),
        ('[gyro]\ncorrelation_time = ["1 h", "1 h", "1 h"]', "gyro.correlation_time: config.no_quantity"),
        ('[gyro]\ncorrelation_time = "0 h"', "gyro: config.not_above_zero"),
        ('[gyro]\nbias_instability = "1 deg/h"', "gyro: imu.instability_without_time"),
        ('[gyro]\nrate_random_walk = "1 deg/h"', "gyro.rate_random_walk: unit.of_other_dimension"),
        ('gyro = "1 deg/h"', "gyro: config.no_table"),
        ("name = 1\n[gyro]", "name: config.no_text"),
        ('name = "x"', "imu.toml: imu.empty_file"),
        ("", "imu.toml: imu.empty_file"),
        ("[gyro\n", "imu.toml: config.no_toml"),
        (f"[gyro]\nbias = 0x{'f' * 9000}", "gyro.bias: config.no_quantity"),
        (f"[gyro]\nbias = {'9' * 9000}", "imu.toml: config.no_toml"),
        (f"x = {'[' * 50_000}", "imu.toml: config.too_nested"),
        (f"a{'.a' * 30_000} = 1", "imu.toml: config.too_nested"),
        ("[gyro" + '. "b=#" ' * 30_000 + "]", "imu.toml: config.too_nested"),
        (f'[gyro]\nbias = "1{"." * 90}" # 1.1.1.1.1.1.1.1.1.1.1.1.1.1.1.1.1.1.1.1.1', "gyro.bias: unit.unknown"),
        (f'[gyro]\nbias = "{" " * 9000}1 deg/h"', "gyro.bias: config.text_too_long"),
        ("#" * 1_000_001, "imu.toml: config.too_long"),
    ],
)
def test_every_mistake_is_named(load, text: str, expected: str) -> None:
    (found,) = problems(load, text)
    assert found.endswith(expected)


def test_all_mistakes_are_told_at_once(load) -> None:
    text = '[gyro]\nbias = "1 mg"\nbiass = 1\n[accel]\nbias = nan\n[initial]\nheading = "-1 deg"\n'
    assert sorted(problems(load, text)) == [
        "accel.bias: config.no_quantity",
        "gyro.bias: unit.of_other_dimension",
        "gyro.biass: config.unknown_key",
        "initial.heading: config.negative",
    ]


def test_a_misspelt_preset_is_suggested() -> None:
    with refused(ConfigError, "imu.unknown") as caught:
        load_imu("tactial")
    assert caught.value.values["close"] == "tactical"
    assert caught.value.exit_code == 2


@pytest.mark.parametrize("name", ["no/such/file.toml", "x" * 5000, "a\0b", ""])
def test_a_missing_file_is_a_configuration_error(name: str) -> None:
    with pytest.raises(ConfigError):
        load_imu(name)


def test_a_folder_or_a_binary_is_a_configuration_error(tmp_path: Path) -> None:
    with refused(ConfigError, "config.unreadable"):
        load_imu(str(tmp_path))
    (tmp_path / "imu.toml").write_bytes(bytes(range(256)))
    with refused(ConfigError, "config.no_toml"):
        load_imu(str(tmp_path / "imu.toml"))


VALUES = st.one_of(
    st.sampled_from(['"1 deg/h"', '"0.1 deg/sqrt(h)"', '"1 mg"', '"5 ppm"', '"1 h"', '"{0} %s"', "inf", "1e400"]),
    st.integers().map(str),
    st.floats().map(repr),
    st.text(st.characters(codec="ascii", categories=["L", "N", "P", "Zs"], exclude_characters='"\\')).map(
        '"{}"'.format
    ),
    st.lists(st.sampled_from(['"1 deg/h"', '"1 ug"', "1", "[]"]), max_size=4).map(lambda x: f"[{', '.join(x)}]"),
)
KEYS = [
    "bias",
    "bias_instability",
    "correlation_time",
    "random_walk",
    "scale_factor",
    "misalignment",
    "rate_random_walk",
]


@settings(max_examples=150, deadline=None)
@given(table=st.sampled_from(["gyro", "accel"]), values=st.dictionaries(st.sampled_from([*KEYS, "x"]), VALUES))
def test_any_value_is_valid_or_a_configuration_error(tmp_path_factory, table: str, values: dict[str, str]) -> None:
    path = tmp_path_factory.getbasetemp() / "fuzz.toml"
    path.write_text("\n".join([f"[{table}]", *(f"{key} = {value}" for key, value in values.items())]))
    with suppress(ConfigError):  # any other error fails
        assert np.all(getattr(load_imu(str(path)), table).bias >= 0.0)


def test_presets_become_more_accurate_in_order() -> None:
    specs = [load_imu(name) for name in PRESETS]
    for sensor in ("gyro", "accel"):
        biases = [float(np.max(getattr(spec, sensor).bias)) for spec in specs]
        assert biases == sorted(biases, reverse=True)
        for key in ("bias", "bias_instability", "random_walk", "scale_factor", "misalignment"):
            sizes = [float(np.max(getattr(getattr(spec, sensor), key))) for spec in specs]
            assert sizes[0] > 5.0 * sizes[-1] > 0.0


@pytest.mark.parametrize(
    ("name", "bias_deg_h", "bias_ug", "arw_deg_sqrt_h", "vrw_m_s_sqrt_h"),
    [  # figures of the datasheets, by hand
        ("consumer", 1800.0, 20_000.0, 0.24, 0.0588),
        ("automotive", 900.0, 2_500.0, 0.3, 0.05),
        ("industrial", 50.0, 1_400.0, 0.15, 0.012),
        ("tactical", 1.0, 1_000.0, 0.125, 0.0198),
        ("navigation", 0.0035, 25.0, 0.002, 0.00588),
    ],
)
def test_presets_hold_their_datasheets(
    name: str, bias_deg_h: float, bias_ug: float, arw_deg_sqrt_h: float, vrw_m_s_sqrt_h: float
) -> None:
    spec = load_imu(name)
    assert spec.name == name
    np.testing.assert_allclose(np.degrees(spec.gyro.bias) * 3600.0, bias_deg_h, rtol=1e-6)
    np.testing.assert_allclose(spec.accel.bias / 9.80665e-6, bias_ug, rtol=1e-6)
    np.testing.assert_allclose(np.degrees(spec.gyro.random_walk) * 60.0, arw_deg_sqrt_h, rtol=1e-3)
    np.testing.assert_allclose(spec.accel.random_walk * 60.0, vrw_m_s_sqrt_h, rtol=1e-2)
    assert spec.absent == ()
    assert "atasheet" in spec.source or "brochure" in spec.source or "specification" in spec.source
    assert "Assumed" in spec.source
