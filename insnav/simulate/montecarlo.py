"""The same task many times with other random numbers, on several processors, always with the same result.

Every run has a seed of its own, which depends on its number alone; results are taken in the order of the numbers. So
neither the number of workers nor a pause changes a bit of the outcome. Only the figures of each run are kept; series
are added up as they come, so memory does not grow with the number of runs.

Workers are processes: much of a run is Python, and the compiled kernels keep the interpreter's lock.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from insnav.exceptions import ConfigError, InsnavError
from insnav.simulate.checkpoint import Checkpoint, Progress
from insnav.types import FloatArray, IntArray

KEEP_EVERY = 2.0  # progress is kept on the disk so often [s]
IDLE = 10.0  # workers without work end after this [s]
_SEED_BITS = 53  # readers of JSON know integers up to here


@dataclass(frozen=True, slots=True)
class Sample:
    """What one run comes to."""

    figures: FloatArray  # (k,) kept for every run
    series: FloatArray  # added up over the runs: of the same shape in all of them, without NaN


class Task(Protocol):
    """One run, given its seed; it must be picklable and depend on nothing else."""

    def __call__(self, seed: int) -> Sample:
        """Make the run."""
        ...


@dataclass(frozen=True, slots=True)
class Failure:
    """A run that ended in an error: its number, its seed, and why."""

    number: int
    seed: int
    reason: str


@dataclass(frozen=True, slots=True)
class Runs:
    """What all runs came to."""

    # (n,) number, from 1, and seed of the runs that ended well
    number: IntArray
    seed: IntArray
    figures: FloatArray  # (n, k) their figures
    total: FloatArray  # sum of their series
    failures: tuple[Failure, ...]  # the others


def run_seed(seed: int, number: int) -> int:
    """Seed of a run, counted from 1, of a series: independent of all others, and the same however many there are."""
    child = np.random.SeedSequence(seed, spawn_key=(number - 1,))  # what `spawn` gives, one at a time
    return int(child.generate_state(1, np.uint64)[0]) >> (64 - _SEED_BITS)


def monte_carlo(
    task: Task,
    runs: int,
    seed: int,
    *,
    workers: int = 1,
    progress: Callable[[float], None] | None = None,
    checkpoint: Checkpoint | None = None,
) -> Runs:
    """Make many runs of a task.

    `task`: called with the seed of each run. Large arrays in it are shared by the workers, not copied; `workers`:
    processes; with one, everything happens in this process; `checkpoint`: where to continue from, and to keep what is
    done. The caller removes it when the result is safe.
    Returns: the same, bit for bit, for any number of workers and after any interruption. A run that raises an
    exception, or whose process dies, becomes a failure and leaves the others alone.
    Raises: ConfigError: fewer than one run or worker, a negative seed, or a checkpoint of another series.
    """
    for name, value, least in (("runs", runs, 1), ("workers", workers, 1), ("seed", seed, 0)):
        if value < least:
            raise ConfigError(f"{value} is not a number of {name}" if least else f"{value} is not a seed", where=name)
    found = checkpoint.load() if checkpoint is not None else None
    tally = _Tally(found)
    if tally.done > runs:
        raise ConfigError(f"{tally.done} runs have been made already", where="runs", why=f"{runs} are wanted")
    wanted = range(tally.done + 1, runs + 1)
    kept = time.monotonic()
    try:
        for outcome in _outcomes(task, wanted, seed, min(workers, max(len(wanted), 1))):
            tally.add(outcome)
            if progress is not None:
                progress(tally.done / runs)
            if checkpoint is not None and time.monotonic() - kept > KEEP_EVERY:
                checkpoint.save(tally.progress())
                kept = time.monotonic()
    finally:
        # stopped, too: what is done need not be done again
        if checkpoint is not None and tally.done > (found.done if found is not None else 0):
            checkpoint.save(tally.progress())
    return tally.runs(seed, runs)


class _Tally:
    """Figures of the runs so far, and the sum of their series."""

    def __init__(self, found: Progress | None) -> None:
        self.done = found.done if found is not None else 0
        self._number = found.number.tolist() if found is not None else []
        self._figures = [*found.figures] if found is not None else []
        self._total = found.total if found is not None and len(found.number) else None
        self._failures = list(found.failures) if found is not None else []

    def add(self, outcome: Sample | str) -> None:
        """Take the outcome of the next run."""
        self.done += 1
        if isinstance(outcome, str):
            self._failures.append((self.done, outcome))
            return
        self._number.append(self.done)
        self._figures.append(outcome.figures)
        self._total = outcome.series.copy() if self._total is None else self._total + outcome.series

    def progress(self) -> Progress:
        total = np.empty(0) if self._total is None else self._total
        return Progress(self.done, np.array(self._number, dtype=np.int64), self._rows(), total, tuple(self._failures))

    def runs(self, seed: int, count: int) -> Runs:
        """The first `count` runs; there may be no more than these."""
        state = self.progress()
        seeds = np.array([run_seed(seed, number) for number in self._number], dtype=np.int64)
        failures = tuple(Failure(number, run_seed(seed, number), reason) for number, reason in state.failures)
        return Runs(state.number, seeds, state.figures, state.total, failures)

    def _rows(self) -> FloatArray:
        return np.array(self._figures, dtype=np.float64) if self._figures else np.empty((0, 0))


def _outcomes(task: Task, wanted: range, seed: int, workers: int) -> Iterator[Sample | str]:
    """Outcome of every wanted run, in order: a sample, or why there is none."""
    if workers == 1:
        for number in wanted:
            yield _attempt(task, run_seed(seed, number))
        return
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    next_one, alone_until = wanted.start, wanted.start
    while next_one < wanted.stop:
        alone = next_one < alone_until
        batch = _Dispatched(range(next_one, next_one + 1 if alone else wanted.stop))
        try:
            for outcome in _in_processes(task, batch, seed, workers):
                next_one += 1
                yield outcome
        except TerminatedWorkerError as error:
            # A process died, by lack of memory for one, and took the runs that were under way with it. Each of them
            # gets another chance in a process of its own; the one that fails again is to blame.
            if alone:
                next_one += 1
                yield f"its process died: {str(error).split('. ')[0]}"
            else:
                alone_until = batch.last + 1


class _Dispatched:
    """Numbers handed out so far."""

    def __init__(self, numbers: range) -> None:
        self._numbers = numbers
        self.last = numbers.start

    def __iter__(self) -> Iterator[int]:
        for number in self._numbers:
            self.last = number
            yield number


def _in_processes(task: Task, numbers: _Dispatched, seed: int, workers: int) -> Iterator[Sample | str]:
    from joblib import Parallel, delayed, parallel_config

    with parallel_config(backend="loky", inner_max_num_threads=1):
        pool = Parallel(
            n_jobs=workers, return_as="generator", idle_worker_timeout=IDLE, initializer=serve, initargs=(os.getpid(),)
        )
        yield from pool(delayed(_attempt)(task, run_seed(seed, number)) for number in numbers)


def serve(parent: int) -> None:
    """Set up a worker: Ctrl-C is for the first process to decide about, and nobody works on when that is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


def _attempt(task: Task, seed: int) -> Sample | str:
    try:
        return task(seed)
    except InsnavError as error:
        return "; ".join(text for text in (error.what, error.why) if text)
    except Exception as error:
        return f"{type(error).__name__}: {error}"
