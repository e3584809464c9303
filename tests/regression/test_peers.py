"""Other programs on a short drive: the same figures from the same data, within what they can do."""

from __future__ import annotations

import importlib.util

import numpy as np
import peers
import pytest
from peers import installed, run_peers

from insnav.regression.corpus import Corpus
from tests.regression.conftest import NOWHERE

pytestmark = pytest.mark.skipif(importlib.util.find_spec("pyins") is None, reason="pyins (python-ins) is not installed")


def test_peers_stand_in_the_same_table(corpus: Corpus, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(peers, "LONGEST", 40.0)
    only = corpus.model_copy(update={"simulated": [c for c in corpus.simulated if c.name == "sculling"]})
    rows = {row.program: row for row in run_peers(only, NOWHERE)}
    assert set(rows) == {"insnav", "insnav, smoothed", *installed()}
    for row in rows.values():
        print(row)
        assert row.remark == ""
        assert np.linalg.norm(row.rms) < 0.2  # the receiver is good to centimetres
        assert row.attitude_deg[0] < 0.1
    assert rows["pyins"].cpu_us > rows["insnav"].cpu_us


def test_a_peer_that_fails_is_a_row_of_the_table(corpus: Corpus, monkeypatch: pytest.MonkeyPatch):
    def fails(task):
        raise RuntimeError("singular matrix")

    monkeypatch.setattr(peers, "LONGEST", 30.0)
    monkeypatch.setattr(peers, "installed", lambda: {"other": fails})
    only = corpus.model_copy(update={"simulated": [c for c in corpus.simulated if c.name == "sculling"]})
    (row,) = (row for row in run_peers(only, NOWHERE) if row.program == "other")
    assert row.remark == "fails: singular matrix"
    assert row.rms == (None, None, None)
