"""Runs are compared over the epochs they share, and the better one looks better."""

from __future__ import annotations

import json
import os
import re
from dataclasses import replace

import numpy as np
import pytest

from insnav.earth import lla_offset
from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.messages import sentence, speaking, translated
from insnav.output.solution_tables import write_run_table
from insnav.plain_text import Name
from insnav.report.comparison.page import comparison_panels
from insnav.report.html import page_html
from insnav.report.terminal import brief_text, page_text
from insnav.session.comparison import compare


def folder(tmp_path, name, solution, file_format="csv"):
    path = tmp_path / name
    path.mkdir()
    write_run_table(path, solution, file_format)
    return path


def test_each_run_gets_its_own_errors(driven, tmp_path):
    _, _, true = driven
    off = replace(true, lla=lla_offset(true.lla, np.array([3.0, 4.0, 0.0])))
    compared = compare(folder(tmp_path, "good", true), folder(tmp_path, "off", off, "parquet"), ref=true)
    rows = compared.found.rows()
    assert [row["run"] for row in rows] == ["good", "off"]
    assert rows[0]["accuracy"]["horizontal_m"]["rms"] < 1e-4
    assert rows[1]["accuracy"]["horizontal_m"]["rms"] == pytest.approx(5.0, abs=1e-4)
    lines = compared.summary().splitlines()
    head, good, bad = (next(line for line in lines if line.startswith(f"  {name} ")) for name in ("run", "good", "off"))
    assert "2D [m]" in head
    assert "5.00" in bad
    assert "5.00" not in good


@pytest.mark.skipif("INSNAV_REVERSED" in os.environ, reason="names would be reversed, too")
def test_no_language_translates_the_names_of_runs(driven, tmp_path):
    _, _, true = driven
    far = replace(true, lla=lla_offset(true.lla, np.array([300.0, 400.0, 0.0])))
    page = compare(folder(tmp_path, "demo", true), folder(tmp_path, "day", far), ref=true).page()
    with speaking("zh"):
        html = page_html(page, {})
        texts = page_text(page), brief_text(page, None), re.sub("<script.*?</script>", "", html, flags=re.DOTALL)
        assert [translated(name) for name in ("demo", "day")] == ["示例", "一昼夜"]
        assert translated(Name("demo")) == "demo"
        finding = Finding.of(Code.RUN_OVERCONFIDENT, subject="day", share=0.2)
        with speaking("zh", page.names):
            assert sentence(finding).startswith("day的位置")
        assert sentence(finding).startswith("日的位置")
    for text in texts:
        assert {"demo", "day"} <= set(re.findall("[a-z]+", text))
        assert "最小" in text
        assert not re.search("示例|一昼夜", text)
    words = json.loads(re.search('id="words"[^>]*>(.*?)</script>', html, re.DOTALL)[1])
    assert "error" in words
    assert not {"demo", "day"} & set(words)


def test_only_shared_epochs_are_counted(driven, tmp_path):
    _, _, true = driven
    half = len(true.time) // 2
    wrong = lla_offset(true.lla, np.column_stack((0.01 * true.time, 0.0 * true.time, 0.0 * true.time)))
    whole = replace(true, lla=wrong)
    part = replace(true, time=true.time[:half], lla=wrong[:half], v_n=true.v_n[:half], rph=true.rph[:half])
    rows = compare(folder(tmp_path, "whole", whole), folder(tmp_path, "part", part), ref=true).found.rows()
    assert rows[0]["accuracy"] == rows[1]["accuracy"]
    assert rows[0]["accuracy"]["n"] == half


def test_runs_of_different_recordings_cannot_be_compared(driven, tmp_path):
    _, _, true = driven
    first, second = slice(0, 500), slice(600, 1200)
    paths = [
        folder(
            tmp_path,
            name,
            replace(true, time=true.time[s], lla=true.lla[s], v_n=true.v_n[s], rph=true.rph[s]),
        )
        for name, s in (("a", first), ("b", second))
    ]
    with pytest.raises(InputError, match=r"compare.no_common_time"):
        compare(*paths, ref=true)


def test_every_solution_has_its_own_line_on_a_map_and_no_run_squeezes_the_distribution(driven, tmp_path):
    _, _, true = driven
    off = {name: lla_offset(true.lla, np.array([size, 0.0, 0.0])) for name, size in (("good", 0.5), ("bad", 5000.0))}
    folders = [folder(tmp_path, name, replace(true, lla=lla)) for name, lla in off.items()]
    track, _, shares = comparison_panels(compare(*folders, ref=true).found)
    for line, size in zip(track.behind, (0.5, 5000.0), strict=True):
        assert np.median(line.y - track.north) == pytest.approx(size, rel=1e-3)
    assert [shade.name for shade in track.shades] == ["error of good [m]", "error of bad [m]"]
    assert shares.log == "x"
    good = shares.curves[0].x
    assert good.min() > 0.0
    assert np.log(good.max() / good.min()) < np.log(10.0)


def test_what_the_reference_does_not_know_has_no_column(driven, tmp_path):
    _, _, true = driven
    unknown = np.full_like(true.v_n, np.nan)
    found = compare(folder(tmp_path, "run", true), ref=replace(true, v_n=unknown, rph=unknown))
    head = next(line for line in found.summary().splitlines() if line.startswith("  run "))
    assert "head" not in head
    assert "v [m/s]" not in head
    assert "N [m]" in head


def test_a_folder_without_a_solution_is_named(driven, tmp_path):
    with pytest.raises(InputError, match=r"output.no_table"):
        compare(tmp_path, ref=driven[2])
