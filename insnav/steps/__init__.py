"""Steps that process a recording, with the data and the estimates that they pass on.

A step is a pure function ``step(recording, model) -> (recording, model, findings)`` in the file of its name. It imports
no other step. It reads the results of earlier steps from the recording and the model.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib import import_module
from time import perf_counter
from typing import TYPE_CHECKING, Any

from insnav.exceptions import InputError
from insnav.findings import CORRELATED_POSITIONS
from insnav.progress import announce

if TYPE_CHECKING:  # the command-line help needs only the names of inputs
    from collections.abc import Callable, Sequence

    from insnav.errors.evaluated_run import EvaluatedRun
    from insnav.explain.explanation import Explanation
    from insnav.filter.filter_input import FilterInput, Output
    from insnav.filter.navigate import AidingChoice, Navigated
    from insnav.filter.noise_estimate import NoiseEstimate
    from insnav.filter.receiver import Receiver
    from insnav.findings import Finding
    from insnav.imu.specification import ImuSpec
    from insnav.input import Reading, ReadingFacts
    from insnav.result import StepRecord
    from insnav.steps.inputs import Inputs
    from insnav.types import GpsData, ImuData, SensorLog, Source, Trajectory


STEPS = (
    "clean",  # remove invalid data
    "one_clock",  # put the samples on the clock of the fixes
    "receiver_noise",  # give each fix a standard deviation
    "imu_noise",  # choose the IMU error specification
    "mounting",  # turn the samples into the axes of the vehicle
    "align",  # estimate initial attitude, GPS delay and clock rate
    "explain",  # find the faults of fixes, clock and IMU
    "noise",  # estimate the noise of IMU and fixes from the innovations
    "lever_arm",  # compare the specified lever arm with the drive
    "navigate",  # run the filter and the smoother
    "check_given",  # check specified inputs that the solution contradicts
    "evaluate",  # compare the solution with the reference
)
LOAD = STEPS[: STEPS.index("align")]
# steps to repeat with another lever arm (`PREPARE`), and with other fixes (`ALIGN`)
PREPARE = STEPS[STEPS.index("align") : STEPS.index("lever_arm")]
ALIGN = STEPS[STEPS.index("align") : STEPS.index("explain")]
NAVIGATE = STEPS[STEPS.index("align") : STEPS.index("navigate")]  # steps that set the filter up
_STAGES = dict.fromkeys(LOAD, "checking the data") | {  # messages of the progress display, by step
    "align": "aligning",
    "explain": "looking for faults",
    **dict.fromkeys(("noise", "lever_arm"), "finding the noise"),
    "navigate": "navigating",
    **dict.fromkeys(("check_given", "evaluate"), "evaluating"),
}
_COLUMNS = ("gyro", "accel", "lla", "v_n", "position_sd", "velocity_sd")  # listed in arithmetic errors


@dataclass(frozen=True, slots=True)
class Recording:
    """Data of a recording. A step does not modify them in place, but may return others in their place."""

    imu: Reading[ImuData]
    gps: Reading[GpsData] | None
    reference: Reading[Trajectory] | None
    logs: Mapping[str, Reading[SensorLog]]  # files of further sensors, by name
    inputs: Inputs  # inputs that the user specified
    fixes: GpsData | None = None  # fixes in use, with a standard deviation for each value
    fixes_by_scatter: GpsData | None = None  # without frozen fixes; a missing sd is the scatter between fixes

    def given(self) -> dict[str, Reading[ImuData] | Reading[GpsData] | Reading[Trajectory] | Reading[SensorLog]]:
        """Return the readings by name: ``imu``, ``gps``, ``reference`` and further sensors."""
        named = {"imu": self.imu, "gps": self.gps, "reference": self.reference, **self.logs}
        return {name: each for name, each in named.items() if each is not None}

    @property
    def facts(self) -> dict[str, ReadingFacts]:
        """Interpretation of each file, by the same names."""
        return {name: each.facts for name, each in self.given().items()}


@dataclass(frozen=True, slots=True)
class Estimate:
    """Value with its standard deviation and source."""

    value: float
    sd: float  # standard deviation; 0 for a value that the filter does not estimate
    source: Source


@dataclass(frozen=True, slots=True)
class Task:
    """Options for the navigation step; see `insnav.session.drive.Drive.navigate`."""

    states: int = 21  # number of filter states: 21, or 15 without scale factor errors
    aiding: AidingChoice = "auto"
    output: Output | None = None  # outputs; by default a smoothed solution every 0.1 s
    progress: Callable[[float], None] | None = None  # function called with the fraction done


@dataclass(frozen=True, slots=True)
class Model:
    """Estimates that the steps pass on."""

    receiver: Receiver  # lever arm and delay, as specified or assumed
    imu: tuple[ImuSpec, Finding] | None = None  # error specification, and how it was chosen
    # yaw of the IMU in the vehicle, positive to the right [rad]; its source is the source of the vehicle axes
    mounting_yaw: Estimate = field(default=Estimate(0.0, 0.0, "given"))
    task: Task = field(default_factory=Task)
    ready: FilterInput | None = None  # input of the filter, after the alignment
    clock: Estimate = field(default=Estimate(0.0, 0.0, "given"))  # shift of the samples to fix time [s]
    noise: NoiseEstimate | None = None  # noise of IMU and fixes, from the innovations
    found: Mapping[str, tuple[Finding, ...]] = field(default_factory=dict)  # findings of each step's last run
    explanation: Explanation | None = None  # faults found in the recording
    solved: Navigated | None = None  # solution of filter and smoother
    evaluated: EvaluatedRun | None = None  # solution compared with the reference

    @property
    def filter_imu(self) -> ImuSpec:
        """IMU specification of the filter: the estimated one, if any."""
        assert self.imu is not None
        return self.imu[0] if self.noise is None else self.noise.spec

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings of all steps from the alignment on that precede the navigation.

        Of several findings on time-correlated errors of positions, only the last one is kept.
        """
        listed = dict.fromkeys(each for step in NAVIGATE for each in self.found.get(step, ()))
        correlated = [each for each in listed if each.code in CORRELATED_POSITIONS]
        return tuple(each for each in listed if each not in correlated[:-1])


def run_steps(
    names: Sequence[str], recording: Recording, model: Model
) -> tuple[Recording, Model, tuple[StepRecord, ...]]:
    """Run the named steps in order, announce each to the progress display, and record its findings and duration."""
    from insnav.result import StepRecord  # import late, as it is slow

    records = []
    for name in names:
        announce(_STAGES[name])
        begin = perf_counter()
        step = getattr(import_module(f"insnav.steps.{name}"), name)
        with naming_data(name, recording.imu, recording.gps):
            recording, model, findings = step(recording, model)
        model = replace(model, found={**model.found, name: findings})
        records.append(StepRecord(name, findings, perf_counter() - begin))
    return recording, model, tuple(records)


@contextmanager
def naming_data(step: str, *given: Reading[Any] | None) -> Iterator[None]:
    """Convert an arithmetic error in a step to an `InputError` that names constant columns and largest values."""
    import numpy as np

    try:
        yield
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        read = [each for each in given if each is not None]
        parts = ((name, getattr(each.data, name, None)) for name in _COLUMNS for each in read)
        columns = [(name, values) for name, values in parts if values is not None and np.isfinite(values).any()]
        raise InputError(
            "input.arithmetic",
            where=", ".join(dict.fromkeys(each.facts.path for each in read)),
            step=step,
            reason=str(error),
            constant=tuple(name for name, values in columns if np.nanmin(values) == np.nanmax(values)),
            largest=tuple(f"{name} {np.nanmax(np.abs(values)):.3g}" for name, values in columns),
        ) from error
