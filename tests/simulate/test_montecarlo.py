"""Many runs: the same bits whatever the number of workers or interruptions, and no run spoils the others."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import tracemalloc
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from insnav.exceptions import ConfigError, OutputError
from insnav.simulate.montecarlo import Checkpoint, Sample, monte_carlo, run_seed
from tests.refusals import refused

ROOT = Path(__file__).parents[2]
SEED = 7
linux = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")


@dataclass(frozen=True)
class Draw:
    """Three normal numbers and a series that does not add up to the same bits in another order."""

    offset: np.ndarray
    poor: int = 0  # number of a run that raises
    deadly: int = 0  # number of a run whose process dies
    stop: int = 0  # number of a run at which the user stops the program

    def __call__(self, seed: int) -> Sample:
        if seed == run_seed(SEED, self.stop or 10**6):
            raise KeyboardInterrupt
        if seed == run_seed(SEED, self.poor or 10**6):
            raise OutputError("output.file_unwritable", reason="full")
        if seed == run_seed(SEED, self.deadly or 10**6):
            os._exit(3)
        rng = np.random.default_rng(seed)
        return Sample(rng.standard_normal(3), rng.standard_normal((50, 4)) * self.offset[:50, None])


TASK = Draw(np.linspace(0.1, 1e6, 200_000))  # large enough to be shared with the workers, not copied


def same(one, two) -> bool:
    return (
        one.figures.tobytes() == two.figures.tobytes()
        and one.total.tobytes() == two.total.tobytes()
        and one.number.tolist() == two.number.tolist()
        and one.failures == two.failures
    )


@pytest.fixture(scope="module")
def alone():
    return monte_carlo(TASK, 40, SEED)


def test_one_worker_and_two_give_the_same_bits(alone):
    assert same(monte_carlo(TASK, 40, SEED, workers=2), alone)


def test_figures_are_kept_and_series_added_up(alone):
    samples = [TASK(seed) for seed in alone.seed]
    np.testing.assert_array_equal(alone.figures, [sample.figures for sample in samples])
    np.testing.assert_allclose(alone.total, np.sum([sample.series for sample in samples], axis=0), rtol=1e-9)


def test_seeds_are_those_of_spawned_sequences_and_do_not_depend_on_how_many_there_are(alone):
    children = np.random.SeedSequence(SEED).spawn(40)
    assert alone.seed.tolist() == [int(child.generate_state(1, np.uint64)[0]) >> 11 for child in children]
    assert alone.seed.max() < 2**53
    few = monte_carlo(TASK, 10, SEED)
    np.testing.assert_array_equal(few.figures, alone.figures[:10])
    assert not np.isin(monte_carlo(TASK, 10, SEED + 1).seed, alone.seed).any()


def test_runs_are_independent():
    drawn = monte_carlo(TASK, 2000, SEED).figures
    bound = 4.0 / np.sqrt(2000)  # four standard deviations
    assert np.abs(drawn.mean(axis=0)).max() < bound
    assert np.abs(np.mean(drawn[1:] * drawn[:-1], axis=0)).max() < bound
    assert np.abs(np.mean(drawn**2, axis=0) - 1.0).max() < bound * np.sqrt(2.0)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_run_that_fails_is_named_and_the_others_are_kept(alone, workers):
    found = monte_carlo(Draw(TASK.offset, poor=5), 12, SEED, workers=workers)
    (failure,) = found.failures
    assert (failure.number, failure.seed) == (5, run_seed(SEED, 5))
    assert failure.error.values == (("reason", "full"),)
    assert found.number.tolist() == [1, 2, 3, 4, 6, 7, 8, 9, 10, 11, 12]
    np.testing.assert_array_equal(found.figures, np.delete(alone.figures[:12], 4, axis=0))


def test_a_run_whose_process_dies_is_named_and_the_others_are_kept(alone):
    found = monte_carlo(Draw(TASK.offset, poor=9, deadly=5), 20, SEED, workers=2)
    assert [failure.number for failure in found.failures] == [5, 9]
    np.testing.assert_array_equal(found.figures, np.delete(alone.figures[:20], [4, 8], axis=0))


def test_a_stopped_series_goes_on_to_the_same_bits(alone, tmp_path):
    checkpoint = Checkpoint(tmp_path / "unfinished", "key")
    with pytest.raises(KeyboardInterrupt):
        monte_carlo(Draw(TASK.offset, stop=17), 40, SEED, checkpoint=checkpoint)
    assert checkpoint.load().done == 16
    seen = []
    found = monte_carlo(TASK, 40, SEED, workers=2, checkpoint=checkpoint, progress=seen.append)
    assert same(found, alone)
    assert seen[0] == 17 / 40
    assert seen[-1] == 1.0
    assert same(monte_carlo(Draw(TASK.offset, poor=1), 40, SEED, checkpoint=checkpoint), alone)  # nothing left to do
    checkpoint.remove()
    assert not list(tmp_path.iterdir())


def test_failures_survive_a_stop(tmp_path):
    checkpoint = Checkpoint(tmp_path / "unfinished", "key")
    with pytest.raises(KeyboardInterrupt):
        monte_carlo(Draw(TASK.offset, poor=1, stop=2), 4, SEED, checkpoint=checkpoint)
    found = monte_carlo(TASK, 4, SEED, checkpoint=checkpoint)
    assert [failure.number for failure in found.failures] == [1]
    assert found.number.tolist() == [2, 3, 4]


def test_a_stop_while_it_is_written_leaves_no_part_of_a_checkpoint(tmp_path, monkeypatch):
    checkpoint = Checkpoint(tmp_path / "unfinished", "key")
    monte_carlo(TASK, 2, SEED, checkpoint=checkpoint)

    def stopped(file, **_):
        file.write(b"a part")
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez", stopped)
    with pytest.raises(KeyboardInterrupt):
        monte_carlo(TASK, 3, SEED, checkpoint=checkpoint)
    assert [path.name for path in tmp_path.iterdir()] == ["unfinished"]


def test_a_checkpoint_of_other_runs_or_of_nobody_is_refused(tmp_path):
    path = tmp_path / "unfinished"
    monte_carlo(TASK, 3, SEED, checkpoint=Checkpoint(path, "one"))
    with refused(ConfigError, "sim.other_series"):
        monte_carlo(TASK, 3, SEED, checkpoint=Checkpoint(path, "two"))
    with refused(ConfigError, "sim.more_runs_done"):
        monte_carlo(TASK, 2, SEED, checkpoint=Checkpoint(path, "one"))
    for content in (b"", b"text", path.read_bytes()[:100]):
        path.write_bytes(content)
        with refused(ConfigError, "sim.progress_unreadable"):
            monte_carlo(TASK, 3, SEED, checkpoint=Checkpoint(path, "one"))


def test_a_checkpoint_with_failures_in_words_is_refused(tmp_path):
    """Earlier versions kept the sentence of an error, not its code."""
    path = tmp_path / "unfinished"
    monte_carlo(Draw(TASK.offset, poor=1), 3, SEED, checkpoint=Checkpoint(path, "one"))
    with np.load(path) as file:
        held = {name: file[name] for name in file.files}
    failures = json.dumps([(1, run_seed(SEED, 1), "The GPS is poor.")])
    with path.open("wb") as stream:
        np.savez(stream, **held | {"failures": np.array(failures)})
    with refused(ConfigError, "sim.progress_unreadable"):
        monte_carlo(TASK, 4, SEED, checkpoint=Checkpoint(path, "one"))


def test_a_checkpoint_that_cannot_be_written_is_an_output_error(tmp_path):
    with refused(OutputError, "sim.progress_unwritable"):
        monte_carlo(TASK, 3, SEED, checkpoint=Checkpoint(tmp_path / "none" / "unfinished", "key"))


@pytest.mark.parametrize(("runs", "seed", "workers"), [(0, 1, 1), (1, -1, 1), (1, 1, 0)])
def test_what_makes_no_sense_is_refused(runs, seed, workers):
    with pytest.raises(ConfigError):
        monte_carlo(TASK, runs, seed, workers=workers)


def long_series(seed: int) -> Sample:
    return Sample(np.array([float(seed % 7)]), np.full(100_000, 1.0))


def test_memory_does_not_grow_with_the_number_of_runs():
    peaks = []
    for runs in (5, 60):
        tracemalloc.start()
        monte_carlo(long_series, runs, SEED)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.5 * peaks[0]


PROGRAM = """
import os, signal, sys, time
from pathlib import Path
import numpy as np
from insnav.simulate.montecarlo import Sample, monte_carlo

class Endless:
    def __call__(self, seed):
        (Path(sys.argv[1]) / str(os.getpid())).touch()
        time.sleep(3600.0)
        return Sample(np.zeros(1), np.zeros(1))

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may start jobs that ignore it
    monte_carlo(Endless(), 10_000, 1, workers=2)
"""


def working(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


@linux
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_no_worker_is_left_behind(tmp_path, number):
    (tmp_path / "pids").mkdir()
    (tmp_path / "program.py").write_text(PROGRAM)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, str(tmp_path / "program.py"), str(tmp_path / "pids")]
    with subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL) as process:
        give_up = time.monotonic() + 60.0
        while len(pids := [int(path.name) for path in (tmp_path / "pids").iterdir()]) < 2:
            assert time.monotonic() < give_up, "the workers never began"
            time.sleep(0.05)
        process.send_signal(number)
        try:
            process.wait(60)
        finally:
            process.kill()
    while any(working(pid) for pid in pids):
        assert time.monotonic() < give_up, "a worker goes on"
        time.sleep(0.05)
