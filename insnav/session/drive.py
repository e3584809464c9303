"""Recorded drive: its reading, its interpretation, and all operations on it.

`load` reads data and chooses models; only the methods of `Drive` navigate. The command line uses the same functions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack, cast, get_args

import numpy as np

from insnav.alignment import find_stationary
from insnav.deferred import library
from insnav.engine import Workers, share_of
from insnav.errors.evaluated_run import EvaluatedRun, fixed_epochs, judged
from insnav.errors.metrics import at_point
from insnav.errors.outage.free_inertial import LENGTHS, WindowReference, reference_from_trajectory
from insnav.exceptions import AlignmentError, ConfigError, InputError, as_keywords
from insnav.filter.agreement import without_rejected
from insnav.filter.filter_input import FilterInput, Output
from insnav.filter.gps_noise import with_sd
from insnav.filter.navigate import AidingChoice, dense, thinned
from insnav.findings import Code, Finding, Severity, added, by_time
from insnav.imu import load_imu
from insnav.imu.specification import ImuSpec
from insnav.input import Reading
from insnav.input.readers.rows import as_epochs
from insnav.messages import sentence
from insnav.progress import announce, in_notebook
from insnav.result import Result, StepRecord
from insnav.session.read import NamedInputs, by_name, read
from insnav.steps import LOAD, STEPS, Model, Recording, Task, run_steps
from insnav.steps.given import given_model, one_of, options_of, reference_point, reference_sd, vector
from insnav.strapdown import intervals
from insnav.types import FloatArray, GpsData, ImuData, Run, Trajectory

if TYPE_CHECKING:  # slow imports happen where they are used: a run needs no budget
    from matplotlib.figure import Figure

    from insnav.errors.budget.from_windows import BudgetStudy, WindowSettings
    from insnav.errors.outage.gnss_outage import OutageStudy
    from insnav.errors.requirement.study import RequirementStudy
    from insnav.filter.fine_alignment import FineAlignment
    from insnav.session.budget import BudgetOptions, BudgetSettings
    from insnav.session.read import Given
    from insnav.session.requirement import RequirementOptions

_report = library("insnav.report.run.panels")
SHORT_REST = 10.0  # duration up to which steady motion may resemble a stop [s]
REFERENCE_SD = (0.05, None)  # sd of reference positions and velocities [m], [m/s]; None: velocities are not used


def load(
    samples: Given | ImuData,
    gps: Given | GpsData | None = None,
    ref: Given | Trajectory | None = None,
    **inputs: Unpack[NamedInputs],
) -> Drive:
    """Read a recorded drive, interpret it, and choose the IMU model.

    Parameters
    ----------
    samples : path, data frame, arrays or ImuData
        IMU data: a file of any supported format, or a data frame with the columns of such a file. Arrays are
        ``(time, gyro, accel)`` in [s], [rad/s], [m/s^2], or ``(gyro, accel)`` with ``rate=``.
    gps : path, data frame, arrays or GpsData, optional
        Fixes; arrays are ``(time, lla)`` in [s], [deg], [deg], [m].
    ref : path, data frame, arrays or Trajectory, optional
        Reference trajectory.
    **inputs
        Inputs that the data do not contain, see `insnav.steps.inputs.Inputs`. ``imu`` is the IMU error specification: a
        preset, a part, a file or an `ImuSpec`. Its older name ``imu_model`` is deprecated.

    Returns
    -------
    Drive

    Raises
    ------
    ConfigError, InputError
        An input is invalid, or the data cannot be used.

    Examples
    --------
    >>> drive = insnav.load("imu.csv", "gps.csv", imu="automotive", lever_arm=(0.8, -0.3, -1.2))  # doctest: +SKIP
    >>> drive.navigate().save("run1")  # doctest: +SKIP
    """
    return drive_of(read(samples, gps, ref, by_name(inputs)))


def align(
    samples: Given | ImuData, gps: Given | GpsData | None = None, **inputs: Unpack[NamedInputs]
) -> Result[FineAlignment]:
    """Align a stationary record, as `Drive.align` does; see `load` for the inputs.

    Parameters
    ----------
    samples, gps, **inputs
        As for `load`; the latitude is ``lat``, or comes from the fixes.

    Returns
    -------
    Result of FineAlignment
    """
    return drive_of(read(samples, gps, None, by_name(inputs))).align()


def _missed_epochs(epochs: FloatArray, run: Run) -> tuple[Finding, ...]:
    """Report epochs outside the solution.

    Raises: InputError: all epochs are outside.
    """
    n_solved = 0 if run.poses is None else len(run.poses.time)
    if not epochs.size or n_solved == epochs.size:
        return ()
    span = tuple(run.solution.time[[0, -1]].tolist())
    if not n_solved:
        raise InputError("session.epochs_outside", where="epochs", epochs_s=(epochs[0], epochs[-1]), solution_s=span)
    return (Finding.of(Code.RUN_EPOCHS_MISSED, count=epochs.size - n_solved, total=epochs.size, solution_s=span),)


def drive_of(recording: Recording) -> Drive:
    """Check that the files belong together, choose unspecified inputs, and return the drive.

    Raises: InputError: IMU and GPS have no common time.
    """
    return Drive(*run_steps(LOAD, recording, given_model(recording)))


@dataclass(frozen=True, slots=True)
class Drive:
    """Recorded drive, interpreted but not navigated; made by `load`.

    Attributes
    ----------
    recording : Recording
        Data, their interpretation, and the inputs specified with them.
    model : Model
        Estimates: IMU error specification, lever arm, delay, mounting.
    steps : tuple of StepRecord
        Steps that were run, with their findings.
    """

    recording: Recording
    model: Model
    steps: tuple[StepRecord, ...]

    @property
    def imu(self) -> Reading[ImuData]:
        """IMU samples, corrected for known errors."""
        return self.recording.imu

    @property
    def gps(self) -> Reading[GpsData] | None:
        """Fixes as read; None without fixes."""
        return self.recording.gps

    @property
    def reference(self) -> Reading[Trajectory] | None:
        """Reference trajectory as read; None without a reference."""
        return self.recording.reference

    @property
    def fixes(self) -> GpsData | None:
        """Fixes, with standard deviations completed; None without fixes."""
        return self.recording.fixes

    @property
    def imu_spec(self) -> ImuSpec:
        """IMU error specification."""
        assert self.model.imu is not None
        return self.model.imu[0]

    @property
    def imu_chosen(self) -> Finding:
        """Finding that states how the IMU error specification was chosen."""
        assert self.model.imu is not None
        return self.model.imu[1]

    @property
    def notes(self) -> tuple[Finding, ...]:
        """Assumptions, except the one on the IMU error specification."""
        findings = (finding for step in self.steps if step.name in LOAD for finding in step.findings)
        return tuple(finding for finding in findings if finding is not self.imu_chosen)

    def __repr__(self) -> str:
        lines = [each.lines()[0] for each in self.recording.facts.values()]
        model = f"IMU model: {self.imu_spec.name}: {sentence(self.imu_chosen)}"
        return as_keywords("\n".join(["Drive", *lines, model]))

    def plot(self) -> Figure:
        """Draw the data before navigation: rates, forces, fixes and gaps.

        Returns
        -------
        matplotlib.figure.Figure
        """
        return cast("Figure", _report.drive_figure(self.recording))

    def beginning(self, length: float) -> Drive:
        """Return the drive with only the IMU samples of its first `length` [s]."""
        imu = self.recording.imu
        return replace(self, recording=replace(self.recording, imu=replace(imu, data=imu.data.beginning(length))))

    def until(self, step: str, task: Task | None = None) -> Drive:
        """Run the steps up to one step.

        Parameters
        ----------
        step : str
            One of `insnav.steps.STEPS`.
        task : Task, optional
            Options of the navigation.

        Returns
        -------
        Drive
            Drive with the data and estimates after that step.

        Raises
        ------
        ConfigError
            Neither GPS nor a reference at rest gives a position.
        InputError, AlignmentError, DivergenceError
            The data cannot be navigated.
        """
        model = self.model if task is None else replace(self.model, task=task)
        pending = STEPS[len(self.steps) : STEPS.index(step) + 1]
        recording, model, steps = run_steps(pending, self.recording, model)
        return Drive(recording, model, (*self.steps, *steps))

    @in_notebook
    def navigate(
        self,
        *,
        states: int = 21,
        aiding: AidingChoice = "auto",
        smooth: bool = True,
        output_interval: float = 0.1,
        epochs: Sequence[float] | FloatArray = (),
        point: Sequence[float] | FloatArray | None = None,
        mechanization: Literal["full", "short"] = "full",
        progress: Callable[[float], None] | None = None,
    ) -> Result[EvaluatedRun]:
        """Navigate the drive, and evaluate the solution against the reference if there is one.

        Parameters
        ----------
        states : {21, 15}
            With or without scale factor errors.
        aiding : {"auto", "on", "off"}
            Non-holonomic constraint, odometer, ZUPT: where GPS has gaps, always, never.
        smooth : bool
            Also give the smoothed solution.
        output_interval : float
            Time between rows of the solution [s]; 0 for every sample. Rows fall on its whole multiples.
        epochs : sequence of float
            Epochs of the table ``poses``, such as camera triggers, on the clock of the solution [s].
        point : sequence of three floats, optional
            Point of the table ``poses``: forward, right, down of the IMU [m].
        mechanization : {"full", "short"}
            With ``short``, also compare the short-duration form with the full form.
        progress : callable, optional
            Called with the fraction done.

        Returns
        -------
        Result of EvaluatedRun

        Raises
        ------
        InputError, AlignmentError, DivergenceError
            The data cannot be navigated.
        """
        one_of("aiding", aiding, get_args(AidingChoice))
        one_of("mechanization", mechanization, ("full", "short"))
        epochs = as_epochs(epochs, "epochs") if len(epochs) else np.empty(0)
        point = vector("point", point)

        output = Output(dense(output_interval), smooth, epochs, point)
        done = self.until(STEPS[-1], Task(states, aiding, output, progress))
        ready, evaluated = done.ready, done.evaluated
        if mechanization == "short":
            from insnav.errors.evaluated_run import short_windows

            windows = short_windows(ready.imu, evaluated.run.solution, evaluated.run.sensor_errors)
            evaluated = replace(evaluated, short_duration=tuple(windows))
        options = {
            "states": states,
            "aiding": aiding,
            "smooth": smooth,
            "output_interval_s": output_interval,
            "mechanization": mechanization,
            "epochs": len(epochs) or None,
            "point": None if point is None else point.tolist(),
        }
        evaluated = replace(evaluated, run=thinned(evaluated.run, output_interval))
        missed = _missed_epochs(epochs, evaluated.run)
        return done.result("run", evaluated, options, (*done.findings, *missed, *evaluated.run.events), evaluated)

    @property
    def ready(self) -> FilterInput:
        """Filter input; after navigation, including the other aiding that the filter used."""
        ready, solved = self.model.ready, self.model.solved
        assert ready is not None
        return ready if solved is None else solved.ready

    @property
    def evaluated(self) -> EvaluatedRun:
        """Solution, compared with the reference if there is one."""
        assert self.model.evaluated is not None
        return self.model.evaluated

    @in_notebook
    def outage(
        self,
        *,
        lengths: Sequence[float] | float = LENGTHS,
        first: float | None = None,
        spacing: float | None = None,
        aiding: AidingChoice = "auto",
        workers: Workers = 2,
        progress: Callable[[float], None] | None = None,
    ) -> Result[OutageStudy]:
        """Simulate GNSS outages throughout the drive.

        Parameters
        ----------
        lengths : float or sequence of float
            Lengths of the outage windows [s].
        first : float, optional
            Start of the first window, after the start of navigation [s].
        spacing : float, optional
            Interval between windows [s]; by default chosen for about sixty windows.
        aiding : {"auto", "on", "off"}
            Whether other aiding is used in the windows: with ``auto`` and ``on``, not with ``off``.
        workers : int or str
            Processes, or an engine: ``processes:4``, ``dask:ADDRESS``.
        progress : callable, optional
            Called with the fraction done.

        Returns
        -------
        Result of OutageStudy

        Raises
        ------
        ConfigError, InputError, AlignmentError
            Invalid windows, or data that cannot be navigated.
        """
        from insnav.errors.outage.gnss_outage import OutageStudy, common_error, outage_growth, outages

        lengths = [float(length) for length in np.ravel(lengths)]
        share = 0.4  # fraction of the progress that navigation takes
        task = Task(aiding="off" if aiding == "off" else "on", progress=share_of(progress, 0.0, share))
        done = self.until(STEPS[-1], task)
        ready, evaluated, notes = done.ready, done.evaluated, done.findings
        reference = None if self.reference is None else partial(self._antenna_positions, self.reference)
        announce("simulating outages")
        ready = replace(ready, gps=without_rejected(ready, evaluated.run))
        report = share_of(progress, share, 1.0 - share)
        windows = outages(
            ready, lengths=lengths, first=first, spacing=spacing, reference=reference, workers=workers, progress=report
        )
        study = OutageStudy(tuple(windows), tuple(outage_growth(windows)), self._compared_with(), evaluated)
        notes = (*(finding for each in study.growth for finding in common_error(each)), *notes)
        if missed := sorted({*lengths} - {window.length for window in windows}):
            notes = (Finding.of(Code.OUTAGE_NO_WINDOW, lengths_s=tuple(missed)), *notes)
        options = {"lengths_s": lengths, "first_s": first, "spacing_s": spacing, "aiding": aiding}
        return done.result("outage", study, options, (*notes, *evaluated.run.events), evaluated)

    @in_notebook
    def budget(
        self,
        settings: BudgetSettings | None = None,
        *,
        windows: WindowSettings | None = None,
        progress: Callable[[float], None] | None = None,
        **options: Unpack[BudgetOptions],
    ) -> Result[BudgetStudy]:
        """Compute the position error of the IMU without GPS, and its sources.

        Parameters
        ----------
        settings : BudgetSettings, optional
            Settings of the budget. The windows of the drive are as long as its last time.
        windows : WindowSettings, optional
            Spacing of the free-inertial windows, with 20 simulated replicas by default. Their length and seed come from
            the budget.
        progress : callable, optional
            Called with the fraction done.
        **options
            Any of the settings by name, such as ``times=(10, 60), runs=100``.

        Returns
        -------
        Result of BudgetStudy

        Raises
        ------
        ConfigError, InputError, AlignmentError
            Invalid windows, or data that cannot be navigated.
        """
        from insnav.errors.budget.from_windows import WindowSettings, recorded_budget
        from insnav.session.budget import BudgetOptions, BudgetSettings, budget_of_windows

        for name in options:
            one_of("budget", name, tuple(BudgetOptions.__annotations__))
        settings = replace(settings or BudgetSettings(), **options)
        done = self.until("noise")
        ready, spec = done.ready, done.model.filter_imu
        reference = None if self.gps is None or self.reference is None else self._window_reference(self.reference)
        chosen = windows or WindowSettings(replicas=20, workers=2)
        chosen = replace(chosen, length=float(max(settings.times)), seed=settings.seed)
        announce("simulating outages")
        recorded = recorded_budget(ready, spec, reference, chosen, progress)
        assumed = () if self.recording.inputs.get("imu_model") is not None else (self.imu_chosen,)
        prepared = (each for each in done.model.findings if not each.timed)
        recorded = replace(recorded, notes=(*self.notes, *assumed, *prepared, *recorded.notes))
        study = budget_of_windows(recorded, settings, progress)
        return done.result("budget", study, asdict(settings), (*recorded.notes, *self._events()))

    @in_notebook
    def require(
        self,
        error: str | float,
        after: str | float,
        *,
        workers: Workers = 1,
        progress: Callable[[float], None] | None = None,
        **options: Unpack[RequirementOptions],
    ) -> Result[RequirementStudy]:
        """Find the IMU quality that a limit on the position error requires on this drive.

        Parameters
        ----------
        error, after : str or float
            Limit and time without GPS; see `insnav.require`. If an IMU model was specified with the drive, only the
            errors that it lacks are allocated.
        workers : int or str
            Processes, or an engine: ``processes:4``, ``dask:ADDRESS``.
        progress : callable, optional
            Called with the completed fraction of the simulated runs.
        **options
            As of `insnav.require`.

        Returns
        -------
        Result of RequirementStudy

        Raises
        ------
        ConfigError, InputError, AlignmentError
            Invalid requirement, or data that cannot be navigated.
        """
        from insnav.session.requirement import Moving, requirement_of, settings_of, study_of
        from insnav.simulate.truth_from_track import truth_from_track

        settings = settings_of(options)
        required = requirement_of(error, after, settings)
        run = self.navigate().found.run
        track = run.solution if run.smoothed is None else run.smoothed.solution
        given = self.recording.inputs.get("imu_model")
        spec = load_imu(str(given)) if isinstance(given, str | Path) else given
        motion = Moving(truth_from_track(track), f"the drive {Path(self.imu.facts.path).name}")
        announce("simulating")
        study = study_of(required, motion, spec, settings, workers, progress)
        return self.result("requirement", study.found, study.options, (*self.notes, *self._events()))

    def align(self) -> Result[FineAlignment]:
        """Align the drive at rest: coarsely from mean samples, then by the filter with zero-velocity updates.

        Returns
        -------
        Result of FineAlignment

        Raises
        ------
        ConfigError
            Neither ``lat`` nor GPS gives a latitude.
        AlignmentError
            No stationary part, or the data do not determine the attitude.
        """
        from insnav.filter.fine_alignment import fine_alignment

        inputs, notes = self.recording.inputs, list(self.notes)
        span = inputs.get("static")
        rest = span or find_stationary(intervals(self.imu.data))
        if rest is None:
            raise AlignmentError("session.no_rest", where=self.imu.facts.path)
        if span is None and rest[1] - rest[0] < SHORT_REST:
            duration = rest[1] - rest[0]
            finding = Finding.of(Code.ALIGN_SHORT_REST, *rest, subject="imu", duration_s=duration, limit_s=SHORT_REST)
            notes.append(finding)
        alignment = fine_alignment(self.imu.data, self.imu_spec, self._place(), rest, inputs.get("heading"))
        return self.result("alignment", alignment, {}, (*notes, *self._events()))

    def _place(self) -> FloatArray:
        """Return latitude, longitude [rad] and height [m] of a stationary record."""
        inputs = self.recording.inputs
        lat = inputs.get("lat")
        if lat is not None:
            return np.array([lat, 0.0, inputs.get("height") or 0.0])
        if self.fixes is None:
            raise ConfigError("session.no_latitude", where="lat")
        return np.asarray(self.fixes.lla[0])

    def _antenna_positions(self, reference: Reading[Trajectory], lever_b: FloatArray) -> GpsData:
        """Move the reference positions to the antenna, at `lever_b` from the IMU, and complete their sd."""
        point, data = reference_point(self.recording.inputs, reference.data), reference.data
        if point is not None and not np.allclose(point, lever_b, atol=1e-3):
            if not np.isfinite(data.rph).all():
                raise ConfigError("session.reference_without_attitude", where="ref_lever_arm")
            data = at_point(data, lever_b - point)
        sd = np.full((len(data.time), 6), np.nan) if data.sd is None else data.sd[:, :6].copy()
        position_sd, _ = reference_sd(self.recording.inputs) or REFERENCE_SD
        sd[:, :3] = np.where(np.isfinite(sd[:, :3]), sd[:, :3], position_sd)
        complete, _ = with_sd(GpsData(data.time, data.lla, data.v_n, sd[:, :3], sd[:, 3:], reference.fix))
        fix = complete.fix
        return complete if fix is None or not (fix == 1).any() else complete.rows(fix == 1)

    def _window_reference(self, reference: Reading[Trajectory]) -> WindowReference:
        """Build the reference of free-inertial windows."""
        position_sd, velocity_sd = reference_sd(self.recording.inputs) or REFERENCE_SD
        data, _ = fixed_epochs(reference)
        if velocity_sd is None:
            data = replace(data, v_n=np.full_like(data.v_n, np.nan))
        return reference_from_trajectory(
            data,
            self._compared_with(),
            position_sd=position_sd,
            velocity_sd=1.0 if velocity_sd is None else velocity_sd,
            lever_b=reference_point(self.recording.inputs, reference.data),
        )

    def _compared_with(self) -> str:
        if self.reference is None:
            return "the drive's own GPS fixes"
        point = reference_point(self.recording.inputs, self.reference.data)
        description = "of the antenna" if point is None else "of the IMU" if not point.any() else "of the point given"
        return f"the positions of {Path(self.reference.facts.path).name} ({description})"

    def _events(self) -> tuple[Finding, ...]:
        """Return the events found when the files were read, in order of time."""
        return by_time([event for reading in self.recording.given().values() for event in reading.events])

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings on the assumptions and choices behind the solution."""
        solved, events = self.model.solved, self.evaluated.run.events
        notes = () if solved is None else solved.notes
        return (*self.notes, *notes, *added(events, self.steps[-1].findings))

    def result(
        self,
        kind: str,
        found: Any,
        options: Mapping[str, object],
        findings: tuple[Finding, ...],
        run: EvaluatedRun | None = None,
    ) -> Result[Any]:
        """Build a result of this `kind`; the findings of a `run` are added."""
        given, spec, chosen = options_of(self.recording.inputs, **options), self.model.filter_imu, self.imu_chosen
        if (noise := self.model.noise) is not None:
            prior, nearest = noise.filter_spec.name, self.imu_spec.name
            if prior != nearest:  # drop the finding that the nearest grade is used
                findings = tuple(each for each in findings if each != chosen)
            elif chosen not in findings:
                findings = (*findings, replace(chosen, severity=Severity.NOTE))
            chosen = Finding.of(Code.IMU_MODEL_ESTIMATED, prior=prior, nearest="" if prior == nearest else nearest)
        all_findings = (*findings, chosen)
        result = Result(
            kind, found, self.recording.facts, given, (spec, chosen), all_findings, self.steps, self.model.explanation
        )
        return result if run is None else judged(result, run)
