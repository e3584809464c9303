"""Repetition of a task with other random numbers on several processors, with reproducible results.

Every run has a seed that depends on its number alone; results are taken in the order of the numbers. The outcome thus
does not depend on engine or interruptions. Only the figures of each run are stored; series are summed as they arrive,
so memory does not grow with the number of runs. A `Checkpoint` stores the progress of a series, to continue after a
stop.
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
_SEED_BITS = 53  # largest integers of JSON readers
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
    figures: FloatArray  # (n, k) their figures
    total: FloatArray  # sum of their series
    failures: tuple[Failure, ...]  # failed runs

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
    """File of the progress, with a key of everything the runs depend on: another key is refused."""

    path: Path
    key: str

    def save(self, runs: Runs) -> None:
        """Replace the file atomically: after any interruption it is unchanged or complete."""
        failures = np.array(json.dumps([(each.number, each.seed, each.error.as_dict()) for each in runs.failures]))
        aside = self.path.with_name(f"{self.path.name}.new")
        arrays = {name: getattr(runs, name) for name in _ARRAYS}
        with writing("sim.progress_unwritable", self.path):
            try:
                with aside.open("wb") as file:
                    np.savez(file, key=np.array(self.key), failures=failures, **arrays)
                    file.flush()
                    os.fsync(file.fileno())
                aside.replace(self.path)
            finally:  # also after a signal
                aside.unlink(missing_ok=True)

    def load(self) -> Runs | None:
        """Read the file; None without a file. A file of other runs, or of another program, is refused."""
        try:
            # opened here: numpy does not close an invalid file
            with self.path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
                held = {name: file[name] for name in file.files}
            key, failures = str(held["key"]), json.loads(str(held["failures"]))
            arrays: Any = {name: held[name] for name in _ARRAYS}
            failed = tuple(Failure(run, seed, ErrorFacts.from_dict(error)) for run, seed, error in failures)
            found = Runs(**arrays, failures=failed)
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
            reason = reason_of(error) if isinstance(error, OSError) else ""
            raise ConfigError("sim.progress_unreadable", where=str(self.path), reason=reason) from error
        if key != self.key:
            raise ConfigError("sim.other_series", where=str(self.path))
        return found

    def remove(self) -> None:
        """Delete the progress."""
        with contextlib.suppress(OSError):
            self.path.unlink(missing_ok=True)


@dataclass(frozen=True, slots=True)
class Sample:
    """Outcome of one run."""

    figures: FloatArray  # (k,) stored for every run
    series: FloatArray  # summed over the runs: of equal shape, without NaN


class Task(Protocol):
    """Interface of one run, given its seed; picklable and without other dependencies."""

    def __call__(self, seed: int) -> Sample:
        """Execute the run."""
        ...


def run_seed(seed: int, number: int) -> int:
    """Compute the seed of a run, counted from 1: independent of all others and of their number."""
    child = np.random.SeedSequence(seed, spawn_key=(number - 1,))  # equals `spawn`, one at a time
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
    becomes a failure and does not affect others.
    Raises: ConfigError: fewer than one run or worker, a negative seed, or a checkpoint of another series.
    """
    engine_of(workers)
    if runs < 1:
        raise ConfigError("sim.no_runs", where="runs", count=runs)
    if seed < 0:
        raise ConfigError("sim.negative_seed", where="seed", seed=seed)
    none = np.zeros(0, dtype=np.int64)
    begun = (None if checkpoint is None else checkpoint.load()) or Runs(none, none, np.empty((0, 0)), np.empty(0), ())
    found = begun
    if begun.done > runs:
        raise ConfigError("sim.more_runs_done", where="runs", done=begun.done, count=runs)
    seeds = [run_seed(seed, number) for number in range(begun.done + 1, runs + 1)]
    kept = time.monotonic()
    try:
        for own, outcome in zip(seeds, each(call, seeds, workers, (task,)), strict=True):
            found = found.after(outcome, own)
            if progress is not None:
                progress(found.done / runs)
            if checkpoint is not None and time.monotonic() - kept > KEEP_EVERY:
                checkpoint.save(found)
                kept = time.monotonic()
    finally:
        # also after a stop: finished runs are kept
        if checkpoint is not None and found.done > begun.done:
            checkpoint.save(found)
    return found
