"""Results in one file: the same comes back, and nothing but results of insnav is made of it."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from insnav.errors.budget.error_budget import budget
from insnav.errors.budget.from_windows import BudgetStudy
from insnav.errors.budget.sources import at_rest
from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.output.data_files import FILE, read_stored, store
from insnav.report.save import page_facts
from insnav.result import Result, open_result
from tests.errors.budget.imus import plain
from tests.refusals import refused


def test_a_budget_is_opened_again(tmp_path: Path):
    found = BudgetStudy(budget(plain(), at_rest(20.0), (5.0, 10.0, 20.0), runs=10))
    findings = (
        Finding.of(Code.BUDGET_ABSENT, terms=("gyro bias", "scale factor")),
        Finding.of(Code.ROWS_NAN, subject="gps", count=3, limit=math.nan),
    )
    made = Result("budget", found, findings=findings)
    again = open_result(made.save(tmp_path / "budget", figures="none"))
    assert page_facts(again.page()) == page_facts(made.page())
    assert again.findings == made.page().findings
    assert set(findings) <= set(again.findings)
    assert again.summary() == made.summary()
    for old, new in zip(made.page().panels, again.page().panels, strict=True):
        for one, other in zip(old.curves, new.curves, strict=True):
            np.testing.assert_array_equal(other.y, one.y)


def written(folder: Path, structure: object) -> Path:
    np.savez(folder / FILE, structure=np.frombuffer(json.dumps(structure).encode(), np.uint8))
    return folder


@pytest.mark.parametrize("name", ["subprocess:Popen", "insnav.result:open_result", "insnav.nowhere:Budget"])
def test_nothing_but_results_is_made(tmp_path: Path, name: str):
    with refused(InputError, "output.unreadable_result"):
        read_stored(written(tmp_path, {"class": name, "fields": {"args": "true"}}))


def test_a_damaged_file_is_refused(tmp_path: Path):
    with pytest.raises(InputError):
        read_stored(tmp_path)
    store({"a": (1.5, None, [np.arange(3.0)])}, tmp_path / FILE)
    again = read_stored(tmp_path)
    np.testing.assert_array_equal(again["a"][2][0], np.arange(3.0))
    assert again["a"][:2] == (1.5, None)
    content = (tmp_path / FILE).read_bytes()
    (tmp_path / FILE).write_bytes(content[: len(content) // 2])
    with pytest.raises(InputError):
        read_stored(tmp_path)
