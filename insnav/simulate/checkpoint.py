"""A file that remembers how far a long series of runs has come, so that a stopped one can go on."""

from __future__ import annotations

import contextlib
import json
import os
import zipfile
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from insnav.exceptions import ConfigError, OutputError
from insnav.types import FloatArray, IntArray

_ARRAYS = ("number", "seed", "figures", "total")


@dataclass(frozen=True, slots=True)
class Failure:
    """A run that ended in an error: its number, its seed, and why."""

    number: int
    seed: int
    reason: str


@dataclass(frozen=True, slots=True)
class Runs:
    """What a series of runs came to, so far."""

    # (n,) number, from 1, and seed of the runs that ended well
    number: IntArray
    seed: IntArray
    figures: FloatArray  # (n, k) their figures
    total: FloatArray  # sum of their series
    failures: tuple[Failure, ...]  # the others

    @property
    def done(self) -> int:
        """Runs that have ended, well or not."""
        return len(self.number) + len(self.failures)


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """Where progress is kept, and a key of everything the runs depend on: progress of another key is refused."""

    path: Path
    key: str

    def save(self, runs: Runs) -> None:
        """Replace the file in one step: whatever stops the program, it is as it was or complete."""
        aside = self.path.with_name(f"{self.path.name}.new")
        try:
            with aside.open("wb") as file:
                np.savez(
                    file,
                    key=np.array(self.key),
                    failures=np.array(json.dumps([astuple(each) for each in runs.failures])),
                    **{name: getattr(runs, name) for name in _ARRAYS},
                )
                file.flush()
                os.fsync(file.fileno())
            aside.replace(self.path)
        except OSError as error:
            raise OutputError(
                "the runs done so far cannot be kept",
                where=str(self.path),
                why=error.strerror or str(error),
                fix="make room or choose another folder with --out",
            ) from error

    def load(self) -> Runs | None:
        """Read the file; None if there is none. A file of other runs, or of another program, is refused."""
        try:
            # opened here: numpy leaves a file open that turns out to be none of its own
            with self.path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
                held = {name: file[name] for name in file.files}
            key, failures = str(held["key"]), json.loads(str(held["failures"]))
            arrays: Any = {name: held[name] for name in _ARRAYS}
            found = Runs(**arrays, failures=tuple(Failure(*each) for each in failures))
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
            raise ConfigError(
                "the runs done so far cannot be read",
                where=str(self.path),
                why=str(error),
                fix="leave --resume out to begin anew",
            ) from error
        if key != self.key:
            raise ConfigError(
                "the unfinished series beside the output folder is another one",
                where=str(self.path),
                why="its motion, sensors, seed or options were not these, or another release of insnav made it",
                fix="repeat the options it was begun with, or leave --resume out to begin anew",
            )
        return found

    def remove(self) -> None:
        """Forget the progress."""
        with contextlib.suppress(OSError):
            self.path.unlink(missing_ok=True)
