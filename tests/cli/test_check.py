"""``insnav check``: its exit code, and folders of a recording."""

from __future__ import annotations

import gzip

from tests.input.spellings.recorded import GPS_HEADERS, IMU_HEADERS, fixes, samples, table


def test_exit_codes_and_the_line(cli, tmp_path):
    imu, gps = table(tmp_path / "a.csv", samples(IMU_HEADERS)), table(tmp_path / "b.csv", fixes(GPS_HEADERS))
    good = cli("check", imu, gps)
    assert good.code == 0
    assert good.out.rstrip().splitlines()[-1] == f"run:  insnav run {imu} --gps {gps}"
    alone = cli("check", imu)
    assert alone.code == 1
    assert "nothing to copy before mend 1" in alone.out
    assert cli("check", tmp_path / "nothing.csv").code == 1


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
    assert f"insnav check {tmp_path}" in " ".join(cli("run", tmp_path).err.split())
