"""Speed as ratios of times taken side by side, which a slow or busy computer does not change much."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

from tests.bench.child import run_child
from tests.bench.job import GENERATOR, PROGRAM, Job, standard_job
from tests.bench.processes import LOOP

pytestmark = [
    pytest.mark.skipif(not GENERATOR.exists(), reason=f"{GENERATOR} makes the data and is absent"),
    pytest.mark.skipif(importlib.util.find_spec("pyins") is None, reason="pyins (python-ins) is not installed"),
]

HOURS = 1 / 6
# CPU of a run of that length, or of the sample drive, in calibration loops: 1.6, 0.6 and 1.7 when this was written
LOOPS = {"nothing given": 2.4, "all given, no searches": 0.9, "sample drive": 2.5}
PEER_S, PEER_SETTLED_S, PEER_RATIO = 60.0, 30.0, 50.0
SHORT_S, LONGER, AT_MOST = 140.0, 4, 6.0  # quadratic cost would be 16


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Job:
    return standard_job(tmp_path_factory.mktemp("bench"), "mems", 1, HOURS)


def test_filter_is_far_faster_than_the_peer_and_both_navigate(job: Job) -> None:
    from tests.bench.compare import side_by_side

    pair = side_by_side(job, PEER_S, PEER_SETTLED_S)
    assert max(*pair.insnav_rms_m, *pair.pyins_rms_m) < 1.0  # speed at nothing is no speed
    assert pair.ratio >= PEER_RATIO


@pytest.mark.parametrize("case", LOOPS)
def test_the_program_costs_few_calibration_loops(job: Job, tmp_path: Path, case: str) -> None:
    """Whole processes, page and all; a loop in between each run, as machines change their pace."""
    program = {
        "nothing given": job.plain(tmp_path / "run"),
        "all given, no searches": [*job.command(tmp_path / "run", given_start=True), "--explain", "off", "--no-smooth"],
        "sample drive": ["demo", "--force", "--out", str(tmp_path / "run")],
    }[case]
    calls = {"program": ["-c", PROGRAM, *program], "loop": ["-c", LOOP]}
    run_child([sys.executable, *calls["program"]])  # compiles, if that is to do
    rounds = [{name: run_child([sys.executable, *call]) for name, call in calls.items()} for _ in range(2)]
    cost, loop = (min(each[name].cpu_s for each in rounds) for name in calls)
    print(f"{case}: {cost / loop:.2f} calibration loops of {loop:.2f} s")
    assert cost / loop <= LOOPS[case]


def test_cost_grows_in_proportion_to_the_data(job: Job) -> None:
    from tests.bench.filtering import best_cpu, read_recording

    recording = read_recording(job)
    short, long = (
        best_cpu(recording.first(seconds), given_start=True, repeat=3)[1] for seconds in (SHORT_S, LONGER * SHORT_S)
    )
    assert long / short <= AT_MOST
