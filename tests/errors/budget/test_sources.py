"""The list of sources: complete, and each family taken apart."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from insnav.errors.budget.error_budget import budget
from insnav.errors.budget.sampled_motion import at_rest
from insnav.errors.budget.sources import families, left_out, not_given, only, sources_of
from insnav.imu import ImuSpec, SensorSpec, error_terms, load_imu
from insnav.imu.error_terms import ErrorTerm
from insnav.report.budget.contributions import effect, growth, size
from insnav.types import FloatArray
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


@dataclass(frozen=True, slots=True)
class _Cubic(SensorSpec):
    """Sensor with one term more: an error by the cube of the specific force."""

    cubic: FloatArray = field(default_factory=lambda: np.zeros(3))


def test_a_new_error_term_is_a_row_of_the_table_and_a_field(monkeypatch: pytest.MonkeyPatch):
    def cube(w: FloatArray, f: FloatArray, t: FloatArray) -> FloatArray:
        return f**3

    row = ErrorTerm(
        "accel", "cubic", "cubic error", "per acceleration", "ug/g^2", "constant", "diagonal", cube, "bends"
    )
    monkeypatch.setattr(error_terms, "TERMS", (*error_terms.TERMS, row))
    # the same error at rest with each: the lower axis feels g
    z = np.array([0.0, 0.0, 1.0])
    cubic = ImuSpec("cubic", SensorSpec(), _Cubic(cubic=1e-3 * z / G**3))
    plain_bias = ImuSpec("bias", SensorSpec(), _Cubic(bias=1e-3 * z))
    assert families(sources_of(cubic)) == ("accel cubic error",)
    motion = at_rest(20.0)
    found, same = (budget(spec, motion, (10.0,), runs=60) for spec in (cubic, plain_bias))
    down = (slice(None), 2)
    np.testing.assert_allclose(found.covariance.total[down], same.covariance.total[down], rtol=2e-3)
    np.testing.assert_allclose(found.analytic.total[down], same.analytic.total[down], rtol=2e-3)
    assert found.simulated.total[-1, 2] == pytest.approx(found.covariance.total[-1, 2], rel=0.3)
    assert found.simulated.parts[-1, 0, 2] == pytest.approx(found.covariance.total[-1, 2], rel=0.3)
    assert effect("accel cubic error") == "bends"
    assert growth(found, "accel cubic error") == "t²"
    assert size(found, "accel cubic error").endswith("ug/g^2")
