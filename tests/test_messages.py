"""Findings, errors and their words: the catalogues are complete, its formats work, its sentences can be read."""

from __future__ import annotations

import ast
import math
import re
import string
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import insnav
from insnav.findings import Code, Finding, Severity
from insnav.messages import LANGUAGES, PARTS, Message, catalogue, form, language, moment, phrase, render, sentence
from insnav.units import UNITS
from tests.cli.conftest import SAMPLE
from tests.error_sites import error_sites

ROOT = Path(__file__).parents[1] / "insnav"
VERBS = ("moment", "word", "lines", "count", "plural", "sign", "abs", "reason", "fix")
SENTENCES = {"text", "done", "advice", "what", "why", "fix"}  # parts that are whole sentences
# units without a factor to SI that a text may name
PLAIN_UNITS = {"", "sd", "LSB", "rows", "K", "°C", "kg m²"}
LONGEST = 25  # words of a sentence
TABLES = {"form", "words"}  # of a catalogue, beside the entries of codes


def fields(text: str) -> Iterator[tuple[str, str]]:
    """Name and format of each value in a text."""
    for _, name, spec, _ in string.Formatter().parse(text):
        if name is not None:
            yield name, spec or ""


def error_entries(lang: str) -> dict[str, Mapping[str, Any]]:
    """Entries of all errors by their code; each stands in the file of its family."""
    entries = {}
    for path in sorted((ROOT / "messages" / "errors").glob(f"*.{lang}.toml")):
        family = path.name.partition(".")[0]
        of_family = {code: entry for code, entry in catalogue(f"errors/{family}.{lang}").items() if code not in TABLES}
        assert [code for code in of_family if code.partition(".")[0] != family] == []
        assert [*of_family] == sorted(of_family), f"sort the codes of {path.name}"
        entries |= of_family
    return entries


def entries(lang: str) -> dict[str, Mapping[str, Any]]:
    return {code: entry for code, entry in catalogue(lang).items() if code not in TABLES} | error_entries(lang)


def texts(lang: str) -> Iterator[tuple[str, str, str]]:
    for code, entry in entries(lang).items():
        yield from ((code, part, text) for part, text in entry.items() if part in {"title"} | SENTENCES)


@pytest.mark.parametrize("lang", LANGUAGES)
def test_each_code_has_an_entry_and_each_entry_a_code(lang: str):
    assert set(catalogue(lang)) - TABLES == {code.value for code in Code}
    for code in Code:
        entry = catalogue(lang)[code.value]
        assert set(entry) <= {*PARTS, "severity"}
        assert entry["title"], code
        assert entry["text"], code


def test_each_code_is_used_and_each_used_code_is_one():
    used = set(re.findall(r"\bCode\.([A-Z]\w+)", "".join(path.read_text() for path in ROOT.rglob("*.py"))))
    assert used == set(Code.__members__)


@pytest.mark.parametrize("lang", LANGUAGES)
def test_each_error_has_an_entry_and_each_entry_an_error(lang: str):
    known = error_entries(lang)
    assert {site.code for site in error_sites()} == set(known)
    for code, entry in known.items():
        assert {"what"} <= set(entry) <= {"what", "why", "fix"}, code


def test_errors_give_the_values_that_their_words_hold():
    known = error_entries("en")
    for site in error_sites():
        shown, needed = (
            values_in("".join(change(text) for text in known[site.code].values()))
            for change in (without_brackets, lambda text: re.sub(r"\[\[.*?\]\]", "", text))
        )
        assert site.values <= shown, f"{site.place}: {site.code} has no place for {site.values - shown}"
        assert site.more or needed <= site.values, f"{site.place}: {site.code} needs {needed - site.values}"


def values_in(text: str) -> set[str]:
    names = {name for name, _ in fields(text)}
    return names - {"span"} | ({"begin", "end"} if "span" in names else set())


def without_brackets(text: str) -> str:
    return re.sub(r"\[\[|\]\]", "", text)


def test_each_language_has_the_same_phrases_with_the_same_values():
    (own, chinese) = (catalogue(f"phrases.{lang}") for lang in LANGUAGES)
    assert {group: [*each] for group, each in own.items()} == {group: [*each] for group, each in chinese.items()}
    for group, phrases in own.items():
        for key, text in phrases.items():
            assert values_in(chinese[group][key]) == values_in(text), f"{group}.{key}"


def test_each_phrase_is_used_and_each_used_phrase_is_one():
    known = {f"{group}.{key}" for group, each in catalogue("phrases.en").items() for key in each}
    source = "".join(path.read_text() for path in ROOT.rglob("*.py"))
    used = re.findall(r"""phrase\(\s*f?"([^"]+)"(?: if [^,()]+ else "([^"]+)")?""", source)
    names = {name for pair in used for name in pair if name}
    whole = {name for name in names if "{" not in name}
    begun = [name.partition("{")[0] for name in names - whole]
    assert whole <= known
    assert all(any(name.startswith(start) for name in known) for start in begun)
    assert {name for name in known - whole if not name.startswith(tuple(begun))} == set()


def test_the_delay_and_the_lever_arm_of_a_run_are_in_words():
    assert phrase("run.delay", delay_s=-0.069, sd_s=0.004) == "the fixes are 0.069 ± 0.004 s early"
    assert phrase("run.delay", delay_s=0.069, sd_s=0.004) == "the fixes are 0.069 ± 0.004 s late"
    assert phrase("run.on_time", sd_s=0.05) == "the fixes are on time to ± 0.050 s"
    arm = phrase("run.lever", arm=("1.00 ± 0.10 m", "not told"))
    assert arm == "lever arm forward, right, down 1.00 ± 0.10 m, not told"


def test_each_language_has_the_same_forms():
    assert len({frozenset(catalogue(lang)["form"]) for lang in LANGUAGES}) == 1
    assert [moment(1.0, 2.0, lang) for lang in LANGUAGES] == ["t = 1.0 to 2.0 s", "t = 1.0 至 2.0 s"]
    assert moment(1.0, 1.0, "zh") == "t = 1.0 s"
    assert [str(Message("", "a.", "b.", joint=form("joint", lang))) for lang in LANGUAGES] == ["a. b.", "a.b."]


@pytest.mark.parametrize(
    ("wanted", "lang"), [("", "en"), ("en", "en"), ("zh", "zh"), ("zh_CN.UTF-8", "zh"), ("xx", "en"), ("ZH", "zh")]
)
def test_the_language_is_that_of_the_environment_or_english(monkeypatch: pytest.MonkeyPatch, wanted: str, lang: str):
    monkeypatch.setenv("INSNAV_LANG", wanted)
    assert language() == lang


@pytest.mark.parametrize("lang", LANGUAGES)
def test_formats_are_known(lang: str):
    for code, part, text in texts(lang):
        for name, spec in fields(without_brackets(text)):
            verb, _, rest = spec.partition(" ")
            unit = rest.partition(" ")[2] if verb == "abs" else "" if verb in VERBS else rest
            place = f"{code}: {part}: {{{name}:{spec}}}"
            assert verb in VERBS or re.fullmatch(r"(\+?,?(\.\d)?[a-z%]?)?", verb), place
            assert unit in UNITS or unit in PLAIN_UNITS, place
            if verb in ("count", "plural", "sign"):
                assert rest.count("|") == 1, place


@pytest.mark.parametrize("lang", LANGUAGES)
def test_languages_show_the_same_values(lang: str):
    english = entries("en")
    for code, entry in entries(lang).items():
        shown, known = ({name for text in each.values() for name, _ in fields(text)} for each in (entry, english[code]))
        assert shown == known if code in error_entries(lang) else shown <= known, code


def test_sentences_are_short():
    long = []
    for code, part, text in texts("en"):
        plain = re.sub(r"\{[^}]*\}", "1", text.replace("[[", "").replace("]]", ""))
        long += [
            f"{code}: {part}: {len(each.split())} words"
            for each in re.split(r"(?<=[.:?])\s", plain)
            if len(each.split()) > LONGEST
        ]
    assert not long, "\n".join(long)


def test_texts_are_sentences():
    for code, part, text in texts("en"):
        if part in SENTENCES and code != Code.STORED_TEXT and not text.endswith((":lines}", ":reason}", ":fix}")):
            # a command that is to be copied ends a text without a full stop
            assert text.removesuffix("]]")[-1] in ".?!" or re.search(r": [^.]+$", text), f"{code}: {part}"
            assert text[0].isupper() or text[0] in "{['-" or text.startswith("insnav "), f"{code}: {part}"


@pytest.mark.parametrize("lang", LANGUAGES)
def test_axes_to_give_follow_their_option(lang: str):
    advice = [text for _, part, text in texts(lang) if part == "advice" and "{axes}" in text]
    assert len(advice) >= 6
    assert all("--imu-axes {axes}" in re.sub(r"\[\[|\]\]", "", text) for text in advice), advice
    for code in (Code.MOUNTING_ASSUMED, Code.MOUNTING_DOUBTED):
        assert "--imu-axes" in catalogue(lang)[code]["advice"]


@pytest.mark.parametrize("lang", LANGUAGES)
def test_another_point_of_the_reference_follows_its_option(lang: str):
    assert "--ref-lever-arm={x_m" in " ".join(catalogue(lang)[Code.REF_POINT].values())


@pytest.mark.parametrize("lang", LANGUAGES)
def test_a_wrong_option_names_the_command_that_shows_the_options(lang: str):
    assert error_entries(lang)["cli.usage"]["fix"].endswith("{command} --help")


def test_what_is_printed_in_python_names_keywords_not_options():
    drive = insnav.load(SAMPLE / "imu.csv.gz", gps=SAMPLE / "gps.csv", imu="automotive", ref=SAMPLE / "ref.csv")
    assert "imu automotive" in repr(drive)
    assert "--" not in repr(drive)
    found = drive.navigate(smooth=False, output_interval=1.0)
    advice = Finding.of(Code.RUN_LEVER_ZERO)
    assert "--lever-arm" in sentence(advice)
    summary = replace(found, findings=(advice,)).summary()
    assert "lever_arm" in summary
    assert not re.search(r"--[a-z]", summary)


def test_a_finding_in_words():
    finding = Finding.of(Code.GATE_POSITION, 12.0, nis=31.5, limit_nis=16.3)
    assert finding.timed
    assert finding.value == 31.5
    assert finding.limit == 16.3
    assert hash(finding) == hash(Finding.of(Code.GATE_POSITION, 12.0, nis=31.5, limit_nis=16.3))
    assert finding.later(3.0).begin == 15.0
    assert Finding.of(Code.GATE_POSITION) == Finding.of(Code.GATE_POSITION, math.nan)
    message = render(finding)
    assert message.title
    assert message.text in sentence(finding)


def test_texts_hold_values_as_they_are_asked_to(monkeypatch: pytest.MonkeyPatch):
    entry = {
        "title": "Delay",
        "text": "{count:count fix is|fixes are} {delay_s:abs .3f s} {delay_s:sign late|early}"
        "[[ ± {sd_s:.3f s}]] from {span}.",
        "done": "{gyro_rad_s:.2g deg/s} {lever_m:.1f m} {axis:word}",
    }
    code, words = next(iter(Code)), {"x": "ex"}
    written = {lang: catalogue(lang)["form"] for lang in LANGUAGES}
    monkeypatch.setattr(
        "insnav.messages.catalogue", lambda lang: {code.value: entry, "words": words, "form": written[lang]}
    )
    values = {"count": 1, "delay_s": -0.05, "gyro_rad_s": math.radians(2.0), "lever_m": (0.1, -0.04, 2.0), "axis": "x"}
    message = render(Finding.of(code, 5.0, 7.0, **values))
    assert message.text == "1 fix is 0.050 s early from t = 5.0 to 7.0 s."
    assert message.done == "2 deg/s 0.1, 0.0, 2.0 m ex"
    message = render(Finding.of(code, 5.0, 7.0, **{**values, "sd_s": 0.01}), at=lambda begin, end: f"{begin}/{end}")
    assert "early ± 0.010 s from 5.0/7.0." in message.text
    message = render(Finding.of(code, 5.0, 7.0, **values), "zh")
    assert message.text.endswith("from t = 5.0 至 7.0 s.")
    assert message.done == "2 deg/s 0.1、0.0、2.0 m ex"
    assert str(message) == message.text + message.done  # such sentences stand side by side


def test_each_of_several_words_is_translated():
    finding = Finding.of(Code.BENCH_FEW, subject="gyro x, accel y (a.csv)", count=3, limit_count=6, what="poses")
    assert "x 轴陀螺、y 轴加速度计 (a.csv)" in render(finding, "zh").text
    assert "gyro x, accel y (a.csv)" in render(finding, "en").text
    assert "x 轴陀螺、other" in render(Finding.of(Code.CHECK_COARSE, sensors=("gyro x", "other")), "zh").text


def test_severities_rise():
    assert Severity.NOTE < Severity.ASSUMPTION < Severity.WARNING < Severity.UNUSABLE


# Decisions are made by codes and numbers. Inside the package nothing reads what a finding says.
TEXT_METHODS = {"startswith", "endswith", "removeprefix", "removesuffix", "partition", "split", "replace", "find"}
TEXT_FUNCTIONS = {"search", "match", "fullmatch", "findall", "sub", "finditer"}
RENDERED = {"sentence", "render", "render_error", "translated", "phrase"}


def decisions(tree: ast.AST) -> Iterator[int]:
    """Lines on which a text that was rendered from a finding is taken apart or compared."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    for scope in functions or [tree]:  # names of one function are no names of another
        names = {
            target.id
            for node in ast.walk(scope)
            for target, value in bindings(node)
            if isinstance(target, ast.Name) and is_rendered(value, set())
        }
        for node in ast.walk(scope):
            if isinstance(node, ast.Compare):
                if any(is_rendered(each, names) for each in (node.left, *node.comparators)):
                    yield node.lineno
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                if node.func.attr in TEXT_METHODS and is_rendered(node.func.value, names):
                    yield node.lineno
                if node.func.attr in TEXT_FUNCTIONS and any(is_rendered(each, names) for each in node.args):
                    yield node.lineno


def bindings(node: ast.AST) -> Iterator[tuple[ast.expr, ast.expr]]:
    """Names that get a value or one of several values, and these."""
    if isinstance(node, ast.Assign):
        yield from ((target, node.value) for target in node.targets)
    elif isinstance(node, ast.AnnAssign) and node.value is not None:
        yield node.target, node.value
    elif isinstance(node, ast.For | ast.comprehension):
        yield node.target, node.iter


def is_rendered(node: ast.AST, names: set[str]) -> bool:
    """Whether an expression is the text of a finding, or a part of it."""
    if isinstance(node, ast.Name):
        return node.id in names
    if isinstance(node, ast.Attribute):
        return node.attr in PARTS[1:] and is_rendered(node.value, names)
    if isinstance(node, ast.Call):
        if getattr(node.func, "id", getattr(node.func, "attr", "")) in RENDERED:
            return True
        if getattr(node.func, "id", "") == "map":
            return getattr(node.args[0], "id", "") in RENDERED
        return getattr(node.func, "id", "") == "str" and any(is_rendered(each, names) for each in node.args)
    if isinstance(node, ast.GeneratorExp | ast.ListComp):
        return is_rendered(node.elt, names)
    return False


def test_no_decision_depends_on_the_text_of_a_finding():
    found = [
        f"{path.relative_to(ROOT)}:{line}"
        for path in sorted(ROOT.rglob("*.py"))
        if path.parent.name != "messages"
        for line in decisions(ast.parse(path.read_text()))
    ]
    assert not found, found


def test_such_a_decision_would_be_noticed():
    for line in (
        "if sentence(x).startswith('gyro'): pass",
        "text = sentence(x)\nif 'gyro' in text: pass",
        "re.search('gyro', render(x).text)",
        "if 'gyro' in messages.translated(x): pass",
        "message = render(x)\nmessage.done.removeprefix('y')",
        "for text in map(sentence, x):\n    if text.startswith('gyro'): pass",
        "[text for text in (sentence(x) for x in y) if 'gyro' in text]",
        "text: str = sentence(x)\nif text == 'gyro': pass",
    ):
        assert list(decisions(ast.parse(line))), line
