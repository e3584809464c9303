"""A file that remembers how far a long series of runs has come, so that a stopped one can go on."""

from __future__ import annotations

import contextlib
import json
import os
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from insnav.exceptions import ConfigError, OutputError
from insnav.types import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Progress:
    """What is known of a series after its first `done` runs."""

    done: int  # runs that have ended, well or not
    number: IntArray  # (n,) numbers of those that ended well
    figures: FloatArray  # (n, k) what each of them came to
    total: FloatArray  # sum of their series
    failures: tuple[tuple[int, str], ...]  # number and reason of the others


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """Where progress is kept, and a key of everything the runs depend on: progress of another key is refused."""

    path: Path
    key: str

    def save(self, progress: Progress) -> None:
        """Replace the file in one step: whatever stops the program, it is as it was or complete."""
        aside = self.path.with_name(f"{self.path.name}.new")
        try:
            with aside.open("wb") as file:
                np.savez(
                    file,
                    key=np.array(self.key),
                    done=np.array(progress.done),
                    number=progress.number,
                    figures=progress.figures,
                    total=progress.total,
                    failures=np.array(json.dumps(progress.failures)),
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

    def load(self) -> Progress | None:
        """Read the file; None if there is none. A file of other runs, or of another program, is refused."""
        try:
            # opened here: numpy leaves a file open that turns out to be none of its own
            with self.path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
                held = {name: file[name] for name in file.files}
            key, failures = str(held["key"]), json.loads(str(held["failures"]))
            found = Progress(
                int(held["done"]),
                held["number"],
                held["figures"],
                held["total"],
                tuple((int(number), str(reason)) for number, reason in failures),
            )
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
