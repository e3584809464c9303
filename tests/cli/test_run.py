"""What `insnav run` prints and leaves behind."""

from __future__ import annotations

import csv
import json
import sys
import tempfile
from pathlib import Path

import pytest

from insnav.exceptions import DivergenceError, InputError
from insnav.findings import Code, Severity, of_families
from insnav.messages import phrase, word
from insnav.output.folder import read_facts
from insnav.steps import STEPS
from insnav.units import DEG
from tests.cli.conftest import QUICK, Cli, findings_of, says
from tests.reversed_messages import as_shown
from tests.shared import verify_folder

WITH_REFERENCE = (*QUICK, "--ref", "ref.csv", "--lever-arm", "0.8,-0.3,-1.2")
TABLES = [
    *("biases.csv", "errors.csv", "events.csv", "explanation.npz", "fixes.csv", "imu.toml"),
    *(
        "innovations.csv",
        "run.json",
        "smoothed.csv",
        "smoothed_biases.csv",
        "smoothed_errors.csv",
        "solution.csv",
        "track.kml",
    ),
]
FIGURES = ["attitude", "biases", "height", "innovations", "track", "uncertainty", "velocity"]
HEIGHTS = [code for code in of_families("read") if code.startswith("read.height.")]
ERROR_FIGURES = ["attitude_error", "error_distribution", "position_error", "velocity_error"]


def _files(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def test_the_summary_says_what_matters(drive: Path, cli: Cli):
    shown = cli("run", *WITH_REFERENCE)
    assert shown.code == 0, shown.err
    lines = shown.out.splitlines()
    assert len(lines) <= 15
    assert "…" not in shown.out  # nothing is cut where it goes to a file
    assert shown.err == "" or "compiling the numerical kernels" in shown.err
    assert phrase("terminal.line", name="imu.csv", text="2.15 min") in lines[0]
    figure = f"{phrase('run.error_of', part=word('horizontal'))} [m]"
    row = next(line for line in lines if line.strip().startswith(figure))
    facts = read_facts(Path("run"))
    both = [facts["smoothed"]["accuracy"], facts["accuracy"]]
    for text, each in zip(row.split()[-2:], both, strict=True):
        assert float(text) == pytest.approx(each["all"]["horizontal_m"]["rms"], rel=0.01)
        assert 0.0 < float(text) < 3.0  # fixes are good to 1.5 m a component
    said = phrase("terminal.files", folder="run", names="run.json", others=len(TABLES) - 1)
    assert lines[-1] == said.rstrip()


def test_everything_or_nothing_is_printed_as_asked(drive: Path, cli: Cli):
    quiet = cli("-q", "run", *WITH_REFERENCE)
    assert (quiet.code, quiet.out, quiet.err) == (0, "", "")
    loud = cli("run", *WITH_REFERENCE, "--force", "-v")
    for words in ("Accuracy of the filtered solution", "GPS fixes", "Estimated sensor errors", "Initial alignment"):
        assert words in loud.out
    for term in ("Stated", "Tilt error", "Lever arm", "A sample that is a mean", "Times of the plots"):  # -v explains
        assert as_shown(term) in " ".join(loud.out.split())
    assert json.loads(cli("run", *WITH_REFERENCE, "--force", "-q", "--json").out)["kind"] == "run"


def test_the_log_says_how_the_files_were_understood_and_no_more(drive: Path, cli: Cli):
    every = cli("run", *WITH_REFERENCE, "-v").err.splitlines()
    names = [line.split(":")[1].strip() for line in every if line.startswith("insnav: ")]
    steps = [phrase("terminal.step", name=step, time_s=0.0).split(":")[0].strip() for step in STEPS]
    assert names == ["IMU", "GPS", "reference", "IMU model", *steps]
    log = every[: next(row for row, line in enumerate(every) if steps[0] in line)]
    text = " ".join(log)
    inputs = read_facts(Path("run"))["input"]
    imu, gps, _ = (findings_of({"findings": each["evidence"]}) for each in inputs.values())
    shown = [each for each in (*imu, *gps) if each.code is not Code.UNITS_STATED]
    assert [each.code for each in shown] == [
        *(Code.UNITS_ACCEL, Code.AXES_ASSUMED, Code.READ_IMU_SAMPLING_ASSUMED, Code.READ_HEIGHT_ELLIPSOIDAL_ASSUMED),
    ]
    assert shown[0]["gravity_m_s2"] == pytest.approx(9.79, abs=0.005)
    assert shown[1]["axes"] == "FRD"
    for each in shown:
        assert says(text, each)
    assert "columns:" not in text  # every header is the name of its quantity
    assert len(log) <= 20


def test_headers_that_were_interpreted_are_logged(drive: Path, cli: Cli):
    path = Path("imu.csv")
    path.write_text(path.read_text().replace("gyro_x_rad_s", "Gx", 1))
    log = cli("run", *QUICK, "--columns", "gyro_x=Gx,time_s=time_s", "-v").err
    assert "columns: gyro_x_rad_s = Gx [rad/s]; the others by their names" in log


def test_short_headers_are_logged_with_the_units_found(drive: Path, cli: Cli):
    path = Path("imu.csv")
    _, rows = path.read_text().split("\n", 1)
    path.write_text(f"time_s,gx,gy,gz,ax,ay,az\n{rows}")
    log = " ".join(cli("run", *QUICK, "-v").err.split())
    for header, unit in (("gx", "rad/s"), ("gy", "rad/s"), ("az", "m/s^2")):
        assert f"= {header} [{unit}]" in log


def test_json_alone_is_on_standard_output_and_is_that_of_the_folder(drive: Path, cli: Cli):
    shown = cli("run", *WITH_REFERENCE, "--json")
    facts = json.loads(shown.out)
    assert shown.out == Path("run/run.json").read_text(encoding="utf-8")
    assert list(facts) == [
        *(
            "schema",
            "versions",
            "kind",
            "accuracy",
            "reference_offset",
            "smoothed",
            "solution",
            "fixes",
            "aiding",
            "outages",
        ),
        *("sensor_errors", "alignment", "events", "explanation"),
        *("input", "imu_model", "configuration"),
        *("verdict", "summary", "method", "findings", "files"),
    ]
    assert facts["configuration"]["lever_arm"] == "0.8,-0.3,-1.2"
    assert facts["configuration"]["gps_height"] is None
    assert not {"out", "force", "as_json"} & set(facts["configuration"])
    assert {"imu", "gps", "reference"} == set(facts["input"])
    assert all(len(each["sha256"]) == 64 for each in facts["input"].values())


@pytest.mark.parametrize("how", [(), ("--figures", "png")])
def test_the_folder_holds_tables_page_and_figures_on_demand(drive: Path, cli: Cli, how: tuple[str, ...]):
    shown = cli("run", "imu.csv", "--gps", "gps.csv", "--ref", "ref.csv", "--imu", "automotive", *how)
    assert shown.code == 0, shown.err
    drawn = [f"figures/{name}.png" for name in [*FIGURES, *ERROR_FIGURES]] if how else []
    assert _files(Path("run")) == sorted([*TABLES, "report.html", *drawn])
    verify_folder(Path("run"))
    names = ["report.html", *(["figures"] if how else []), "run.json"]
    assert phrase("terminal.files", folder="run", names=", ".join(names), others=len(TABLES) - 1) in shown.out


def test_the_same_input_gives_the_same_bytes(drive: Path, cli: Cli):
    for name in ("first", "second"):
        assert cli("run", *WITH_REFERENCE, "--out", name).code == 0
    assert _files(Path("first")) == _files(Path("second")) == TABLES
    for name in TABLES:
        assert Path("first", name).read_bytes() == Path("second", name).read_bytes(), name


def test_two_files_are_told_apart_by_their_content(drive: Path, cli: Cli):
    cli("run", *QUICK, "--out", "named")
    named = read_facts(Path("named"))
    for order in (("imu.csv", "gps.csv"), ("gps.csv", "imu.csv")):
        shown = cli("run", *order, *QUICK[3:], "--out", order[0][:3])
        assert shown.code == 0, shown.err
        facts = read_facts(Path(order[0][:3]))
        assert facts["configuration"] == named["configuration"]
        assert facts["files"]["solution.csv"] == named["files"]["solution.csv"]
    twice = cli("run", "imu.csv", "gps.csv", "--gps", "gps.csv")
    assert twice.code == 2
    assert "cli.fixes_twice" in twice.err


def test_a_folder_brings_its_reference_and_is_as_its_files(drive: Path, cli: Cli):
    folder = Path("recording")
    folder.mkdir()
    for name in ("imu.csv", "gps.csv", "ref.csv"):
        (folder / name).write_bytes(Path(name).read_bytes())
    options = ("--imu", "automotive", "--figures", "none")
    assert cli("run", "imu.csv", "--gps", "gps.csv", "--ref", "ref.csv", *options, "--out", "files").code == 0
    assert cli("run", folder, *options, "--out", "folder", "--fail-above", "100").code == 0
    assert Path("files/errors.csv").read_bytes() == Path("folder/errors.csv").read_bytes()


def test_what_is_empty_or_not_there_is_said_before_the_folder_in_the_way(drive: Path, cli: Cli):
    Path("run").mkdir()
    Path("empty.csv").touch()
    assert "format.empty" in cli("run", "imu.csv", "--gps", "empty.csv").err
    assert "format.no_file" in cli("run", "imu.csv", "--gps", "gone.csv").err
    assert "output.folder_exists" in cli("run", "imu.csv", "--gps", "gps.csv").err


def test_a_limit_on_the_error_decides_the_exit_code(drive: Path, cli: Cli):
    good = cli("run", *WITH_REFERENCE, "--fail-above", "5", "--out", "good")
    bad = cli("run", *WITH_REFERENCE, "--fail-above", "0.01", "--out", "bad", "--json")
    assert (good.code, bad.code) == (0, 1)
    rms = json.loads(bad.out)["accuracy"]["all"]["horizontal_m"]["rms"]
    assert "cli.worse_than_limit" in bad.err
    assert f"{rms:.3f}" in bad.err
    assert "error" not in good.err
    verify_folder(Path("bad"))


@pytest.mark.parametrize(("north_m", "code"), [(0.0, 0), (200.0, 1)])
def test_exit_code_1_is_the_verdict_in_every_command(drive: Path, cli: Cli, north_m: float, code: int):
    head, *rows = Path("ref.csv").read_text().splitlines()
    place = head.split(",").index("lat_deg")
    cells = [row.split(",") for row in rows]
    for row in cells:
        row[place] = f"{float(row[place]) + north_m / 111_000.0:.9f}"
    Path("ref.csv").write_text("\n".join([head, *map(",".join, cells)]))
    Path("drives.toml").write_text('[[drive]]\nfile = "imu.csv"\ngps = "gps.csv"\nref = "ref.csv"\n')
    options = ("--imu", "automotive")
    for command in (
        ("run", *QUICK, "--ref", "ref.csv"),
        ("outage", "imu.csv", "gps.csv", *options, "--ref", "ref.csv", "--lengths", "10", "--engine", "1"),
        ("batch", "drives.toml", *options, "--figures", "none", "--engine", "1"),
    ):
        shown = cli(*command)
        assert shown.code == code, (command, shown.err)
        assert ("cli.not_relied_on" in shown.err) == bool(code)
        light = read_facts(Path({"batch": "fleet"}.get(command[0], command[0])))["verdict"]["light"]
        assert (light == "bad") == bool(code)


def test_data_that_lose_the_filter_are_unusable_data():
    assert DivergenceError.exit_code == InputError.exit_code == 3


@pytest.mark.parametrize(
    ("options", "kind", "code"),
    [
        ((), "ellipsoidal", Code.READ_HEIGHT_ELLIPSOIDAL_ASSUMED),
        (("--gps-height", "msl"), "msl", Code.READ_HEIGHT_MSL),
        (("--gps-height", "ellipsoidal"), "ellipsoidal", Code.READ_HEIGHT_ELLIPSOIDAL),
    ],
)
def test_what_heights_are_is_passed_on(drive: Path, cli: Cli, options: tuple[str, ...], kind: str, code: Code):
    shown = cli("run", *QUICK, *options, "-v")
    facts = read_facts(Path("run"))["input"]["gps"]
    assert facts["height"] == kind
    (how,) = findings_of({"findings": facts["evidence"]}, *HEIGHTS)
    assert how.code is code
    assert not how.get("column")  # it is given, or assumed
    assert (how.get("option") == "--gps-height") == bool(options)
    assert (how.severity is Severity.ASSUMPTION) == (kind == "msl" or not options)  # heights stay as they are
    assert says(shown.err, how)


def test_the_header_says_what_heights_are(drive: Path, cli: Cli):
    path = Path("gps.csv")
    path.write_text(path.read_text().replace("height_m", "height_msl_m", 1))
    shown = cli("run", *QUICK, "-v")
    facts = read_facts(Path("run"))["input"]["gps"]
    assert facts["height"] == "msl"
    (how,) = findings_of({"findings": facts["evidence"]}, *HEIGHTS)
    assert (how.code, how["column"]) == (Code.READ_HEIGHT_MSL, "height_msl_m")
    assert says(shown.err, how)


def test_an_initial_state_replaces_the_alignment(drive: Path, cli: Cli):
    first = next(csv.DictReader(Path("ref.csv").read_text().splitlines()))
    start = {name: float(first[name]) for name in ("time_s", "lat_deg", "lon_deg", "height_m")}
    start["v_n_m_s"] = [float(first[name]) for name in ("vn_m_s", "ve_m_s", "vd_m_s")]
    start["roll_pitch_heading_deg"] = [float(first[name]) for name in ("roll_deg", "pitch_deg", "heading_deg")]
    start |= {"sd_position_m": [0.1] * 3, "sd_velocity_m_s": [0.01] * 3, "sd_attitude_deg": [0.1] * 3}
    Path("start.json").write_text(json.dumps(start))
    shown = cli("run", *QUICK, "--initial", "start.json")
    assert shown.code == 0, shown.err
    found = read_facts(Path("run"))["alignment"]
    assert found["heading_method"] == Code.ALIGN_HEADING_GIVEN
    assert found["heading_deg"] == pytest.approx(float(first["heading_deg"]))


@pytest.mark.parametrize("heading", [None, "220"])
def test_a_heading_that_is_wrong_does_not_go_unnoticed(drive: Path, cli: Cli, heading: str | None):
    shown = cli("run", *QUICK, *(("--heading", heading) if heading else ()))
    assert shown.code == 0, shown.err
    wrong = findings_of(read_facts(Path("run")), Code.GIVEN_HEADING_REJECTED)
    assert [round(each["given_rad"] / DEG) for each in wrong] == ([220] if heading else [])
    for each in wrong:
        assert each.severity is Severity.WARNING
        assert says(shown.out, each)
    assert not findings_of(read_facts(Path("run")), Code.RUN_MANY_REJECTED, Code.RUN_ROW_REJECTED)  # it is not used


def test_rate_and_format_of_the_tables(drive: Path, cli: Cli):
    shown = cli("run", *QUICK, "--rate", "full", "--format", "parquet")
    assert shown.code == 0, shown.err
    assert {"solution.parquet", "innovations.parquet", "biases.parquet"} <= set(_files(Path("run")))
    assert read_facts(Path("run"))["solution"]["rate_hz"] == pytest.approx(100.0, rel=1e-3)


def _snapshot(*folders: Path) -> set[Path]:
    return {path for folder in folders for path in folder.rglob("*")}


def test_nothing_is_written_elsewhere_and_nobody_is_called(
    drive: Path, cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    elsewhere = tmp_path / "tmp"
    elsewhere.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(elsewhere))
    seen: list[str] = []
    watching = [True]  # a hook cannot be taken away again

    def watch(event: str, arguments: tuple[object, ...]) -> None:
        if not watching:
            return
        if event == "open" and isinstance(arguments[1], str) and set(arguments[1]) & set("wax+"):
            seen.append(str(Path(str(arguments[0])).resolve()))
        elif event.startswith("socket."):
            seen.append(event)

    before = _snapshot(tmp_path)
    sys.addaudithook(watch)
    try:
        shown = cli("run", "imu.csv", "--gps", "gps.csv", "--imu", "automotive", "--out", "here")
    finally:
        watching.clear()
    assert shown.code == 0, shown.err
    assert {path.relative_to(drive).parts[0] for path in _snapshot(tmp_path) - before} == {"here"}
    assert any(name.endswith("report.html") for name in seen)  # the watch works
    caches = ("__pycache__", "numba", "matplotlib", "fontconfig")  # of libraries, in their own places
    strange = [name for name in seen if not name.startswith((str(drive / ".here.tmp-"), "/dev/null"))]
    assert [name for name in strange if not any(cache in name for cache in caches)] == []


def test_without_smoothing_there_is_no_trace_of_it(drive: Path, cli: Cli):
    shown = cli("run", *WITH_REFERENCE, "--no-smooth")
    assert shown.code == 0, shown.err
    assert _files(Path("run")) == [name for name in TABLES if not name.startswith("smoothed")]
    assert read_facts(Path("run"))["smoothed"] is None
    assert "smoothed" not in shown.out


def test_the_smoothed_solution_stands_beside_that_of_the_filter(drive: Path, cli: Cli):
    shown = cli("run", *WITH_REFERENCE)
    facts = read_facts(Path("run"))
    rms = [part["all"]["horizontal_m"]["rms"] for part in (facts["accuracy"], facts["smoothed"]["accuracy"])]
    assert rms[1] < rms[0]
    assert facts["smoothed"]["horizontal_rms_ratio"] == pytest.approx(rms[1] / rms[0])
    assert f"{phrase('run.smoothed')}  {phrase('run.filtered')}" in shown.out
    headers = [Path("run", name).read_text().split("\n", 1)[0] for name in ("solution.csv", "smoothed.csv")]
    assert headers[0] == headers[1]
