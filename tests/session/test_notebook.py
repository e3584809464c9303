"""What a notebook does with a drive, and that the command line does the same."""

from __future__ import annotations

import json
import pydoc
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

import insnav
from insnav.errors.metrics import at_point
from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, Finding, Severity
from insnav.input.interpret.schema import LOG_SCHEMAS
from insnav.output.solution_tables import read_solution
from insnav.sample_statistics import rms
from insnav.steps.inputs import INPUTS, LOGS, Inputs
from tests.cli.conftest import Cli, cli
from tests.refusals import refused
from tests.shared import verify_folder

__all__ = ["cli"]
LEVER = (0.8, -0.3, -1.2)


def test_false_fixes_are_no_reference_of_outages(drive: Path) -> None:
    fixes = pd.read_csv("gps.csv")
    false = (fixes.time_s > fixes.time_s[0] + 90.0) & (fixes.time_s < fixes.time_s[0] + 100.0)
    fixes.loc[false, "lat_deg"] += 1e-3  # 111 m
    fixes.to_csv("false.csv", index=False)
    found = insnav.load("imu.csv", gps="false.csv", lever_arm=LEVER).outage(lengths=10, workers=1)
    assert found.found.growth[0].largest[-1, found.found.growth[0].column("horizontal")] < 50.0
    rejected = found.page().findings[0]
    assert (rejected.code, rejected.severity, rejected.subject) == (
        Code.RECORD_FALSE_POSITIONS,
        Severity.WARNING,
        "gps",
    )
    assert (rejected.begin - fixes.time_s[0], rejected.end - fixes.time_s[0]) == pytest.approx((91.0, 99.0), abs=0.1)


def test_the_imu_error_specification_has_one_name(drive: Path) -> None:
    for name in ("tactical", "STIM300", insnav.load_imu("tactical")):
        named = insnav.load("imu.csv", "gps.csv", imu=name)
        with pytest.warns(DeprecationWarning, match="use imu") as caught:
            old = insnav.load("imu.csv", "gps.csv", imu_model=name)
        assert [each.filename for each in caught] == [__file__]  # so Python shows it to who wrote it
        assert (named.imu_spec.name, named.imu_chosen) == (old.imu_spec.name, old.imu_chosen)
        assert named.imu_spec.name != insnav.load("imu.csv", "gps.csv").imu_spec.name
    assert insnav.check("imu.csv", "gps.csv", imu="tactical").found.command.endswith("--imu tactical")
    assert insnav.align("imu.csv", "gps.csv", imu="tactical").imu_model[0].name == "tactical"
    made = insnav.simulate("city", imu="tactical")
    assert made.imu_spec.name == insnav.load(made.imu.data, made.gps.data, imu="tactical").imu_spec.name


def test_the_first_lines_of_a_notebook(drive: Path) -> None:
    drive_ = insnav.load("imu.csv", gps="gps.csv", ref="ref.csv", lever_arm=LEVER)
    assert "13000 rows" in repr(drive_)
    result = drive_.navigate()
    assert isinstance(result.plot("position_error"), Figure)
    assert isinstance(result.plot("track"), Figure)
    frame, filtered = result.to_frame(), result.to_frame("filtered")
    best, run = result.found.run.smoothed.solution, result.found.run
    for table, solution in ((frame, best), (result.to_frame("smoothed"), best), (filtered, run.solution)):
        np.testing.assert_allclose(np.deg2rad(table["lat_deg"]), solution.lla[:, 0], rtol=0, atol=1e-15)
    assert {f"``{name}``" for name in frame.columns} <= set(re.findall("``[a-z_]+``", insnav.Result.to_frame.__doc__))
    with refused(ConfigError, "input.unknown_word"):
        result.to_frame("forward")
    reference = pd.read_csv("ref.csv")
    times = frame.time_s[(frame.time_s >= reference.time_s.min()) & (frame.time_s <= reference.time_s.max())]
    height = np.interp(times, reference.time_s, reference.height_m) - frame.height_m[times.index]
    assert list(result.accuracy) == ["smoothed", "filtered"]
    assert result.accuracy["smoothed"]["vertical_m"] == pytest.approx(rms(height.to_numpy()), rel=0.02)
    assert result.accuracy["smoothed"]["horizontal_m"] < result.accuracy["filtered"]["horizontal_m"]
    stated = insnav.load("imu.csv", "gps.csv").navigate(smooth=False).accuracy
    assert stated.keys() == {"filtered"}
    assert {name for name in stated["filtered"] if not name.startswith("sd_")} == {"nis_mean_per_axis"}
    result.save("run1")
    verify_folder(Path("run1"))
    again, smoothed = insnav.open_result("run1").found.run.smoothed, result.found.run.smoothed
    np.testing.assert_allclose(again.sensor_errors.value, smoothed.sensor_errors.value, rtol=0, atol=1e-8)
    assert "horizontal error RMS" in result.summary()
    head, verdict, figures = repr(result).splitlines()
    assert head == "Result: run of imu.csv, gps.csv, ref.csv"
    assert verdict == result.page().verdict.rating
    assert f"{result.accuracy['smoothed']['horizontal_m']:.3g} m" in figures
    assert "<table" in result._repr_html_()
    outage = drive_.outage(lengths=(10, 30))
    assert [each.length for each in outage.found.growth] == [10.0, 30.0]
    assert [each.length for each in drive_.outage(lengths=10).found.growth] == [10.0]
    with pytest.raises(ConfigError, match="sequence"):
        drive_.budget(times=60)
    budget = drive_.budget(times=(10, 60), windows=insnav_windows())
    assert list(budget.found.budget.time[budget.found.budget.chosen]) == [10.0, 60.0]


def test_fixes_that_end_early_make_the_rest_a_gap_that_other_aiding_bridges(drive: Path) -> None:
    gps = pd.read_csv("gps.csv")
    ends = gps[gps["time_s"] < gps["time_s"].iloc[-1] - 10.0]
    assert insnav.load("imu.csv", gps=ends).navigate().found.run.aiding
    assert not insnav.load("imu.csv", gps=gps).navigate().found.run.aiding


def insnav_windows() -> object:
    from insnav.errors.budget.from_windows import WindowSettings

    return WindowSettings(spacing=20.0)  # without simulated replicas, which take a minute


def test_notebook_and_shell_give_the_same_bytes(drive: Path, cli: Cli) -> None:
    options = ("--ref", "ref.csv", "--lever-arm", "0.8,-0.3,-1.2", "--figures", "none")
    assert cli("run", "imu.csv", "--gps", "gps.csv", *options, "--out", "shell").code == 0
    insnav.load("imu.csv", gps="gps.csv", ref="ref.csv", lever_arm=LEVER).navigate().save("notebook", figures="none")
    for name in ("solution.csv", "smoothed.csv", "innovations.csv", "biases.csv"):
        assert Path("shell", name).read_bytes() == Path("notebook", name).read_bytes()
    ours, theirs = (json.loads(Path(folder, "run.json").read_text()) for folder in ("notebook", "shell"))
    assert {key for key in ours if ours[key] != theirs[key]} == {"configuration"}


def test_files_frames_arrays_and_types_are_the_same_data(drive: Path) -> None:
    imu, gps = pd.read_csv("imu.csv"), pd.read_csv("gps.csv")
    given = {"imu": "automotive", "lever_arm": LEVER}
    from_files = insnav.load("imu.csv", gps="gps.csv", **given)
    solution = from_files.navigate(smooth=False).found.run.solution
    columns = [imu[[f"{name}_{axis}_{unit}" for axis in "xyz"]].to_numpy() for name, unit in _UNITS.items()]
    assert from_files.gps is not None
    for samples, fixes in (
        (imu, gps),
        ((imu["time_s"].to_numpy(), *columns), gps),
        (from_files.imu.data, from_files.gps.data),
    ):
        again = insnav.load(samples, gps=fixes, **given).navigate(smooth=False).found.run.solution
        np.testing.assert_array_equal(again.lla, solution.lla)
        np.testing.assert_array_equal(again.rph, solution.rph)


_UNITS = {"gyro": "rad_s", "accel": "m_s2"}


def test_a_data_frame_may_hold_datetimes_and_remarks(drive: Path) -> None:
    imu, gps = pd.read_csv("imu.csv"), pd.read_csv("gps.csv")
    plain = insnav.load(imu, gps=gps, imu="automotive")
    imu["time_s"] = pd.to_datetime(imu["time_s"], unit="s")
    imu["remark"] = "ok"
    dated = insnav.load(imu, gps=gps, imu="automotive", columns={"time": "time_s"})
    np.testing.assert_allclose(dated.imu.data.time, plain.imu.data.time, atol=1e-6)
    np.testing.assert_array_equal(dated.imu.data.gyro, plain.imu.data.gyro)


def test_every_input_has_a_type_and_a_meaning() -> None:
    assert set(INPUTS) == set(Inputs.__annotations__)
    assert set(LOGS) == set(LOG_SCHEMAS)
    options = [each.option for each in (*INPUTS.values(), *LOGS.values()) if each.option]
    assert len(set(options)) == len(options)


def test_what_is_given_about_the_start_holds_for_every_method(drive: Path) -> None:
    at_0 = insnav.load("imu.csv", "gps.csv", imu="automotive", heading=0.75, static=(100000.0, 100050.0))
    alignment = at_0.until("align").ready.alignment
    assert alignment.rph[2] == pytest.approx(0.75, abs=0.01)
    assert alignment.heading_method is Code.ALIGN_HEADING_GIVEN
    assert alignment.static is not None
    assert alignment.static[1] <= 100050.1


def test_arrays_without_times_need_a_rate() -> None:
    n = 3000
    rest = (np.zeros((n, 3)), np.tile([0.0, 0.0, -9.81], (n, 1)))
    drive = insnav.load(rest, rate=100.0, lat=0.8)
    assert drive.imu.facts.rate_hz == pytest.approx(100.0)
    with pytest.raises(ConfigError, match=r"session.not_samples"):
        insnav.load(rest)


def test_positions_in_radians_are_refused_as_such() -> None:
    lla = np.column_stack([np.full(50, 0.84), np.linspace(0.15, 0.151, 50), np.full(50, 400.0)])
    rest = (np.zeros((500, 3)), np.tile([0.0, 0.0, -9.81], (500, 1)))
    with pytest.raises(ConfigError, match=r"session.positions_in_radians"):
        insnav.load(rest, (np.arange(50) * 0.1, lla), rate=100.0)


@pytest.mark.parametrize(
    ("inputs", "error", "words"),
    [
        ({"lever_arm": (1.0, 2.0)}, ConfigError, "input.not_a_vector"),
        ({"lever_arm": (0.0, 0.0, 120.0)}, ConfigError, "input.long_lever_arm"),
        ({"gps_delay": float("nan")}, ConfigError, "input.out_of_range"),
        ({"heading": 92.0}, ConfigError, "input.out_of_range"),  # degrees, where radians are meant
        ({"static": (20.0, 10.0)}, ConfigError, "input.bad_span"),
        ({"lever": (0.0, 0.0, 0.0)}, ConfigError, "input.unknown_input"),
        ({"logs": {"sonar": "sonar.csv"}}, ConfigError, "input.unknown_sensor"),
        ({"gps_columns": {"lat": "zz"}}, InputError, "zz"),
        ({"imu": "none.toml"}, ConfigError, "imu.unknown"),
    ],
)
def test_what_cannot_be_meant_is_refused(
    drive: Path, inputs: dict[str, object], error: type[Exception], words: str
) -> None:
    with pytest.raises((error, ConfigError), match=words):
        insnav.load("imu.csv", gps="gps.csv", **inputs)


def test_a_place_is_needed_to_navigate_and_to_align(drive: Path) -> None:
    alone = insnav.load("imu.csv", imu="automotive")
    with pytest.raises(ConfigError, match=r"align.no_position") as error:
        alone.navigate()
    assert error.value.values == {"imu": "imu.csv", "beside": "gps.csv"}
    with pytest.raises(ConfigError, match=r"session.no_latitude"):
        alone.align()
    at_a_latitude = insnav.load("imu.csv", imu="automotive", lat=np.deg2rad(48.0)).align()
    with_fixes = insnav.load("imu.csv", gps="gps.csv", imu="automotive").align()
    np.testing.assert_allclose(with_fixes.found.coarse.rph[:2], at_a_latitude.found.coarse.rph[:2], atol=1e-3)


def test_a_reference_of_another_point_is_brought_to_the_antenna(drive: Path) -> None:
    at_imu = insnav.load("imu.csv", "gps.csv", "ref.csv", lever_arm=LEVER, ref_lever_arm=(0, 0, 0))
    assert at_imu.reference is not None
    data = at_imu.reference.data
    moved = at_imu._antenna_positions(at_imu.reference, np.array(LEVER))
    down = moved.lla[:, 2] - data.lla[:, 2]
    assert np.median(down) == pytest.approx(1.2, abs=0.05)  # the antenna is above the IMU
    blind = insnav.Trajectory(data.time, data.lla, data.v_n, np.full_like(data.rph, np.nan))
    with pytest.raises(ConfigError, match=r"session.reference_without_attitude"):
        insnav.load("imu.csv", "gps.csv", blind, lever_arm=LEVER, ref_lever_arm=(0, 0, 0)).outage(lengths=(5,))


def test_bare_positions_are_of_the_antenna_for_every_command(drive: Path) -> None:
    """The same reference once as a solution of the IMU, and once as positions of a receiver at the antenna."""
    of_imu = insnav.load("imu.csv", "gps.csv", "ref.csv", lever_arm=LEVER, imu="automotive")
    assert of_imu.reference is not None
    data = of_imu.reference.data
    at_antenna = at_point(data, np.array(LEVER))
    unknown = np.full_like(data.rph, np.nan)
    bare = insnav.Trajectory(at_antenna.time, at_antenna.lla, unknown, unknown)
    of_antenna = insnav.load("imu.csv", "gps.csv", bare, lever_arm=LEVER, imu="automotive")
    run = of_antenna.navigate()
    assert Finding.of(Code.REF_AT_ANTENNA, subject="ref") in run.page().findings
    size = rms(of_imu.navigate().found.errors.horizontal)
    assert rms(run.found.errors.horizontal) == pytest.approx(size, rel=0.02)
    (other, *_) = insnav.compare(run, ref=bare).found.compared
    assert rms(other.errors.horizontal) == pytest.approx(size, rel=0.02)
    one, two = (each.outage(lengths=(5,), workers=1).found for each in (of_imu, of_antenna))
    assert one.reference.endswith("(of the IMU)")
    assert two.reference.endswith("(of the antenna)")
    assert two.growth[0].rms[-1, 0] == pytest.approx(one.growth[0].rms[-1, 0], rel=0.02)
    assert of_antenna._window_reference(of_antenna.reference).lever_b is None
    np.testing.assert_array_equal(of_imu._window_reference(of_imu.reference).lever_b, 0.0)


def test_a_simulated_drive_knows_its_exact_motion() -> None:
    drive = insnav.simulate("laboratory_slide", imu="tactical", gps="rtk", seed=3)
    assert drive.reference is not None
    assert drive.imu_spec.name == "tactical"
    again = insnav.simulate("laboratory_slide", imu="tactical", gps="rtk", seed=3)
    np.testing.assert_array_equal(drive.imu.data.gyro, again.imu.data.gyro)
    other = insnav.simulate("laboratory_slide", imu="tactical", gps="rtk", seed=4)
    assert not np.array_equal(drive.imu.data.gyro, other.imu.data.gyro)


@pytest.mark.parametrize(
    "lines",
    [
        "import insnav; insnav.simulate; from insnav.simulate import Truth",
        "from insnav.simulate import Truth; import insnav",
        "import insnav.simulate; import insnav",
        "from insnav import simulate; import insnav; assert simulate is insnav.simulate",
    ],
)
def test_simulate_is_a_function_and_a_package(lines: str) -> None:
    use = "assert callable(insnav.simulate); from insnav.simulate import Truth; assert insnav.simulate.Truth is Truth"
    subprocess.run([sys.executable, "-c", f"{lines}; {use}"], check=True)


def test_the_public_names_are_seen_and_explained() -> None:
    names = [name for name in dir(insnav) if not name.startswith("_")]
    assert 18 <= len(names) <= 37  # one for every command that finds something
    assert {"load", "simulate", "calibrate", "compare", "open_result", "Drive", "Result"} <= set(names)
    for name in names:
        assert getattr(insnav, name).__doc__
    text = pydoc.render_doc(insnav, renderer=pydoc.plaintext)
    assert "Conventions, everywhere in insnav" in text
    assert "load(samples" in text


def test_the_package_can_be_run() -> None:
    shown = subprocess.run([sys.executable, "-m", "insnav", "--version"], check=True, capture_output=True, text=True)
    assert shown.stdout == f"insnav {insnav.__version__}\n"


def test_results_in_memory_and_folders_are_compared(drive: Path) -> None:
    result = insnav.load("imu.csv", gps="gps.csv", lever_arm=LEVER).navigate(smooth=False)
    result.save("saved", figures="none")
    both = insnav.compare(result, "saved", ref="ref.csv")
    memory, folder = both.found.compared
    assert [each.run for each in both.found.compared] == ["run 1", "saved"]
    np.testing.assert_allclose(memory.errors.horizontal, folder.errors.horizontal, atol=1e-4)
    assert isinstance(both.plot("horizontal_error"), Figure)
    assert len(both.to_frame()) == 2
    assert read_solution(Path("saved")).lla.shape == result.found.run.solution.lla.shape
