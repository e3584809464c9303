"""A recorded drive: read, understood, and everything that can be done with it.

`load` reads and chooses; nothing is navigated before a method of `Drive` is called. The command line calls the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack, get_args

import numpy as np

from insnav import spill
from insnav.alignment import find_stationary
from insnav.engine import Workers, share_of
from insnav.errors.evaluated_run import EvaluatedRun, evaluate_run, fixed_epochs
from insnav.errors.metrics import at_point
from insnav.errors.outage.window_reference import WindowReference, reference_from_trajectory
from insnav.errors.outage.windows import LENGTHS
from insnav.errors.run_findings import judged
from insnav.exceptions import AlignmentError, ConfigError, InputError, as_keywords
from insnav.filter import FilterSettings
from insnav.filter.delay_step import with_one_delay
from insnav.filter.frozen import UNUSABLE, without_frozen
from insnav.filter.gps_delay import on_time
from insnav.filter.gps_noise import with_sd
from insnav.filter.gyro_fault import without_gyro_faults
from insnav.filter.lever_check import (
    delay_contradicted,
    lever_contradicted,
    with_hidden_lever,
    with_right_heading,
    with_right_lever,
)
from insnav.filter.navigate import AidingChoice, Navigated, dense, navigate_prepared, thinned
from insnav.filter.noise_identification import (
    identify_noise,
    understated,
    with_careful_biases,
    with_known_noise,
    with_noise,
    with_usual_noise,
)
from insnav.filter.prepare import DELAY_SD, Prepared, Start, prepare
from insnav.filter.whole_record import without_rejected
from insnav.findings import Code, Finding, Severity, by_time, of_code
from insnav.imu import load_imu
from insnav.imu.specification import ImuSpec
from insnav.input import Reading
from insnav.input.readers.kinds import files_with
from insnav.messages import sentence
from insnav.result import Result
from insnav.session import defaults
from insnav.session.checked_inputs import one_of, options_of, reference_point, reference_sd
from insnav.session.clock import on_one_clock
from insnav.session.inputs import Inputs
from insnav.session.mounted import as_mounted, doubt_mounting, in_likely_axes
from insnav.session.read import Readings, read
from insnav.strapdown import intervals
from insnav.types import FloatArray, GpsData, ImuData, Trajectory

if TYPE_CHECKING:  # what takes long to import is imported where it is used: a run needs no budget
    from insnav.errors.budget.drive_motion import BudgetStudy
    from insnav.errors.budget.from_windows import WindowSettings
    from insnav.errors.outage.gnss_outage import OutageStudy
    from insnav.errors.requirement.study import RequirementStudy
    from insnav.filter.fine_alignment import FineAlignment
    from insnav.session.budget import BudgetOptions, BudgetSettings
    from insnav.session.read import Given
    from insnav.session.requirement import RequirementOptions

SLOWEST = 2.5  # rate of an IMU that can be navigated [Hz]
SHORT_REST = 10.0  # so long may steady motion look like rest [s]


def load(
    imu: Given | ImuData,
    gps: Given | GpsData | None = None,
    ref: Given | Trajectory | None = None,
    **inputs: Unpack[Inputs],
) -> Drive:
    """Read a recorded drive, find out what it is, and choose the IMU model.

    Parameters
    ----------
    imu : path, data frame, arrays or ImuData
        Samples: a file of any supported format; a data frame with any columns a file may have; arrays
        ``(time, gyro, accel)`` in [s], [rad/s], [m/s^2], or ``(gyro, accel)`` with ``rate=``.
    gps : path, data frame, arrays or GpsData, optional
        Fixes; arrays are ``(time, lla)`` in [s], [deg], [deg], [m].
    ref : path, data frame, arrays or Trajectory, optional
        Reference trajectory.
    **inputs
        What the data do not say themselves, as in `insnav.session.inputs.Inputs`.

    Returns
    -------
    Drive

    Raises
    ------
    ConfigError, InputError
        What cannot be meant, or used.

    Examples
    --------
    >>> drive = insnav.load("imu.csv", gps="gps.csv", lever_arm=(0.8, -0.3, -1.2))  # doctest: +SKIP
    >>> drive.navigate().save("run1")  # doctest: +SKIP
    """
    return drive_of(read(imu, gps, ref, inputs))


def drive_of(readings: Readings) -> Drive:
    """Check that readings belong together, and choose what was not given.

    Raises: InputError: IMU and GPS have no time in common.
    """
    inputs = readings.inputs
    given_model = defaults.given_imu(inputs.get("imu_model"))
    if readings.imu.facts.rate_hz < SLOWEST:
        raise InputError(
            "the samples of the IMU are too far apart to be navigated",
            where=readings.imu.facts.path,
            why=f"{1.0 / readings.imu.facts.rate_hz:.3g} s; the turns in between are not known",
            fix="export the sensors at their full rate (50 Hz or more), not merged to that of the fixes",
        )
    # what changes slowly hides no motion: fixes without a standard deviation are as good as they scatter
    scattered = None
    if readings.gps is not None:
        scattered = without_frozen(with_sd(readings.gps.data)[0], readings.imu.data)[0]
        scattered = scattered.rows(scattered.position_sd[:, 0] < UNUSABLE)
    imu, sensor_logs, clocks = on_one_clock(readings.imu, readings.gps, scattered, readings.logs, inputs)
    readings, samples = replace(readings, imu=imu, logs=sensor_logs), imu.data
    fixes, assumed = defaults.complete_fixes(samples, readings.gps, readings.reference)
    readings = replace(readings, gps=defaults.with_scales_checked(readings.gps))
    mounted, yaw, turned = as_mounted(readings.imu, scattered or fixes, inputs)
    readings, samples = replace(readings, imu=mounted), mounted.data
    spec, chosen = given_model or defaults.imu_from_rest(samples, defaults.stationary_part(samples, fixes, inputs))
    logs = tuple(log.data for log in readings.logs.values())
    settings = replace(defaults.filter_settings(inputs, logs, readings.gps), mounting_yaw=yaw)
    drive = Drive(readings, fixes, spec, chosen, settings, (*clocks, *turned, *assumed))
    start = inputs.get("heading"), inputs.get("initial")
    if not any(of_code(turned, Code.MOUNTING_ASSUMED)) or fixes is None or start != (None, None):
        return drive

    def prepared(data: ImuData) -> Prepared:
        return replace(drive, readings=replace(readings, imu=replace(mounted, data=data)))._prepared(fixes)

    imu, yaw, note = in_likely_axes(mounted, prepared)
    settings = replace(settings, mounting_yaw=yaw)
    turned = (*turned[:-1], note) if imu is mounted else (note,)
    return replace(drive, readings=replace(readings, imu=imu), settings=settings, notes=(*clocks, *turned, *assumed))


@dataclass(frozen=True, slots=True)
class Drive:
    """A recorded drive, read and understood but not navigated; made by `load`.

    Attributes
    ----------
    readings : Readings
        Data as read, with what was understood, and the inputs given with them.
    fixes : GpsData or None
        Fixes with a standard deviation for every value.
    imu_spec : ImuSpec
        IMU error specification.
    imu_chosen : Finding
        How it was chosen.
    settings : FilterSettings
        Lever arm, delay, gates.
    notes : tuple of Finding
        What was assumed.
    clock : tuple of float
        By which samples are late at the start [s] and their clock is slow [s/s] where the search for that begins.
    """

    readings: Readings
    fixes: GpsData | None
    imu_spec: ImuSpec
    imu_chosen: Finding
    settings: FilterSettings
    notes: tuple[Finding, ...]
    clock: tuple[float, float] = (0.0, 0.0)

    @property
    def imu(self) -> Reading[ImuData]:
        """Samples, known errors corrected."""
        return self.readings.imu

    @property
    def gps(self) -> Reading[GpsData] | None:
        """Fixes as read."""
        return self.readings.gps

    @property
    def reference(self) -> Reading[Trajectory] | None:
        """Reference as read."""
        return self.readings.reference

    def __repr__(self) -> str:
        lines = [each.lines()[0] for each in self.readings.facts.values()]
        model = f"IMU model: {self.imu_spec.name}: {sentence(self.imu_chosen)}"
        return as_keywords("\n".join(["Drive", *lines, model]))

    def beginning(self, length: float) -> Drive:
        """Give the drive with the samples of its first `length` [s] only."""
        imu = self.readings.imu
        return replace(self, readings=replace(self.readings, imu=replace(imu, data=imu.data.beginning(length))))

    def prepared(self, states: int = 21) -> Prepared:
        """Align the drive and set the filter up; nothing is navigated yet.

        Parameters
        ----------
        states : {21, 15}
            With or without scale factor errors.

        Returns
        -------
        Prepared

        Raises
        ------
        ConfigError
            Neither GPS nor a reference at rest gives a position.
        InputError, AlignmentError
            The data cannot be navigated.
        """
        if states not in (15, 21):
            raise ConfigError(f"{states} states are not supported", where="--states", fix="use 21 or 15")
        if self.fixes is None:
            moves = ", and no reference" if self.reference is None else ", and by the reference it moves"
            imu = Path(self.readings.imu.facts.path)
            beside = ", ".join(files_with("gps", imu.parent)) if imu.is_file() else ""
            raise ConfigError(
                "nothing tells where the vehicle was",
                where="--gps",
                why=f"there are no fixes{moves}" + f"; beside {imu.name} some are in {beside}" * bool(beside),
                fix="give fixes with --gps; for a bench, --ref with its place at the start and the end, velocity zero",
            )
        fixes, given = self.fixes, self.readings.inputs.get("heading")

        def with_heading(heading: float | None) -> Prepared:
            return on_time(
                lambda clock, rate: self._prepared(fixes, states, clock, rate, heading), self.settings, self.clock
            )

        ready = with_heading(given)
        return ready if given is None else with_right_heading(ready, lambda: with_heading(None))

    def _prepared(
        self, fixes: GpsData, states: int = 21, clock: float = 0.0, rate: float = 0.0, heading: float | None = None
    ) -> Prepared:
        """Prepare with all that has the time of the samples moved by `clock` at the start [s], and by `rate` [s/s]."""
        inputs, imu = self.readings.inputs, self.imu.data
        initial, span = inputs.get("initial"), inputs.get("static")
        begin, end = float(imu.time[0]), float(imu.time[-1])

        def moved(time: Any) -> Any:
            return time + clock + rate * (time - begin)

        logs = tuple(replace(log, time=moved(log.time)) for log in self.settings.logs)
        ready = prepare(
            replace(imu, time=spill.by_blocks(moved, imu.time)),
            fixes,
            self.imu_spec,
            replace(self.settings, logs=logs),
            states=states,
            start=replace(initial, time=moved(initial.time)) if isinstance(initial, Start) else None,
            static_span=None if span is None else (moved(span[0]), moved(span[1])),
            heading=heading,
        )
        return replace(ready, clock=clock + 0.5 * rate * (end - begin), rate=rate)

    def prepared_with_noise(self, states: int = 21) -> tuple[Prepared, ImuSpec]:
        """As `prepared`, with the noise found in the innovations of the drive if that was asked for, and its IMU.

        Parameters
        ----------
        states : {21, 15}
            With or without scale factor errors.

        Returns
        -------
        ready : Prepared
        spec : ImuSpec
        """
        ready = self.prepared(states)
        wanted = defaults.noise_wanted(self.readings.inputs, self.gps)
        if wanted != "estimate":
            claimed = self.gps is None or bool(np.isfinite(self.gps.data.position_sd).all())
            known = with_known_noise(ready, self.imu_spec, lasting=wanted == "fixes", sizes=not claimed)
            return known, self.imu_spec
        ready = replace(ready, kinds=defaults.better_kinds(self.readings.inputs, self.imu_spec))
        found = identify_noise(ready, self.imu_spec)
        if found is None:
            kept = Finding.of(Code.IMU_MODEL_KEPT, subject="imu", model=self.imu_spec.name)
            return with_usual_noise(replace(ready, notes=(*ready.notes, kept))), self.imu_spec
        ready, found = without_gyro_faults(ready, found, self.imu_spec)
        return with_noise(ready, found), found.spec

    def navigate(
        self,
        *,
        states: int = 21,
        aiding: AidingChoice = "auto",
        smooth: bool = True,
        output_interval: float = 0.1,
        mechanization: Literal["full", "short"] = "full",
        progress: Callable[[float], None] | None = None,
    ) -> Result[EvaluatedRun]:
        """Navigate the drive, and evaluate it against the reference if there is one.

        Parameters
        ----------
        states : {21, 15}
            With or without scale factor errors.
        aiding : {"auto", "on", "off"}
            Non-holonomic constraint, odometer, ZUPT: where GPS has gaps, always, never.
        smooth : bool
            Also give the smoothed solution.
        output_interval : float
            Time between rows of the solution [s]; 0 for every sample.
        mechanization : {"full", "short"}
            short: also compare the short-duration form with the full one.
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

        ready, found, notes = self._evaluated(states, aiding, smooth, output_interval, progress)
        if mechanization == "short":
            from insnav.errors.short_duration_errors import short_windows

            windows = short_windows(ready.imu, found.run.solution, found.run.sensor_errors)
            found = replace(found, short_duration=tuple(windows))
        options = {
            "states": states,
            "aiding": aiding,
            "smooth": smooth,
            "output_interval_s": output_interval,
            "mechanization": mechanization,
        }
        found = replace(found, run=thinned(found.run, output_interval))
        return self._result("run", found, options, (*notes, *found.run.events), self._spec(ready), found)

    def _spec(self, ready: Prepared) -> ImuSpec:
        return self.imu_spec if ready.noise is None else ready.noise.spec

    def _evaluated(
        self,
        states: int = 21,
        aiding: AidingChoice = "auto",
        smooth: bool = True,
        output_interval: float = 0.1,
        progress: Callable[[float], None] | None = None,
    ) -> tuple[Prepared, EvaluatedRun, tuple[Finding, ...]]:
        """See `navigate`: the drive as it was prepared, other aiding included, the run of it, and notes."""

        def navigated(fixes: GpsData | None, clock: tuple[float, float] | None = None) -> tuple[Prepared, Navigated]:
            some = replace(self, fixes=fixes)
            if clock is not None:
                some = replace(some, clock=clock, settings=replace(self.settings, delay_sd=DELAY_SD))
            ready, _ = some.prepared_with_noise(states)
            if self.readings.inputs.get("lever_arm") is not None and not ready.settings.lever_sd:
                free = replace(self.settings, lever_b=np.zeros(3), lever_sd=defaults.LEVER_SD)
                ready = with_right_lever(ready, lambda: replace(some, settings=free).prepared_with_noise(states)[0])
            ready = with_careful_biases(ready, self.imu_spec)
            settings = replace(ready.settings, smooth=smooth, output_interval=dense(output_interval))
            ready = replace(ready, settings=settings)
            return ready, navigate_prepared(ready, self._spec(ready), aiding=aiding, progress=progress)

        ready, done = with_one_delay(self.fixes, navigated)
        doubts = () if self.gps is None else understated(ready, self.gps.data)
        if self.readings.inputs.get("gps_delay") is not None:
            doubts = (*doubts, *delay_contradicted(ready))
        if ready.settings.lever_sd:
            run, hidden = with_hidden_lever(done.ready or ready, done.run)
            done, doubts = replace(done, run=run), (*doubts, *hidden)
        if ready.settings.lever_sd and not self.settings.lever_sd:
            doubts = (*doubts, lever_contradicted(self.settings.lever_b, done.run))
        doubts = (*doubt_mounting(self.notes, done.run.events), *doubts)
        done = replace(done, run=replace(done.run, events=self._events((*doubts, *done.run.events))))
        point = None if self.reference is None else reference_point(self.readings.inputs, self.reference.data)
        found, notes = evaluate_run(done, self.reference, done.run.lever_b if point is None else point)
        found = replace(found, noise=ready.noise)
        return done.ready or ready, found, (*self.notes, *done.notes, *notes)

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
        """Simulate GNSS outages all over the drive.

        Parameters
        ----------
        lengths : float or sequence of float
            Lengths of the outage windows [s].
        first : float, optional
            Where the first begins, after the start of navigation [s].
        spacing : float, optional
            From one to the next [s]; by default so that about sixty fit.
        aiding : {"auto", "on", "off"}
            Use other aiding in the windows: auto and on do, off does not.
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
            Windows that make no sense, or data that cannot be navigated.
        """
        from insnav.errors.outage.gnss_outage import OutageStudy, outages
        from insnav.errors.outage.statistics import common_error, outage_growth

        lengths = [float(length) for length in np.ravel(lengths)]
        share = 0.4  # of the work is the run
        ready, run, notes = self._evaluated(
            aiding="off" if aiding == "off" else "on", progress=share_of(progress, 0.0, share)
        )
        reference = None if self.reference is None else partial(self._antenna_positions, self.reference)
        windows = outages(
            replace(ready, gps=without_rejected(ready.gps, run.run, ready.settings)),
            lengths=lengths,
            first=first,
            spacing=spacing,
            reference=reference,
            workers=workers,
            progress=share_of(progress, share, 1.0 - share),
        )
        found = OutageStudy(tuple(windows), tuple(outage_growth(windows)), self._compared_with(), run)
        notes = (*(finding for each in found.growth for finding in common_error(each)), *notes)
        if missed := sorted({*lengths} - {window.length for window in windows}):
            notes = (Finding.of(Code.OUTAGE_NO_WINDOW, lengths_s=tuple(missed)), *notes)
        options = {"lengths_s": lengths, "first_s": first, "spacing_s": spacing, "aiding": aiding}
        return self._result("outage", found, options, (*notes, *run.run.events), self._spec(ready), run)

    def budget(
        self,
        settings: BudgetSettings | None = None,
        *,
        windows: WindowSettings | None = None,
        progress: Callable[[float], None] | None = None,
        **options: Unpack[BudgetOptions],
    ) -> Result[BudgetStudy]:
        """Find out how much error the IMU makes without GPS, and from what.

        Parameters
        ----------
        settings : BudgetSettings, optional
            How the budget is drawn up; the windows of the drive are as long as the last of its times.
        windows : WindowSettings, optional
            How free-inertial windows are slid along the drive, with 20 simulated replicas by default; their length and
            seed are those of the budget.
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
            Windows that make no sense, or data that cannot be navigated.
        """
        from insnav.errors.budget.from_windows import WindowSettings, recorded_budget
        from insnav.session.budget import BudgetOptions, BudgetSettings, budget_of_windows

        for name in options:
            one_of("budget", name, tuple(BudgetOptions.__annotations__))
        settings = replace(settings or BudgetSettings(), **options)
        ready, spec = self.prepared_with_noise()
        reference = None if self.gps is None or self.reference is None else self._window_reference(self.reference)
        chosen = replace(
            windows or WindowSettings(replicas=20, workers=2), length=float(max(settings.times)), seed=settings.seed
        )
        recorded = recorded_budget(ready, spec, reference, chosen, progress)
        given = self.readings.inputs.get("imu_model") is not None
        assumed = () if given else (self.imu_chosen,)
        recorded = replace(recorded, notes=(*self.notes, *assumed, *recorded.notes))
        found = budget_of_windows(recorded, settings, progress)
        return self._result("budget", found, asdict(settings), (*recorded.notes, *self._events(())), spec)

    def require(
        self,
        error: str | float,
        after: str | float,
        *,
        workers: Workers = 1,
        progress: Callable[[float], None] | None = None,
        **options: Unpack[RequirementOptions],
    ) -> Result[RequirementStudy]:
        """Find out how good an IMU must be on this drive for a limit on the position error.

        Parameters
        ----------
        error, after : str or float
            Limit and time without GPS; see `insnav.require`. An IMU model that was given with the drive is that whose
            errors are given.
        workers : int or str
            Processes, or an engine: ``processes:4``, ``dask:ADDRESS``.
        progress : callable, optional
            Called with the fraction of the simulated runs that is done.
        **options
            As of `insnav.require`.

        Returns
        -------
        Result of RequirementStudy

        Raises
        ------
        ConfigError, InputError, AlignmentError
            A requirement that makes no sense, or data that cannot be navigated.
        """
        from insnav.session.requirement import Moving, requirement_of, settings_of, study_of
        from insnav.simulate.truth_from_track import truth_from_track

        settings = settings_of(options)
        required = requirement_of(error, after, settings)
        run = self.navigate().found.run
        track = run.solution if run.smoothed is None else run.smoothed.solution
        given = self.readings.inputs.get("imu_model")
        spec = load_imu(str(given)) if isinstance(given, str | Path) else given
        motion = Moving(truth_from_track(track), f"the drive {Path(self.imu.facts.path).name}")
        found = study_of(required, motion, spec, settings, workers, progress)
        return self._result("requirement", found.found, found.options, (*self.notes, *self._events(())))

    def align(self) -> Result[FineAlignment]:
        """Align the drive at rest: from means, then by the filter with zero velocity.

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

        inputs, notes = self.readings.inputs, list(self.notes)
        span = inputs.get("static")
        rest = span or find_stationary(intervals(self.imu.data))
        if rest is None:
            raise AlignmentError(
                "no rest was found",
                where=self.imu.facts.path,
                why="every half second shows turns or vibration",
                fix="give the static interval with --static FROM:TO",
            )
        if span is None and rest[1] - rest[0] < SHORT_REST:
            duration = rest[1] - rest[0]
            short = Finding.of(Code.ALIGN_SHORT_REST, *rest, subject="imu", duration_s=duration, limit_s=SHORT_REST)
            notes.append(short)
        found = fine_alignment(self.imu.data, self.imu_spec, self._place(), rest, inputs.get("heading"))
        return self._result("alignment", found, {}, (*notes, *self._events(())))

    def _place(self) -> FloatArray:
        """Latitude, longitude [rad] and height [m] of a stationary record."""
        inputs = self.readings.inputs
        lat = inputs.get("lat")
        if lat is not None:
            return np.array([lat, 0.0, inputs.get("height") or 0.0])
        if self.fixes is None:
            raise ConfigError("nothing tells the latitude", where="lat", fix="give it with --lat, or fixes with --gps")
        return np.asarray(self.fixes.lla[0])

    def _antenna_positions(self, reference: Reading[Trajectory], lever_b: FloatArray) -> GpsData:
        """Positions of the reference brought to the antenna, `lever_b` from the IMU, each with a standard deviation."""
        point, data = reference_point(self.readings.inputs, reference.data), reference.data
        if point is not None and not np.allclose(point, lever_b, atol=1e-3):
            if not np.isfinite(data.rph).all():
                raise ConfigError(
                    "the reference cannot be brought to the antenna",
                    where="ref_lever_arm",
                    why="it has no attitude",
                    fix="leave it out for a reference of the antenna itself",
                )
            data = at_point(data, lever_b - point)
        sd = np.full((len(data.time), 6), np.nan) if data.sd is None else data.sd[:, :6].copy()
        position_sd, _ = reference_sd(self.readings.inputs) or defaults.REFERENCE_SD
        sd[:, :3] = np.where(np.isfinite(sd[:, :3]), sd[:, :3], position_sd)
        complete, _ = with_sd(GpsData(data.time, data.lla, data.v_n, sd[:, :3], sd[:, 3:], reference.fix))
        fix = complete.fix
        return complete if fix is None or not (fix == 1).any() else complete.rows(fix == 1)

    def _window_reference(self, reference: Reading[Trajectory]) -> WindowReference:
        """The reference as what free-inertial windows are compared with."""
        position_sd, velocity_sd = reference_sd(self.readings.inputs) or defaults.REFERENCE_SD
        data, _ = fixed_epochs(reference)
        if velocity_sd is None:
            data = replace(data, v_n=np.full_like(data.v_n, np.nan))
        return reference_from_trajectory(
            data,
            self._compared_with(),
            position_sd=position_sd,
            velocity_sd=1.0 if velocity_sd is None else velocity_sd,
            lever_b=reference_point(self.readings.inputs, reference.data),
        )

    def _compared_with(self) -> str:
        if self.reference is None:
            return "the drive's own GPS fixes"
        point = reference_point(self.readings.inputs, self.reference.data)
        of = "of the antenna" if point is None else "of the IMU" if not point.any() else "of the point given"
        return f"the positions of {Path(self.reference.facts.path).name} ({of})"

    def _events(self, more: Sequence[Finding]) -> tuple[Finding, ...]:
        """Events of reading and these, in order of time."""
        read_events = [event for reading in self.readings.given().values() for event in reading.events]
        return by_time([*read_events, *more])

    def _result(
        self,
        kind: str,
        found: Any,
        options: Mapping[str, object],
        findings: tuple[Finding, ...],
        spec: ImuSpec | None = None,
        run: EvaluatedRun | None = None,
    ) -> Result[Any]:
        """Make a result; that of a `run` has the findings about it, too."""
        given = options_of(self.readings.inputs, **options)
        chosen = self.imu_chosen
        if spec is not None and spec is not self.imu_spec:
            prior = () if chosen in findings else (replace(chosen, severity=Severity.NOTE),)
            chosen = Finding.of(Code.IMU_MODEL_ESTIMATED, prior=self.imu_spec.name)
            findings = (*findings, *prior)
        result = Result(kind, found, self.readings.facts, given, (spec or self.imu_spec, chosen), (*findings, chosen))
        return result if run is None else judged(result, run)
