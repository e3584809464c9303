"""What `insnav calibrate poses` prints, writes and refuses."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insnav.findings import Code
from insnav.imu import correct, load_calibration
from insnav.imu.model import ErrorTerms
from insnav.input import read_imu
from insnav.input.interpret.physics import axes_matrix
from insnav.output.folder import read_facts
from insnav.types import ImuData
from tests.cli.conftest import Cli, findings_of, says
from tests.lab.test_multi_position import G_SENSITIVITY, TRUE, measured
from tests.lab.test_six_positions import measured as six_measured
from tests.shared import verify_folder

HEADER = "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"
RAW_HEADER = "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z"
G = ("--gravity", 9.81)


def write(name: str, data: ImuData, header: str = HEADER, **how: object) -> None:
    rows = np.column_stack((data.time, data.gyro, data.accel))
    np.savetxt(name, rows, how.get("fmt", "%.9g"), ",", header=header, comments="")


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with 24 poses in SI and in counts."""
    monkeypatch.chdir(tmp_path)
    data = measured(np.random.default_rng(1))
    write("imu.csv", data)
    raw = replace(data, gyro=data.gyro * 4800.0 + 32700.0, accel=data.accel * 415.0 + 32900.0)
    write("counts.csv", raw, RAW_HEADER, fmt=["%.6f", *["%.0f"] * 6])
    return tmp_path


def test_the_calibration_file_is_what_run_reads(bench: Path, cli: Cli) -> None:
    shown = cli("calibrate", "poses", "imu.csv", *G, "-v")
    assert shown.code == 0, shown.err
    got = load_calibration("calibration/calibration.toml")
    facts = read_facts(Path("calibration"))
    for name, truth in (("accel", TRUE.accel_matrix), ("gyro", TRUE.gyro_matrix)):
        sd = np.array(facts[name]["matrix_sd"])
        found = getattr(got, f"{name}_matrix")
        assert (np.abs(found - truth) <= 4.5 * sd + 1e-12).all()
        np.testing.assert_allclose(found, facts[name]["matrix"], rtol=1e-12)
    assert len(facts["poses_s"]) == 24
    verify_folder(Path("calibration"))
    assert Path("calibration/figures/poses.png").stat().st_size > 10_000


def test_the_page_shows_field_units_and_every_pose_only_on_the_page(bench: Path, cli: Cli) -> None:
    shown = cli("calibrate", "poses", "imu.csv", *G, "-v")
    for text in (
        "24 poses and 23 turns",
        "bias x",
        " mg",
        "scale factor error z",
        " ppm",
        "x senses y",
        " mrad",
        "left out",
    ):
        assert text in shown.out
    assert "turn share [%]" not in cli("calibrate", "poses", "imu.csv", *G, "--force").out
    page = Path("calibration/report.html").read_text(encoding="utf-8")
    assert 'turn share <span class="unit">[%]' in page
    assert "normal gravity" not in shown.err
    assert "as given" in shown.err
    (sensitivity,) = findings_of(read_facts(Path("calibration")), Code.BENCH_G_SENSITIVITY)
    assert says(shown.out, sensitivity)


@pytest.mark.parametrize("axes", ["FRD", "RFU"])
def test_counts_and_the_calibration_give_what_was_true(bench: Path, cli: Cli, axes: str) -> None:
    """The file of counts, read by zero and scale and corrected, is the motion without errors."""
    shown = cli("calibrate", "poses", "counts.csv", "--counts", *G, "--imu-axes", axes, "--json")
    assert shown.code == 0, shown.err
    facts = json.loads(shown.out)
    known = load_calibration("calibration/calibration.toml")
    assert known.gyro_raw is not None
    assert known.accel_raw is not None
    scales = {"gyro": known.gyro_raw, "accel": known.accel_raw}
    got = correct(read_imu("counts.csv", axes=axes, units=scales).data, known)
    exact = replace(TRUE, gyro_terms=ErrorTerms(g_sensitivity=G_SENSITIVITY))
    truth = correct(measured(np.random.default_rng(1)), exact)
    turn = axes_matrix(axes)
    if axes == "FRD":
        matrix = np.array(facts["accel"]["matrix_counts_m_s2"]) / 415.0
        np.testing.assert_allclose(matrix, TRUE.accel_matrix, atol=0.01)
        # noise is the same in both; what is left is the rounding to counts and the uncertainty of the calibration
        assert np.sqrt(np.mean((got.accel - truth.accel) ** 2)) < 2.5e-3
        assert np.sqrt(np.mean((got.gyro - truth.gyro) ** 2)) < 1.2e-3
    else:
        # the accelerometer x that defines the axes is another one: the same motion, turned by the misalignment
        turned = truth.accel @ turn.T
        assert np.sqrt(np.mean((got.accel - turned) ** 2)) < 0.05
        still = np.abs(np.linalg.norm(truth.accel, axis=1) - 9.81) < 0.05
        assert abs(np.linalg.norm(got.accel[still], axis=1).mean() - 9.81) < 0.01


def test_impact_on_navigation_is_on_the_page(bench: Path, cli: Cli) -> None:
    shown = cli("calibrate", "poses", "imu.csv", *G, "-v")
    assert "Impact on navigation" in shown.out
    assert "Uncertainty of corrected data" in shown.out
    facts = read_facts(Path("calibration"))
    assert all(item["with_m"] < 0.1 * item["without_m"] for item in facts["navigation_impact"])
    known = load_calibration("calibration/calibration.toml")
    assert known.gyro_terms is not None
    unit = "rad_s_m_s2"
    np.testing.assert_allclose(known.gyro_terms.g_sensitivity, facts["gyro"][f"g_sensitivity_{unit}"])


def test_gravity_follows_from_latitude_and_height(bench: Path, cli: Cli) -> None:
    shown = cli("calibrate", "poses", "imu.csv", "--lat", 45, "--height", 0, "--json")
    # WGS-84 normal gravity at 45 degrees: 9.80620 m/s^2
    assert json.loads(shown.out)["gravity_m_s2"] == pytest.approx(9.80620, abs=1e-5)


def test_six_positions_with_sections_and_without(bench: Path, cli: Cli) -> None:
    from insnav.lab.multi_position.method import find_sections

    data = six_measured(0.003)
    write("six.csv", data)
    spans = find_sections(data)
    Path("sections.json").write_text(json.dumps({k: {"start": a, "end": b} for k, (a, b) in spans.items()}))
    Path("sections.toml").write_text("".join(f"{k} = [{a}, {b}]\n" for k, (a, b) in spans.items()))
    texts = []
    for options in ((), ("--sections", "sections.json"), ("--sections", "sections.toml")):
        shown = cli("calibrate", "poses", "six.csv", "--method", "six", *G, *options, "--force")
        assert shown.code == 0, shown.err
        texts.append(Path("calibration/calibration.toml").read_text())
        assert "position errors are" in shown.out
    assert texts[0] == texts[1] == texts[2]


@pytest.mark.parametrize(
    ("options", "code", "word"),
    [
        (("imu.csv",), 2, "session.no_gravity"),
        (("imu.csv", *G, "--lat", "48"), 2, "session.gravity_twice"),
        (("imu.csv", "--gravity", "981"), 2, "lab.gravity"),
        (("imu.csv", "--lat", "91"), 2, "session.bad_latitude"),
        (("imu.csv", *G, "--sections", "s.json"), 2, "lab.sections_need_six"),
        (("imu.csv", *G, "--method", "six", "--sections", "no.json"), 2, "lab.sections_unreadable"),
        (("imu.csv", *G, "--method", "six", "--turn", "5"), 2, "--turn"),
        (("imu.csv", *G, "--method", "six"), 3, "lab.section_missing"),
        (("imu.csv", *G, "--counts"), 3, "input.counts_with_units"),
        (("counts.csv", *G), 3, "columns.no_gravity"),
        (("imu.csv", *G, "--out", "/dev/null/such"), 4, "output.folder_unwritable"),
    ],
)
def test_what_cannot_be_is_refused(bench: Path, cli: Cli, options: tuple[str, ...], code: int, word: str) -> None:
    shown = cli("calibrate", "poses", *options)
    assert shown.code == code, shown.err
    assert shown.out == ""
    assert word in shown.err
    assert not Path("calibration").exists()


@pytest.mark.parametrize("text", ["[1, 2]", '{"x_p": "all"}', '{"x_p": [0]}', "{", '{"x_p": [0, true]}'])
def test_sections_that_are_none_are_refused(bench: Path, cli: Cli, text: str) -> None:
    Path("s.json").write_text(text)
    shown = cli("calibrate", "poses", "imu.csv", *G, "--method", "six", "--sections", "s.json")
    assert shown.code == 2
    assert "s.json" in shown.err


def test_two_columns_exchanged_are_found_out(bench: Path, cli: Cli) -> None:
    Path("swapped.csv").write_text(
        Path("imu.csv").read_text().replace("gyro_x_rad_s,gyro_y_rad_s", "gyro_y_rad_s,gyro_x_rad_s")
    )
    shown = cli("calibrate", "poses", "swapped.csv", *G)
    assert shown.code == 3
    assert "+y, +x, +z" in shown.err
