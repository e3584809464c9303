"""A worse filter is caught and named; noise, another computer and a quick run are not."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import insnav
from insnav.exceptions import DivergenceError
from insnav.findings import Code, Finding
from insnav.output.folder import read_facts
from insnav.regression.baseline import BASELINE_FILE, Baseline, read_baseline, write_baseline
from insnav.regression.corpus import Corpus
from insnav.regression.evaluate import Accuracy, run_corpus
from insnav.regression.verdict import Comparison, compare
from tests.cli.conftest import Cli, cli  # noqa: F401
from tests.regression.conftest import LIBRARY, NOWHERE, Spoil, with_values

REPEATS = 20


def only(corpus: Corpus, name: str) -> Corpus:
    return corpus.model_copy(update={"simulated": [case for case in corpus.simulated if case.name == name]})


def altered(result: Accuracy, change) -> Accuracy:
    """The same with all values changed by a function of metric and values."""
    cases = {}
    for name, case in result.cases.items():
        cases[name] = with_values(case, {key: change(key, value) for key, value in case.measured.values.items()})
    return replace(result, cases=cases)


def test_the_same_version_is_the_same(result: Accuracy, baseline: Baseline, corpus: Corpus):
    again = run_corpus(only(corpus, "sculling"), NOWHERE, quick=True)
    found = compare(again, baseline)
    assert found.passed
    assert {change.verdict for change in found.changes} == {"same"}
    assert len(found.changes) > 25
    for key, value in again.cases["sculling"].measured.values.items():
        if key != "cpu_ratio":
            np.testing.assert_array_equal(value, result.cases["sculling"].measured.values[key])


@pytest.mark.parametrize(
    ("how", "case", "metric"),
    [
        ("gyro noise", "short drive", "velocity_rms_m_s"),
        ("lever arm", "short drive", "velocity_rms_m_s"),
        ("no sculling", "sculling", "innovation_position_m"),
    ],
)
def test_a_worse_filter_is_caught(how: str, case: str, metric: str, corpus: Corpus, baseline: Baseline, spoil: Spoil):
    spoil(how)
    found = compare(run_corpus(only(corpus, case), NOWHERE), baseline)
    print(
        *(
            f"{change.metric.key} {change.old:.4g} {change.new:.4g} {change.adjusted:.1e}"
            for change in sorted(found.changes, key=lambda c: c.shift.p)[:8]
        )
    )
    assert not found.passed
    assert metric in {change.metric.key for change in found.failing}
    assert all(change.case == case for change in found.failing)


@pytest.mark.parametrize(
    ("how", "case", "metric"),
    [
        ("Q doubled", "flapping fixes", "innovation_position_m"),
        ("R doubled", "flapping fixes", "nis_velocity"),
        ("lever arm 10 cm", "flapping fixes", "cep50_m"),
        ("delay 20 ms", "flapping fixes", "innovation_velocity_m_s"),
        ("gate doubled", "flapping fixes", "innovation_position_m"),
        ("gravity north", "balloon", "roll_pitch_rms_deg"),
    ],
)
def test_a_deterioration_is_named(
    how: str, case: str, metric: str, deteriorations: Corpus, before: Baseline, spoil: Spoil
):
    spoil(how)
    found = compare(run_corpus(only(deteriorations, case), NOWHERE, quick=True), before)
    assert metric in {change.metric.key for change in found.failing}


def test_the_command_names_what_is_worse_and_ends_with_1(
    corpus_file: Path,
    tmp_path: Path,
    spoil: Spoil,
    cli: Cli,  # noqa: F811
):
    folder, reports = tmp_path / "trajectories", tmp_path / "reports"
    shutil.copytree(corpus_file.parent, folder)
    head, _, sculling, *_, recorded = corpus_file.read_text().split("[[")
    (folder / "corpus.toml").write_text("[[".join([head, sculling, recorded]))
    options = ("regress", "--corpus", folder / "corpus.toml", "--engine", 1)
    first = cli(*options, "--update-baseline", "--plot")
    assert first.code == 0, first.err
    assert "no baseline" in first.out
    assert any("far away" in line and "not_here" in line for line in first.err.splitlines())
    made = {path.name for path in reports.iterdir()}
    assert {BASELINE_FILE, "history.jsonl", "accuracy.html", "accuracy.md", "accuracy_growth.png"} <= made
    before = (reports / BASELINE_FILE).read_bytes()
    power = cli("regress", "--corpus", folder / "corpus.toml", "--power", "--json")
    detectable = {row["metric"]: row["detectable_percent"] for row in json.loads(power.out)["power"]}
    assert 1.0 < detectable["north_rms_m"] < 200.0
    assert "sculling" in cli("regress", "--corpus", folder / "corpus.toml", "--power").out
    spoil("no sculling")
    done = cli(*options, "--quick")
    assert done.code == 1
    (line,) = (line for line in done.out.splitlines() if line.startswith("FAILS") and "innovations" in line)
    assert "sculling" in line
    assert "->" in line
    assert " m (" in line
    assert "FAILED" in done.out
    assert (reports / BASELINE_FILE).read_bytes() == before


def test_a_quick_run_is_no_baseline(corpus_file: Path, cli: Cli):  # noqa: F811
    done = cli("regress", "--corpus", corpus_file, "--quick", "--update-baseline")
    assert done.code == 2
    assert "--quick" in done.err


def test_recorded_drives_that_are_absent_are_skipped_by_name(result: Accuracy):
    assert set(result.skipped) == {"far away"}
    skipped = result.skipped["far away"]
    assert (skipped.code, skipped.subject, skipped["data"]) == (Code.REGRESSION_NO_DATA, "far away", "not_here")


def test_rounding_of_another_computer_is_no_change(result: Accuracy, baseline: Baseline):
    def rounded(key, value):
        return value * (1.0 + 1e-6) + 1e-9

    found = compare(altered(result, rounded), baseline)
    assert found.passed
    assert {change.verdict for change in found.changes} == {"same"}


def test_one_drive_that_goes_another_way_is_no_change(result: Accuracy, baseline: Baseline):
    """As when rounding lets a fix through that was rejected."""

    def one(key, value):
        return np.where(np.arange(len(value)) == 2, 3.0 * value, value)

    assert compare(altered(result, one), baseline).passed


def test_a_small_but_certain_worsening_is_told_and_passes(result: Accuracy, baseline: Baseline):
    def some(key, value):
        return value * 1.03 if key == "heading_rms_deg" else value

    found = compare(altered(result, some), baseline)
    assert found.passed
    assert {c.metric.key for c in found.changes if c.verdict == "worse"} == {"heading_rms_deg"}


def test_better_is_told(result: Accuracy, baseline: Baseline):
    found = compare(altered(result, lambda key, value: value * 0.8 if key == "outage_30s_m" else value), baseline)
    assert found.passed
    assert {c.metric.key for c in found.changes if c.verdict == "better"} == {"outage_30s_m"}


@pytest.mark.parametrize(("factor", "passes"), [(2.5, True), (3.5, False), (0.1, True)])
def test_cpu_time_fails_only_if_hugely_worse(factor: float, passes: bool, result: Accuracy, baseline: Baseline):
    found = compare(altered(result, lambda key, value: value * factor if key == "cpu_ratio" else value), baseline)
    assert found.passed is passes


@pytest.mark.parametrize(("factor", "passes"), [(0.5, False), (1.5, False), (1.0, True)])
def test_an_untrue_sd_is_worse_either_way(factor: float, passes: bool, result: Accuracy, baseline: Baseline):
    def told(key, value):
        return np.full_like(value, 1.02 * factor) if key == "nees_velocity" else value

    honest = replace(
        baseline,
        cases={
            name: with_values(
                case,
                {**case.measured.values, "nees_velocity": np.full(len(case.measured.values["north_rms_m"]), 1.02)},
            )
            for name, case in baseline.cases.items()
        },
    )
    assert compare(altered(result, told), honest).passed is passes


DIVERGED = DivergenceError("filter.not_finite").facts


def test_a_drive_that_fails_now_is_named(result: Accuracy, baseline: Baseline):
    cases = {**result.cases, "sculling": replace(result.cases["sculling"], failures={3: DIVERGED})}
    found = compare(replace(result, cases=cases), baseline)
    assert not found.passed
    broken = Finding.of(Code.REGRESSION_BROKEN, subject="sculling", run=3, cause=DIVERGED)
    assert found.broken == {"sculling": broken}


def test_another_case_of_the_same_name_is_not_compared(result: Accuracy, baseline: Baseline):
    cases = {name: replace(case, digest="other") for name, case in result.cases.items()}
    found = compare(replace(result, cases=cases), baseline)
    assert not found.changes
    assert {name: each.code for name, each in found.apart.items()} == dict.fromkeys(cases, Code.REGRESSION_OTHER_CASE)


def test_noise_alone_is_never_called_worse():
    """Seeds of the committed baseline against other seeds of it, all figures of all cases, many times."""
    stored = read_baseline(LIBRARY.parent / "reports" / BASELINE_FILE)
    if stored is None:
        pytest.skip("there is no baseline yet")
    cases = {name: case for name, case in stored.cases.items() if not case.pieces}
    found: list[Comparison] = []
    for repeat in range(REPEATS):
        rng = np.random.default_rng(repeat)
        now, then = {}, {}
        for name, case in cases.items():
            values = case.measured.values
            order = rng.permutation(len(values["north_rms_m"]))
            halves = order[: len(order) // 2], order[len(order) // 2 :]
            first, second = ({key: value[half] for key, value in values.items()} for half in halves)
            then[name], now[name] = with_values(case, first), with_values(case, second)
        found.append(compare(Accuracy(now, {}, False), Baseline(stored.origin, then)))
    smallest = sorted(min(change.adjusted for change in each.changes) for each in found)
    print(f"{len(found[0].changes)} figures, {REPEATS} repeats: smallest corrected p {smallest[:3]}")
    assert len(found[0].changes) > 300
    assert all(each.passed for each in found)


def test_python_returns_what_the_command_prints(
    corpus_file: Path,
    baseline: Baseline,
    tmp_path: Path,
    cli: Cli,  # noqa: F811
):
    folder = tmp_path / "trajectories"
    shutil.copytree(corpus_file.parent, folder)
    write_baseline(tmp_path / "reports" / BASELINE_FILE, baseline)
    result = insnav.regress(folder / "corpus.toml", quick=True, workers=1)
    assert result.found.comparison.passed
    where = result.save(tmp_path / "out")
    again = insnav.open_result(where)
    assert again.summary() == result.summary()
    for each in (result, again):
        assert list(each.to_frame()["case"]) == ["short drive", "sculling"]
        assert each.plot("accuracy_growth") is not None
        assert each.page().title in each._repr_html_()
    shown = cli("regress", "--corpus", folder / "corpus.toml", "--engine", 1, "--quick", "--json")
    assert shown.code == 0
    printed, saved = json.loads(shown.out), read_facts(where)
    for each in (printed, saved):
        each["origin"].pop("date")  # a minute may pass between both
    assert {key: printed[key] for key in ("origin", "baseline", "skipped")}.items() <= saved.items()
    assert printed["cases"].keys() == saved["cases"].keys()
