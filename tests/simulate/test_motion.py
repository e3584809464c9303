"""Motion profiles as files: what is read, and how everything that is wrong is told at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insnav.exceptions import ConfigError
from insnav.simulate.motion import library, load_profile
from tests.simulate.profiles import HEAD, motion, profile, segments

START = HEAD.format(vehicle="car", start="", lat="45 deg")


def problems(path: Path, text: str) -> list[str]:
    """Everything that is said to be wrong with a profile."""
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_profile(path)
    assert caught.value.where == str(path)
    return (caught.value.why or caught.value.what).splitlines()


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
    expected = [
        "vehicle: Input should be 'car', 'aircraft' or 'slide'",
        "start.lat: must be between -90 deg and 90 deg",
        "start.lon: '9' is not a number with a unit",
        "start.hight: unknown key, did you mean 'height'?",
        "segment 1: unknown kind 'acelerate', did you mean 'accelerate'?",
        "segment 2 (accelerate): to: '-5 m/s' is negative",
        "segment 3 (turn): rat: unknown key, did you mean 'rate'?",
        "segment 4 (repeat): count: Input should be greater than or equal to 1",
        "segment 4 (repeat), segment 1 (cruise): needs either duration or distance",
        "segment 4 (repeat), segment 2 (turn): angle must not be zero",
    ]
    assert len(found) == len(expected)
    for text, beginning in zip(found, expected, strict=True):
        assert text.startswith(beginning)


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
    expected = [
        "vibration.band 1: needs 0 < low < high",
        "vibration: frequencies must be above 0 and at most 100 Hz",
        "segment 2 (turn): 180 m/s^2 across the way",  # 30^2 / 5
        "segment 3 (accelerate): 2942 m/s^2 is more than a car can",
        "segment 4 (static): the speed is 60 m/s: stop first",  # as if the third had been driven
        "segment 5 (repeat), segment 1 (lane_change): 60 m/s^2 across the way",
        "segment 6 (climb): 50 deg is steeper than a car climbs",
        "segment 7 (brake): the speed is 60 m/s already",
    ]
    assert len(found) == len(expected)
    for text, beginning in zip(found, expected, strict=True):
        assert text.startswith(beginning)


MOVING = 'accelerate: to = "20 m/s"'


@pytest.mark.parametrize(
    ("vehicle", "lines", "expected"),
    [
        ("car", ['cruise: duration = "5 s"'], "segment 1 (cruise): a car at rest cannot do this"),
        ("car", ['turn: angle = "9 deg", rate = "9 deg/s"'], "segment 1 (turn): a car at rest"),
        ("car", ['accelerate: to = "500 km/h"'], "segment 1 (accelerate): 138.9 m/s is faster than a car goes"),
        ("car", [MOVING, 'accelerate: to = "5 m/s"'], "segment 2 (accelerate): the speed is 20 m/s already"),
        ("car", [MOVING, 'brake: to = "25 m/s"'], "segment 2 (brake): the speed is 20 m/s already"),
        ("car", [MOVING, 'turn: angle = "9 deg", rate = "5000 deg/s"'], "beyond 4000 deg/s"),
        ("car", [MOVING, 'helix: radius = "60 m", turns = 1, height = "300 m"'], "steeper than a car climbs"),
        ("car", [MOVING, 'helix: radius = "60 m", turns = 1, height = "3000 m"'], "steeper than a car climbs"),
        ("car", [MOVING, 'helix: radius = "10 m", turns = 1, height = "1 m"'], "40 m/s^2 across the way"),
        ("car", [MOVING, 'slide: length = "2 m"'], "segment 2 (slide): a slide starts from rest"),
        ("car", ['spin: axis = "x", turns = 1, rate = "9 deg/s"'], "the body of a car does not turn by itself"),
        ("car", ['linear: x = "1 m"'], "the body of a car does not turn by itself"),
        ("slide", ['linear: speed = "1 m/s"'], "needs one or more of x, y, roll, pitch, yaw"),
        ("slide", ['linear: x = "1 m", acceleration = "300 g"'], "faster than a slide can"),
        ("slide", ['linear: roll = "100 deg", yaw = "90 deg"'], "less than 180 deg together"),
        ("slide", ['circular: axes = ["x", "yaw"], radius = "1 m"'], "two of a slide (x, y) or two of a table"),
        ("slide", ['circular: axes = ["roll", "yaw"], radius = "1 m"'], "a unit of length"),
        (
            "slide",
            ['spin: axis = "x", turns = 1, rate = "9 deg/s"', 'linear: yaw = "9 deg"'],
            "where a spin has turned the body",
        ),
        ("slide", ['spin: axis = "x", turns = 1, rate = "5000 deg/s"'], "5000 deg/s is beyond 4000 deg/s"),
        ("slide", ['slide: length = "2 m", acceleration = "300 g"'], "more than a slide can"),
        ("slide", ['coning: angle = "90 deg", frequency = "20 Hz", duration = "9 s"'], "faster than 4000 deg/s"),
        (
            "slide",
            ['sculling: angle = "1 deg", acceleration = "300 g", frequency = "9 Hz", duration = "9 s"'],
            "2942 m/s^2 is beyond",
        ),
        ("slide", ['spin: axis = "w", turns = 1, rate = "9 deg/s"'], "axis: must be an axis"),
        ("slide", ['spin: axis = [0, 0, 0], turns = 1, rate = "9 deg/s"'], "axis: must be an axis"),
        ("slide", ['spin: axis = "x", rate = "9 deg/s"'], "needs either angle or turns"),
        ("car", [MOVING, 'turn: angle = "9 deg", rate = "9 deg/s", radius = "9 m"'], "needs either rate or radius"),
        ("car", [MOVING, 'lane_change: offset = "3 m", duration = "0 s"'], "duration must be above zero"),
        ("car", ["static"], "segment 1 (static): duration: is missing"),
        ("car", ['static: duration = "nan s"'], "'nan s' is not a number with a unit"),
        ("car", ['static: duration = "5 kg"'], "segment 1 (static): duration"),
        ("car", ["static: duration = 5"], "must be a text with a unit"),
        ("car", ['static: duration = "49 h"'], "49 h, and the longest is 48 h"),
    ],
)
def test_what_cannot_be_meant_or_driven_is_refused(tmp_path, vehicle, lines, expected):
    (found,) = problems(tmp_path / "bad.toml", segments(*lines) + HEAD.format(vehicle=vehicle, start="", lat="45 deg"))
    assert expected in found


def test_no_more_moves_than_memory_holds(tmp_path):
    inner = '{ kind = "accelerate", to = "5 m/s" }, { kind = "stop" }'
    text = segments(f"repeat: count = 10000, segment = [{inner}, {inner}]") + START
    (found,) = problems(tmp_path / "bad.toml", text)
    assert "more than 20000 moves" in found


def test_what_is_missing_or_no_file_is_told(tmp_path):
    assert problems(tmp_path / "bad.toml", 'purpose = "none"\n') == [
        "start: is missing; a motion needs [start] with lat and lon",
        "segment: is missing; a motion needs [[segment]], or [[waypoint]]",
    ]
    for text in ('purpose = "none', "\x00\x01"):
        (tmp_path / "bad.toml").write_text(text)
        with pytest.raises(ConfigError, match="not a TOML file"):
            load_profile(tmp_path / "bad.toml")
    with pytest.raises(ConfigError, match="cannot read"):
        load_profile(tmp_path / "none.toml")


def test_a_misspelt_profile_is_suggested(tmp_path):
    with pytest.raises(ConfigError) as caught:
        load_profile("figure_eigth")
    assert caught.value.fix == "did you mean 'figure_eight'?"
    with pytest.raises(ConfigError, match="library of profiles is not here"):
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
