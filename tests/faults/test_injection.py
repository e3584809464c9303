"""A few faults of the injection script, put into a short drive: refused, found, or said, and never silent."""

from __future__ import annotations

import pytest

from tests.faults.injection import OUTCOMES, cases, clean, outcome

WANTED = {
    "spike 1000m": "good",
    "first fix 300m": "told",
    "jump 30 s 300m": "told",
    "jump for good 500m": "warned",
    "drag with v 5.0": "warned",
    "drag 60 s 0.2m/s": "warned",
    "jump for good 3m": "warned",
    "sd factor 0.3": "warned",
    "clock back": "refused",
    "stuck gyro-z [s] 4": "told",
    "axes left-handed FLD": "told",
    "velocity ENU": "refused",
}


def test_nothing_is_said_without_a_fault():
    assert clean("short").inside > 0.99
    assert not clean("short").said[0]


@pytest.mark.parametrize("name", WANTED)
def test_a_fault_is_never_silent(name):
    (case,) = [case for case in cases() if case.name == name]
    found = outcome("short", case)
    assert OUTCOMES.index(found.kind) >= OUTCOMES.index(WANTED[name]), found
