"""A gyro that is off for a while is found and named, and none that is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insnav
from insnav.attitude import wrap_pi
from insnav.earth import ned_offset
from insnav.filter import gyro_fault
from insnav.filter.gyro_fault import Episode
from insnav.filter.innovation_likelihood import LATER
from insnav.filter.noise_identification import known_likelihood
from insnav.findings import CONTRADICTIONS, Code, Severity, of_code
from insnav.input import read_gps, read_imu
from insnav.tabular import runs_of
from insnav.types import ImuData
from insnav.units import DEG
from tests.filter.drives import without_velocities
from tests.shared import recorded


def off(imu: ImuData, axis: int, rate: float, begin: float, length: float) -> ImuData:
    gyro, inside = imu.gyro.copy(), (imu.time > begin) & (imu.time <= begin + length)
    gyro[inside, axis] += rate * (np.median(np.diff(imu.time)) if imu.sampling == "increment" else 1.0)
    return replace(imu, gyro=gyro)


@pytest.mark.parametrize("axis", [0, 2])
def test_what_a_rate_does_to_the_innovations_is_what_samples_with_it_show(axis):
    """The response beside the filter, against a filter that is run again on samples that are off."""
    drive = insnav.simulate("city", imu="automotive", gps="single", seed=3)
    imu = drive.imu.data
    edges, rate, innovations = np.array([200.0, 215.0, 230.0]) + imu.time[0], 0.02 * DEG, []
    for samples in (imu, off(imu, axis, rate, edges[0], 30.0)):
        ready = insnav.load(samples, drive.gps.data).until("align").ready
        known = known_likelihood(ready, insnav.load(samples, drive.gps.data).imu_spec)
        assert known is not None
        innovations.append(known[0].normalised(known[1])[0])
        if samples is imu:
            _, weight, by = known[0].by_spans(known[1], edges, axis)
    change, expected = innovations[1] - innovations[0], -rate * by.sum(axis=0)
    assert np.sum(weight * (change - expected) ** 2) < 0.01 * np.sum(weight * expected**2)
    without = known[0].without(edges[0], edges[-1], axis, rate).normalised(known[1])[0]
    assert np.sum(weight * (without - innovations[0]) ** 2) < 0.02 * np.sum(weight * expected**2)


def test_what_a_delay_does_to_the_innovations_is_what_later_fixes_show():
    """The same of fixes that are late between two times, and true before and after."""
    drive = insnav.simulate("city", imu="automotive", gps="single", seed=3)
    imu, gps = drive.imu.data, drive.gps.data
    edges, late, innovations = np.array([200.4, 215.4, 230.4]) + imu.time[0], 0.01, []
    inside = (gps.time > edges[0]) & (gps.time <= edges[-1])
    fixes = replace(gps, lla=gps.lla.copy(), v_n=gps.v_n.copy())
    true = drive.reference.data  # ten rows a second: central differences are of the motion, not of what vibrates
    for name in ("lla", "v_n"):
        slope = np.gradient(getattr(true, name), true.time, axis=0)
        moved = np.column_stack([np.interp(gps.time[inside], true.time, column) for column in slope.T])
        getattr(fixes, name)[inside] -= late * moved
    loaded = insnav.load(imu, gps)
    ready = loaded.until("align").ready
    for some in (ready.gps, replace(ready.gps, lla=fixes.lla, v_n=fixes.v_n)):
        known = known_likelihood(replace(ready, gps=some), loaded.imu_spec)
        assert known is not None
        innovations.append(known[0].normalised(known[1])[0])
        if some is ready.gps:
            _, weight, by = known[0].by_spans(known[1], edges, LATER)
    change, expected = innovations[1] - innovations[0], -late * by.sum(axis=0)
    assert np.sum(weight * (change - expected) ** 2) < 0.05 * np.sum(weight * expected**2)


def test_gyros_do_not_stand_for_fixes_that_begin_to_lag():
    drive = insnav.simulate("round_trip", imu="automotive", gps="single", seed=9112)
    gps, begin = drive.gps.data, drive.imu.data.time[0] + 80.0
    gps = replace(gps, v_n=np.full_like(gps.v_n, np.nan), velocity_sd=np.full_like(gps.velocity_sd, np.nan))
    late = gps.time + 1.0 * (gps.time > begin)
    gps = replace(gps, time=late).rows(np.diff(late, prepend=-np.inf) > 0.0)
    run = insnav.load(drive.imu.data, gps).navigate().found.run
    (said,) = of_code(run.events, *CONTRADICTIONS)
    assert said.code is Code.CHANGE_DELAY
    assert said["delay_s"] == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize(("left", "named"), [(0.3, 1), (0.7, 0)])
def test_a_gyro_that_leaves_much_to_the_fixes_is_none(monkeypatch, left, named):
    """Multipath of 17 s in a city: 4.9 deg/s for 3 s were taken off, and the heading lost; fixes were as far off."""
    settled = list[float]()
    before = gyro_fault._settled

    def seen(*of):
        found = before(*of)
        settled.extend([found[0][0].gain] if found[0] is not None else [])
        return found

    monkeypatch.setattr(gyro_fault, "_settled", seen)
    monkeypatch.setattr(gyro_fault, "_rival", lambda *_: left * settled[-1] if settled else 1e9)
    monkeypatch.setattr(gyro_fault, "ALIKE", 0.0)
    drive = insnav.simulate("bends", imu="automotive", gps="single", seed=1)
    ready = insnav.load(off(drive.imu.data, 2, -5.0 * DEG, 120.0, 30.0), drive.gps.data).until("noise").ready
    assert settled
    assert [each.subject for each in of_code(ready.faults, Code.CHANGE_GYRO_FAULT)] == ["gyro z"] * named


@pytest.mark.parametrize(
    ("motion", "imu", "gps", "seed", "axis", "rate", "begin", "length"),
    [
        ("bends", "automotive", "single", 1, 2, -5.0, 120.0, 30.0),
        ("city", "automotive", "single", 4, 2, -5.0, 200.0, 40.0),
        # all fixes are rejected from then on to the end
        ("bends", "automotive", "rtk", 9202, 0, 4.0, 100.0, 20.0),
        # lost in the first quarter of the drive, before anything of it is seen
        ("motorway", "consumer", "dgps", 9203, 2, 2.0, 120.0, 30.0),
    ],
)
def test_a_gyro_by_which_the_filter_is_lost_is_named(motion, imu, gps, seed, axis, rate, begin, length):
    """Heading is off by 16 to 150 deg, where innovations are no linear function of the rate."""
    drive = insnav.simulate(motion, imu=imu, gps=gps, seed=seed)
    begin += drive.imu.data.time[0]
    run = insnav.load(off(drive.imu.data, axis, rate * DEG, begin, length), drive.gps.data).navigate().found.run
    (said,) = of_code(run.events, *CONTRADICTIONS)
    assert said.code is Code.CHANGE_GYRO_FAULT
    assert said.severity is Severity.WARNING
    assert said.subject == f"gyro {'xyz'[axis]}"
    assert said["rate_rad_s"] == pytest.approx(rate * DEG, rel=0.05)
    assert said.begin == pytest.approx(begin, abs=2.0)
    solution, truth = run.smoothed.solution, drive.reference.data
    heading = np.interp(solution.time, truth.time, np.unwrap(truth.rph[:, 2]))
    assert np.abs(wrap_pi(solution.rph[:, 2] - heading)).max() < 6.0 * DEG


def test_a_weak_one_that_the_noise_found_with_it_holds_is_named():
    """0.7 deg/s for half a minute of three: its own gain is 13, a tenth of what it is with the noise without it."""
    drive = insnav.simulate("round_trip", imu="automotive", gps="single", seed=9168)
    begin = drive.imu.data.time[0] + 70.0
    run = insnav.load(off(drive.imu.data, 2, 0.7 * DEG, begin, 30.0), drive.gps.data).navigate().found.run
    (said,) = of_code(run.events, *CONTRADICTIONS)
    assert (said.code, said.subject) == (Code.CHANGE_GYRO_FAULT, "gyro z")
    assert said["rate_rad_s"] == pytest.approx(0.7 * DEG, rel=0.15)
    assert said.begin == pytest.approx(begin, abs=3.0)


def test_no_vehicle_turns_far_faster_while_a_gyro_is_off():
    """About a run that was lost between houses a gyro was off by 150 deg/s for nine seconds, which was taken off."""
    imu = insnav.simulate("round_trip", imu="automotive", gps="single", seed=9168).imu.data
    begin = float(imu.time[0]) + 70.0
    fault = Episode(2, begin, begin + 9.0, 5.0 * DEG, 100.0)
    assert fault.bearable(off(imu, 2, 5.0 * DEG, begin, 9.0))
    assert not replace(fault, rate=-150.0 * DEG).bearable(imu)
    clipped = replace(fault, rate=-60.0 * DEG)  # what is not there while the vehicle turns as fast as elsewhere
    turning = replace(imu, gyro=imu.gyro + 60.0 * DEG * (imu.time % 20.0 < 9.0)[:, None])
    assert clipped.bearable(off(turning, 2, -60.0 * DEG, begin, 9.0))


def test_a_rest_within_it_shows_one_or_refutes_it():
    """A flight had its take-off explained by a gyro that was off by 0.36 deg/s, which it was not on the ground before.

    Positions were up to 17 m off, with standard deviations of 2 km.
    """
    drive = insnav.simulate("city", imu="automotive", gps="dgps", seed=2)
    truth, imu = drive.reference.data, drive.imu.data
    stops = runs_of(np.linalg.norm(truth.v_n, axis=1) < 0.01)
    first, last = max(stops[1:-1], key=lambda each: each[1] - each[0])
    begin, length = truth.time[first] - 5.0, truth.time[last - 1] - truth.time[first] + 10.0
    fault = Episode(1, begin, begin + length, 0.4 * DEG, 100.0)
    ready = insnav.load(imu, drive.gps.data).until("align").ready
    assert not fault.seen_at_rest(ready)
    assert fault.seen_at_rest(replace(ready, imu=off(imu, 1, 0.4 * DEG, begin, length)))
    assert not fault.seen_at_rest(replace(ready, imu=off(imu, 1, -0.4 * DEG, begin, length)))
    assert replace(fault, begin=begin + 20.0, end=begin + 25.0).seen_at_rest(ready)  # shorter than a rest


def test_one_that_vibration_hides_in_a_recorded_car_is_named():
    """In-run bias is found for it, in place of the noise that vibration adds; biases then seem to step three times."""
    folder = recorded("rtklib_drive_20250708")
    imu, gps = read_imu(folder / "imu.csv.gz").data, read_gps(folder / "gps.csv").data
    first = max(imu.time[0], gps.time[0]) + 250.0
    imu, gps = (each.rows((each.time >= first) & (each.time <= first + 290.0)) for each in (imu, gps))
    run = insnav.load(off(imu, 2, 1.0 * DEG, first + 120.0, 40.0), gps).navigate().found.run
    steps = Code.CHANGE_GYRO_BIAS, Code.CHANGE_GYRO_BIAS_AMBIGUOUS
    (said,) = of_code(run.events, Code.CHANGE_GYRO_FAULT, *steps)
    assert (said.code, said.subject) == (Code.CHANGE_GYRO_FAULT, "gyro z")
    assert said["rate_rad_s"] == pytest.approx(1.0 * DEG, rel=0.15)
    assert said.begin == pytest.approx(first + 120.0, abs=3.0)


@pytest.mark.parametrize(
    ("axis", "rate", "length", "velocities"), [(2, 2.0, 20.0, True), (2, -2.0, 30.0, False), (0, 0, 0, True)]
)
def test_a_gyro_that_is_off_for_a_while_is_named_and_heading_is_as_good_as_stated(axis, rate, length, velocities):
    drive = insnav.simulate("city", imu="consumer", gps="single", seed=7)
    gps, begin = drive.gps.data, drive.imu.data.time[0] + 250.0
    if not velocities:
        gps = replace(gps, v_n=np.full_like(gps.v_n, np.nan), velocity_sd=np.full_like(gps.velocity_sd, np.nan))
    run = insnav.load(off(drive.imu.data, axis, rate * DEG, begin, length), gps).navigate().found.run
    said = list(of_code(run.events, Code.CHANGE_GYRO_FAULT))
    assert len(said) == (rate != 0)
    for fault in said:
        assert fault.subject == f"gyro {'xyz'[axis]}"
        assert fault["rate_rad_s"] == pytest.approx(rate * DEG, rel=0.25)
        assert fault.begin == pytest.approx(begin, abs=3.0)
        angle = fault["rate_rad_s"] * (fault.end - fault.begin)
        assert angle == pytest.approx(rate * DEG * length, rel=0.04)  # in all: shown best
    solution, truth = run.smoothed.solution, drive.reference.data
    heading = np.interp(solution.time, truth.time, np.unwrap(truth.rph[:, 2]))
    errors = np.abs(wrap_pi(solution.rph[:, 2] - heading)) / solution.sd[:, 8]
    assert np.mean(errors < 3.0) > 0.98


def test_a_drive_without_its_gyro_fault_is_no_surer_of_the_lever_arm_than_its_parts_agree():
    """The antenna is on the IMU; an arm of 0.33 m was stated with an sd of 0.02."""
    folder = recorded("rtklib_drive_20250708")
    imu, gps = read_imu(folder / "imu.csv.gz").data, read_gps(folder / "gps.csv").data
    first = imu.time[0] + 200.0
    imu, gps = (each.rows((each.time >= first) & (each.time < first + 200.0)) for each in (imu, gps))
    gps = gps.rows(np.abs(gps.time % 1.0 - 0.5) < 0.01)
    run = insnav.load(off(imu, 0, 2.0 * DEG, first + 100.0, 10.0), gps).navigate().found.run
    assert any(
        each.subject == "gyro x" and each["rate_rad_s"] > 0.0 for each in of_code(run.events, Code.CHANGE_GYRO_FAULT)
    )
    assert (np.abs(run.lever_b) < 3.0 * run.lever_sd).all()


def test_false_fixes_make_no_gyro_off_by_what_no_gyro_shows():
    """Positions of streets, up to 25 m off with an sd of 2.5 m: a run that they lost was ascribed to 7000 deg/s."""
    drive = insnav.simulate("bends", imu="tactical", gps="urban", seed=634)
    track, true = insnav.load(drive.imu.data, without_velocities(drive.gps.data)).navigate(), drive.reference.data
    assert not any(of_code(track.found.run.events, Code.CHANGE_GYRO_FAULT))
    at = track.found.run.smoothed.solution
    off = ned_offset(at.lla, np.column_stack([np.interp(at.time, true.time, column) for column in true.lla.T]))
    assert np.sqrt(np.mean(off[:, :2] ** 2)) < 8.0
    assert np.mean(np.abs(off) < 3.0 * at.sd[:, :3]) > 0.97
