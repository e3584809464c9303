"""``insnav export``."""

from __future__ import annotations

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
