"""``run.json`` is as its schema says: a key that goes, comes or changes its type needs a new version there."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from insnav.input import ReadingFacts
from insnav.report.run_json import SCHEMA
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
    if name == "with a reference":  # and the schema notices a key too many, one too few, and another type
        assert wrong({**facts, "accuracy_m": 1.0})
        assert wrong({key: value for key, value in facts.items() if key != "fixes"})
        assert wrong({**facts, "accuracy": facts["accuracy"] | {"epochs": "many"}})
        assert wrong(facts | {"solution": {"rows": 3}})


def test_the_schema_is_one_and_of_this_version():
    Draft202012Validator.check_schema(RULES)
    assert RULES["properties"]["schema"]["const"] == SCHEMA


def test_inputs_are_as_the_schema_says_whatever_their_file_told():
    rules = {"$ref": "#/$defs/reading", "$defs": RULES["$defs"]}
    facts = ReadingFacts(
        "GPS", "rover.pos", "0" * 64, 9, 9, 0.0, 2.0, 4.0, 0, 0.0, {"time_s": "time [s]"}, height="msl", gps_week=2381
    )
    assert not list(Draft202012Validator(rules).iter_errors(facts.as_dict()))
    assert list(Draft202012Validator(rules).iter_errors(facts.as_dict() | {"week": 1}))
