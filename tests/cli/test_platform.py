"""What `insnav platform` makes of a flight whose truth is known, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from insnav.earth import gravity_n
from insnav.errors import platform_errors
from insnav.errors.platform_errors import level_force
from insnav.output.data_files import write_data, write_table
from insnav.output.folder import read_facts
from insnav.output.solution_tables import read_solution
from insnav.simulate import circle, reference, straight
from tests.cli.conftest import Cli
from tests.shared import verify_folder

START = ("--lat", "48.000000000", "--lon", "11.0", "--height", "1000")


def write_force(path: Path, time: np.ndarray, f_n: np.ndarray) -> None:
    named = {"f_east_m_s2": f_n[:, 1], "f_north_m_s2": f_n[:, 0], "f_up_m_s2": -f_n[:, 2]}
    write_table(path, {"time_s": time, **named})


@pytest.fixture
def flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, ...]:
    """A working directory with a minute of a turn and its truth; the options of its start."""
    monkeypatch.chdir(tmp_path)
    truth = circle(np.array([np.radians(48.0), np.radians(11.0), 1000.0]), 100.0, 0.05, 60.0)
    time = np.arange(1201) / 20.0
    write_force(Path("fw.csv"), time, level_force(truth, time))
    write_data(Path("ref.csv"), reference(truth, time))
    at = truth.evaluate(time[:1])
    lat, lon = np.degrees(at.lla[0, :2])
    return ("--lat", f"{lat:.12f}", "--lon", f"{lon:.12f}", "--height", "1000", "--v-north", f"{at.v_n[0, 0]:.9f}")


def test_a_flight_is_found_again_and_every_integrator_judged(flight: tuple[str, ...], cli: Cli):
    shown = cli("platform", "fw.csv", *flight, "--v-east", "0", "--ref", "ref.csv", "-v")
    assert shown.code == 0, shown.err
    facts = verify_folder(Path("platform"))
    off = facts["largest_difference_to_reference"]
    assert off["fourth"]["horizontal_m"] < 1e-4
    assert off["forward"]["horizontal_m"] == pytest.approx(off["backward"]["horizontal_m"], rel=0.01)
    assert off["forward"]["horizontal_m"] > 1.0 > off["mean"]["horizontal_m"] > off["fourth"]["horizontal_m"]
    solution = read_solution(Path("platform"))
    assert len(solution.time) == 601
    assert np.degrees(solution.lla[-1, 0]) == pytest.approx(facts["end"]["fourth"]["lat_deg"], abs=1e-9)
    torquing = Path("platform/torquing.csv").read_text(encoding="utf-8").splitlines()
    assert torquing[0] == "time_s,torquing_e_deg_h,torquing_n_deg_h,torquing_u_deg_h"
    assert len(torquing) == 602
    figures = {file.stem for file in Path("platform/figures").iterdir()}
    assert figures == {"track", "velocity", "torquing", "integrators"}
    for word in ("forward", "backward", "mean", "fourth", "Horizontal difference to the reference"):
        assert word in shown.out


def test_the_chosen_integrator_is_the_one_written(flight: tuple[str, ...], cli: Cli):
    shown = cli("platform", "fw.csv", *flight, "--integrator", "forward", "--json", "--rate", "full")
    facts = json.loads(shown.out)
    solution = read_solution(Path("platform"))
    assert len(solution.time) == 1201
    assert np.degrees(solution.lla[-1, 0]) == pytest.approx(facts["end"]["forward"]["lat_deg"], abs=1e-9)
    assert abs(np.degrees(solution.lla[-1, 0]) - facts["end"]["fourth"]["lat_deg"]) > 1e-7
    assert set(facts["largest_difference_to_fourth"]) == {"forward", "backward", "mean"}


def test_gravity_straight_down_has_no_part_to_the_north(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Cli):
    """Ten minutes at 5 km: 8.08e-9 h sin 2L t^2 / 2 = 7.3 m, which gravity of one size does not have."""
    monkeypatch.chdir(tmp_path)
    time = np.arange(0.0, 601.0, 1.0)
    write_force(Path("rest.csv"), time, np.tile([0.0, 0.0, -9.79], (len(time), 1)))
    ends = []
    for number, more in enumerate(((), ("--gravity", "9.79"))):
        out = f"p{number}"
        shown = cli("platform", "rest.csv", "--lat", "45", "--lon", "0", "--height", "5000", *more, "--out", out)
        assert shown.code == 0, shown.err
        ends.append(np.radians(read_facts(Path(out))["end"]["fourth"]["lat_deg"] - 45.0) * 6.37e6)
    assert ends[0] == pytest.approx(-7.2, abs=0.2)
    assert abs(ends[1]) < 0.05
    refused = cli("platform", "rest.csv", "--lat", "45", "--lon", "0", "--gravity", "98", "--out", "no")
    assert refused.code == 2
    assert "--gravity" in refused.err


def test_a_damped_vertical_channel_takes_its_height_from_a_file(flight: tuple[str, ...], cli: Cli):
    Path("h.csv").write_text("time_s,height_m\n" + "".join(f"{t},1000\n" for t in range(61)), encoding="utf-8")
    shown = cli("platform", "fw.csv", *flight, "--vertical", "damped", "--height-input", "h.csv", "--ref", "ref.csv")
    assert shown.code == 0, shown.err
    assert read_facts(Path("platform"))["largest_difference_to_reference"]["fourth"]["horizontal_m"] < 1e-4
    assert read_solution(Path("platform")).lla[:, 2] == pytest.approx(1000.0, abs=1e-3)


def test_the_errors_of_a_platform_at_rest_are_beside_the_closed_form(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Cli
):
    monkeypatch.chdir(tmp_path)
    time = np.arange(0.0, 12.5 * 3600.0, 2.0)
    force = np.tile(-gravity_n(np.radians(45.0), 0.0), (len(time), 1))
    write_force(Path("rest.csv"), time, force)
    errors = ("--gyro-drift", "0.01,-0.02,0.01", "--accel-bias", "50,0,0", "--misalignment", "0.001,0,0.01")
    shown = cli("platform", "rest.csv", "--lat", "45", "--lon", "179.9", *errors, "-v")
    assert shown.code == 0, shown.err
    facts = read_facts(Path("platform"))["platform_errors"]
    assert facts["drift_n_e_d_deg_h"] == pytest.approx([0.01, -0.02, 0.01])
    assert facts["bias_n_e_d_ug"] == pytest.approx([50.0, 0.0, 0.0])
    assert facts["tilt_n_e_d_deg"] == pytest.approx([0.001, 0.0, 0.01])
    found, theory = facts["largest_position_error_n_e_m"], facts["largest_by_closed_form_n_e_m"]
    assert found == pytest.approx(theory, rel=0.02)
    assert "Schuler [min]  84.38" in shown.out
    assert Path("platform/figures/errors.png").exists()
    header = Path("platform/torquing.csv").read_text(encoding="utf-8").splitlines()[0]
    assert header.endswith("tilt_n_deg,tilt_e_deg,tilt_d_deg")


def test_the_demonstration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Cli):
    """With shorter motions: what is shown is tested elsewhere."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(platform_errors, "DAY_RATE", 0.5)
    monkeypatch.setattr(platform_errors, "PATTERN", 120.0)
    monkeypatch.setattr(platform_errors, "FLIGHT", 60.0)
    shown = cli("platform", "--demo")
    assert shown.code == 0, shown.err
    facts = verify_folder(Path("platform"))
    assert [
        facts["known_functions"][name]["order_on_sine"] for name in ("forward", "backward", "mean", "fourth")
    ] == pytest.approx([1.0, 1.0, 2.0, 4.0], abs=0.1)
    assert facts["day_largest_n_e"]["platform_m"] == pytest.approx(facts["day_largest_n_e"]["closed form_m"], rel=0.02)
    assert facts["day_largest_n_e"]["strapdown_m"] == pytest.approx(facts["day_largest_n_e"]["closed form_m"], rel=0.02)
    assert {file.stem for file in Path("platform/figures").iterdir()} == {"line", "sine", "flight", "day", "pattern"}


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ((), 2, ("FORCE_FILE, --lat, --lon", "cli.missing")),
        (("fw.csv", "--lon", "11"), 2, ("cli.missing",)),
        (("fw.csv", "--demo"), 2, ("cli.demonstration_alone", "FORCE_FILE")),
        (("--demo", "--lat", "60", "--gyro-drift", "1,0,0"), 2, ("--lat, --gyro-drift",)),
        (("fw.csv", "--lat", "91", "--lon", "11"), 2, ("platform.out_of_range",)),
        (("fw.csv", "--lat", "90", "--lon", "11"), 2, ("platform.start_near_pole",)),
        (("fw.csv", "--lat", "48", "--lon", "nan"), 2, ("platform.out_of_range",)),
        (("fw.csv", *START, "--v-east", "inf"), 2, ("--v-east",)),
        (("fw.csv", *START, "--v-up", "3"), 2, ("platform.vertical_velocity",)),
        (("fw.csv", *START, "--gyro-drift", "0.01"), 2, ("--gyro-drift", "cli.not_numbers")),
        (("fw.csv", *START, "--misalignment", "0,20,0"), 2, ("platform.not_level",)),
        (("fw.csv", *START, "--vertical", "damped"), 2, ("cli.damped_needs_heights",)),
        (("fw.csv", *START, "--height-input", "ref.csv"), 2, ("--vertical",)),
        (
            ("fw.csv", *START, "--vertical", "damped", "--height-input", "late.csv"),
            3,
            ("platform.heights_do_not_cover",),
        ),
        (("none.csv", *START), 3, ("format.no_file",)),
        (("level.csv", *START, "--vertical", "free"), 3, ("platform.no_vertical_axis",)),
        (("fw.csv", *START, "--sample-rate", "0"), 2, ("platform.bad_rate", "--sample-rate")),
        (("fw.csv", *START, "--sample-rate", "20"), 2, ("input.rate_beside_times",)),
        (
            ("away.csv", "--lat", "89.9", "--lon", "11", "--gyro-drift", "0,50,0"),
            3,
            ("platform.near_pole_with_errors",),
        ),
        (("gap.csv", *START), 3, ("gap.csv",)),
        (("away.csv", *START, "--vertical", "free"), 3, ("platform.free_height",)),
        (("fw.csv", *START, "--columns", "f_east=nothing"), 2, ("--columns", "columns.no_such_column")),
    ],
)
def test_what_cannot_be_is_refused(
    flight: tuple[str, ...], cli: Cli, arguments: tuple[str, ...], code: int, words: tuple[str, ...]
):
    rows = Path("fw.csv").read_text(encoding="utf-8").splitlines()
    level = [",".join(row.split(",")[:3]) for row in rows]
    Path("level.csv").write_text("\n".join([*level, ""]), encoding="utf-8")
    Path("gap.csv").write_text("\n".join([*rows[:400], *rows[500:], ""]), encoding="utf-8")
    truth = straight(np.array([0.8, 0.2, 1000.0]), 10.0, 0.0, 100.0, start=20.0)
    write_data(Path("late.csv"), reference(truth, 20.0 + np.arange(0.0, 100.0)))
    time = np.arange(0.0, 30000.0, 5.0)
    write_force(Path("away.csv"), time, np.tile([0.0, 0.0, -9.9], (len(time), 1)))
    shown = cli("platform", *arguments)
    assert shown.code == code, shown.err
    assert shown.out == ""
    for word in words:
        assert word in shown.err
    assert "Traceback" not in shown.err
    assert not Path("platform").exists()


def test_help_has_examples_and_fits_a_terminal(cli: Cli):
    shown = cli("platform", "--help")
    assert "insnav platform --demo" in shown.out
    assert max(map(len, shown.out.splitlines())) <= 80
