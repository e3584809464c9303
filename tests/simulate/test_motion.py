"""Motion profiles as files: what is read, and how everything that is wrong is told at once."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insnav.exceptions import ConfigError
from insnav.simulate.motion import library, load_profile
from tests.refusals import problems_of, refused
from tests.simulate.profiles import HEAD, motion, profile, segments

START = HEAD.format(vehicle="car", start="", lat="45 deg")


def problems(path: Path, text: str) -> list[str]:
    """Place and code of everything that is wrong with a profile."""
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_profile(path)
    assert caught.value.where.startswith(str(path))
    return problems_of(caught.value)


def test_a_start_is_where_it_says(tmp_path):
    start = 'heading = "-30 deg"\nroll = "2 deg"\npitch = "-3 deg"\ntime = "1000 s"'
    at = motion(profile(tmp_path, 'static: duration = "5 s"', start=start))
    np.testing.assert_allclose(at.time[[0, -1]], [1000.0, 1005.0])
    np.testing.assert_allclose(at.at.lla, np.tile([np.radians(45.0), np.radians(9.0), 100.0], (len(at.time), 1)))
    np.testing.assert_allclose(np.degrees(at.at.rph), np.tile([2.0, -3.0, 330.0], (len(at.time), 1)))
    np.testing.assert_allclose(at.at.v_n, 0.0, atol=1e-12)


def test_a_motion_may_begin_in_flight(tmp_path):
    start = 'heading = "90 deg"\nspeed = "80 m/s"'
    at = motion(profile(tmp_path, 'cruise: duration = "5 s"', vehicle="aircraft", start=start))
    np.testing.assert_allclose(at.at.v_n, np.tile([0.0, 80.0, 0.0], (len(at.time), 1)), atol=1e-9)


def test_everything_wrong_is_told_at_once_with_its_segment(tmp_path):
    found = problems(
        tmp_path / "bad.toml",
        """
purpose = "bad"
vehicle = "boat"
[start]
lat = "95 deg"
lon = "9"
hight = "3 m"
[[segment]]
kind = "acelerate"
[[segment]]
kind = "accelerate"
to = "-5 m/s"
[[segment]]
kind = "turn"
angle = "90 deg"
rat = "3 deg/s"
[[segment]]
kind = "repeat"
count = 0
segment = [ { kind = "cruise" }, { kind = "turn", angle = "0 deg", rate = "3 deg/s" } ]
""",
    )
    assert found == [
        "start.hight: config.unknown_key",
        "vehicle: config.no_choice",
        "start.lat: sim.no_latitude",
        "start.lon: unit.missing",
        "segment 1: sim.unknown_kind",
        "segment 2 (accelerate): to: config.negative",
        "segment 3 (turn): rat: config.unknown_key",
        "segment 3 (turn): config.not_one_key",
        "segment 4 (repeat): count: config.out_of_range",
        "segment 4 (repeat), segment 1 (cruise): config.not_one_key",
        "segment 4 (repeat), segment 2 (turn): sim.no_angle",
    ]


def test_everything_that_cannot_be_driven_is_told_at_once_with_its_segment(tmp_path):
    found = problems(
        tmp_path / "bad.toml",
        segments(
            'accelerate: to = "30 m/s"',
            'turn: angle = "90 deg", radius = "5 m"',
            'accelerate: to = "60 m/s", acceleration = "300 g"',
            'static: duration = "3 s"',
            'repeat: count = 3, segment = [{ kind = "lane_change", offset = "30 m", duration = "2 s" }]',
            'climb: height = "40 m", angle = "50 deg"',
            'brake: to = "90 m/s"',
        )
        + START
        + '[vibration]\nengine = [{ frequency = "300 Hz", acceleration = "1 g" }]\n'
        + 'band = [{ low = "5 Hz", high = "3 Hz", density = "1 (m/s^2)^2/Hz" }]\n',
    )
    assert found == [
        "vibration.band 1: sim.no_band",
        "vibration: sim.vibration_frequency",
        "segment 2 (turn): sim.sideways_in_turn",  # 30^2 / 5
        "segment 3 (accelerate): sim.too_fast_acceleration",
        "segment 4 (static): sim.static_while_moving",  # as if the third had been driven
        "segment 5 (repeat), segment 1 (lane_change): sim.sideways_in_lane_change",
        "segment 6 (climb): sim.too_steep",
        "segment 7 (brake): sim.wrong_way",
    ]


MOVING = 'accelerate: to = "20 m/s"'


@pytest.mark.parametrize(
    ("vehicle", "lines", "expected"),
    [
        ("car", ['cruise: duration = "5 s"'], "segment 1 (cruise): sim.at_rest"),
        ("car", ['turn: angle = "9 deg", rate = "9 deg/s"'], "segment 1 (turn): sim.at_rest"),
        ("car", ['accelerate: to = "500 km/h"'], "segment 1 (accelerate): sim.too_fast"),
        ("car", [MOVING, 'accelerate: to = "5 m/s"'], "segment 2 (accelerate): sim.wrong_way"),
        ("car", [MOVING, 'brake: to = "25 m/s"'], "segment 2 (brake): sim.wrong_way"),
        ("car", [MOVING, 'turn: angle = "9 deg", rate = "5000 deg/s"'], "segment 2 (turn): sim.too_fast_turn"),
        (
            "car",
            [MOVING, 'helix: radius = "60 m", turns = 1, height = "300 m"'],
            "segment 2 (helix): sim.too_steep_helix",
        ),
        (
            "car",
            [MOVING, 'helix: radius = "60 m", turns = 1, height = "3000 m"'],
            "segment 2 (helix): sim.too_steep_helix",
        ),
        (
            "car",
            [MOVING, 'helix: radius = "10 m", turns = 1, height = "1 m"'],
            "segment 2 (helix): sim.sideways_in_helix",
        ),
        ("car", [MOVING, 'slide: length = "2 m"'], "segment 2 (slide): sim.not_from_rest"),
        ("car", ['spin: axis = "x", turns = 1, rate = "9 deg/s"'], "segment 1 (spin): sim.body_fixed"),
        ("car", ['linear: x = "1 m"'], "segment 1 (linear): sim.body_fixed"),
        ("slide", ['linear: speed = "1 m/s"'], "segment 1 (linear): sim.no_move"),
        ("slide", ['linear: x = "1 m", acceleration = "300 g"'], "segment 1 (linear): sim.too_fast_planned"),
        ("slide", ['linear: roll = "100 deg", yaw = "90 deg"'], "segment 1 (linear): sim.table_turns_far"),
        ("slide", ['circular: axes = ["x", "yaw"], radius = "1 m"'], "segment 1 (circular): sim.no_pair_of_axes"),
        (
            "slide",
            ['circular: axes = ["roll", "yaw"], radius = "1 m"'],
            "segment 1 (circular): unit.of_other_dimension",
        ),
        (
            "slide",
            ['spin: axis = "x", turns = 1, rate = "9 deg/s"', 'linear: yaw = "9 deg"'],
            "segment 2 (linear): sim.table_after_spin",
        ),
        ("slide", ['spin: axis = "x", turns = 1, rate = "5000 deg/s"'], "segment 1 (spin): sim.too_fast_turn"),
        ("slide", ['slide: length = "2 m", acceleration = "300 g"'], "segment 1 (slide): sim.too_fast_acceleration"),
        (
            "slide",
            ['coning: angle = "90 deg", frequency = "20 Hz", duration = "9 s"'],
            "segment 1 (coning): sim.too_fast_turn",
        ),
        (
            "slide",
            ['sculling: angle = "1 deg", acceleration = "300 g", frequency = "9 Hz", duration = "9 s"'],
            "segment 1 (sculling): sim.too_fast_acceleration",
        ),
        ("slide", ['spin: axis = "w", turns = 1, rate = "9 deg/s"'], "segment 1 (spin): axis: sim.no_axis"),
        ("slide", ['spin: axis = [0, 0, 0], turns = 1, rate = "9 deg/s"'], "segment 1 (spin): axis: sim.no_axis"),
        ("slide", ['spin: axis = "x", rate = "9 deg/s"'], "segment 1 (spin): config.not_one_key"),
        (
            "car",
            [MOVING, 'turn: angle = "9 deg", rate = "9 deg/s", radius = "9 m"'],
            "segment 2 (turn): config.not_one_key",
        ),
        (
            "car",
            [MOVING, 'lane_change: offset = "3 m", duration = "0 s"'],
            "segment 2 (lane_change): config.not_above_zero",
        ),
        ("car", ["static"], "segment 1 (static): duration: config.missing_key"),
        ("car", ['static: duration = "nan s"'], "segment 1 (static): duration: unit.missing"),
        ("car", ['static: duration = "5 kg"'], "segment 1 (static): duration: unit.of_other_dimension"),
        ("car", ["static: duration = 5"], "segment 1 (static): duration: config.no_quantity"),
        ("car", ['static: duration = "49 h"'], "bad.toml: sim.too_long"),
    ],
)
def test_what_cannot_be_meant_or_driven_is_refused(tmp_path, vehicle, lines, expected):
    (found,) = problems(tmp_path / "bad.toml", segments(*lines) + HEAD.format(vehicle=vehicle, start="", lat="45 deg"))
    assert found.endswith(expected)


def test_no_more_moves_than_memory_holds(tmp_path):
    inner = '{ kind = "accelerate", to = "5 m/s" }, { kind = "stop" }'
    text = segments(f"repeat: count = 10000, segment = [{inner}, {inner}]") + START
    (found,) = problems(tmp_path / "bad.toml", text)
    assert found.endswith("segment: sim.many_moves")


def test_repeats_in_each_other_are_multiplied_before_they_are_made(tmp_path):
    segment = '{ kind = "accelerate", to = "5 m/s" }'
    for _ in range(3):
        segment = f'{{ kind = "repeat", count = 1000, segment = [{segment}] }}'
    tracemalloc.start()
    found = problems(tmp_path / "bad.toml", f"segment = [{segment}]\n{START}")
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()
    assert [each.rpartition(" ")[2] for each in found] == ["sim.many_moves"]


def test_what_is_missing_or_no_file_is_told(tmp_path):
    assert problems(tmp_path / "bad.toml", 'purpose = "none"\n') == [
        "start: sim.no_start",
        "segment: sim.no_segments",
    ]
    for text in ('purpose = "none', "\x00\x01"):
        (tmp_path / "bad.toml").write_text(text)
        with refused(ConfigError, "config.no_toml"):
            load_profile(tmp_path / "bad.toml")
    with refused(ConfigError, "config.unreadable"):
        load_profile(tmp_path / "none.toml")


def test_a_misspelt_profile_is_suggested(tmp_path):
    with pytest.raises(ConfigError) as caught:
        load_profile("figure_eigth")
    assert (caught.value.code, caught.value.values["close"]) == ("sim.unknown_profile", "figure_eight")
    with refused(ConfigError, "sim.no_profiles"):
        load_profile("city", library=tmp_path)


def test_the_text_makes_the_same_motion_under_another_name(tmp_path):
    one = profile(tmp_path, MOVING, 'cruise: duration = "5 s"', vibration="")
    (tmp_path / "copy.toml").write_text(one.text)
    other = load_profile(tmp_path / "copy.toml")
    assert (other.name, other.purpose, other.duration) == ("profile", "to test", one.duration)
    time = np.array([15.0])
    np.testing.assert_array_equal(one.truth(3).evaluate(time).f_b, other.truth(3).evaluate(time).f_b)
    assert not np.array_equal(one.truth(3).evaluate(time).f_b, one.truth(4).evaluate(time).f_b)


VALUES = st.one_of(
    st.sampled_from(["5 m/s", "-5 m", "1e400 s", "nan deg", "3 s", "90 deg", "0 m", "2 m", "9 deg/s", "", "x"]),
    st.integers(-3, 3),
    st.floats(),
    st.booleans(),
    st.lists(st.integers(-1, 1), max_size=3),
)
KEYS = st.sampled_from(
    ["to", "acceleration", "duration", "angle", "rate", "radius", "height", "turns", "length", "axis", "jerk", "hight"]
)
KINDS = st.sampled_from(["static", "accelerate", "turn", "helix", "slide", "spin", "climb", "stop", "repeat", "fly"])


@settings(max_examples=60, deadline=None)
@given(vehicle=st.sampled_from(["car", "slide"]), tables=st.lists(st.tuples(KINDS, st.dictionaries(KEYS, VALUES))))
def test_any_profile_is_a_motion_or_refused(tmp_path_factory, vehicle, tables):
    import tomli_w

    content = {
        "purpose": "any",
        "vehicle": vehicle,
        "start": {"lat": "45 deg", "lon": "9 deg"},
        "segment": [{"kind": kind, **keys} for kind, keys in tables],
    }
    path = tmp_path_factory.mktemp("any") / "any.toml"
    path.write_text(tomli_w.dumps(content))
    try:
        made = load_profile(path)
    except ConfigError:
        return
    assert 0.0 <= made.duration < 48.0 * 3600.0


# ---- the library


LISTED = {path.stem: path for path in library()}


def test_the_library_has_what_was_promised():
    assert len(LISTED) >= 10
    assert "corpus" not in LISTED  # the name is taken
    purposes = [load_profile(path).purpose for path in LISTED.values()]
    assert len(set(purposes)) == len(purposes)
    assert all(purpose and "\n" not in purpose for purpose in purposes)


def test_an_installed_library_is_whole():
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text()
    assert '"trajectories" = "insnav/trajectories"' in text
    assert LISTED


@pytest.mark.parametrize("name", sorted(set(LISTED) - {"static_hour", "standard_hour", "aircraft_pattern"}))
def test_every_profile_of_the_library_is_a_smooth_motion(name):
    made = load_profile(name)
    truth = made.truth(0)
    assert truth.duration == pytest.approx(made.duration)
    for begin in truth.start + np.linspace(0.0, 0.9, 7) * truth.duration:
        # what happens in a millisecond is as small as a millisecond: nothing jumps
        at = truth.evaluate(begin + np.arange(1000) * 1e-3)
        for values, limit in ((at.f_b, 1.0), (at.w_ib_b, 0.3), (at.v_n, 0.02)):
            assert np.isfinite(values).all()
            assert np.abs(np.diff(values, axis=0)).max() < limit
    assert np.linalg.norm(truth.evaluate(np.array([truth.start])).v_n) < 250.0
