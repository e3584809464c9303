"""``insnav check``: its exit code, and folders of a recording."""

from __future__ import annotations

import gzip
from dataclasses import replace

import numpy as np
import pytest

from insnav.alignment import Mounting
from insnav.alignment.clock_offset import ClockOffset
from insnav.exceptions import InputError
from insnav.findings import Code, of_code
from insnav.fleet.batch import find_drives
from insnav.fleet.tuning import tune
from insnav.input.readers.kinds import open_parts
from insnav.messages import sentence
from insnav.report.check.page import page
from insnav.report.terminal import page_text
from insnav.result import open_result
from insnav.session.check import check
from tests.input.spellings.recorded import GPS_HEADERS, IMU_HEADERS, fixes, samples, table
from tests.refusals import refused


def test_exit_codes_and_the_line(cli, tmp_path):
    imu, gps = table(tmp_path / "a.csv", samples(IMU_HEADERS)), table(tmp_path / "b.csv", fixes(GPS_HEADERS))
    good = cli("check", imu, gps, "--out", tmp_path / "checked")
    assert good.code == 0
    assert open_result(tmp_path / "checked").summary().splitlines()[0] == good.out.splitlines()[0]
    assert good.out.rstrip().splitlines()[-1] == f"run:  insnav run {imu} --gps {gps}"
    alone = cli("check", imu)
    assert alone.code == 1
    assert "nothing to copy before mend 1" in alone.out
    assert cli("check", tmp_path / "nothing.csv").code == 1


def test_a_file_of_dates_alone_is_not_understood(cli, tmp_path):
    (tmp_path / "dates.txt").write_text("".join(f"2011-09-26 13:02:{s:02d}.33509\n" for s in range(20)))
    found = cli("check", tmp_path / "dates.txt")
    assert found.code == 1
    assert "not understood" in found.out


def test_a_folder_of_a_recording_is_no_phone(cli, tmp_path):
    folder = tmp_path / "drive"
    folder.mkdir()
    table(folder / "gps.csv", fixes(GPS_HEADERS))
    imu = table(tmp_path / "imu.csv", samples(IMU_HEADERS))
    assert "folder" in cli("run", folder, "--out", tmp_path / "run").err
    (folder / "imu.csv.gz").write_bytes(gzip.compress(imu.read_bytes()))
    found = cli("check", folder)
    assert found.code == 0
    rates = [line.split() for line in found.out.splitlines() if line.strip().startswith(str(folder))]
    assert [line[1] for line in rates] == ["IMU", "GPS"]
    assert [float(line[4]) for line in rates] == [50.0, 5.0]


def test_files_may_be_given_as_for_a_run_or_as_a_folder_of_any_names(cli, tmp_path):
    imu, gps = table(tmp_path / "a.csv", samples(IMU_HEADERS)), table(tmp_path / "b.csv", fixes(GPS_HEADERS))
    ref = table(tmp_path / "c.csv", fixes(GPS_HEADERS))
    line = f"run:  insnav run {imu} --gps {gps} --ref {ref}"
    assert cli("check", imu, "--gps", gps, "--ref", ref).out.rstrip().splitlines()[-1] == line
    assert cli("check", tmp_path).out.rstrip().splitlines()[-1] == line
    assert "format.folder_of_data" in cli("run", tmp_path).err


def test_a_folder_of_any_names_is_read_by_what_its_files_hold(tmp_path):
    imu, gps = table(tmp_path / "drive.csv", samples(IMU_HEADERS)), table(tmp_path / "rover.csv", fixes(GPS_HEADERS))
    (tmp_path / "notes.txt").write_text("a fine day\n")
    for name in ("imu.csv", "drive.csv"):  # by its name a recording without fixes
        imu = imu.rename(tmp_path / name)
        assert {part: each.name for part, each in open_parts(tmp_path).items()} == {"imu": str(imu), "gps": str(gps)}
    ref = table(tmp_path / "ref.csv", fixes(GPS_HEADERS))  # only its name says that these are no fixes
    table(tmp_path / "ref_moved.csv", fixes(GPS_HEADERS))
    with refused(InputError, "format.folder_of_data"):  # rover or ref_moved?
        open_parts(tmp_path)
    gps = gps.rename(tmp_path / "gps.csv")
    named = {"imu": str(imu), "gps": str(gps), "reference": str(ref)}
    assert {part: each.name for part, each in open_parts(tmp_path).items()} == named
    (drive,), left = find_drives(tmp_path, tmp_path / "fleet", 1)
    assert drive.arguments == (str(imu), "--gps", str(gps), "--ref", str(ref))
    assert any("ref_moved" in each.subject for each in left)
    gps.unlink()
    (drive,), _ = find_drives(tmp_path, tmp_path / "fleet", 1)
    with pytest.raises(InputError, match=r"tune.no_fixes") as error:
        tune(drive.files())
    assert "--gps" not in str(error.value)


def test_a_folder_that_may_not_be_looked_into_is_no_recording(tmp_path, monkeypatch):
    monkeypatch.setattr("os.access", lambda *_: False)
    table(tmp_path / "drive.csv", samples(IMU_HEADERS)), table(tmp_path / "gps.csv", fixes(GPS_HEADERS))
    with refused(InputError, "format.folder_of_data"):
        open_parts(tmp_path)


def test_clocks_that_differ_are_spoken_of_only_where_they_do(tmp_path):
    readings = replace(check(table(tmp_path / "a.csv", samples(IMU_HEADERS))), findings=())
    for offset, said in ((None, False), (0.002, False), (0.2, True)):
        both = None if offset is None else ClockOffset(offset, 0.025, 0.9, 0.9, 300.0)
        arm = replace(
            readings.found, offset=both, mounting=Mounting(np.eye(3), 0.1, 9, 0.0, 0.0, np.eye(3), mirrored=False)
        )
        shown = page_text(page(replace(readings, found=arm)))
        assert "IMU and GPS together" in shown
        assert ("clocks that differ" in shown) == said


def test_times_in_what_is_to_be_mended_are_from_the_start(cli, tmp_path):
    cli("simulate", "city", "--fault", "imu-spike:3rad/s@200s", "--out", tmp_path / "city")
    imu = tmp_path / "city" / "imu.csv"
    head, *rows = imu.read_text().splitlines()
    later = [f"{float(time) + 5000.0:.3f},{rest}" for time, _, rest in (row.partition(",") for row in rows)]
    imu.write_text("\n".join([head, *later]))
    shown = cli("check", imu).out
    result = check(imu)
    (spike,) = of_code(result.found.problems, Code.CHECK_SPIKES)
    assert spike["count"] == 1
    at = spike.begin - result.inputs["imu"].start_s
    assert at == pytest.approx(200.0, abs=1.5)
    assert sentence(spike, at=lambda *_: f"{at:.1f} s from the start") in shown
