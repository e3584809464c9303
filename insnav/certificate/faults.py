"""Fault matrix: faults of recordings, files and machines, required behaviour, and the tests that verify it."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib.resources import files
from typing import Literal

from insnav.messages import translated


@dataclass(frozen=True, slots=True)
class FaultRow:
    """Row of the fault matrix: a fault, the required behaviour, and its test."""

    key: str  # such as ``N1``: N navigation and sensors, F files, P process
    fault: str
    bar: str  # required behaviour
    measured: str  # measured behaviour
    test: str  # test file, or file and function; empty without a test
    state: Literal["met", "partly", "open"]  # partly: the test is weaker than the limit
    reason: str = ""  # reason for a changed requirement


def fault_matrix() -> tuple[FaultRow, ...]:
    """Read every row of the matrix."""
    text = files("insnav.certificate").joinpath("faults.toml").read_text(encoding="utf-8")
    return tuple(FaultRow(key, **row) for key, row in tomllib.loads(text).items())


def matrix_lines(rows: tuple[FaultRow, ...]) -> list[str]:
    """Format the matrix as text: a line of state and fault, and the measurement below."""
    lines = []
    for row in rows:
        lines.append(f"{row.key:<4} {translated(row.state):<7} {translated(row.fault)}")
        parts = {"limit": row.bar, "measured": row.measured, "test": row.test, "changed": row.reason}
        lines += [f"{'':<12} {translated(f'{name}: ')}{text}" for name, text in parts.items() if text]
    count = {state: sum(row.state == state for row in rows) for state in ("met", "partly", "open")}
    met = f"{len(rows)} faults: {count['met']} met, {count['partly']} in part, {count['open']} open"
    return [*lines, translated(met)]
