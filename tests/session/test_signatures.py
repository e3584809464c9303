"""Options in the signatures: code editors show them."""

from __future__ import annotations

import inspect
from dataclasses import fields
from typing import Any

import pytest

import insnav
from insnav.lab.calibration import BenchInputs, BenchOptions
from insnav.session.simulation import SimulationOptions


def test_no_public_function_hides_its_options():
    for name in insnav.__all__:
        found = getattr(insnav, name)
        if not callable(found) or inspect.isclass(found):
            continue
        for each in inspect.signature(found).parameters.values():
            if each.kind is inspect.Parameter.VAR_KEYWORD:
                assert str(each.annotation).startswith("Unpack["), (name, each)
            if each.kind is inspect.Parameter.VAR_POSITIONAL:
                assert each.annotation not in (Any, "Any", inspect.Parameter.empty), (name, each)


def test_the_options_of_a_simulation_are_its_parameters():
    shown = inspect.signature(insnav.simulate).parameters
    assert set(shown) == {"profile", *SimulationOptions.__annotations__}
    assert shown["imu"].default == "consumer"
    with pytest.raises(TypeError, match="gpss"):
        insnav.simulate("city", gpss="rtk")


def test_the_keywords_of_a_calibration_are_those_of_its_options():
    assert set(BenchInputs.__annotations__) == {each.name for each in fields(BenchOptions)}
