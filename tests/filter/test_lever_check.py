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
from insnav.filter.delay_and_lever import with_hidden_lever
from insnav.filter.navigate import feed
from insnav.filter.navigator import Navigator
from insnav.findings import Code, Severity, of_code
from insnav.input import read_gps, read_imu
from insnav.session.simulation import plan_of, profiled
from insnav.types import GpsData, ImuData
from insnav.units import DEG
from tests.filter import drives
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
    found = list(of_code(result.findings, Code.GIVEN_LEVER_ARM_REJECTED))
    assert [each.severity for each in found] == [Severity.WARNING] * said
    solution, truth = result.found.run.smoothed.solution, drive.reference.data
    true = np.column_stack([np.interp(solution.time, truth.time, each) for each in truth.lla.T])
    assert (
        np.mean(np.abs(ned_offset(solution.lla, true)) < 3.0 * solution.sd[:, :3]) > 0.97
    )  # an arm that is wrong, too
    if found:
        estimate = np.array(found[0]["estimate_m"])
        assert np.abs(estimate[:2]).max() < 0.3
        np.testing.assert_array_equal(estimate, result.found.run.lever_b)  # its own, not that of a search
        assert found[0]["given_m"] == arm


@pytest.mark.parametrize(("profile", "delay"), [("round_trip", 0.0), ("city", 0.3), ("city", -0.2)])
def test_a_delay_that_the_drive_contradicts_is_not_used(profile, delay):
    drive = insnav.simulate(profile, imu="automotive", gps="dgps", seed=1)  # its fixes are on time
    result = insnav.load(drive.imu.data, drive.gps.data, gps_delay=delay).navigate(smooth=False)
    found = list(of_code(result.findings, Code.GIVEN_DELAY_REJECTED))
    assert [(each["given_s"], each.severity) for each in found] == [(delay, Severity.WARNING)] * bool(delay)
    assert all(abs(each["estimate_s"]) < 3.0 * each["estimate_sd_s"] for each in found)
    assert abs(result.found.run.gps_delay) < 0.01
    assert result.explanation.faults == ()


def test_an_error_as_large_as_the_note_says_is_said():
    drive = insnav.simulate("aircraft_pattern", imu="industrial", gps="dgps", seed=14)
    imu, gps = drive.imu.data, drive.gps.data
    imu, gps = imu.rows(imu.time < 400.0), gps.rows(gps.time < 400.0)
    right = insnav.load(imu, gps, lever_arm=(0.0, 0.0, 0.0)).navigate()
    (checked,) = of_code(right.findings, Code.ESTIMATE_LEVER_ARM_CHECKED)
    assert checked.severity is Severity.NOTE
    assert not any(of_code(right.findings, Code.GIVEN_LEVER_ARM_REJECTED))
    wrong = insnav.load(imu, gps, lever_arm=(checked["detectable_m"][0], 0.0, 0.0)).navigate()
    assert any(of_code(wrong.findings, Code.GIVEN_LEVER_ARM_REJECTED))


@pytest.mark.parametrize(("off", "said"), [(0.0, False), (4.0, False), (-20.0, True), (83.0, True)])
def test_a_heading_that_the_drive_contradicts_is_not_used(off, said):
    drive = insnav.simulate("city", imu="automotive", seed=1)
    heading = float(drive.reference.data.rph[0, 2])
    aligned = insnav.load(drive.imu.data, drive.gps.data, heading=heading + off * DEG).until("align")
    ready = aligned.ready
    warned = list(of_code(aligned.model.findings, Code.GIVEN_HEADING_REJECTED, Code.GIVEN_HEADING_KEPT))
    assert [each.code for each in warned] == [Code.GIVEN_HEADING_REJECTED] * said
    assert [each.severity for each in warned] == [Severity.WARNING] * said
    assert (ready.alignment.heading_method is Code.ALIGN_HEADING_GIVEN) != said
    if said:
        assert abs(wrap_pi(ready.alignment.rph[2] - heading)) < 3.0 * ready.alignment.sd[2]
        assert warned[0]["estimate_rad"] == ready.alignment.rph[2]
        assert warned[0]["given_rad"] == pytest.approx(heading + off * DEG)
        assert warned[0]["difference_rad"] > warned[0]["limit_rad"]


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
    said = insnav.load(imu, gps, lever_arm=(metres, 0.0, 0.0)).navigate(smooth=False).findings
    assert not any(of_code(said, Code.GIVEN_LEVER_ARM_REJECTED))


@pytest.mark.parametrize(("noise", "said"), [(0.3, False), (20.0, False), (160.0, True)])
def test_noise_that_no_gyros_have_is_said(noise, said):
    """The IMU of one drive with the fixes of another: found to be 160 deg/√h, and the exit code was 0."""
    drive = insnav.simulate("figure_eight", imu="automotive", gps="dgps", seed=1)
    run = insnav.load(drive.imu.data, drive.gps.data).navigate().found.run
    model = SimpleNamespace(noise=np.full(20, (noise * DEG / 60.0) ** 2))
    same, events = with_hidden_lever(SimpleNamespace(model=model), run)
    assert same is run
    assert [event.code for event in events] == [Code.NOISE_GYROS] * said
    assert [event["noise_rad_sqrt_s"] for event in events] == pytest.approx([noise * DEG / 60.0] * said)


@pytest.mark.parametrize(("metres", "kept"), [(1.0, True), (2.0, False), (5.0, False)])
def test_a_wrong_lever_arm_beside_noisy_gyros_is_said_or_not_used(metres, kept):
    """Vibration, 8 deg/√h, may pretend half of an arm: 1 m too long is kept with a warning, 5 m are not noise."""
    folder = recorded("rtklib_drive_20250708")
    imu, gps = read_imu(folder / "imu.csv.gz").data, read_gps(folder / "gps.csv").data
    first = imu.time[0] + 20.0
    imu, gps = (each.rows((each.time >= first) & (each.time <= first + 180.0)) for each in (imu, gps))
    found = insnav.load(imu, gps, lever_arm=(metres, 0.0, 0.0)).navigate(smooth=False)
    assert any(of_code(found.findings, Code.GIVEN_LEVER_ARM_KEPT)) is kept
    assert any(of_code(found.findings, Code.GIVEN_LEVER_ARM_REJECTED)) is not kept
    assert bool(found.found.run.lever_b[0] == metres) is kept


def test_what_parts_of_the_drive_disagree_on_leaves_the_lever_arm_of_the_filter():
    drive = insnav.simulate("round_trip", imu="automotive", gps="rtk", seed=3)
    ready = insnav.load(drive.imu.data, drive.gps.data).until("align").ready
    runs = []
    for least_delay_sd in (0.0, 0.3):
        some = drives.changed(ready, least_delay_sd=least_delay_sd, smooth=False)
        runs.append(feed(Navigator(some), some.imu).finish())
    assert (runs[1].lever_sd > 1.2 * runs[0].lever_sd).any()
    np.testing.assert_array_equal(runs[1].lever_sd_alone, runs[0].lever_sd)


@pytest.mark.parametrize("metres", [2.0, 5.0])
def test_a_wrong_lever_arm_is_rejected_before_faults_are_searched(metres):
    """With 5 m, the search explained everything by faults in 36 runs of the filter and 18 times the CPU time."""
    made = plan_of(profiled("city", 11), {"imu": "automotive", "gps": "single", "seed": 11}).measured()
    end = made.imu.time[0] + 300.0
    imu, gps = made.imu.rows(made.imu.time <= end), made.gps.rows(made.gps.time <= end)
    model = insnav.load(imu, gps, lever_arm=(metres, 0.0, 0.0)).until("explain").model
    assert model.ready.receiver.lever_arm.sd > 0.0
    assert model.explanation.faults == ()
    assert model.explanation.runs == 1
