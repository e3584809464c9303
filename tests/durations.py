"""Tiers of tests by their durations, which ``durations.json`` holds.

- ``fast``: up to a second, for every edit (``-m fast``);
- ``push``: up to five seconds, and tests that nobody has measured; a plain ``pytest`` runs ``fast`` and ``push``;
- ``nightly``: all others; ``-m ""`` runs every test.

``python -m pytest -m "" -n 2 --dist loadfile --record-durations`` measures them again, where the recorded drives are.
It measures processor time, which does not depend on what else a machine does. The set-up of a fixture that tests share
counts in equal parts for each of them, not for the test that happens to come first.
"""

from __future__ import annotations

import json
import os
from collections import defaultdict
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import Any

import pytest

TIERS = {"fast": 1.0, "push": 5.0, "nightly": float("inf")}  # the longest test [s]
FILE = Path(__file__).with_suffix(".json")

Durations = dict[str, dict[str, float]]
"""Seconds of each test by its name, by file."""


def read_durations() -> Durations:
    durations: Durations = json.loads(FILE.read_text(encoding="utf-8"))
    return durations


def tier(seconds: float) -> str:
    return next(name for name, longest in TIERS.items() if seconds <= longest)


def tier_of(nodeid: str, durations: Durations) -> str:
    """Choose the tier of a test; an entry without parameters is of them all."""
    file, _, name = nodeid.partition("::")
    of_file = durations.get(file, {})
    return tier(of_file.get(name, of_file.get(name.partition("[")[0], TIERS["push"])))


def summarize(seconds: Mapping[str, float]) -> Durations:
    """Give one entry, the longest, to the parameters of a test that are of one tier."""
    functions: dict[str, dict[str, dict[str, float]]] = defaultdict(lambda: defaultdict(dict))
    for nodeid in sorted(seconds):
        file, _, name = nodeid.partition("::")
        functions[file][name.partition("[")[0]][name] = round(seconds[nodeid], 2)
    found: Durations = {}
    for file, of_file in functions.items():
        found[file] = {}
        for function, parameters in of_file.items():
            alike = len({*map(tier, parameters.values())}) == 1
            found[file] |= {function: max(parameters.values())} if alike else parameters
    return found


def apportion(
    seconds: Mapping[str, float], set_up: Mapping[tuple[str, str], float], fixtures: Mapping[str, list[str]]
) -> dict[str, float]:
    """Add to each test an equal part of the fixtures that it shares.

    Parameters
    ----------
    seconds : mapping
        Duration of each test without them [s].
    set_up : mapping
        Duration of each fixture [s], by where it is defined and its name.
    fixtures : mapping
        Names of the fixtures of each test.
    """
    whole = dict(seconds)
    for (place, name), duration in set_up.items():
        users = [test for test in seconds if test.startswith(place) and name in fixtures[test]]
        whole |= {test: whole[test] + duration / len(users) for test in users}
    return whole


class Recorder:
    """Plugin that measures the tests of a run that pass, and writes their durations into a file at its end."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.begin = 0.0
        self.new: list[tuple[str, str, float]] = []  # fixtures that the test at hand set up
        self.seconds: dict[str, float] = {}
        self.set_up: dict[tuple[str, str], float] = defaultdict(float)
        self.fixtures: dict[str, list[str]] = {}
        self.passed: set[str] = set()

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_setup(self) -> None:
        self.begin, self.new = _processor_time(), []

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[Any]) -> Generator[None, Any, Any]:
        begin = _processor_time()
        try:
            return (yield)
        finally:
            if fixturedef.scope != "function":
                self.new.append((fixturedef.baseid, fixturedef.argname, _processor_time() - begin))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_teardown(self, item: pytest.Item) -> Generator[None, None, None]:
        yield
        measured = {
            "all": _processor_time() - self.begin,
            "new": self.new,
            "fixtures": getattr(item, "fixturenames", []),
        }
        item.user_properties.append(
            ("measured", measured)
        )  # with the report, from the worker to the process that writes

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call" and report.passed:
            self.passed.add(report.nodeid)
        if report.when == "teardown" and report.nodeid in self.passed:
            measured = dict(report.user_properties)["measured"]
            self.fixtures[report.nodeid] = measured["fixtures"]
            self.seconds[report.nodeid] = measured["all"] - sum(duration for _, _, duration in measured["new"])
            for place, name, duration in measured["new"]:
                self.set_up[place, name] += duration

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if not hasattr(session.config, "workerinput"):
            durations = summarize(apportion(self.seconds, self.set_up, self.fixtures))
            self.file.write_text(json.dumps(durations, indent=0, ensure_ascii=False) + "\n", encoding="utf-8")


def _processor_time() -> float:
    """Time of this process and of those that it started and that have ended [s]."""
    return sum(os.times()[:4])
