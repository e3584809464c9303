"""The list of sources: complete, and each family taken apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.errors.budget.sources import families, left_out, not_given, only, sources_of
from insnav.imu import ImuSpec, SensorSpec, load_imu
from tests.errors.budget.imus import plain, whole

G = 9.80665
# the 39 sources of the covariance budget of PSINS
PSINS = {
    "initial tilt": 2,
    "initial heading": 1,
    "initial velocity": 3,
    "initial position": 3,
    "gyro bias": 3,
    "accel bias": 3,
    "gyro white noise": 3,
    "accel white noise": 3,
    "gyro scale factor": 3,
    "gyro misalignment": 6,
    "accel scale factor": 3,
    "accel misalignment": 6,
}


def test_all_sources_of_psins_are_there_and_more():
    listed = sources_of(whole(), 1e-5)
    count = {name: sum(source.family == name for source in listed) for name in families(listed)}
    assert sum(PSINS.values()) == 39
    assert {name: count[name] for name in PSINS} == PSINS
    further = {"bias instability", "rate random walk", "flicker noise", "bias ramp", "asymmetry"} | {
        "non-linearity",
        "quantisation",
    }
    assert {f"{group} {term}" for group in ("gyro", "accel") for term in further} <= set(count)
    assert {"gyro g-sensitivity", "gravity model", "timing offset", "timing drift"} <= set(count)
    names = [source.name for source in listed]
    assert len(set(names)) == len(names) == 95
    assert all(source.sd > 0.0 for source in listed)


def test_what_is_not_given_is_zero_and_said():
    spec = ImuSpec("bare", SensorSpec(bias=np.full(3, 1e-6)), SensorSpec(), absent=("gyro.random_walk", "accel.bias"))
    listed = sources_of(spec)
    assert len(listed) == 95
    assert families(listed) == ("gyro bias",)
    assert set(not_given(spec)) == {
        "gyro.random_walk",
        "accel.bias",
        "initial.position",
        "initial.velocity",
        "initial.tilt",
        "initial.heading",
    }
    assert "initial.tilt" in not_given(load_imu("tactical"))


def test_what_is_not_in_the_budget_is_said():
    spec = whole()
    assert left_out(spec) == ()
    other = replace(spec, gyro=replace(spec.gyro, resolution=np.full(3, 1e-6), range=np.full(3, 5.0)))
    assert left_out(replace(other, positions=np.eye(3))) == (
        "gyro resolution",
        "gyro end of the range",
        "places of the accelerometers",
    )


@pytest.mark.parametrize("spec", [plain(), whole()], ids=["plain", "whole"])
def test_families_taken_apart_are_the_whole(spec):
    listed = sources_of(spec)
    for name in families(listed):
        alone = sources_of(only(spec, name))
        assert families(alone) == (name,)
        assert [s for s in alone if s.family == name] == [s for s in listed if s.family == name]
