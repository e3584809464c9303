"""A reference of another point of the vehicle, and of another height: found, and told from the errors of the run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.earth import lla_offset
from insnav.errors.metrics import at_point, position_errors
from insnav.errors.reference_check import offset_findings, reference_offset
from insnav.findings import Code
from insnav.simulate import reference
from insnav.types import FloatArray, Trajectory
from tests.filter import drives

POINT = np.array([1.4, -0.6, 0.0])


def driven(seed: int, size: float) -> tuple[Trajectory, Trajectory]:
    """A track with errors of `size` [m] that last for half a minute, and the truth."""
    motion = drives.truth()
    time = motion.start + np.arange(0.0, motion.duration, 0.5)
    truth = reference(motion, time)
    rng = np.random.default_rng(seed)
    error = np.zeros((time.size, 3))
    keep = np.exp(-0.5 / 30.0)
    for k in range(1, time.size):
        error[k] = keep * error[k - 1] + np.sqrt(1.0 - keep**2) * size * rng.standard_normal(3)
    sd = np.full((time.size, 9), max(size, 1e-3))
    return replace(truth, lla=lla_offset(truth.lla, error), sd=sd), truth


def moved(truth: Trajectory, point: FloatArray, height: float = 0.0) -> Trajectory:
    elsewhere = at_point(truth, point)
    return replace(elsewhere, lla=elsewhere.lla + np.array([0.0, 0.0, height]))


def test_a_point_of_the_vehicle_is_found_exactly_without_errors():
    track, truth = driven(0, 0.0)
    found = reference_offset(position_errors(track, moved(truth, POINT, -47.0)), track)
    assert found is not None
    np.testing.assert_allclose(found.body, POINT[:2], atol=0.03)  # the vehicle is not level everywhere
    assert found.horizontal_rms == pytest.approx(np.hypot(*POINT[:2]), abs=0.03)
    assert found.horizontal_rms_without < 0.05
    assert found.down == pytest.approx(-47.0, abs=0.1)
    point, geoid = offset_findings(found, np.array([0.5, 0.0, -1.0]))
    assert (point.code, geoid.code) == (Code.REF_POINT, Code.REF_GEOID)
    assert point["forward_m"] == pytest.approx(1.4, abs=0.01)
    assert point["x_m"] == pytest.approx(1.9, abs=0.01)  # from the IMU, not from the point compared with
    assert point["z_m"] == -1.0
    assert geoid["height_m"] == pytest.approx(-47.0, abs=0.1)


def test_its_standard_deviation_is_about_right():
    ratios = []
    for seed in range(20):
        track, truth = driven(seed, 0.3)
        found = reference_offset(position_errors(track, moved(truth, POINT)), track)
        assert found is not None
        assert found.clear
        ratios.append((found.body - POINT[:2]) / found.body_sd)
    assert np.sqrt(np.mean(np.square(ratios))) < 1.6


def test_an_error_of_the_run_is_no_other_point():
    for seed in range(10):
        track, truth = driven(seed, 1.0)
        found = reference_offset(position_errors(track, truth), track)
        assert found is not None
        assert offset_findings(found, np.zeros(3)) == []


def test_a_lever_arm_that_is_not_known_is_no_other_point():
    track, truth = driven(1, 0.3)
    errors = position_errors(track, moved(truth, POINT))
    for lever_sd, clear in ((np.full(3, 0.05), True), (np.full(3, 0.5), False)):
        assert reference_offset(errors, track, lever_sd).clear == clear


def test_without_turns_nothing_is_told():
    track, truth = driven(1, 0.1)
    errors = position_errors(track, truth)
    assert reference_offset(errors, replace(track, rph=np.zeros_like(track.rph))) is None
    assert reference_offset(replace(errors, position=np.full_like(errors.position, np.nan)), track) is None
