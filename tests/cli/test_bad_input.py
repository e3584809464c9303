"""Every bad input has its exit code and says what, where, why and how to mend it; none gives a traceback."""

from __future__ import annotations

import csv
import errno
import json
import os
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from insnav.cli.options import number_in
from insnav.exceptions import ConfigError
from insnav.messages import phrase
from tests.cli.conftest import QUICK, Cli, Outcome
from tests.reversed_messages import as_shown


def refused(shown: Outcome, code: int, *words: str) -> None:
    """One block on standard error, nothing on standard output."""
    assert shown.code == code, shown.err
    assert shown.out == ""
    assert "Traceback" not in shown.err
    assert shown.err.count("insnav: error: ") == 1
    block = shown.err[shown.err.index("insnav: error: ") :]
    for word in words:
        assert word in block, block


def _lines(name: str, change: Callable[[list[str]], list[str]]) -> None:
    path = Path(name)
    path.write_text("\n".join(change(path.read_text().splitlines())) + "\n")


def _cell(name: str, row: int, column: int, text: str) -> None:
    def change(lines: list[str]) -> list[str]:
        cells = lines[row].split(",")
        cells[column] = text
        return [*lines[:row], ",".join(cells), *lines[row + 1 :]]

    _lines(name, change)


def _swap_back(lines: list[str]) -> list[str]:
    """The clock starts again in the middle of the record."""
    middle = len(lines) // 2
    return [lines[0], *lines[middle:], *lines[1:middle]]


def _shift(name: str, seconds: float) -> None:
    def change(lines: list[str]) -> list[str]:
        rows = [line.split(",", 1) for line in lines[1:]]
        return [lines[0], *(f"{float(time) + seconds:.3f},{rest}" for time, rest in rows)]

    _lines(name, change)


SPOILED = {
    "IMU file empty": (lambda: Path("imu.csv").write_text(""), ("format.empty", "imu.csv")),
    "GPS file empty": (lambda: Path("gps.csv").write_text(""), ("format.empty", "gps.csv")),
    "IMU header only": (lambda: _lines("imu.csv", lambda lines: lines[:1]), ("imu.csv", "why:")),
    "GPS header only": (lambda: _lines("gps.csv", lambda lines: lines[:1]), ("gps.csv", "why:")),
    "IMU column missing": (
        lambda: _lines("imu.csv", lambda lines: [lines[0].replace("gyro_z_rad_s", "zz"), *lines[1:]]),
        ("columns.missing", "zz", "gyro_z=zz"),
    ),
    "GPS column missing": (
        lambda: _lines("gps.csv", lambda lines: [lines[0].replace("lat_deg", "foo"), *lines[1:]]),
        ("columns.missing", "foo", "lat=foo"),
    ),
    "binary": (
        lambda: Path("imu.csv").write_bytes(b"\x7fELF\x02\x01\x01" + bytes(range(256)) * 20),
        ("format.unknown", "imu.csv"),
    ),
    "text in a number": (lambda: _cell("imu.csv", 500, 2, "abc"), ("imu.csv:501:gyro_y_rad_s", "abc")),
    "files of different days": (
        lambda: _shift("gps.csv", 86400.0 * 3),
        ("clock.no_common_time", "100000.010", "359201.000", "fix:"),
    ),
    "IMU time backwards": (lambda: _lines("imu.csv", _swap_back), ("imu.csv", "fix:")),
    "GPS time backwards": (lambda: _lines("gps.csv", _swap_back), ("gps.csv", "fix:")),
    "GPS sd negative": (lambda: _cell("gps.csv", 20, 9, "-1"), ("input.bad_sd", "gps.csv:21:sd_d_m", "-1")),
    "latitude of no place": (
        lambda: _cell("gps.csv", 5, 1, "148"),
        ("input.impossible_angle", "gps.csv:6:lat_deg", "148"),
    ),
}


@pytest.mark.parametrize("what", SPOILED)
def test_a_spoiled_file_is_refused_with_exit_code_3(drive: Path, cli: Cli, what: str):
    spoil, words = SPOILED[what]
    spoil()
    refused(cli("run", *QUICK), 3, *words)
    assert not (drive / "run").exists()
    assert sorted(path.name for path in drive.iterdir()) == ["gps.csv", "imu.csv", "ref.csv"]


def test_a_missing_file_is_named_with_its_likely_name(drive: Path, cli: Cli):
    refused(cli("run", "imu.csv", "--gps", "gsp.csv"), 3, "format.no_file", "gsp.csv", "gps.csv")


@pytest.mark.parametrize(("text", "delay"), [("0.15", 0.15), ("150ms", 0.15), ("-0.15 s", -0.15)])
def test_a_number_may_have_a_unit(text: str, delay: float):
    assert number_in("s", "--gps-delay", text) == pytest.approx(delay)


@pytest.mark.parametrize(("text", "code"), [("150 mm", "unit.of_other_dimension"), ("late", "unit.missing")])
def test_a_number_of_another_unit_is_refused_with_the_right_ones(drive: Path, cli: Cli, text: str, code: str):
    shown = cli("run", "imu.csv", "--gps", "gps.csv", "--gps-delay", text)
    assert (shown.code, code in shown.err, "--gps-delay" in shown.err) == (2, True, True)
    with pytest.raises(ConfigError) as caught:
        number_in("s", "--gps-delay", text)
    assert "s" in caught.value.values.get("units", caught.value.values["unit"])


def test_missing_fixes_are_named_before_the_axes(drive: Path, cli: Cli):
    header, *rows = (drive / "imu.csv").read_text(encoding="utf-8").splitlines()
    names, cells = header.split(","), [row.split(",") for row in rows]
    turned = [i for i, name in enumerate(names) if re.search("_[yz](_|$)", name)]
    for row in cells:
        for i in turned:
            row[i] = str(-float(row[i]))
    Path("flu.csv").write_text("\n".join([header, *map(",".join, cells)]), encoding="utf-8")
    assert "align.no_position" in cli("run", "flu.csv").err
    assert "columns.axes_flu" in cli("align", "flu.csv", "--lat", "48").err


def test_a_position_file_given_as_imu_is_recognised(drive: Path, cli: Cli):
    refused(cli("run", "gps.csv", "--gps", "gps.csv"), 3, "columns.missing")


def test_empty_cells_are_counted_events_and_never_reach_the_output(drive: Path, cli: Cli):
    for row in (300, 301, 4000):
        _cell("imu.csv", row, 3, "")
    _cell("imu.csv", 9000, 5, "nan")
    _cell("gps.csv", 90, 1, "NaN")
    shown = cli("run", *QUICK)
    assert shown.code == 0, shown.err
    facts = json.loads(Path("run/run.json").read_text())
    assert facts["input"]["imu"]["n_rows"] - facts["input"]["imu"]["n_used"] == 4
    assert facts["input"]["gps"]["n_rows"] - facts["input"]["gps"]["n_used"] == 1
    with Path("run/events.csv").open(newline="") as file:
        codes = [row["code"] for row in csv.DictReader(file)]
    assert codes.count("rows.nan") == facts["events"]["rows.nan"] >= 1
    assert codes.count("rows.no_position") == facts["events"]["rows.no_position"] == 1
    for name in ("solution.csv", "biases.csv"):
        text = Path("run", name).read_text().lower()
        assert "nan" not in text
        assert ",," not in text
        assert "inf" not in text


WRONG_OPTIONS = {
    "IMU misspelt": (("--imu", "industral"), "--imu", "industrial"),
    "two numbers for an arm": (("--lever-arm", "1,2"), "--lever-arm", "cli.not_numbers"),
    "an arm of words": (("--lever-arm", "a,b,c"), "--lever-arm", "cli.not_numbers"),
    "an arm of no number": (("--lever-arm", "nan,0,0"), "--lever-arm", "cli.not_numbers"),
    "an arm in millimetres": (("--lever-arm", "800,0,-1200"), "--lever-arm", "input.long_lever_arm"),
    "an interval backwards": (("--static", "30:10"), "--static", "cli.span_backward"),
    "no rate": (("--rate", "often"), "--rate", "cli.not_a_rate"),
    "17 states": (("--states", "17"), "--states", "align.bad_states"),
    "columns without header": (("--columns", "gyro_x"), "--columns", "cli.not_names"),
    "a column that is not there": (("--columns", "gyro_x=foo"), "--columns", "columns.no_such_column"),
    "a column of the fixes that is not there": (
        ("--gps-columns", "lat=foo"),
        "--gps-columns",
        "columns.no_such_column",
    ),
    "no unit": (("--imu-units", "foo"), "--imu-units", "input.unknown_imu_unit"),
    "no axes": (("--imu-axes", "FFF"), "axes", "FFF"),
    "a heading that is no number": (("--heading", "nan"), "--heading", "nan"),
    "a heading beyond a turn": (("--heading", "400"), "--heading", "input.out_of_range"),
    "a delay of a day": (("--gps-delay", "86400"), "--gps-delay", "86400"),
    "a limit without reference": (("--fail-above", "2"), "--fail-above", "cli.limit_without_reference"),
    "a limit below zero": (("--fail-above", "-2", "--ref", "ref.csv"), "--fail-above", "cli.not_a_limit"),
}


@pytest.mark.parametrize("what", WRONG_OPTIONS)
def test_a_wrong_option_is_named_with_exit_code_2(drive: Path, cli: Cli, what: str):
    options, *words = WRONG_OPTIONS[what]
    refused(cli("run", "imu.csv", "--gps", "gps.csv", *options), 2, *words)
    assert not (drive / "run").exists()


def test_only_one_file_comes_from_standard_input(drive: Path, cli: Cli):
    refused(cli("run", "-", "--gps", "-"), 2, "session.one_from_stdin", "IMU_FILE, --gps")


def test_all_errors_of_an_imu_file_are_told_at_once(drive: Path, cli: Cli):
    Path("bad.toml").write_text('[gyro]\nbias = "5 furlongs"\nbiass = "1 deg/h"\n[accel]\nbias = 3\n')
    refused(cli("run", "imu.csv", "--gps", "gps.csv", "--imu", "bad.toml"), 2, "config.several_errors", "bad.toml")
    shown = cli("run", "imu.csv", "--gps", "gps.csv", "--imu", "bad.toml").err
    for word in ("gyro.bias", "furlongs", "biass", "accel.bias"):
        assert word in shown


def test_an_unknown_key_hides_no_missing_one(drive: Path, cli: Cli):
    text = '[gyro]\nbias_instability = "5 deg/h"\nnoise_density = "1 deg/h"\n[accel]\nbias = 1\nbias_drift = "1 mg"\n'
    Path("imu.toml").write_text(text, encoding="utf-8")
    shown = cli("run", "imu.csv", "--gps", "gps.csv", "--imu", "imu.toml")
    assert shown.code == 2
    of = as_shown(": ")
    for each in ("gyro.noise_density", f"gyro{of}", "accel.bias_drift", f"accel.bias{of}"):
        assert each in shown.err
    assert as_shown("correlation_time") in shown.err


def test_an_imu_file_that_is_no_toml_is_named(drive: Path, cli: Cli):
    Path("bad.toml").write_text("[gyro\n")
    refused(cli("run", "imu.csv", "--gps", "gps.csv", "--imu", "bad.toml"), 2, "bad.toml", "line 1")


@pytest.mark.parametrize(
    "text", ["", "{", pytest.param("[" * 10_000, id="nested"), "[]", "null", '{"time_s": "soon"}', '{"time_s": 1e400}']
)
def test_an_initial_state_must_be_complete(drive: Path, cli: Cli, text: str):
    Path("start.json").write_text(text)
    code = "input.unreadable_start" if text[-1:] in ("", "{", "[") else "input.incomplete_start"
    refused(cli("run", "imu.csv", "--gps", "gps.csv", "--initial", "start.json"), 3, code, "start.json")


def test_an_initial_state_needs_positive_standard_deviations(drive: Path, cli: Cli):
    three = [0.0, 0.0, 0.0]
    start = {"time_s": 100001.0, "lat_deg": 48.0, "lon_deg": 11.0, "height_m": 500.0, "v_n_m_s": three}
    start |= {"roll_pitch_heading_deg": three, "sd_position_m": three, "sd_velocity_m_s": [1.0, 1.0, 1.0]}
    start |= {"sd_attitude_deg": [1.0, 1.0, -1.0]}
    Path("start.json").write_text(json.dumps(start))
    refused(cli("run", "imu.csv", "--gps", "gps.csv", "--initial", "start.json"), 3, "sd_position_m, sd_attitude_deg")


def _unwritable(folder: Path) -> Path:
    """A folder that takes no new entries, also for the superuser."""
    if os.geteuid() == 0:
        if not Path("/proc/self").exists():
            pytest.skip("the superuser may write everywhere, and there is no /proc")
        return Path("/proc")
    folder.mkdir()
    folder.chmod(0o500)
    return folder


@pytest.mark.skipif(sys.platform == "win32", reason="permissions are different there")
def test_a_folder_that_cannot_be_made_is_known_at_once(drive: Path, cli: Cli):
    place = _unwritable(drive / "locked") / "result"
    shown = cli("run", *QUICK, "--out", place)
    refused(shown, 4, "output.folder_unwritable")
    assert "IMU:" not in shown.err  # nothing was read in vain


def test_a_parent_that_is_a_file_is_known_at_once(drive: Path, cli: Cli):
    Path("a").touch()
    shown = cli("run", *QUICK, "--out", "a/b/c")
    refused(shown, 4, "output.folder_unwritable", os.strerror(errno.ENOTDIR))
    assert "IMU:" not in shown.err  # nothing was read in vain


def _content(folder: str) -> dict[Path, bytes]:
    return {path.relative_to(folder): path.read_bytes() for path in Path(folder).rglob("*") if path.is_file()}


def test_an_existing_result_is_kept_without_force(drive: Path, cli: Cli):
    assert cli("run", *QUICK).code == 0
    before = _content("run")
    refused(cli("run", *QUICK, "--out", "run"), 4, "output.folder_exists")
    assert before == _content("run")
    assert cli("run", *QUICK, "--force").code == 0
    assert not Path("run~1").exists()


def test_a_result_in_the_default_folder_makes_way_and_is_kept(drive: Path, cli: Cli):
    assert cli("run", *QUICK).code == 0
    Path("run/run.json").write_text(Path("run/run.json").read_text() + " ")
    first, second = _content("run"), cli("run", *QUICK)
    assert (second.code, _content("run~1")) == (0, first)
    assert phrase("terminal.kept", folder="run~1") in second.err
    shutil.rmtree("run~1")
    Path("run~1").mkdir()  # of the user: not touched
    assert cli("run", *QUICK).code == 0
    assert list(Path("run~1").iterdir()) == []
    assert _content("run~2").keys() == first.keys()


@pytest.mark.parametrize("file", ["thesis.tex", None])
def test_a_folder_of_the_user_never_makes_way(drive: Path, cli: Cli, file: str | None):
    Path("run").mkdir()
    if file:
        Path("run", file).write_text("years of work")
    refused(cli("run", *QUICK), 4, "output.foreign_files" if file else "output.folder_exists")
    assert sorted(path.name for path in Path().glob("run*")) == ["run"]
    assert [path.name for path in Path("run").iterdir()] == ([file] if file else [])


def test_force_does_not_replace_what_is_not_a_result(drive: Path, cli: Cli):
    Path("run").mkdir()
    Path("run/thesis.tex").write_text("years of work")
    refused(cli("run", *QUICK, "--force"), 4, "thesis.tex")
    assert Path("run/thesis.tex").read_text() == "years of work"


def test_a_file_in_the_way_is_named(drive: Path, cli: Cli):
    Path("run").write_text("")
    refused(cli("run", *QUICK, "--force"), 4, "output.folder_is_file")


def test_names_with_escape_codes_do_not_reach_the_terminal(drive: Path, cli: Cli):
    shown = cli("run", "\x1b[31mred.csv", "--gps", "gps.csv")
    refused(shown, 3, "red.csv")
    assert "\x1b" not in shown.err


def test_advice_fits_the_mistake(drive: Path, cli: Cli):
    assert cli("run", *QUICK).code == 0
    Path("short.csv").write_text("".join(Path("imu.csv").read_text().splitlines(keepends=True)[:51]))  # 0.5 s
    for arguments, code, words in (
        (("short.csv", "gps.csv"), 3, ("columns.short_record", "0.49 s")),
        (("imu.csv", "gps.csv", "--imu", "imu.csv"), 2, ("imu.no_specification", "--imu", "imu.csv")),
        (("imu.csv", "gps.csv", "--imu", "gps.csv"), 2, ("imu.no_specification", "gps.csv")),
        (("run", "gps.csv"), 3, ("format.result_folder", as_shown("insnav report"))),
    ):
        shown = cli("run", *arguments)
        refused(shown, code, *words)
        assert "offset" not in shown.err
        assert "biases.csv" not in shown.err


def test_a_record_of_some_fixes_may_still_be_of_another_clock(drive: Path, cli: Cli):
    rows = Path("imu.csv").read_text().splitlines(keepends=True)
    Path("part.csv").write_text("".join([rows[0], *rows[:351][1:]]))  # 3.5 s
    gps = [line.split(",", 1) for line in Path("gps.csv").read_text().splitlines()]
    later = [gps[0], *([f"{float(time) + 18.0}", rest] for time, rest in gps[1:])]
    Path("later.csv").write_text("\n".join(map(",".join, later)))
    refused(cli("run", "part.csv", "later.csv"), 3, "columns.clock_offset", as_shown("Set --imu-time-offset ") + "18")


def test_fixes_are_no_reference_of_a_red_verdict(drive: Path, cli: Cli):
    shown = cli("run", *QUICK, "--ref", "gps.csv")
    assert shown.code == 0, shown.err
    assert phrase("terminal.line", name=phrase("light.unknown"), text=phrase("run.same_as_gps")) in shown.out
    assert phrase("light.bad") not in shown.out
    again = cli("report", "run")
    assert phrase("run.same_as_gps") in again.out
