"""The smoother beside the batch smoother of GTSAM, on the same files in the same run."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

from insnav.earth import ned_offset
from insnav.units import DEG
from tests.bench.job import GENERATOR, Job, standard_job

pytestmark = [
    pytest.mark.skipif(not GENERATOR.exists(), reason=f"{GENERATOR} makes the data and is absent"),
    pytest.mark.skipif(importlib.util.find_spec("pyins") is None, reason="pyins (python-ins) is not installed"),
    pytest.mark.skipif(importlib.util.find_spec("gtsam") is None, reason="gtsam is not installed (pip install gtsam)"),
]

SECONDS, SETTLED = 600.0, 240.0


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Job:
    return standard_job(tmp_path_factory.mktemp("bench"), "mems", 1, SECONDS / 3600.0)


def test_smoother_is_neither_slower_nor_less_accurate_than_the_peer(job: Job) -> None:
    from tests.bench.accuracy import Truth
    from tests.bench.filtering import best_cpu, read_recording
    from tests.bench.peer import run_gtsam

    part = read_recording(job).first(SECONDS).at_interval(0.1)
    peer = run_gtsam(part.imu, part.gps, job.start, SECONDS)
    done, cpu = best_cpu(part, given_start=True, repeat=3)
    smoothed = done.run.smoothed
    assert smoothed is not None
    truth = Truth(job.path("ref.csv"), part.start.time + SETTLED)

    def horizontal_rms(time: np.ndarray, lla: np.ndarray) -> float:
        row = np.minimum(np.searchsorted(truth.time, time - 0.05), truth.time.size - 1)
        ahead = truth.time[row] - time
        near = np.abs(ahead) < 0.051
        v_n = np.column_stack([np.interp(time, smoothed.epochs.time, v) for v in smoothed.epochs.v_n.T])
        error = ned_offset(lla, truth.lla_deg[row] * [DEG, DEG, 1.0]) + v_n * ahead[:, None]
        return float(np.sqrt(np.mean(error[near, 0] ** 2 + error[near, 1] ** 2)))

    ours = horizontal_rms(smoothed.epochs.time, smoothed.epochs.lla)
    theirs = horizontal_rms(peer.time, peer.lla_deg * [DEG, DEG, 1.0])
    print(f"horizontal RMS {ours:.4f} m, gtsam {theirs:.4f} m; CPU {cpu:.3f} s, gtsam {peer.cpu_s:.3f} s")
    assert ours <= 1.01 * theirs
    assert cpu < peer.cpu_s
