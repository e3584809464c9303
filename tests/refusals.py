"""Errors that a test expects: by their code, never by their words."""

from __future__ import annotations

import pytest

from insnav.exceptions import InsnavError


def refused(kind: type[InsnavError], code: str) -> pytest.RaisesExc[InsnavError]:
    """Expect an error of a kind and a code: ``with refused(InputError, "imu.too_slow") as caught:``."""
    return pytest.raises(kind, check=lambda error: error.code == code)


def problems_of(error: InsnavError) -> list[str]:
    """Place and code of an error, or of each that it is about: ``gyro.bias: unit.unknown``."""
    return [f"{each.where}: {each.code}" for each in error.values.get("problems", (error,))]
