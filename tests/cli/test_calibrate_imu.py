"""`insnav calibrate imu`: what it prints and writes, and that `run` takes the file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from insnav.findings import Code, Severity
from insnav.imu import corrupt, load_calibration
from insnav.output.folder import read_facts
from insnav.types import ImuData
from insnav.units import DEG
from tests.cli.conftest import QUICK, Cli, findings_of, says
from tests.lab.sweeps import asymmetric, cubic, gyros, straight, write
from tests.shared import verify_folder


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    write(tmp_path, gyros(rng, (cubic, straight, asymmetric)), 0.005, rng)
    return tmp_path


FILES = ("about_x.csv", "about_y.csv", "about_z.csv")


def test_sweeps_on_the_terminal_and_in_the_folder(bench: Path, cli: Cli) -> None:
    shown = cli("calibrate", "imu", *FILES, "-v")
    assert shown.code == 0, shown.err
    for words in (
        "gyro x senses y",
        "matrix and pieces",
        "Pieces: error = k rate + b'",
        "condition",
        "Impact on navigation",
        "Uncertainty of corrected data",
        "times smaller",
    ):
        assert words in shown.out
    verify_folder(Path("calibration"))
    assert Path("calibration/figures/rate_errors.png").stat().st_size > 20_000
    known = load_calibration("calibration/calibration.toml")
    assert known.gyro_map is not None
    assert known.gyro_map.axes[1] is None
    facts = json.loads(Path("calibration/run.json").read_text())
    assert facts["rate_error"]["map_deg_s"] < 0.2 * facts["rate_error"]["matrix_deg_s"]
    assert set(facts["pieces"]) == {"x", "z"}
    assert all(item["with_m"] < 0.2 * item["without_m"] for item in facts["navigation_impact"])


def test_run_takes_the_file_with_its_pieces(bench: Path, drive: Path, cli: Cli) -> None:
    """A drive as gyros of such a matrix and shape show it, run with the calibration, ends where the true one does."""
    shown = cli("calibrate", "imu", *(bench / name for name in FILES))
    assert shown.code == 0, shown.err
    known = load_calibration("calibration/calibration.toml")
    rows = np.genfromtxt("imu.csv", delimiter=",", skip_header=1)
    header = Path("imu.csv").read_text().split("\n", 1)[0]
    bent = corrupt(ImuData(rows[:, 0], rows[:, 1:4], rows[:, 4:7]), known)
    rows[:, 1:4] = bent.gyro
    np.savetxt("bent.csv", rows, "%.12g", ",", header=header, comments="")
    ends = []
    for arguments in (QUICK, ("bent.csv", *QUICK[1:], "--calibration", "calibration/calibration.toml")):
        shown = cli("run", *arguments, "--out", "run", "--force")
        assert shown.code == 0, shown.err
        ends.append(np.genfromtxt("run/solution.csv", delimiter=",", skip_header=1)[-1, :7])
    np.testing.assert_allclose(ends[1], ends[0], rtol=1e-6, atol=1e-3)


def test_an_intercept_set_by_hand_and_its_effect(bench: Path, cli: Cli) -> None:
    assert cli("calibrate", "imu", *FILES, "--json", "--out", "plain").code == 0
    plain = load_calibration("plain/calibration.toml").gyro_map
    assert plain is not None
    before = plain.axes[0]
    assert before is not None
    rate, error = before.rate[:2], before.error[:2]
    given = float(error[0] - np.diff(error)[0] / np.diff(rate)[0] * rate[0]) / DEG + 0.02
    shown = cli("calibrate", "imu", *FILES, "--intercept", f"x1={given}", "--out", "hand", "-v")
    assert shown.code == 0, shown.err
    assert "Set by hand" in shown.out
    (harm,) = findings_of(read_facts(Path("hand")), Code.BENCH_INTERCEPT)
    assert harm.severity is Severity.WARNING
    assert harm.subject == "x1"
    assert harm["after_rad_s"] > harm["before_rad_s"]
    assert says(shown.out, harm)
    change = json.loads(Path("hand/run.json").read_text())["adjusted"]["x1"]
    assert change["given_deg_s"] - change["found_deg_s"] == pytest.approx(0.02, abs=1e-6)
    assert change["after_deg_s"] > change["before_deg_s"]
    hand = load_calibration("hand/calibration.toml").gyro_map
    assert hand is not None
    after = hand.axes[0]
    assert after is not None
    np.testing.assert_allclose(after.rate_error(2.0 * rate[:1]) - before.rate_error(2.0 * rate[:1]), 0.02 * DEG)
    for text in ("y1=0", "x1=up", "x1", "x1=1e9"):
        assert cli("calibrate", "imu", *FILES, "--intercept", text, "--out", "no").code == 2, text


def test_json_is_the_same_as_the_file(bench: Path, cli: Cli) -> None:
    shown = cli("calibrate", "imu", *FILES, "--json", "--out", "c")
    assert json.loads(shown.out) == json.loads(Path("c/run.json").read_text())


@pytest.mark.parametrize(
    ("arguments", "code", "word"),
    [
        (("about_x.csv",), 3, "columns.missing"),
        (("about_x.csv", "about_y.csv"), 3, "lab.not_three_sweeps"),
        (("about_y.csv", "about_x.csv", "about_z.csv"), 3, "lab.gyro_crossed"),
        ((*FILES, "--spike-limit", "-1"), 2, "--spike-limit"),
        ((*FILES, "--out", "/dev/null/such"), 4, "output.folder_unwritable"),
    ],
)
def test_what_cannot_be_is_refused(bench: Path, cli: Cli, arguments: tuple[str, ...], code: int, word: str) -> None:
    shown = cli("calibrate", "imu", *arguments)
    assert shown.code == code, shown.err
    assert shown.out == ""
    assert word in shown.err
    assert not Path("calibration").exists()
