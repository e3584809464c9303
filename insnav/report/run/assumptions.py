"""What was taken for granted because nobody said it, what matters most first."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from insnav.result import Result
from insnav.types import Run

_ASSUMED = re.compile(r"\bassumed\b")


def run_assumptions(result: Result[Any]) -> tuple[str, ...]:
    """Give lever arm and IMU model unless they were given, and what the files did not say."""
    evidence = {text: name for name, each in result.inputs.items() for text in each.evidence if _ASSUMED.search(text)}
    files = tuple(f"{name}: {text.replace('(assumed; ', '(')}" for text, name in evidence.items())
    return (*_lever_arm(result.found.run, result.options), *_model(result), *files)


def _lever_arm(run: Run, options: Mapping[str, Any]) -> tuple[str, ...]:
    given = options.get("lever_arm") is not None
    if given or np.any(run.lever_b) or np.any(run.lever_sd > 0.0) or len(run.innovations.time) == 0:
        return ()
    return ("lever arm zero, the antenna at the IMU: give it with lever_arm, --lever-arm",)


def _model(result: Result[Any]) -> tuple[str, ...]:
    given = any(result.options.get(name) is not None for name in ("imu", "imu_model"))
    if given or result.imu_model is None:
        return ()
    spec, how = result.imu_model
    if spec.name.endswith("as found"):  # in the innovations of the drive
        return ()
    return (f"IMU model {spec.name}: {how}",)
