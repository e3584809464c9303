"""A run of the filter, evaluated against a reference where there is one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.errors.metrics import TrajectoryErrors, position_errors
from insnav.errors.reference_offset import ReferenceOffset, offset_notes, reference_offset
from insnav.errors.short_duration_errors import ShortWindow
from insnav.filter.navigate import Navigated
from insnav.filter.noise_identification import NoiseEstimate
from insnav.input.readers.reading import Reading
from insnav.types import FloatArray, GpsData, Run, Trajectory


@dataclass(frozen=True, slots=True)
class EvaluatedRun:
    """A run, the fixes it used, and its errors."""

    run: Run
    gps: GpsData | None = None  # fixes as they were used, every value with a standard deviation
    # of the filtered and of the smoothed solution against the reference
    errors: TrajectoryErrors | None = None
    smoothed_errors: TrajectoryErrors | None = None
    # short-duration mechanization against the full one, if that was asked for
    short_duration: tuple[ShortWindow, ...] = ()
    noise: NoiseEstimate | None = None  # as found in the innovations

    @property
    def reference_offset(self) -> ReferenceOffset | None:
        """Constant parts of the filter's errors, if there is a reference that tells them."""
        return None if self.errors is None else reference_offset(self.errors, self.run.solution)

    @property
    def solutions(self) -> dict[str, Trajectory]:
        """Solutions by their names, the better one first."""
        smoothed = {} if self.run.smoothed is None else {"smoothed": self.run.smoothed.solution}
        return {**smoothed, "filtered": self.run.solution}

    @property
    def known_errors(self) -> dict[str, TrajectoryErrors]:
        """Errors of the solutions, where there is a reference, the better one first."""
        both = {"smoothed": self.smoothed_errors, "filtered": self.errors}
        return {name: each for name, each in both.items() if each is not None}


def evaluate_run(
    done: Navigated, reference: Reading[Trajectory] | None = None, lever_b: FloatArray | None = None
) -> tuple[EvaluatedRun, tuple[str, ...]]:
    """Compare a run with a reference.

    `lever_b` (3,): point of the reference seen from the IMU, body axes [m].
    Raises: InputError: run and reference have no time in common.
    """
    notes = []
    errors = smoothed_errors = None
    if reference is not None:
        good = fixed_epochs(reference)
        errors = position_errors(done.run.solution, good, lever_b=lever_b)
        if done.run.smoothed is not None:
            smoothed_errors = position_errors(done.run.smoothed.solution, good, lever_b=lever_b)
        left = len(reference.data.time) - len(good.time)
        if left:
            notes.append(f"accuracy counts reference epochs with fix = 1 only; {left} others are left out")
        offset = reference_offset(errors, done.run.solution)
        notes += offset_notes(offset) if offset is not None else []
    return EvaluatedRun(done.run, done.gps, errors, smoothed_errors), tuple(notes)


def fixed_epochs(reference: Reading[Trajectory]) -> Trajectory:
    """Epochs of a reference with fixed ambiguities; all of them where the file does not tell."""
    if reference.fix is None or not (reference.fix == 1).any():
        return reference.data
    return reference.data.rows(np.asarray(reference.fix == 1))
