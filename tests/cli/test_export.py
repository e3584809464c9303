"""``insnav export``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.output.test_export_formats import SBET, SMRMSG, circle
from tests.output.test_export_formats import folder as _folder
from tests.output.test_track_files import run as _run
from tests.reversed_messages import as_shown

run, folder = _run, _folder


def test_a_run_is_exported_once(cli, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = run()
    assert cli("export", folder, "--to", "gpx").code == 0
    assert "<trkpt" in (tmp_path / "track.gpx").read_text()
    again = cli("export", folder, "--to", "gpx")
    assert again.code == 4
    assert "exists" in again.err
    assert cli("export", folder, "--to", "gpx", "--force").code == 0


def test_what_cannot_be_exported_is_said(cli, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli("export", "nowhere", "--to", "gpx").code == 3
    assert cli("export", run(), "--to", "shp").code == 2
    assert cli("export", run(start=5.0, week=None), "--to", "nmea").code == 2
    assert cli("export", run(), "--to", "csv", "--out", "no/such/folder.csv").code == 4
    damaged = run()
    table = next(Path(damaged).glob("s*.csv"))
    head, first, *rows = table.read_text().splitlines()
    lost = ",".join([first.split(",")[0], "nan", *first.split(",")[2:]])
    for file in Path(damaged).glob("s*.csv"):
        file.write_text("\n".join([head, lost, *rows]) + "\n")
    shown = cli("export", damaged, "--to", "gpx", "--out", "x.gpx")
    assert (shown.code, "session.rows_without_position" in shown.err) == (3, True)


def test_the_command_writes_both_files_of_an_sbet(cli, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    place = folder(circle())
    assert cli("export", place, "--to", "sbet", "--rate", "50").code == 0
    count = len(np.fromfile("sbet_track.out", SBET))
    assert count == len(np.fromfile("smrmsg_track.out", SMRMSG)) > 900
    (tmp_path / "sbet_track.out").unlink()
    assert cli("export", place, "--to", "sbet").code == 4  # the other file is there
    (tmp_path / "t.txt").write_text("604791.51\n700000\n")
    shown = cli("export", place, "--to", "utm", "--epochs", "t.txt", "--point", "1,0,0")
    assert shown.code == 0
    assert f"1{as_shown(' of ')}2" in shown.err
    assert cli("export", place, "--to", "csv", "--poses").code == 3
