"""``insnav compare --tum``: the errors that insnav counts are those that evo finds in the files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import QUICK, Cli

SCALE = 1e-9  # agreement [m], [deg]


@pytest.fixture
def compared(drive: Path, cli: Cli) -> dict[str, dict]:
    """Figures of two runs by insnav, and the files for evo in tum/."""
    for name, arm in (("right", "0.8,-0.3,-1.2"), ("wrong", "0.8,-0.3,0.8")):
        assert cli("run", *QUICK, "--lever-arm", arm, "--out", name).code == 0
    done = cli("compare", "right", "wrong", "--ref", "ref.csv", "--tum", "tum", "--json")
    assert done.code == 0, done.err
    ends = {"filtered": "", "smoothed": "-smoothed"}
    return {row["run"] + ends[row["solution"]]: row["accuracy"] for row in json.loads(done.out)}


def test_evo_finds_the_same_errors(compared: dict[str, dict], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("HOME", str(tmp_path))  # evo writes its settings there
    pytest.importorskip("evo", reason="evo is not installed")
    from evo.core import metrics, sync
    from evo.tools import file_interface

    truth = file_interface.read_tum_trajectory_file("tum/reference.tum")
    for name, own in compared.items():
        run = file_interface.read_tum_trajectory_file(f"tum/{name}.tum")
        assert run.num_poses == truth.num_poses == own["n"]
        pair = sync.associate_trajectories(truth, run)
        ape = metrics.APE(metrics.PoseRelation.translation_part)
        ape.process_data(pair)
        rms = np.sqrt(sum(own[axis]["rms"] ** 2 for axis in ("north_m", "east_m", "down_m")))
        print(f"{name}: evo {ape.get_statistic(metrics.StatisticsType.rmse):.12f} m, insnav {rms:.12f} m")
        assert abs(ape.get_statistic(metrics.StatisticsType.rmse) - rms) < SCALE
        up = pair[1].positions_xyz[:, 2] - pair[0].positions_xyz[:, 2]
        assert np.sqrt(np.mean(up**2)) == pytest.approx(own["down_m"]["rms"], rel=1e-3)
        turned = metrics.APE(metrics.PoseRelation.rotation_angle_deg)
        turned.process_data(pair)
        about = np.sqrt(sum(own[axis]["rms"] ** 2 for axis in ("roll_deg", "pitch_deg", "heading_deg")))
        assert turned.get_statistic(metrics.StatisticsType.rmse) == pytest.approx(about, rel=0.02)
    assert compared["wrong"]["down_m"]["rms"] > compared["right"]["down_m"]["rms"] + 1.0


def test_the_files_hold_places_of_the_drive(compared: dict[str, dict]):
    rows = np.loadtxt("tum/right.tum")
    assert rows.shape == (compared["right"]["n"], 8)
    np.testing.assert_allclose(np.linalg.norm(rows[:, 4:], axis=1), 1.0, atol=1e-12)
    moved = np.linalg.norm(np.diff(rows[:, 1:4], axis=0), axis=1).sum()
    assert 50.0 < moved < 5000.0


def test_an_existing_folder_is_left_alone(compared: dict[str, dict], cli: Cli):
    assert cli("compare", "right", "--ref", "ref.csv", "--tum", "tum").code == 4
    done = cli("compare", "right", "--ref", "ref.csv", "--tum", "tum", "--force")
    assert done.code == 0
    assert not Path("tum/wrong.tum").exists()
