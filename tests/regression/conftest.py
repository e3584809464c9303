"""A corpus of two short drives, what it came to, and filters that are worse on purpose."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insnav import strapdown
from insnav.attitude import dcm_from_rph
from insnav.earth import gravity_n
from insnav.filter.receiver import Delay, LeverArm
from insnav.regression import evaluate as run
from insnav.regression.baseline import Baseline, Origin, renewed
from insnav.regression.corpus import Corpus, Material, load_corpus
from insnav.regression.evaluate import Accuracy, CaseResult, run_corpus

LIBRARY = Path(__file__).parents[2] / "trajectories"
NOWHERE = Path("nowhere")
sys.path.insert(0, str(LIBRARY.parent / "reports"))  # where `peers` is
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


def with_values(case: CaseResult, values: dict[str, np.ndarray]) -> CaseResult:
    """The same case with other values."""
    return replace(case, measured=replace(case.measured, values=values))


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
def deteriorations() -> Corpus:
    """The short drives of the corpus, on which every deterioration of `SPOILS` shows."""
    every = load_corpus(LIBRARY / "corpus.toml")
    short = [case for case in every.simulated if case.name in ("flapping fixes", "balloon")]
    return every.model_copy(update={"simulated": short, "recorded": []})


@pytest.fixture(scope="session")
def before(deteriorations: Corpus) -> Baseline:
    return renewed(None, run_corpus(deteriorations, NOWHERE, quick=True), THEN)


@pytest.fixture(scope="session")
def result(corpus: Corpus) -> Accuracy:
    return run_corpus(corpus, NOWHERE)


@pytest.fixture(scope="session")
def baseline(result: Accuracy) -> Baseline:
    return renewed(None, result, THEN)


Spoil = Callable[[str], None]


def more_noise(material: Material) -> Material:
    def doubled(sensor):
        keys = ("random_walk", "bias_instability", "rate_random_walk")
        return replace(sensor, **{key: np.sqrt(2.0) * getattr(sensor, key) for key in keys})

    spec = material.spec
    return replace(material, spec=replace(spec, gyro=doubled(spec.gyro), accel=doubled(spec.accel)))


def worse_fixes(material: Material) -> Material:
    gps, root = material.gps, np.sqrt(2.0)
    return replace(material, gps=replace(gps, position_sd=root * gps.position_sd, velocity_sd=root * gps.velocity_sd))


def with_delay(delay: float) -> Callable[[Material], Material]:
    return lambda material: replace(material, receiver=replace(material.receiver, delay=Delay(delay)))


def moved_antenna(metres: float) -> Callable[[Material], Material]:
    def moved(material: Material) -> Material:
        lever_arm = LeverArm(material.receiver.lever_arm.value + np.array([metres, 0.0, 0.0]))
        return replace(material, receiver=replace(material.receiver, lever_arm=lever_arm))

    return moved


def wider_gate(material: Material) -> Material:
    gates = replace(material.gates)
    object.__setattr__(gates, "nis_limit", 2.0 * gates.nis_limit)
    return replace(material, gates=gates)


def gravity_without_north(material: Material) -> Material:
    """What a mechanization without it makes of the samples, one with it makes of samples that show it too."""
    every = material.truth.rows(slice(None, None, 50))
    north = np.interp(material.imu.time, every.time, [gravity_n(lat, height)[0] for lat, _, height in every.lla])
    rph = np.column_stack(
        [np.interp(material.imu.time, material.truth.time, np.unwrap(each)) for each in material.truth.rph.T]
    )
    shown = dcm_from_rph(rph)[:, 0, :] * north[:, None]
    return replace(material, imu=replace(material.imu, accel=material.imu.accel + shown))


SPOILS: dict[str, Callable[[Material], Material]] = {
    "gyro noise": lambda m: replace(
        m, spec=replace(m.spec, gyro=replace(m.spec.gyro, random_walk=3.0 * m.spec.gyro.random_walk))
    ),
    "lever arm": moved_antenna(0.5),
    "Q doubled": more_noise,
    "R doubled": worse_fixes,
    "lever arm 10 cm": moved_antenna(0.1),
    "delay 20 ms": with_delay(0.02),
    "gate doubled": wider_gate,
    "gravity north": gravity_without_north,
}


@pytest.fixture
def spoil(monkeypatch: pytest.MonkeyPatch) -> Spoil:
    """Make the filter worse: one of `SPOILS`, or ``no sculling``."""

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
            return measure(SPOILS[how](material))

        monkeypatch.setattr(run, "measure", worse)

    return spoilt
