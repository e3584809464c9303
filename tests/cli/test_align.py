"""What `insnav align` finds in a record whose attitude is known, prints and leaves behind."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import insnav
from insnav.findings import Code, Finding
from insnav.messages import phrase, render
from insnav.output.folder import read_facts
from insnav.units import DEG
from tests.cli.conftest import AT_REST, Cli, findings_of, says, warnings_of
from tests.input.files import IMU_HEADER, rolling, write

HERE = ("--lat", AT_REST["lat"], "--height", 500)


def test_the_attitude_of_a_good_imu_is_found_within_its_uncertainty(at_rest: Path, cli: Cli):
    shown = cli("align", "static.csv", *HERE, "--imu", "navigation")
    assert shown.code == 0, shown.err
    facts = read_facts(Path("alignment"))
    for name in ("coarse", "fine"):
        found = facts[name]
        assert found["roll_deg"] == pytest.approx(AT_REST["roll"], abs=3 * found["tilt_north_sd_deg"])
        assert found["pitch_deg"] == pytest.approx(AT_REST["pitch"], abs=3 * found["tilt_north_sd_deg"])
        assert found["heading_deg"] == pytest.approx(AT_REST["heading"], abs=3 * found["heading_sd_deg"])
        assert found["heading_sd_deg"] < 0.3
    assert facts["latitude_from_sensors_deg"] == pytest.approx(AT_REST["lat"], abs=0.05)


def test_the_summary_says_what_was_found_and_how_well(at_rest: Path, cli: Cli):
    _, attitude, light, *lines = cli("align", "static.csv", *HERE, "--imu", "navigation").out.splitlines()
    assert re.search(r"heading (39|40)\.\d+ ± 0\.\d+ deg", attitude)
    assert light.startswith(phrase("light.good"))
    assert [line[:12].strip() for line in lines] == ["static", "coarse", "", "fine", "", "latitude", "files"]
    assert lines[0].endswith("600.0 s long")
    assert re.search(r"heading (39|40)\.\d+ ± 0\.\d+ deg", lines[2])
    assert f"({render(Finding.of(Code.ALIGN_HEADING_GYROCOMPASS)).title})" in lines[2]
    assert "from the sensors alone" in lines[5]
    assert max(map(len, lines)) <= 110
    again = insnav.open_result("alignment")
    assert again.imu_model is not None
    assert list(again.page().summary) == lines[: len(again.page().summary)]


def test_a_heading_that_cannot_be_found_is_not_made_up(at_rest: Path, cli: Cli):
    shown = cli("align", "static.csv", *HERE, "--imu", "consumer")
    assert shown.code == 0
    assert "heading not found" in shown.out
    assert "the gyro bias hides the Earth's rotation" in shown.out
    facts = read_facts(Path("alignment"))
    assert facts["coarse"]["heading_sd_deg"] is None
    assert facts["fine"] is None


def test_a_latitude_that_the_gyros_contradict_is_warned_of(at_rest: Path, cli: Cli):
    shown = cli("align", "static.csv", "--lat", AT_REST["lat"] - 10, "--imu", "navigation")
    facts = read_facts(Path("alignment"))
    assert facts["fine"] is None
    (warning,) = warnings_of(facts)
    assert warning.code is Code.ALIGN_LATITUDE
    assert warning["off_rad"] == pytest.approx(10.0 * DEG, abs=0.5 * DEG)
    assert says(shown.out, warning)
    heading, sd = facts["coarse"]["heading_deg"], facts["coarse"]["heading_sd_deg"]
    assert sd is None or (sd > 5.0 and heading == pytest.approx(AT_REST["heading"], abs=3 * sd))


def test_a_given_heading_is_taken_over(at_rest: Path, cli: Cli):
    shown = cli("align", "static.csv", *HERE, "--imu", "automotive", "--heading", "92", "--static", "100:400", "--json")
    facts = json.loads(shown.out)
    assert shown.out == Path("alignment/run.json").read_text(encoding="utf-8")
    assert facts["coarse"]["heading_deg"] == pytest.approx(92.0)
    assert facts["coarse"]["static_s"] == pytest.approx([100.0, 400.0], abs=0.1)


@pytest.mark.parametrize(
    ("options", "code", "word"),
    [
        (("--lat", "91"), 2, "input.out_of_range"),
        (("--lat", "nan"), 2, "input.out_of_range"),
        (("--lat", "48", "--height", "inf"), 2, "--height"),
        (("--lat", "48", "--static", "9000:9100", "--imu", "tactical"), 3, "imu.static_outside"),
        (("--lat", "48", "--out", "static.csv/such"), 4, "output.folder_unwritable"),
    ],
)
def test_what_cannot_be_is_refused(at_rest: Path, cli: Cli, options: tuple[str, ...], code: int, word: str):
    shown = cli("align", "static.csv", *options)
    assert shown.code == code
    assert shown.out == ""
    assert word in shown.err
    assert not Path("alignment").exists()


def test_a_record_without_rest_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Cli):
    monkeypatch.chdir(tmp_path)
    write(Path("rolling.csv"), rolling(), IMU_HEADER)
    shown = cli("align", "rolling.csv", "--lat", "48")
    assert shown.code == 3, shown.out
    assert "session.no_rest" in shown.err
    assert not Path("alignment").exists()


def test_a_short_rest_is_pointed_out(drive: Path, cli: Cli):
    lines = Path("imu.csv").read_text().splitlines()
    Path("brief.csv").write_text("\n".join([lines[0], *lines[6600:]]) + "\n")
    shown = cli("align", "brief.csv", "--lat", "48", "--imu", "automotive")
    assert shown.code == 0, shown.err
    (short,) = findings_of(read_facts(Path("alignment")), Code.ALIGN_SHORT_REST)
    assert short["duration_s"] == pytest.approx(5.0, abs=0.1)
    assert says(shown.err, short)
