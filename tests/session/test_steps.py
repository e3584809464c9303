"""A drive goes through named steps, each in its own file."""

from __future__ import annotations

import ast
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

import insnav
from insnav import steps
from insnav.exceptions import InputError
from insnav.filter.filter_input import FilterInput
from insnav.findings import Code, Finding, of_code
from insnav.steps import LOAD, STEPS, Estimate
from insnav.steps.check_given import check_given
from insnav.steps.clean import clean
from tests.refusals import refused

FOLDER = Path(steps.__file__).parent
# files that are no steps
SUPPORT = {"__init__", "given", "inputs"}


@pytest.fixture(scope="module")
def drive() -> insnav.Drive:
    return insnav.simulate("city", imu="automotive", seed=4)


def test_each_step_is_a_function_in_a_short_file_of_its_name() -> None:
    assert {path.stem for path in FOLDER.glob("*.py")} == {*STEPS, *SUPPORT}
    for name in STEPS:
        source = (FOLDER / f"{name}.py").read_text(encoding="utf-8")
        functions = {node.name: node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)}
        assert [each.arg for each in functions[name].args.args] == ["recording", "model"]
        assert source.count("\n") <= 250


def test_no_step_imports_another_and_one_file_names_them() -> None:
    for path in FOLDER.glob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        imported = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        assert not imported & {f"insnav.steps.{name}" for name in STEPS}, path
        named = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)} & {*STEPS}
        assert len(named) <= 1 or path.stem == "__init__", path


def test_a_result_holds_its_steps_in_order(drive: insnav.Drive) -> None:
    assert tuple(step.name for step in drive.steps) == LOAD
    found = drive.navigate()
    assert tuple(step.name for step in found.steps) == STEPS
    assert all(step.time_s >= 0.0 for step in found.steps)
    assert {finding for step in found.steps for finding in step.findings} <= {*found.findings, drive.imu_chosen}


def test_a_step_leaves_what_it_was_given_as_it_was(drive: insnav.Drive) -> None:
    before = drive.imu.data.time.copy()
    aligned = drive.until("align")
    assert drive.model.ready is None
    assert aligned.model.ready is not None
    np.testing.assert_array_equal(drive.imu.data.time, before)
    again, once = aligned.until("noise").model.filter_imu, drive.until("noise").model.filter_imu
    np.testing.assert_array_equal(again.gyro.bias, once.gyro.bias)


def test_estimates_are_in_the_model_and_findings_with_the_steps(drive: insnav.Drive) -> None:
    """The input of the filter carried noise, notes, faults and clock from step to step."""
    assert not {each.name for each in fields(FilterInput)} & {"noise", "notes", "faults", "findings", "clock", "rate"}
    done = insnav.load(drive.imu.data, gps=drive.gps.data).until("navigate")
    model = done.model
    assert (model.noise is not None, model.clock.source) == (True, "data")
    assert {*model.findings} <= {finding for step in done.steps for finding in step.findings}
    change = Finding.of(Code.CHANGE_GYRO_BIAS, 100.0)
    changed = replace(model.solved, run=replace(model.solved.run, events=(change,)))
    assumed = replace(model, mounting_yaw=Estimate(0.0, 0.0, "prior"), solved=changed)
    (doubt,) = of_code(check_given(done.recording, assumed)[2], Code.MOUNTING_DOUBTED)
    assert doubt["count"] == 1  # faults are events of the run: they were counted twice


def test_arithmetic_that_fails_names_the_data(drive: insnav.Drive) -> None:
    """A velocity that no power of which is finite: the least squares behind it do not converge."""
    gps = drive.recording.gps.data
    v_n = gps.v_n.copy()
    v_n[len(v_n) // 2, 0] = -1e308
    with refused(InputError, "input.arithmetic") as caught, np.errstate(all="ignore"):
        insnav.load(drive.imu.data, gps=replace(gps, v_n=v_n)).until("align")
    assert caught.value.values["step"] == "align"
    assert "v_n 1e+308" in caught.value.values["largest"]
    assert "v_n" not in caught.value.values["constant"]


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_three_sensors_that_are_always_zero_are_refused_on_a_drive_but_not_at_rest(drive: insnav.Drive, sensor: str):
    imu, gps = drive.imu.data, drive.recording.gps.data
    dead = replace(imu, **{sensor: np.zeros_like(imu.gyro)})
    with refused(InputError, "imu.triad_zero"):
        insnav.load(dead, gps=gps)
    standing = replace(gps, lla=np.tile(gps.lla[0], (len(gps.time), 1)), v_n=np.zeros_like(gps.v_n))
    record = replace(drive.recording, imu=replace(drive.recording.imu, data=dead))
    record = replace(record, gps=replace(drive.recording.gps, data=standing))
    assert clean(record, drive.model)[0].fixes_by_scatter is not None
