"""Each test belongs to a tier, and the durations that say so are of tests that there are."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.durations import TIERS, apportion, read_durations, summarize, tier_of

ROOT = Path(__file__).parents[1]


def test_durations_are_of_tests_that_there_are():
    gone = []
    for file, tests in read_durations().items():
        text = (ROOT / file).read_text(encoding="utf-8") if (ROOT / file).exists() else ""
        there = {*re.findall(r"^(?:async )?def (test_\w+)\(", text, re.MULTILINE)}
        gone += [f"{file}::{test}" for test in tests if test.partition("[")[0] not in there]
    assert not gone, "take these out of tests/durations.json"


def test_a_test_belongs_to_one_tier(request: pytest.FixtureRequest):
    durations = {"a.py": {"test_quick": 1.0, "test_some[x]": 4.0, "test_some[y[0]]": 6.0}}
    tests = ("test_quick", "test_quick[new]", "test_some[x]", "test_some[y[0]]", "test_some[new]", "test_new")
    tiers = [tier_of(f"a.py::{test}", durations) for test in tests]
    assert tiers == ["fast", "fast", "push", "nightly", "push", "push"]
    assert [mark.name for mark in request.node.iter_markers() if mark.name in TIERS] == [
        tier_of(request.node.nodeid, read_durations())
    ]


def test_parameters_of_one_tier_have_one_entry():
    seconds = {"b.py::test_b": 0.014, "a.py::test_a[1]": 0.5, "a.py::test_a[2]": 0.71, "b.py::test_c[1]": 0.5}
    seconds["b.py::test_c[2]"] = 7.0
    assert summarize(seconds) == {
        "a.py": {"test_a": 0.71},
        "b.py": {"test_b": 0.01, "test_c[1]": 0.5, "test_c[2]": 7.0},
    }


def test_tests_share_the_duration_of_a_fixture():
    fixtures = {"a/x.py::test_a": ["drive"], "a/x.py::test_b": ["drive", "tmp"], "b/x.py::test_c": ["drive"]}
    shared = apportion(dict.fromkeys(fixtures, 0.25), {("a", "drive"): 3.0}, fixtures)
    assert shared == {"a/x.py::test_a": 1.75, "a/x.py::test_b": 1.75, "b/x.py::test_c": 0.25}


CONFTEST = """
from pathlib import Path
from tests.durations import Recorder

def pytest_configure(config):
    config.pluginmanager.register(Recorder(Path(__file__).with_name("measured.json")))
"""
TESTS = """
import time
import pytest

def work(seconds):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass

@pytest.fixture(scope="module")
def drive():
    work(0.2)

def test_first(drive):
    work(0.1)

def test_second(drive):
    pass

def test_that_skips(drive):
    pytest.skip()
"""


def test_a_run_is_measured_also_in_workers(tmp_path: Path):
    (tmp_path / "conftest.py").write_text(CONFTEST)
    (tmp_path / "test_some.py").write_text(TESTS)
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-n", "1", "--rootdir", ".", "."]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, check=True)
    measured = json.loads((tmp_path / "measured.json").read_text())
    assert measured == {
        "test_some.py": {"test_first": pytest.approx(0.2, abs=0.05), "test_second": pytest.approx(0.1, abs=0.05)}
    }
