"""Where the antenna is: found, and a lever arm that is given wrong is said, one that is right is not."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest

import insnav
from insnav.attitude import dcm_from_rph, wrap_pi
from insnav.earth import lla_offset, ned_offset
from insnav.filter.lever_check import with_hidden_lever
from insnav.filter.navigate import feed
from insnav.findings import Code
from insnav.input import read_gps, read_imu
from insnav.session.simulation import plan_of, profiled
from insnav.types import GpsData, ImuData
from insnav.units import DEG
from tests.shared import recorded


@pytest.mark.parametrize(
    ("profile", "arm", "said"),
    [
        ("round_trip", (0.0, 0.0, 0.0), False),
        ("city", (0.0, 0.0, 0.0), False),
        ("city", (1.0, 0.0, 0.0), True),
        ("city", (0.0, -2.0, 0.0), True),
    ],
)
def test_a_wrong_lever_arm_is_said(profile, arm, said):
    drive = insnav.simulate(profile, imu="automotive", gps="dgps", seed=1)  # its antenna is at the IMU
    result = insnav.load(drive.imu.data, drive.gps.data, lever_arm=arm).navigate()
    found = [text for text in result.page().warnings if "the antenna seems" in text]
    assert bool(found) == said
    solution, truth = result.found.run.smoothed.solution, drive.reference.data
    true = np.column_stack([np.interp(solution.time, truth.time, each) for each in truth.lla.T])
    assert (
        np.mean(np.abs(ned_offset(solution.lla, true)) < 3.0 * solution.sd[:, :3]) > 0.97
    )  # an arm that is wrong, too
    if found:
        estimate = np.array([float(value) for value in found[0].rpartition(" ")[2].split(",")])
        assert np.abs(estimate[:2]).max() < 0.3
        np.testing.assert_allclose(estimate, result.found.run.lever_b, atol=0.0051)  # its own, not that of a search


@pytest.mark.parametrize(
    ("profile", "delay", "said"), [("round_trip", 0.0, ""), ("city", 0.3, "smaller"), ("city", -0.2, "larger")]
)
def test_a_wrong_delay_is_said(profile, delay, said):
    drive = insnav.simulate(profile, imu="automotive", gps="dgps", seed=1)  # its fixes are on time
    page = insnav.load(drive.imu.data, drive.gps.data, gps_delay=delay).navigate(smooth=False).page()
    found = [text for text in page.warnings if "delay of the fixes given" in text]
    assert [f"asks for a {said} one" in text for text in found] == [True] * bool(said)


def test_an_error_as_large_as_the_note_says_is_said():
    drive = insnav.simulate("aircraft_pattern", imu="industrial", gps="dgps", seed=14)
    imu, gps = drive.imu.data, drive.gps.data
    imu, gps = imu.rows(imu.time < 400.0), gps.rows(gps.time < 400.0)
    right = insnav.load(imu, gps, lever_arm=(0.0, 0.0, 0.0)).navigate()
    (note,) = [note for note in right.notes if note.startswith("errors of the lever arm given")]
    assert not [text for text in right.page().warnings if "the antenna seems" in text]
    sizes = [float(value) for value in note.split()[-5].split(",")]
    wrong = insnav.load(imu, gps, lever_arm=(sizes[0], 0.0, 0.0)).navigate()
    assert [text for text in wrong.page().warnings if "the antenna seems" in text]


@pytest.mark.parametrize(("off", "said"), [(0.0, False), (4.0, False), (-20.0, True), (83.0, True)])
def test_a_heading_that_the_drive_contradicts_is_not_used(off, said):
    drive = insnav.simulate("city", imu="automotive", seed=1)
    heading = float(drive.reference.data.rph[0, 2])
    ready = insnav.load(drive.imu.data, drive.gps.data, heading=heading + off * DEG).prepared()
    warned = [event.action for event in ready.faults if event.action.startswith("the heading given")]
    assert bool(warned) == any(note.startswith("heading given") for note in ready.notes) == said
    assert (ready.alignment.heading_method is Code.ALIGN_HEADING_GIVEN) != said
    if said:
        assert abs(wrap_pi(ready.alignment.rph[2] - heading)) < 3.0 * ready.alignment.sd[2]
        assert f"shows {np.rad2deg(ready.alignment.rph[2]):.0f} ±" in warned[0]


@lru_cache(maxsize=1)
def smoothing(
    metres: float, profile: str, imu: str, gps: str, seed: int, span: tuple[float, float]
) -> tuple[ImuData, GpsData]:
    """A receiver that smooths velocities over 0.2 s, its antenna far ahead; vibration moves it as it does the IMU."""
    plan = plan_of(profiled(profile, seed), {"imu": imu, "gps": gps, "seed": seed})
    made, truth = plan.measured(), plan.truth

    def ahead(time):
        return (
            dcm_from_rph(truth.evaluate(np.clip(time, truth.start, truth.start + truth.duration)).rph)[..., 0] * metres
        )

    time = made.gps.time
    faster = (ahead(time + 0.1) - ahead(time - 0.1)) / 0.2
    fixes = replace(made.gps, lla=lla_offset(made.gps.lla, ahead(time)), v_n=made.gps.v_n + faster)
    first, last = made.imu.time[0] + np.array(span)
    return tuple(each.rows((each.time >= first) & (each.time <= last)) for each in (made.imu, fixes))


@pytest.mark.parametrize("metres", [2.0, 5.0])
@pytest.mark.parametrize(
    "drive",
    [
        ("motorway", "consumer", "urban", 12, (60.0, 360.0)),
        ("mountain_road", "tactical", "rtk", 13, (0.0, 240.0)),
    ],
    ids=["motorway", "mountain"],
)
def test_a_long_lever_arm_is_found_and_not_called_wrong_where_the_imu_vibrates(drive, metres):
    """With the rate of one sample taken for that of the antenna 5 m were 0.95 and 4.4 m, and called wrong where given.

    With one arm for turns and vibration two metres on the motorway were 0.67 m, 9 of its sd off.
    """
    imu, gps = smoothing(metres, *drive)
    run = insnav.load(imu, gps).navigate(smooth=False).found.run
    assert abs(run.lever_b[0] - metres) < 3.0 * run.lever_sd[0]
    assert abs(run.lever_b[0] - metres) < 0.2 or run.lever_sd[0] > 0.1
    said = insnav.load(imu, gps, lever_arm=(metres, 0.0, 0.0)).navigate(smooth=False).events
    assert not [event for event in said if "the antenna seems" in event.action]


@pytest.mark.parametrize(("noise", "words"), [(0.3, None), (20.0, None), (160.0, "more than any have")])
def test_noise_that_no_gyros_have_is_said(noise, words):
    """The IMU of one drive with the fixes of another: found to be 160 deg/√h, and the exit code was 0."""
    drive = insnav.simulate("figure_eight", imu="automotive", gps="dgps", seed=1)
    run = insnav.load(drive.imu.data, drive.gps.data).navigate().found.run
    model = SimpleNamespace(noise=np.full(20, (noise * DEG / 60.0) ** 2))
    same, events = with_hidden_lever(SimpleNamespace(model=model), run)
    assert same is run
    said = [event.action for event in events]
    assert len(said) == (words is not None)
    assert all(words in text for text in said)


@pytest.mark.parametrize(("metres", "kept"), [(1.0, True), (2.0, False), (5.0, False)])
def test_a_wrong_lever_arm_beside_noisy_gyros_is_said_or_not_used(metres, kept):
    """Vibration, 8 deg/√h, may pretend half of an arm: 1 m too long is kept with a warning, 5 m are not noise."""
    folder = recorded("rtklib_drive_20250708")
    imu, gps = read_imu(folder / "imu.csv.gz").data, read_gps(folder / "gps.csv").data
    first = imu.time[0] + 20.0
    imu, gps = (each.rows((each.time >= first) & (each.time <= first + 180.0)) for each in (imu, gps))
    found = insnav.load(imu, gps, lever_arm=(metres, 0.0, 0.0)).navigate(smooth=False)
    said = " ".join(event.action for event in found.events)
    assert ("the lever arm given is used, though fixes show" in said) is kept
    assert ("the antenna seems to be at" in said) is not kept
    assert bool(found.found.run.lever_b[0] == metres) is kept


def test_what_parts_of_the_drive_disagree_on_leaves_the_lever_arm_of_the_filter():
    drive = insnav.simulate("round_trip", imu="automotive", gps="rtk", seed=3)
    ready = insnav.load(drive.imu.data, drive.gps.data).prepared()
    runs = []
    for surest in (0.0, 0.3):
        some = replace(ready, settings=replace(ready.settings, surest=surest, smooth=False))
        runs.append(feed(some.navigator(), some.imu).finish())
    assert (runs[1].lever_sd > 1.2 * runs[0].lever_sd).any()
    np.testing.assert_array_equal(runs[1].lever_sd_alone, runs[0].lever_sd)
