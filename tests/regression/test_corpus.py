"""The corpus file: what it holds, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insnav.exceptions import ConfigError, InputError
from insnav.regression.baseline import Baseline, read_baseline, write_baseline
from insnav.regression.corpus import Corpus, load_corpus, source_of
from insnav.regression.evaluate import measure
from tests.refusals import problems_of, refused
from tests.regression.conftest import CORPUS, LIBRARY, NOWHERE
from tests.shared import DATA, recorded


def test_the_corpus_of_the_project_can_be_read_and_all_its_files_are_there():
    corpus = load_corpus(LIBRARY / "corpus.toml")
    assert len(corpus.simulated) >= 9
    assert len(corpus.recorded) == 5
    for case in corpus.simulated:
        assert (LIBRARY / f"{case.profile}.toml").is_file()


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('profile = "short.toml"', 'profil = "short.toml"', "simulated 1.profil: config.unknown_key"),
        ('settle = "70 s"', 'settle = "70 m"', "simulated 1.settle: unit.of_other_dimension"),
        ("seeds = 8", "seeds = 0", "seeds: config.out_of_range"),
        ('name = "sculling"', 'name = "short drive"', "short drive: regress.same_name"),
        ('data = "not_here"', 'data = "not_here"\nseeds = 3', "regress.seeds_without_fixes"),
    ],
)
def test_what_is_wrong_is_named(old: str, new: str, expected: str, tmp_path: Path):
    assert old in CORPUS
    path = tmp_path / "corpus.toml"
    path.write_text(CORPUS.replace(old, new))
    with pytest.raises(ConfigError) as error:
        load_corpus(path)
    assert any(each.endswith(expected) for each in problems_of(error.value))


def test_the_digest_is_that_of_the_case_and_its_files(corpus: Corpus, corpus_file: Path, tmp_path: Path):
    case = corpus.simulated[0]
    first = source_of(case, NOWHERE).digest
    assert source_of(case.model_copy(update={"seeds": 3}), NOWHERE).digest == first
    assert source_of(case.model_copy(update={"gps": "single"}), NOWHERE).digest != first
    moved = tmp_path / "trajectories"
    moved.mkdir()
    (moved / "corpus.toml").write_text(CORPUS)
    (moved / "short.toml").write_text((corpus_file.parent / "short.toml").read_text())
    elsewhere = load_corpus(moved / "corpus.toml").simulated[0]
    assert source_of(elsewhere, NOWHERE).digest == first
    (moved / "short.toml").write_text((corpus_file.parent / "short.toml").read_text().replace("8 m/s", "9 m/s"))
    assert source_of(elsewhere, NOWHERE).digest != first


def test_a_baseline_comes_back_as_it_was(baseline: Baseline, tmp_path: Path):
    write_baseline(tmp_path / "b.json", baseline)
    back = read_baseline(tmp_path / "b.json")
    assert back is not None
    assert back.origin == baseline.origin
    for name, case in baseline.cases.items():
        assert list(back.cases[name].measured.values) == list(case.measured.values)
        for key, value in case.measured.values.items():
            np.testing.assert_allclose(back.cases[name].measured.values[key], value, rtol=1e-4)


@pytest.mark.parametrize(
    "text", ["", "[]", '{"format": 1}', '{"format": 99, "cases": {}}', '{"format": 1, "cases": 3}']
)
def test_a_damaged_baseline_is_refused(text: str, tmp_path: Path):
    (tmp_path / "b.json").write_text(text)
    with refused(InputError, "regress.baseline_format" if "99" in text else "regress.damaged_baseline"):
        read_baseline(tmp_path / "b.json")


def test_a_recorded_drive_is_evaluated_in_pieces():
    recorded("umn_thor75_uav")
    (case,) = (case for case in load_corpus(LIBRARY / "corpus.toml").recorded if case.data == "umn_thor75_uav")
    found = measure(source_of(case, DATA).material(1)).values
    assert len(found["roll_pitch_rms_deg"]) > 10
    assert np.nanmedian(found["roll_pitch_rms_deg"]) < 2.5
    assert "north_rms_m" not in found  # its reference is not good for that
