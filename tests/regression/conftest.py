"""A corpus of two short drives, what it came to, and filters that are worse on purpose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insnav import strapdown
from insnav.regression import run_corpus as run
from insnav.regression.baseline import Baseline, renewed
from insnav.regression.cases import Material
from insnav.regression.corpus import Corpus, load_corpus
from insnav.regression.provenance import Origin
from insnav.regression.run_corpus import Result, run_corpus

LIBRARY = Path(__file__).parents[2] / "trajectories"
NOWHERE = Path("nowhere")
THEN = Origin("0.0.9", "abc", "2026-01-01T00:00Z", {}, "2 x abacus")
CORPUS = """
[[simulated]]
name = "short drive"
profile = "short.toml"
imu = "tactical"
gps = "dgps"
lever_arm = ["0.3 m", "0.0 m", "-2.0 m"]
settle = "70 s"
seeds = 8
quick = 8

[[simulated]]
name = "sculling"
profile = "sculling.toml"
imu = "navigation"
gps = "rtk"
settle = "10 s"
seeds = 6
quick = 6

[[recorded]]
name = "far away"
data = "not_here"
imu = "consumer"
"""
SHORT = """
purpose = "Rest, then bends"

[start]
lat = "60 deg"
lon = "20 deg"
heading = "100 deg"

[[segment]]
kind = "static"
duration = "60 s"

[[segment]]
kind = "accelerate"
to = "8 m/s"

[[segment]]
kind = "repeat"
count = 4
segment = [
  { kind = "turn", angle = "70 deg", rate = "8 deg/s" },
  { kind = "cruise", duration = "20 s" },
  { kind = "turn", angle = "-50 deg", rate = "8 deg/s" },
  { kind = "cruise", duration = "10 s" },
]
"""


@pytest.fixture(scope="session")
def corpus_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("project") / "trajectories"
    folder.mkdir()
    (folder / "corpus.toml").write_text(CORPUS)
    (folder / "short.toml").write_text(SHORT)
    (folder / "sculling.toml").write_text((LIBRARY / "sculling.toml").read_text())
    return folder / "corpus.toml"


@pytest.fixture(scope="session")
def corpus(corpus_file: Path) -> Corpus:
    return load_corpus(corpus_file)


@pytest.fixture(scope="session")
def result(corpus: Corpus) -> Result:
    return run_corpus(corpus, NOWHERE)


@pytest.fixture(scope="session")
def baseline(result: Result) -> Baseline:
    return renewed(None, result, THEN)


Spoil = Callable[[str], None]


@pytest.fixture
def spoil(monkeypatch: pytest.MonkeyPatch) -> Spoil:
    """Make the filter worse: ``gyro noise``, ``lever arm`` or ``no sculling``."""

    def spoilt(how: str) -> None:
        if how == "no sculling":
            whole = strapdown.increments

            def without(*args, **kwargs):
                inc = whole(*args, **kwargs)
                return replace(inc, sculling=np.zeros_like(inc.sculling))

            monkeypatch.setattr(strapdown, "increments", without)
            return
        measure = run.measure

        def worse(material: Material):
            spec, settings = material.spec, material.settings
            if how == "gyro noise":
                spec = replace(spec, gyro=replace(spec.gyro, random_walk=3.0 * spec.gyro.random_walk))
            else:
                settings = replace(settings, lever_b=settings.lever_b + np.array([0.5, 0.0, 0.0]))
            return measure(replace(material, spec=spec, settings=settings))

        monkeypatch.setattr(run, "measure", worse)

    return spoilt
