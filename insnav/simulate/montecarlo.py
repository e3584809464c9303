"""Repetition of a task with different random numbers on several processors, with reproducible results.

Each run has a seed that depends only on its number, and results are processed in the order of these numbers. The
results thus do not depend on engine or interruptions. Figures are stored for each run. Time series are only summed over
the runs, to save memory. A `Checkpoint` stores the progress of a series, to continue after a stop.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from operator import call
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from insnav.engine import Workers, each, engine_of
from insnav.exceptions import ConfigError, InsnavError, reason_of, writing
from insnav.findings import ErrorFacts
from insnav.types import FloatArray, IntArray

KEEP_EVERY = 2.0  # interval of storing progress on disk [s]
_SEED_BITS = 53  # size of a seed [bits]: JSON readers represent larger integers inexactly
_ARRAYS = ("number", "seed", "figures", "total")


@dataclass(frozen=True, slots=True)
class Failure:
    """Run that ended in an error."""

    number: int
    seed: int
    error: ErrorFacts


@dataclass(frozen=True, slots=True)
class Runs:
    """Results of a series of runs, so far."""

    # (n,) number, from 1, and seed of the successful runs
    number: IntArray
    seed: IntArray
    figures: FloatArray  # (n, k) figures of the successful runs
    total: FloatArray  # sum of the series of the successful runs
    failures: tuple[Failure, ...]  # runs that ended in an error

    @property
    def done(self) -> int:
        """Number of finished runs, successful or not."""
        return len(self.number) + len(self.failures)

    def after(self, outcome: Sample | InsnavError, seed: int) -> Runs:
        """Add the outcome of the next run."""
        number = self.done + 1
        if isinstance(outcome, InsnavError):
            return replace(self, failures=(*self.failures, Failure(number, seed, outcome.facts)))
        first = not len(self.number)
        return replace(
            self,
            number=np.append(self.number, number),
            seed=np.append(self.seed, seed),
            figures=outcome.figures[None] if first else np.vstack([self.figures, outcome.figures]),
            total=outcome.series.copy() if first else self.total + outcome.series,
        )


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """File of the progress, with a key of all inputs of the runs. A file with another key is refused."""

    path: Path
    key: str

    def save(self, runs: Runs) -> None:
        """Replace the file atomically: after any interruption it is unchanged or complete."""
        failures = np.array(json.dumps([(each.number, each.seed, each.error.as_dict()) for each in runs.failures]))
        temporary = self.path.with_name(f"{self.path.name}.new")
        arrays = {name: getattr(runs, name) for name in _ARRAYS}
        with writing("sim.progress_unwritable", self.path):
            try:
                with temporary.open("wb") as file:
                    np.savez(file, key=np.array(self.key), failures=failures, **arrays)
                    file.flush()
                    os.fsync(file.fileno())
                temporary.replace(self.path)
            finally:  # delete it also when a signal interrupts the program
                temporary.unlink(missing_ok=True)

    def load(self) -> Runs | None:
        """Read the file; None if there is none. A file of another series or another program is refused."""
        try:
            # open the file here, as numpy does not close an invalid file
            with self.path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
                loaded = {name: file[name] for name in file.files}
            key, failures = str(loaded["key"]), json.loads(str(loaded["failures"]))
            arrays: Any = {name: loaded[name] for name in _ARRAYS}
            failed = tuple(Failure(run, seed, ErrorFacts.from_dict(error)) for run, seed, error in failures)
            runs = Runs(**arrays, failures=failed)
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
            reason = reason_of(error) if isinstance(error, OSError) else ""
            raise ConfigError("sim.progress_unreadable", where=str(self.path), reason=reason) from error
        if key != self.key:
            raise ConfigError("sim.other_series", where=str(self.path))
        return runs

    def remove(self) -> None:
        """Delete the file."""
        with contextlib.suppress(OSError):
            self.path.unlink(missing_ok=True)


@dataclass(frozen=True, slots=True)
class Sample:
    """Outcome of one run."""

    figures: FloatArray  # (k,) values stored for every run
    series: FloatArray  # summed over the runs: the same shape in each run, without NaN


class Task(Protocol):
    """Interface of one run, given its seed; picklable and without other dependencies."""

    def __call__(self, seed: int) -> Sample:
        """Execute the run."""
        ...


def run_seed(seed: int, number: int) -> int:
    """Compute the seed of run `number`, counted from 1, independent of the other seeds and of the number of runs."""
    child = np.random.SeedSequence(seed, spawn_key=(number - 1,))  # as `spawn` would give, without the other seeds
    return int(child.generate_state(1, np.uint64)[0]) >> (64 - _SEED_BITS)


def monte_carlo(
    task: Task,
    runs: int,
    seed: int,
    *,
    workers: Workers = 1,
    progress: Callable[[float], None] | None = None,
    checkpoint: Checkpoint | None = None,
) -> Runs:
    """Execute many runs of a task.

    `task`: called with the seed of each run. `checkpoint`: progress to continue from, and to store. The caller removes
    it when the result is saved.
    Returns: identical for any engine and after any interruption. A run that raises an exception, or whose process dies,
    becomes a failure and does not affect the other runs.
    Raises: ConfigError: fewer than one run or worker, a negative seed, or a checkpoint of another series.
    """
    engine_of(workers)
    if runs < 1:
        raise ConfigError("sim.no_runs", where="runs", count=runs)
    if seed < 0:
        raise ConfigError("sim.negative_seed", where="seed", seed=seed)
    none = np.zeros(0, dtype=np.int64)
    begun = (None if checkpoint is None else checkpoint.load()) or Runs(none, none, np.empty((0, 0)), np.empty(0), ())
    finished = begun
    if begun.done > runs:
        raise ConfigError("sim.more_runs_done", where="runs", done=begun.done, count=runs)
    seeds = [run_seed(seed, number) for number in range(begun.done + 1, runs + 1)]
    saved_at = time.monotonic()
    try:
        for seed_of_run, outcome in zip(seeds, each(call, seeds, workers, (task,)), strict=True):
            finished = finished.after(outcome, seed_of_run)
            if progress is not None:
                progress(finished.done / runs)
            if checkpoint is not None and time.monotonic() - saved_at > KEEP_EVERY:
                checkpoint.save(finished)
                saved_at = time.monotonic()
    finally:
        # save the finished runs, also after an interruption
        if checkpoint is not None and finished.done > begun.done:
            checkpoint.save(finished)
    return finished
