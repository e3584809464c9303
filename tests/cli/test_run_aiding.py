"""What `insnav run` uses besides fixes: each can be asked for, and the result says what was used."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insnav.findings import Code
from insnav.output.folder import read_facts
from tests.cli.conftest import QUICK, SAMPLE, Cli, findings_of, says

ARM = ("--lever-arm", "0.8,-0.3,-1.2")


def gap(first: float, last: float) -> None:
    """Take the fixes of an interval out of gps.csv [s after the first]."""
    head, *rows = Path("gps.csv").read_text().splitlines()
    start = float(rows[0].split(",")[0])
    kept = [row for row in rows if not first <= float(row.split(",")[0]) - start <= last]
    Path("gps.csv").write_text("\n".join([head, *kept]) + "\n")


def used(out: str) -> set[str]:
    return {aid["name"] for aid in read_facts(Path(out))["aiding"]}


def test_zupt_is_used_where_fixes_are_missing(drive: Path, cli: Cli):
    assert cli("run", *QUICK, *ARM, "--out", "without-gap").code == 0
    assert not read_facts(Path("without-gap")).get("aiding")
    gap(100.0, 110.0)
    assert cli("run", *QUICK, *ARM, "--out", "auto").code == 0
    assert used("auto") == {"zupt"}  # a minute of driving is too little for the mounting angles
    assert cli("run", *QUICK, *ARM, "--aiding", "off", "--out", "off").code == 0
    assert not read_facts(Path("off")).get("aiding")


def test_nhc_is_used_where_the_drive_shows_that_it_holds(tmp_path: Path, cli: Cli):
    files = (SAMPLE / "imu.csv.gz", "--gps", SAMPLE / "gps.csv", "--imu", "automotive", "--figures", "none")
    shown = cli("run", *files, *ARM, "--out", tmp_path / "run", "-v")
    assert shown.code == 0, shown.err
    assert used(str(tmp_path / "run")) == {"nhc", "zupt"}
    assert any(line.startswith("  nhc ") for line in shown.out.splitlines())
    (nhc,) = findings_of(read_facts(tmp_path / "run"), Code.NHC_USED)
    assert says(shown.out, nhc)


def test_a_lever_arm_that_is_only_roughly_known_is_estimated(drive: Path, cli: Cli):
    shown = cli("run", *QUICK, "--lever-arm", "0.8,-0.3,0", "--lever-arm-sd", "1.5")
    assert shown.code == 0, shown.err
    down = read_facts(Path("run"))["fixes"]["lever_arm_m"][2]
    assert down < -0.3  # -1.2 m; a minute of driving shows part of it


def test_the_height_stays_where_it_is_said_to(drive: Path, cli: Cli):
    gap(75.0, 200.0)  # the whole way, which goes up and down
    span = []
    for out, options in (("free", ()), ("level", ("--fixed-height", "0.5"))):
        assert cli("run", *QUICK, *ARM, *options, "--aiding", "off", "--out", out).code == 0
        names = Path(out, "solution.csv").read_text().splitlines()[0].split(",")
        height = np.loadtxt(Path(out, "solution.csv"), delimiter=",", skiprows=1)[:, names.index("height_m")]
        span.append(np.ptp(height[-500:]))
    print("ups and downs [m]:", span)
    assert span[1] < 0.7 * span[0]  # on a hill it is not true, and in part rejected
    assert "height" in used("level")


def test_the_heading_of_two_antennas_is_used_if_it_is_said_how_good_it_is(drive: Path, cli: Cli):
    ref = np.loadtxt("ref.csv", delimiter=",", skiprows=1)
    names = Path("ref.csv").read_text().splitlines()[0].split(",")
    head, *rows = Path("gps.csv").read_text().splitlines()
    time, column = ref[:, names.index("time_s")], np.unwrap(np.radians(ref[:, names.index("heading_deg")]))
    turned = np.degrees(np.interp([float(row.split(",")[0]) for row in rows], time, column)) % 360.0
    text = "\n".join([f"{head},heading_deg", *(f"{row},{value:.4f}" for row, value in zip(rows, turned, strict=True))])
    Path("gps.csv").write_text(text + "\n")
    found = {}
    for out, options in (("unused", ()), ("used", ("--gps-heading-sd", "0.3"))):
        assert cli("run", *QUICK, *ARM, *options, "--ref", "ref.csv", "--out", out).code == 0
        found[out] = read_facts(Path(out))["accuracy"]["all"]["heading_deg"]["rms"]
    assert found["used"] < 0.3 < found["unused"]


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (("--aiding", "maybe"), "--aiding"),
        (("--lever-arm-sd", "-1"), "--lever-arm-sd"),
        (("--fixed-height", "nan"), "--fixed-height"),
        (("--gps-heading-sd", "120"), "--gps-heading-sd"),
    ],
)
def test_wrong_values_are_refused_by_name(drive: Path, cli: Cli, options: tuple[str, ...], word: str):
    shown = cli("run", *QUICK, *options)
    assert shown.code == 2
    assert word in shown.err


def test_a_speedometer_of_its_own_clock_and_unit_is_used(tmp_path: Path, cli: Cli):
    names = (SAMPLE / "ref.csv").read_text().splitlines()[0].split(",")
    ref = np.loadtxt(SAMPLE / "ref.csv", delimiter=",", skiprows=1)[::2]
    speed = np.linalg.norm(ref[:, names.index("vn_m_s") : names.index("vd_m_s") + 1], axis=1)
    log = tmp_path / "speed.csv"
    rows = [
        f"{1e3 * (time - 99000.0):.0f},{3.6 * 1.05 * value:.3f}" for time, value in zip(ref[:, 0], speed, strict=True)
    ]
    log.write_text("\n".join(["time [ms],speed [km/h]", *rows]) + "\n")
    files = (SAMPLE / "imu.csv.gz", "--gps", SAMPLE / "gps.csv", "--imu", "automotive", "--figures", "none")
    shown = cli("run", *files, *ARM, "--speed", log, "--out", tmp_path / "run")
    assert shown.code == 0, shown.err
    assert used(str(tmp_path / "run")) == {"nhc", "zupt", "speedometer"}
    facts = read_facts(tmp_path / "run")
    assert facts["input"]["speedometer"]["n_rows"] == len(ref)
    (fitted,) = findings_of(facts, Code.ODOMETER_USED)
    assert fitted.subject == "speedometer"
    assert fitted["lag_s"] == pytest.approx(-99000.0, abs=0.05)
    assert fitted["scale"] == pytest.approx(1.0 / 1.05, abs=0.002)
