"""The stage of the work is named with its fraction, and the remaining time that is promised is what it turns out."""

from __future__ import annotations

import io
import math
import re
import sys
import time
from collections.abc import Callable
from types import ModuleType, SimpleNamespace

import pytest

import insnav
from insnav import progress
from insnav.cli import console
from insnav.library import sample_drive
from insnav.messages import phrase
from tests.reversed_messages import as_shown

Clock = Callable[[float], None]


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """A clock that is set to a time [s]."""
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return lambda seconds: now.__setitem__(0, seconds)


def left_of(line: str) -> float | None:
    """Remaining time that a line promises [s]."""
    found = re.search(rf"{as_shown(', about ')}(\d+) s{as_shown(' to come')}", line)
    return None if found is None else float(found[1])


def so_far(name: str, time_s: float, count: str = "", share: float = math.nan) -> str:
    """Line of a stage without a remaining time."""
    return phrase("terminal.so_far", stage=name + count, share=share, time_s=time_s, left_s=math.nan)


def test_a_stage_says_its_fraction_and_count_only_where_they_are_known(clock: Clock):
    stage = progress.Stages(print, ())
    assert stage.line() == so_far("computing", 0.0)  # before the first announcement
    stage("reading")
    clock(27.0)
    assert stage.line() == so_far("reading", 27.0)  # what is not known is no time to come
    stage("navigating", 0.25, 300)
    assert stage.line() == so_far("navigating", 27.0, " 75/300", 0.25)
    stage("writing")
    assert stage.line() == so_far("writing", 27.0)


@pytest.mark.parametrize(("quick", "slow"), [(10.0, 10.0), (10.0, 50.0), (50.0, 10.0)])
def test_the_remaining_time_is_honest_if_the_work_becomes_slower_or_quicker(clock: Clock, quick: float, slow: float):
    """A stage of two halves; where the second has taken as long as the first, the promise is what is really left."""
    stage = progress.Stages(print, ())
    stage("reading")
    clock(100.0)
    whole = quick + slow
    for step in range(101):
        share = step / 100.0
        since = 2.0 * quick * share if share < 0.5 else quick + 2.0 * slow * (share - 0.5)
        clock(100.0 + since)
        stage("navigating", share)
        if step > 1 and (since < quick or quick <= since - quick < whole - quick - 1.0):
            truth = whole - since if since > quick else quick - since + quick
            assert left_of(stage.line()) == pytest.approx(truth, abs=0.5 + 0.03 * truth)
    assert left_of(stage.line()) is None  # all is done


def test_nothing_is_promised_without_two_reports_or_when_the_work_begins_again(clock: Clock):
    stage = progress.Stages(print, ())
    stage("navigating", 0.5)
    clock(1.0)
    assert left_of(stage.line()) is None
    stage.advance(0.6)
    assert left_of(stage.line()) == 4.0
    clock(3.0)
    assert left_of(stage.line()) is None  # half of the time without a report
    stage.advance(0.1)
    assert left_of(stage.line()) is None


def test_a_terminal_shows_one_line_and_clears_it(monkeypatch: pytest.MonkeyPatch):
    terminal = io.StringIO()
    terminal.isatty = lambda: True  # type: ignore[method-assign]
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setattr(progress, "DELAY", 0.01)
    monkeypatch.setattr(progress, "REDRAWN", 0.02)
    monkeypatch.setenv("COLUMNS", "30")
    with console.Stages():
        progress.announce("compiling kernels (once)")
        time.sleep(0.2)
        console.note("a remark")
    states = terminal.getvalue().split(console.CLEARED)
    assert f"compiling kernels (once){as_shown(': ')}0 s" in states  # cut at the width: the line is not left twice
    assert "insnav: a remark\n" in "".join(states)
    assert states[-1] == ""


@pytest.fixture
def cell(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the cell of a notebook shows, one state after the other."""
    shown: list[str] = []
    handle = SimpleNamespace(update=lambda data, raw: shown.append(data["text/plain"]))
    for name, content in (
        ("IPython", {"get_ipython": lambda: SimpleNamespace(kernel=object())}),
        ("IPython.display", {"display": lambda data, raw, display_id: handle}),
    ):
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(progress, "DELAY", 0.01)
    monkeypatch.setattr(progress, "REDRAWN", 0.01)
    return shown


def names_of(lines: list[str]) -> set[str]:
    """Stages that some lines show."""
    return {re.split(r" \d+ %| ?:", line)[0] for line in lines}


def test_a_notebook_shows_the_progress_of_outage_and_budget(cell: list[str]):
    imu, gps, _ = sample_drive()
    drive = insnav.load(imu, gps).beginning(150.0)
    drive.outage(lengths=10.0, spacing=20.0)
    assert {"aligning", "navigating", "simulating outages"} <= names_of(cell)
    assert any(" %" in line for line in cell)
    assert cell[-1] == ""
    cell.clear()
    drive.budget(times=(10.0,))
    assert {"simulating outages", "simulating replicas"} <= names_of(cell)
    cell.clear()
    drive.navigate(progress=lambda fraction: None)  # who asks for it shows it himself
    assert cell == []


def test_the_stages_are_in_the_language_of_the_messages(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("INSNAV_LANG", "zh")
    stage = progress.Stages(print, ())
    stage("finding the noise")
    assert stage.line() == phrase("terminal.so_far", stage=as_shown("估计噪声"), time_s=0.0)
