"""`insnav run --mechanization short` shows the error of the short form and leaves the solution as it is."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.conftest import QUICK, Cli
from tests.shared import verify_folder


def test_the_short_form_is_reported_beside_the_full_one(drive: Path, cli: Cli):
    plain = cli("run", *QUICK, "--out", "full")
    shown = cli("run", *QUICK[:-1], "png", "--mechanization", "short", "--out", "short", "-v")
    assert plain.code == shown.code == 0, shown.err
    facts, before = verify_folder(Path("short")), verify_folder(Path("full"))
    assert "short_mechanization" not in before
    found = facts["short_mechanization"]
    assert found["windows"] >= 1
    last = found["after_60_s"]
    assert 0.0 < last["position_m"]["rms"] <= last["position_m"]["max"] < 20.0
    # the drive is short and slow: dropping the Earth's rate from the attitude costs most, 1/6 g W cos(L) t^3
    assert last["position_if_dropped_from_attitude_too_m"]["rms"] == pytest.approx(17.0, rel=0.2)
    assert (Path("short/solution.csv")).read_bytes() == (Path("full/solution.csv")).read_bytes()
    assert Path("short/figures/short_mechanization.png").exists()
    assert "Short-duration mechanization" in Path("short/report.html").read_text(encoding="utf-8")
    assert "Short-duration mechanization minus the full one" in shown.out
    assert "Short-duration" not in plain.out
    header = Path("short/short.csv").read_text(encoding="utf-8").splitlines()[0]
    assert header.startswith("time_s,window_start_s,position_n_m,position_e_m,position_d_m,velocity_n_m_s")
