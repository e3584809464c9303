"""``insnav export``."""

from __future__ import annotations

from pathlib import Path

from tests.output.test_track_files import run as _run

run = _run


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
