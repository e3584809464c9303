"""Errors are data: a code, a place and values, which the catalogue of errors puts into words."""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
from collections.abc import Mapping
from typing import Any

import pytest

from insnav import messages
from insnav.exceptions import ConfigError, InputError, InsnavError, OutputError, writing
from insnav.findings import Code, Finding
from insnav.messages import render
from tests.refusals import refused

SLOW = {
    "what": "The samples of {axis:word} are {interval_s:.2g s} apart.",
    "why": "{count:count gap|gaps}[[ of {gap_s:.1f s}]]: {names}.",
    "fix": "Set --imu-rate.",
}
ENTRIES = {
    "errors/test": {
        "test.slow": SLOW,
        "test.inside": {"what": "{text} is wrong.", "fix": "Write {units}."},
        "test.several": {"what": "{count:count thing is|things are} wrong.", "why": "{problems:lines}"},
        "test.unwritable": {"what": "No file {name}.", "why": "It says: {reason}."},
        "words": {"x": "ex"},
    }
}


@pytest.fixture(autouse=True)
def entries(monkeypatch: pytest.MonkeyPatch) -> None:
    read = messages.catalogue

    def catalogue(name: str) -> Mapping[str, Any]:
        family, _, lang = name.partition(".")
        found = {code: dict(entry) for code, entry in ENTRIES.get(family, {}).items()}
        if lang == "zh":
            found.get("test.slow", {}).update(what="{axis:word} 间隔 {interval_s:.2g s}。")
        return found or read(name)

    monkeypatch.setattr("insnav.messages.catalogue", catalogue)


def slow(**more: float) -> InputError:
    values = {"axis": "x", "interval_s": 0.5, "count": 1, "names": ("a", "b")}
    return InputError("test.slow", where="imu.csv:3", gives={"imu": "x"}, **values, **more)


def test_an_error_is_put_into_words_in_the_language_of_who_reads(monkeypatch: pytest.MonkeyPatch):
    error = slow()
    assert (error.what, error.why) == ("The samples of ex are 0.5 s apart.", "1 gap: a, b.")
    assert slow(gap_s=2.0).why == "1 gap of 2.0 s: a, b."
    assert error.reason == f"{error.what} {error.why}"
    assert [text for _, text in error.details()] == ["imu.csv:3", error.why, error.fix, "test.slow"]
    assert str(error).splitlines()[0] == error.what
    assert error.fix == "Set --imu-rate."
    assert "imu_rate" in str(error)  # who calls from Python has keywords
    monkeypatch.setenv("INSNAV_LANG", "zh")
    assert error.what == "ex 间隔 0.5 s。"


def test_no_catalogue_is_read_until_somebody_reads_the_error():
    script = """
import sys
from insnav.exceptions import InputError
error = InputError("install.no_sample_drive")
assert error.code == error.args[0]
assert "insnav.messages" not in sys.modules
assert error.what
assert "insnav.messages" in sys.modules
"""
    subprocess.run([sys.executable, "-c", script], check=True, timeout=60)


def test_errors_pass_between_processes_and_through_files():
    several = ConfigError("test.several", where="a.toml", count=2, problems=(slow(), slow(gap_s=2.0)))
    for again in (
        pickle.loads(pickle.dumps(several)),
        InsnavError.from_dict(json.loads(json.dumps(several.as_dict()))),
    ):
        assert type(again) is ConfigError
        assert (again.code, again.where, again.values["count"]) == (several.code, several.where, 2)
        assert str(again) == str(several)
    assert pickle.loads(pickle.dumps(slow())).gives == {"imu": "x"}


def test_the_cause_of_an_error_is_put_into_words_with_it():
    inside = ConfigError("test.inside", where="gyro.bias", text="5 foo", units=("deg", "rad"))
    error = ConfigError("test.several", count=1, problems=(inside, "and this"))
    assert error.what == "1 thing is wrong."
    assert error.why == "gyro.bias: 5 foo is wrong. Write deg, rad.\nand this"


def test_a_finding_may_be_the_cause_of_an_error():
    found = Finding.of(Code.BATCH_NO_COLUMNS, subject="a.csv")
    error = InputError("batch.no_drives", count=3, cause=found)
    assert messages.sentence(found) in error.why
    assert InsnavError.from_dict(json.loads(json.dumps(error.as_dict()))).values["cause"] == found


def test_what_the_system_refuses_is_its_reason():
    with refused(OutputError, "test.unwritable") as caught, writing("test.unwritable", "a.csv", name="a.csv"):
        raise PermissionError(13, "Permission denied")
    assert caught.value.where == "a.csv"
    assert caught.value.values == {"reason": "Permission denied", "name": "a.csv"}


def test_a_finding_holds_an_error_as_data_in_the_language_of_who_reads(monkeypatch: pytest.MonkeyPatch):
    several = ConfigError("test.several", where="a.toml", count=1, problems=(slow(gap_s=2.0),))
    finding = Finding.of(Code.CHECK_REFUSED, cause=several.facts)
    again = Finding.from_dict(json.loads(json.dumps(finding.as_dict())))
    assert again == finding
    assert hash(again) == hash(finding)
    assert render(again).text == f"a.toml: {several.reason}"
    assert render(Finding.of(Code.CHECK_REFUSED, cause=slow().facts)).advice == "Set --imu-rate."
    assert render(again, "zh").text.endswith("ex 间隔 0.5 s。1 gap of 2.0 s: a、b.Set --imu-rate.")
