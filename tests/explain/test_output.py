"""What a user sees of the explanation, and what he may set: results, pages, ``--explain`` and ``--faults``."""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import insnav
from insnav.config_file import parse_quantity
from insnav.exceptions import ConfigError
from insnav.explain.explanation import Explanation, Tried
from insnav.explain.kinds import KINDS, Kind, with_priors
from insnav.findings import Code, of_code
from insnav.messages import LANGUAGES, phrase, speaking
from insnav.output.folder import read_facts
from insnav.report.page import section_tables
from insnav.report.save import MOST, explanation_line, explanation_section, facts_of
from insnav.report.terminal import table_text
from insnav.result import Result, open_result
from insnav.simulate.recording import gps_jump
from insnav.types import GpsData
from insnav.units import DEG, UNITS
from tests.explain.test_faults import recording

SEED, METRES, LASTS = 3, 60.0, 20.0
DOCUMENT = Path(__file__).parents[2] / "docs" / "howto" / "faults.md"


def jumped() -> tuple[GpsData, float]:
    """Fixes of which twenty are off, and when that begins."""
    gps = recording(SEED).gps
    begin = float(gps.time[0]) + 199.5
    return gps_jump(gps, METRES, (begin, begin + LASTS)), begin


@lru_cache
def drive_of(*, explain: str, clean: bool = False) -> insnav.Drive:
    made = recording(SEED)
    return insnav.load(made.imu, made.gps if clean else jumped()[0], imu="automotive", explain=explain)


@lru_cache
def result_of(*, explain: str = "on", clean: bool = False) -> Result:
    return drive_of(explain=explain, clean=clean).navigate()


def test_the_fixes_behind_a_jump_that_stays_are_moved_back():
    """Those after it, as there are fewer of them."""
    made, begin = recording(SEED), float(recording(SEED).gps.time[-1]) - 99.5
    stays = gps_jump(made.gps, METRES, (begin, begin + 1000.0))
    found = insnav.load(made.imu, stays, imu="automotive").until("explain").model.explanation
    (jump,) = (each for each in found.tried if each.accepted)
    assert (jump.name, jump.left_out) == ("offset", 0)
    assert jump.moved == pytest.approx(100, abs=1)


def row(name: str, *, gain: float = 1.0, accepted: bool = False, **more: float) -> Tried:
    kind = next(each for each in KINDS if each.name == name)
    return Tried(name, 1.0, np.inf, gain, 5.0, kind.unit, accepted, **more)


# --- results -----------------------------------------------------------------------------------------------


def test_a_result_holds_the_fault_that_was_made():
    (found,) = (each for each in result_of().explanation.tried if each.accepted)
    assert found.name == "offset"
    assert found.begin == pytest.approx(jumped()[1], abs=1.0)
    assert found.end - found.begin == pytest.approx(LASTS, abs=1.0)
    assert found.size == pytest.approx(METRES, rel=0.1)
    assert found.left_out == LASTS
    step = drive_of(explain="on").until("explain")
    assert step.model.explanation.passes == result_of().explanation.passes > 0


def test_the_gain_is_that_of_the_evidence_and_the_prior_its_closed_form():
    """Half the rate costs 2 log 2, at the same size; the gain, which has the prior in it, falls by the same."""
    kind = next(each for each in KINDS if each.name == "offset")
    given = {"offset": {"rate": f"{0.5 * kind.rate} 1/h"}}
    made = recording(SEED)
    rarer = insnav.load(made.imu, jumped()[0], imu="automotive", faults=given).until("explain").model.explanation
    before, after = (next(each for each in found.tried if each.accepted) for found in (result_of().explanation, rarer))
    assert after.prior - before.prior == pytest.approx(2.0 * np.log(2.0), abs=0.01)
    assert before.gain - after.gain == pytest.approx(2.0 * np.log(2.0), abs=0.5)


def test_what_is_saved_is_opened_again(tmp_path: Path):
    saved = result_of()
    again = open_result(saved.save(tmp_path / "run", figures="none")).explanation
    assert isinstance(again, Explanation)
    assert again.tried == saved.explanation.tried
    assert (again.passes, again.runs, again.findings) == (saved.explanation.passes, 1, saved.explanation.findings)
    for ours, theirs in zip(again.faults, saved.explanation.faults, strict=True):
        assert ours.kind == theirs.kind
        assert (ours.begin, ours.end, ours.gain, ours.back) == (theirs.begin, theirs.end, theirs.gain, theirs.back)
        np.testing.assert_array_equal(ours.size, theirs.size)
    facts = read_facts(tmp_path / "run")["explanation"]
    best = facts["rows"][0]
    assert (best["fault"], best["accepted"], best["left_out"], best["moved"]) == ("offset", True, 20, 0)
    assert best["size_m"] == saved.explanation.tried[0].size
    assert facts["considered"] == len(saved.explanation.tried)
    opened = open_result(tmp_path / "run")
    assert facts_of(opened)["explanation"] == facts


def test_off_leaves_the_plain_filter_with_its_gates(tmp_path: Path):
    plain = result_of(explain="off")
    assert plain.explanation is None
    ready = drive_of(explain="off").until("explain").ready
    assert (ready.explained.false, ready.explained.changes, ready.explained.rough) == (None, (), ())
    assert any(of_code(result_of().findings, Code.RECORD_FALSE_POSITIONS))
    assert not any(of_code(plain.findings, Code.RECORD_FALSE_POSITIONS))
    assert "explanation" not in read_facts(plain.save(tmp_path / "run", figures="none"))
    assert open_result(tmp_path / "run").explanation is None


def test_a_clean_drive_is_the_same_without():
    on, off = (result_of(explain=each, clean=True) for each in ("on", "off"))
    assert not any(each.accepted for each in on.explanation.tried)
    np.testing.assert_array_equal(on.found.run.solution.lla, off.found.run.solution.lla)


def test_delays_that_were_found_earlier_stay_in_the_table():
    earlier = Explanation(tried=(row("delay", accepted=True), row("offset")), passes=10, runs=2)
    found = Explanation(tried=(row("drag"),), passes=5, runs=1).after([earlier])
    assert [each.name for each in found.tried] == ["delay", "drag"]
    assert (found.passes, found.runs) == (15, 3)
    unsearched = Explanation().after([earlier])
    assert (unsearched.passes, unsearched.runs) == (10, 2)


# --- page and terminal -------------------------------------------------------------------------------------


def test_the_page_shows_at_most_eight_faults_and_what_they_changed():
    rows = [
        row("offset", gain=99.0, accepted=True, size=60.0, left_out=20, moved=5),
        row("gyro_z", gain=90.0, accepted=True, size=DEG),
        row("rough", gain=80.0, accepted=True, size=3.0),
        row("delay", gain=70.0, accepted=True, size=0.2),
        *(row("drag", gain=float(number)) for number in range(20, 0, -1)),
    ]
    found = explanation_section(Explanation(tried=tuple(rows), passes=7))
    tables = section_tables(found, ("all", "page"))
    assert len(tables[1].rows) == MOST == 8
    shown = [" ".join(each) for each in tables[1].rows]
    changed = [phrase("explanation.left_out", count=20), *(phrase(f"explanation.{n}") for n in ("corrected", "rough"))]
    assert phrase("explanation.moved", count=5) in shown[0]
    for line, size, words in zip(shown, ("60.0 m", "1.00 deg/s", "3.00 m"), changed, strict=False):
        assert size in line
        assert words in line
        assert phrase("page.yes") in line
    assert phrase("fault.drag") in shown[-1]
    assert phrase("page.no") in shown[-1]
    assert not found.folded
    assert explanation_section(Explanation()).folded
    assert max(map(len, table_text(tables[1], 80).splitlines())) <= 80


def test_the_page_of_a_run_has_the_table():
    from insnav.report.html import page_html

    page = result_of().page()
    text = page_html(page, {})
    assert phrase("fault.offset") in text
    assert phrase("explanation.left_out", count=20) in text


@pytest.mark.parametrize("lang", LANGUAGES)
def test_every_kind_has_words(lang):
    with speaking(lang):
        words = [phrase(f"fault.{each}") for each in (*(kind.name for kind in KINDS), "return")]
        for accepted in (False, True):
            assert "7" in explanation_line(Explanation(tried=(row("offset", accepted=accepted),), passes=7))
    assert len({*words}) == len(words)


# --- settings ----------------------------------------------------------------------------------------------


def kinds_of(**given: dict[str, str]) -> dict[str, Kind]:
    return {kind.name: kind for kind in with_priors(given)}


def test_priors_are_given_with_their_units(tmp_path: Path):
    file = tmp_path / "faults.toml"
    file.write_text('[faults.offset]\nrate = "0.2 1/h"\nsize = "3000 cm"\n[faults.gyro_z]\nsize = "3600 deg/h"\n')
    usual = {kind.name: kind for kind in KINDS}
    found = {kind.name: kind for kind in with_priors(file)}
    assert (found["offset"].rate, found["offset"].size) == pytest.approx((0.2, 30.0))
    assert (found["gyro_z"].rate, found["gyro_z"].size) == pytest.approx((usual["gyro_z"].rate, DEG))
    again = kinds_of(offset={"rate": "0.2 1/h", "size": "3000 cm"}, gyro_z={"size": "3600 deg/h"})
    assert found == again
    for name in usual.keys() - {"offset", "gyro_z"}:
        assert found[name].size == usual[name].size
        assert found[name].rate == pytest.approx(usual[name].rate, rel=1e-14)


@pytest.mark.parametrize(
    ("given", "code", "where"),
    [
        ({"ofset": {"size": "1 m"}}, "config.unknown_key", "faults.ofset"),
        ({"offset": {"sizes": "1 m"}}, "config.unknown_key", "faults.offset.sizes"),
        ({"offset": {"size": "-1 m"}}, "config.negative", "faults.offset.size"),
        ({"offset": {"size": "0 m"}}, "config.not_above_zero", "faults.offset"),
        ({"offset": {"size": 1.0}}, "config.no_quantity", "faults.offset.size"),
        ({"offset": {"size": "1 deg"}}, "unit.of_other_dimension", "faults.offset.size"),
        ({"offset": {"size": "large"}}, "unit.missing", "faults.offset.size"),
        ({"offset": {"rate": "1 m"}}, "unit.of_other_dimension", "faults.offset.rate"),
        ({"offset": 1.0}, "config.no_table", "faults.offset"),
    ],
)
def test_what_cannot_be_a_prior_is_refused(given, code, where):
    made = recording(SEED)
    with pytest.raises(ConfigError) as refused:
        insnav.load(made.imu, made.gps, faults=given)
    assert (refused.value.code, refused.value.where) == (code, where)


def test_a_word_that_is_no_choice_is_refused():
    made = recording(SEED)
    with pytest.raises(ConfigError) as refused:
        insnav.load(made.imu, made.gps, explain="never")
    assert (refused.value.code, refused.value.where) == ("input.unknown_word", "explain")


def test_the_document_has_the_priors_that_are_built_in():
    found = {}
    for line in DOCUMENT.read_text(encoding="utf-8").splitlines():
        if line.startswith("| `"):
            names, _, rate, size = (each.strip() for each in line.strip("|").split("|"))
            found |= dict.fromkeys(re.findall(r"`(\w+)`", names), (rate, size))
    assert found.keys() == {kind.name for kind in KINDS}
    for kind in KINDS:
        rate, size = found[kind.name]
        assert parse_quantity(rate, "frequency") * 3600.0 == pytest.approx(kind.rate)
        assert parse_quantity(size, UNITS[kind.unit][0]) == pytest.approx(kind.size)
