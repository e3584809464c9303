"""Pictures of README and manual show what the code draws today."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from tests.cli.conftest import ROOT

sys.path.insert(0, str(ROOT / "reports"))
import pictures


@pytest.mark.parametrize("name", [*pictures.FIGURES, pictures.PAGE])
def test_a_picture_shows_what_is_drawn_today(name: str):
    then, now = pictures.carried(name), pictures.numbers(name)
    assert then.keys() == now.keys()
    for key, values in then.items():
        scale = max(np.abs(values).max(), 1e-12)
        np.testing.assert_allclose(np.array(now[key]) / scale, np.array(values) / scale, atol=0.02, err_msg=key)
