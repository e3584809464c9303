"""``run.json`` is as its schema says: a key that goes, comes or changes its type needs a new version there."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from insnav.findings import Code, Finding, Severity
from insnav.input import ReadingFacts
from insnav.report.save import SCHEMA
from tests.cli.conftest import ROOT, Cli

RULES = json.loads((ROOT / "insnav" / "report" / "run.schema.json").read_text(encoding="utf-8"))
RUNS = {
    "nothing given": ("run", "imu.csv", "--gps", "gps.csv"),
    "with a reference": ("run", "imu.csv", "--gps", "gps.csv", "--ref", "ref.csv", "--mechanization", "short"),
    "less": ("run", "imu.csv", "--gps", "gps.csv", "--imu", "automotive", "--states", "15", "--no-smooth"),
    "at one height": ("run", "imu.csv", "--gps", "gps.csv", "--fixed-height", "2"),
    "outage": ("outage", "imu.csv", "--gps", "gps.csv", "--ref", "ref.csv", "--lengths", "5", "--workers", "1"),
    "budget": ("budget", "--profile", "city", "--imu", "tactical"),
    "simulate": ("simulate", "city", "--imu", "ideal", "--rate", "20"),
}


def wrong(facts: dict[str, Any]) -> list[str]:
    return [f"{each.json_path}: {each.message}" for each in Draft202012Validator(RULES).iter_errors(facts)]


@pytest.mark.parametrize("name", RUNS)
def test_what_is_written_is_what_the_schema_says(name: str, cli: Cli, drive: Path):
    assert cli(*RUNS[name], "--out", "out").code == 0
    facts = json.loads((drive / "out" / "run.json").read_text())
    assert wrong(facts) == []
    assert facts["findings"] or name == "simulate"
    assert not {"warnings", "notes", "assumptions"} & facts.keys()
    if name == "with a reference":  # and the schema notices a key too many, one too few, and another type
        assert wrong({**facts, "accuracy_m": 1.0})
        assert wrong({key: value for key, value in facts.items() if key != "fixes"})
        assert wrong({**facts, "accuracy": facts["accuracy"] | {"epochs": "many"}})
        assert wrong(facts | {"solution": {"rows": 3}})


def test_the_schema_is_one_and_of_this_version():
    Draft202012Validator.check_schema(RULES)
    assert RULES["properties"]["schema"]["const"] == SCHEMA


def test_findings_are_as_the_schema_says():
    rules = {"$ref": "#/$defs/finding", "$defs": RULES["$defs"]}
    plain = Finding.of(Code.RUN_LEVER_ZERO).as_dict()
    values = {"lost_m": 1.0, "axes": ("x", "z"), "lever_m": (0.1, np.nan, 2.0), "count": 3, "sd_s": np.inf}
    full = Finding.of(Code.GPS_FROZEN, 3.0, 5.0, subject="gps", **values).as_dict()
    assert full["values"]["lever_m"] == [0.1, None, 2.0]
    assert not [error for each in (plain, full) for error in Draft202012Validator(rules).iter_errors(each)]
    for wrong in (
        plain | {"text": "no words"},
        plain | {"severity": "fatal"},
        full | {"from_s": None},
        full | {"values": {"size": {}}},
        {"code": "gps.frozen"},
    ):
        assert list(Draft202012Validator(rules).iter_errors(wrong)), wrong
    assert RULES["$defs"]["finding"]["properties"]["severity"]["enum"] == [each.name.lower() for each in Severity]


def test_inputs_are_as_the_schema_says_whatever_their_file_told():
    rules = {"$ref": "#/$defs/reading", "$defs": RULES["$defs"]}
    facts = ReadingFacts(
        "GPS", "rover.pos", "0" * 64, 9, 9, 0.0, 2.0, 4.0, 0, 0.0, {"time_s": "time [s]"}, height="msl", gps_week=2381,
        evidence=(Finding.of(Code.READ_HEIGHT_MSL, subject="gps"),),
    )  # fmt: skip
    assert not list(Draft202012Validator(rules).iter_errors(facts.as_dict()))
    assert list(Draft202012Validator(rules).iter_errors(facts.as_dict() | {"week": 1}))
    assert list(Draft202012Validator(rules).iter_errors(facts.as_dict() | {"evidence": ["as stated"]}))
