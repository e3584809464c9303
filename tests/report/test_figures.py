"""Figures are drawn for whatever a run holds, show what they must, and never leave out an extreme."""

from __future__ import annotations

from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from PIL import Image

from insnav.errors.evaluated_run import EvaluatedRun
from insnav.errors.metrics import position_errors
from insnav.report.figures import (
    draw_drawings,
    drawing,
    save,
)
from insnav.report.panels import BINS, Clock, broken_at_gaps, envelope, modes, thinned
from insnav.report.run.page import run_figures
from insnav.report.run.panels import figure_drawings, run_track
from insnav.report.style import number
from insnav.types import GpsData, Smoothed
from tests.report.synthetic import drive

ALWAYS = ["track", "height", "velocity", "attitude"]
ERRORS = ["position_error", "velocity_error", "attitude_error", "error_distribution"]


def labels(axes):
    return axes.get_legend_handles_labels()[1]


def drawn(name, run, gps=None, errors=None):
    """One figure of a run."""
    title, note, drawings, columns = figure_drawings(name, EvaluatedRun(run, gps, errors))
    return draw_drawings(drawings, title, note, columns=columns)


def draw_all(run, gps, errors, folder, file_format="png"):
    with drawing():
        return [
            save(each.draw(), folder / each.name, file_format) for each in run_figures(EvaluatedRun(run, gps, errors))
        ]


def test_a_full_run_has_every_figure_with_ink_in_it(driven, tmp_path):
    run, gps, true = driven
    before = dict(mpl.rcParams)
    files = draw_all(run, gps, position_errors(run.solution, true), tmp_path)
    assert sorted(f.stem for f in files) == sorted([*ALWAYS, *ERRORS, "innovations", "biases"])
    for file in files:
        image = np.asarray(Image.open(file).convert("L"))
        assert image.shape[1] > 1000
        assert 0.01 < np.mean(image < 250) < 0.6
    assert dict(mpl.rcParams) == before


@pytest.mark.parametrize("file_format", ["png", "svg"])
def test_the_same_run_gives_the_same_bytes(bare, tmp_path, file_format):
    first = [f.read_bytes() for f in draw_all(bare, None, None, tmp_path, file_format)]
    assert [f.read_bytes() for f in draw_all(bare, None, None, tmp_path, file_format)] == first


def test_the_shortest_run_is_drawn_without_a_warning(bare, tmp_path):
    assert [f.stem for f in draw_all(bare, None, None, tmp_path)] == ALWAYS
    errors = position_errors(bare.solution, bare.solution)
    assert [f.stem for f in draw_all(bare, None, errors, tmp_path, "svg")][1:5] == ERRORS


def test_a_reference_of_positions_only_gives_only_position_errors(driven, tmp_path):
    run, gps, true = driven
    unknown = np.full_like(true.v_n, np.nan)
    errors = position_errors(run.solution, replace(true, v_n=unknown, rph=unknown))
    stems = [f.stem for f in draw_all(run, gps, errors, tmp_path)]
    assert stems[1:3] == ["position_error", "error_distribution"]
    assert "velocity_error" not in stems


def test_a_run_without_velocity_fixes_or_with_every_fix_refused_is_drawn(tmp_path):
    run, gps, _ = drive(60.0, rate=5.0, outage=(40.0, 45.0), velocity=False)
    assert len(drawn("innovations", run).axes) == 4
    refused = replace(run.innovations, used_position=np.zeros_like(run.innovations.used_position))
    draw_all(replace(run, innovations=refused), gps, None, tmp_path)


def test_the_track_has_equal_axes_and_shows_outage_and_rejections(driven):
    run, gps, _ = driven
    axes = drawn("track", run, gps).axes[0]
    assert axes.get_aspect() == 1.0
    assert "no fix used" in labels(axes)
    assert "position rejected (3, 1 beyond the edge)" in labels(axes)
    rejected = next(line for line in axes.lines if str(line.get_label()).startswith("position rejected"))
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    x, y = rejected.get_data()
    assert ((x >= left) & (x <= right) & (y >= low) & (y <= high)).all()


def test_a_vehicle_that_never_moved_has_a_track(driven):
    run, _, _ = driven
    still = replace(run.solution, lla=np.tile(run.solution.lla[0], (len(run.solution.time), 1)))
    axes = drawn("track", replace(run, solution=still)).axes[0]
    assert np.ptp(axes.get_xlim()) > 3.0


def test_heading_is_drawn_without_jumps(driven):
    run, _, _ = driven
    turns = (run.solution.time / 60.0 * 2.0 * np.pi) % (2.0 * np.pi)  # ten turns
    rph = np.column_stack((run.solution.rph[:, :2], turns))
    turning = drawn("attitude", replace(run, solution=replace(run.solution, rph=rph))).axes[2].lines[0].get_ydata()
    assert np.nanmax(np.abs(np.diff(turning))) < 10.0
    assert np.nanmax(turning) <= 360.0
    about_north = np.where(np.arange(len(run.solution.time)) % 2, 0.02, 2.0 * np.pi - 0.02)
    rph = np.column_stack((run.solution.rph[:, :2], about_north))
    axes = drawn("attitude", replace(run, solution=replace(run.solution, rph=rph))).axes[2]
    assert np.nanmax(np.abs(np.diff(axes.lines[0].get_ydata()))) < 3.0


def test_innovations_beyond_the_scale_are_marked_at_its_edge(driven):
    run, _, _ = driven
    east = drawn("innovations", run).axes[2]
    marked = [line for line in east.lines if line.get_marker() in "^v" and len(line.get_ydata())]
    assert sum(len(line.get_ydata()) for line in marked) == 3
    assert max(abs(limit) for limit in east.get_ylim()) < 20.0


def test_cep50_and_r95_are_named_on_the_distribution(driven):
    run, _, true = driven
    errors = position_errors(run.solution, true)
    named = labels(drawn("error_distribution", run, errors=errors).axes[0])
    cep50, r95 = (number(float(np.percentile(errors.horizontal, share))) for share in (50.0, 95.0))
    assert f"CEP50 {cep50} m, R95 {r95} m" in named


def test_thinning_keeps_every_extreme_and_every_break():
    time = np.arange(1_000_000.0)
    value = np.sin(time / 1e4)
    value[[123_456, 654_321]] = 9.0, -9.0
    value[500_000] = np.nan
    x, y = thinned(time, value)
    assert len(x) <= 3 * BINS + 1
    assert np.nanmax(y) == 9.0
    assert np.nanmin(y) == -9.0
    assert np.isnan(y).sum() == 1
    assert (np.diff(x) > 0.0).all()
    assert x[-1] == time[-1]
    _, low, high = envelope(time, np.nan_to_num(value) - 1.0, np.nan_to_num(value) + 1.0)
    assert (low.min(), high.max()) == (-10.0, 10.0)


def test_no_line_is_drawn_across_a_gap():
    time = np.concatenate((np.arange(10.0), np.arange(100.0, 110.0)))
    t, columns = broken_at_gaps(time, np.ones((20, 2)))
    assert len(t) == 21
    assert np.isnan(columns[10]).all()
    assert np.isfinite(np.delete(columns, 10, axis=0)).all()


def test_long_runs_are_in_minutes_and_all_start_at_zero():
    short, long = Clock.of(np.array([1e9, 1e9 + 100.0])), Clock.of(np.array([5.0, 5000.0]))
    assert short(1e9 + 10.0) == 10.0
    assert "[s]" in short.label
    assert long(65.0) == 1.0
    assert "[min]" in long.label


@pytest.mark.parametrize("times", ["after", "none"])
def test_gps_that_has_nothing_to_show_is_no_trouble(driven, tmp_path, times):
    run, gps, _ = driven
    rows = slice(0, 0) if times == "none" else slice(-2, None)
    few = GpsData(gps.time[rows], gps.lla[rows], np.full_like(gps.v_n[rows], np.nan), gps.v_n[rows], gps.v_n[rows])
    assert draw_all(run, few, None, tmp_path)


def test_a_track_is_coloured_by_what_varies_on_it(driven):
    run, gps, _ = driven
    assert run_track(EvaluatedRun(run, gps)).shades[0].name == "horizontal sd [m]"
    even = replace(run.solution, sd=np.ones_like(run.solution.sd))
    assert run_track(EvaluatedRun(replace(run, solution=even), gps)).shades[0].name.startswith("speed")


def test_the_page_opens_on_the_smoothed_solution_whatever_varies(driven):
    run, gps, _ = driven
    even = replace(run.solution, sd=np.ones_like(run.solution.sd))
    found = EvaluatedRun(replace(run, smoothed=Smoothed(even, run.epochs, run.sensor_errors)), gps)
    assert modes([run_track(found)]) == ("smoothed", "filtered")
    _, _, (height,), _ = figure_drawings("height", found)
    assert [each.name for each in height.curves if each.name.endswith("ed")] == ["±3 sd, smoothed", "smoothed"]
