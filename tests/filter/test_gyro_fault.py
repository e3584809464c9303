"""A gyro that is off for a while is found and named, and none that is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insnav
from insnav.attitude import wrap_pi
from insnav.filter.noise_identification import known_likelihood
from insnav.types import ImuData
from insnav.units import DEG


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
        ready = insnav.load(samples, drive.gps.data).prepared()
        known = known_likelihood(ready, insnav.load(samples, drive.gps.data).imu_spec)
        assert known is not None
        innovations.append(known[0].normalised(known[1])[0])
        if samples is imu:
            _, weight, by = known[0].by_rates(known[1], edges, axis)
    change, expected = innovations[1] - innovations[0], -rate * by.sum(axis=0)
    assert np.sum(weight * (change - expected) ** 2) < 0.01 * np.sum(weight * expected**2)


@pytest.mark.parametrize(
    ("axis", "rate", "length", "velocities"), [(2, 2.0, 20.0, True), (2, -2.0, 30.0, False), (0, 0, 0, True)]
)
def test_a_gyro_that_is_off_for_a_while_is_named_and_heading_is_as_good_as_stated(axis, rate, length, velocities):
    drive = insnav.simulate("city", imu="consumer", gps="single", seed=7)
    gps, begin = drive.gps.data, drive.imu.data.time[0] + 250.0
    if not velocities:
        gps = replace(gps, v_n=np.full_like(gps.v_n, np.nan), velocity_sd=np.full_like(gps.velocity_sd, np.nan))
    run = insnav.load(off(drive.imu.data, axis, rate * DEG, begin, length), gps).navigate().found.run
    said = [event for event in run.events if "is off by" in event.action]
    assert len(said) == (rate != 0)
    for event in said:
        assert f"gyro {'xyz'[axis]} is off by {np.sign(rate) * event.value:+.2g} deg/s" in event.action
        assert event.value == pytest.approx(abs(rate), rel=0.25)
        assert event.time == pytest.approx(begin, abs=3.0)
    solution, truth = run.smoothed.solution, drive.reference.data
    heading = np.interp(solution.time, truth.time, np.unwrap(truth.rph[:, 2]))
    errors = np.abs(wrap_pi(solution.rph[:, 2] - heading)) / solution.sd[:, 8]
    assert np.mean(errors < 3.0) > 0.98
