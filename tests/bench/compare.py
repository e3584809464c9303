"""insnav and pyins in turn on one slice of a job, from the same start with the same figures.

A process of its own with a single thread for matrices: at these sizes further threads only spin, which doubles
the CPU time of pyins and would flatter the ratio.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

from tests.bench.child import run_child
from tests.bench.job import Job, generator

ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in ("OPENBLAS", "MKL", "OMP")}
INSNAV_REPEAT = 5


@dataclass(frozen=True)
class Pair:
    """CPU time of each filter for a sample [us], and RMS of North, East, Down of each [m]."""

    insnav_us: float
    pyins_us: float
    insnav_rms_m: list[float]
    pyins_rms_m: list[float]

    @property
    def ratio(self) -> float:
        return self.pyins_us / self.insnav_us


def side_by_side(job: Job, seconds: float, settled: float) -> Pair:
    """Filter the first `seconds` with both; RMS from `settled` on, as a proof that both do the job."""
    call = ["-m", "tests.bench.compare", str(job.folder), job.scenario, f"{seconds:g}", f"{settled:g}"]
    return Pair(**json.loads(run_child([sys.executable, *call], **ONE_THREAD).stdout))


def _measure(job: Job, seconds: float, settled: float) -> Pair:
    import numpy as np

    from insnav.units import DEG
    from tests.bench.accuracy import Truth, rms
    from tests.bench.filtering import best_cpu, read_recording

    generator()  # pyins computes with the Earth of the truth
    from tests.bench.peer import run_pyins

    part = read_recording(job).first(seconds)
    peer = run_pyins(part.imu, part.gps, job.start, seconds)
    done, cpu = best_cpu(part, given_start=True, repeat=INSNAV_REPEAT)
    truth = Truth(job.path("ref.csv"), part.start.time + settled)
    solution = done.run.solution
    lla_deg = np.column_stack([solution.lla[:, :2] / DEG, solution.lla[:, 2]])
    return Pair(
        1e6 * cpu / part.samples,
        1e6 * peer.cpu_s / peer.samples,
        rms(truth.position_errors(solution.time, lla_deg)),
        rms(truth.position_errors(peer.time, peer.lla_deg)),
    )


if __name__ == "__main__":
    folder, scenario, *numbers = sys.argv[1:]
    print(json.dumps(asdict(_measure(Job(Path(folder), scenario), *map(float, numbers)))))
