"""What `insnav tune` takes and leaves behind."""

from __future__ import annotations

from pathlib import Path

from tests.cli.conftest import Cli


def test_tune_takes_one_drive_as_files(drive: Path, cli: Cli):
    refused = cli("tune", "imu.csv", "other.csv", "--gps", "gps.csv")
    assert refused.code == 2
    assert "tune.fixes_of_several_drives" in refused.err
    done = cli("tune", "imu.csv", "--gps", "gps.csv", "--lever-arm", "0.8,-0.3,-1.2")
    assert done.code == 0, done.err
    assert "drives: 1" in done.out
    assert Path("tune/imu.toml").is_file()
