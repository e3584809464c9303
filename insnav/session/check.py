"""Check of recorded files: their content, their problems, and the ``insnav run`` command for them."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Unpack, cast

import numpy as np

from insnav.alignment import Mounting, find_mounting
from insnav.alignment.align import STATIC_SPEED
from insnav.alignment.clock_offset import ClockOffset
from insnav.errors.evaluated_run import failure, same_positions
from insnav.exceptions import DivergenceError, InputError, InsnavError
from insnav.filter.agreement import FixFigures, look_at_fixes
from insnav.filter.delay_and_lever import looked
from insnav.filter.gps_noise import clock_offset, with_sd
from insnav.findings import Code, Finding, of_code
from insnav.imu.health import inspect
from insnav.imu.inspection import JOLT, ImuFigures, inspect_samples
from insnav.input import Reading, ReadingFacts, read_gps
from insnav.input.formats.registry import open_tables
from insnav.input.readers.imu import parse_units
from insnav.input.readers.kinds import data_files, kinds_of
from insnav.input.readers.reading import not_covered
from insnav.result import Result
from insnav.session.drive import Drive, drive_of
from insnav.session.read import NamedInputs, by_name, read
from insnav.steps import Recording
from insnav.steps.given import options_of, stationary_part
from insnav.steps.inputs import INPUTS, Inputs
from insnav.strapdown import intervals, joined
from insnav.types import BoolArray, GpsData, ImuData, Run
from insnav.units import G0

WORST_FIRST: Final = (
    *(Code.CHECK_REFUSED, Code.CHECK_OPTION_NEEDED, Code.CHECK_STUCK, Code.CHECK_CLIPPED, Code.ROWS_CUT),
    *(Code.READ_ROWS_UNREADABLE, Code.FILES_IMU_BEGINS_LATE, Code.FILES_IMU_ENDS_EARLY, Code.FILES_GPS_BEGINS_LATE),
    *(Code.FILES_GPS_ENDS_EARLY, Code.CHECK_IMU_GAPS, Code.CHECK_LOW_RATE, Code.CHECK_FALSE_VELOCITIES),
    *(Code.CHECK_JUMPS, Code.CHECK_NO_VELOCITIES, Code.CHECK_SMALL_SD, Code.CHECK_NO_SD, Code.CHECK_SAME_DATA),
    *(Code.CHECK_AXES, Code.CHECK_FORCE_STEP, Code.CHECK_JOLT, Code.CHECK_DELAY, Code.CHECK_UNSORTED),
    *(Code.CHECK_SAME_TIME, Code.CHECK_GPS_GAPS, Code.CHECK_LEVER_ARM, Code.CHECK_COARSE, Code.CHECK_SPIKES),
    *(Code.CHECK_JITTER, Code.CHECK_NO_REST, Code.CHECK_VELOCITY_LAG, Code.CHECK_NO_LEVER_ARM),
)
BEGIN = 300.0  # length of the part of a drive that is navigated [s]
ATTEMPTS = 6  # largest number of readings, each with the inputs requested by the last refusal
WORTH = {"delay": 0.05, "lever": 0.2}  # smallest delay [s] and lever arm [m] that are reported
STEP = 0.004 * G0  # smallest reported change of specific force between stops [m/s^2]
LEAST_RATE, JITTER = 40.0, 0.05  # lowest rate [Hz], largest jitter [intervals] without a finding


@dataclass(frozen=True, slots=True)
class Checked:
    """Result of `check`: role of each file, statistics, problems, and the command to run."""

    roles: Mapping[str, str]  # role of each file
    command: str  # ``insnav run`` command, as complete as the known inputs allow
    problems: tuple[Finding, ...]  # the worst first; notes need no action
    imu: ImuFigures | None = None
    gps: FixFigures | None = None
    offset: ClockOffset | None = None
    mounting: Mounting | None = None
    run: Run | None = None  # result of the filter; None if the files cannot be navigated
    rest: tuple[float, float] | None = None  # first stationary interval [s]
    runs: bool = False  # whether the command ran successfully
    runs_as_given: bool = False  # whether ``insnav run`` accepts the files without options


@dataclass(slots=True)
class _Patient:
    """Files under examination, with the findings so far."""

    inputs: Inputs
    roles: dict[str, str] = field(default_factory=dict)
    problems: list[Finding] = field(default_factory=list)
    refusals: int = 0
    parts: Mapping[str, str | Path] = field(default_factory=dict)  # file of each part of the recording

    def add(self, code: Code, begin: float = np.nan, **values: Any) -> None:
        """Add a finding."""
        self.problems.append(Finding.of(code, begin, **values))

    def refused(self, error: InsnavError) -> bool:
        """Report an error of insnav run, add the inputs that it requests, and return whether these inputs are new."""
        self.refusals += 1
        before = {**self.inputs}
        for key, value in error.gives.items():  # inputs that the error requests
            old = self.inputs.get(key)
            old = parse_units(old) if key == "units" and isinstance(old, str) else old
            merged = {**old, **value} if isinstance(old, Mapping) else value
            self.inputs = cast(Inputs, {**self.inputs, key: merged})
        is_new = self.inputs != before
        causes = [each["cause"] for each in of_code(self.problems, Code.CHECK_OPTION_NEEDED, Code.CHECK_REFUSED)]
        if (error.code, error.where) not in {(each.code, each.where) for each in causes}:
            self.add(Code.CHECK_OPTION_NEEDED if is_new else Code.CHECK_REFUSED, cause=error.facts)
        return is_new


def check(
    *files: str | Path, gps: str | Path | None = None, ref: str | Path | None = None, **inputs: Unpack[NamedInputs]
) -> Result[Checked]:
    """Examine the files of a recording, in any order, or its folder.

    Unusable files raise no error: they are the first problem of the result. If a file is refused for lack of an input,
    insnav tries the input that the refusal requests, and adds it to ``found.command``.

    Parameters
    ----------
    *files : path
        Files or folders.
    gps, ref : path, optional
        Files that are known to contain the GPS fixes and the reference.
    **inputs
        As for `insnav.load`.

    Returns
    -------
    Result of Checked
        The worst problem comes first in ``found.problems``.
    """
    roles = {Path(each): role for each, role in ((gps, "gps"), (ref, "reference")) if each is not None}
    given = by_name(inputs)
    patient = _Patient(given)
    by_role = _sorted([*files, *roles], patient, roles)
    data, drive = _opened(by_role, patient)
    found = Checked(dict(patient.roles), "", ())
    if data is not None:
        found = _examined(found, data, drive, patient)
    facts = {} if data is None else data.facts
    if data is None and "gps" in by_role:
        facts, found = _fixes_alone(by_role["gps"], found, patient)
    if given.get("axes") is None and "imu" in facts:  # a refusal, not the user, supplied these axes
        evidence = tuple(each for each in facts["imu"].evidence if each.code is not Code.AXES_GIVEN)
        facts = {**facts, "imu": replace(facts["imu"], evidence=evidence)}
    problems = tuple(sorted(patient.problems, key=lambda each: WORST_FIRST.index(each.code)))
    line = _command(patient) if "imu" in by_role else ""
    as_given = found.run is not None and not patient.refusals
    found = replace(found, command=line, runs=found.run is not None, runs_as_given=as_given, problems=problems)
    given_events = {} if data is None else {name: each.events for name, each in data.given().items()}
    events = (e for name, listed in given_events.items() for e in listed if name == "imu" or e.code is Code.ROWS_GAP)
    notes: tuple[Finding, ...] = () if drive is None else drive.notes
    return Result("check", found, facts, options_of(given), None, (*problems, *notes, *events))


def _sorted(files: Sequence[str | Path], patient: _Patient, roles: Mapping[Path, str]) -> dict[str, str | Path]:
    """Identify the file of each role: ``imu``, ``gps``, ``reference``."""
    by_file: dict[str | Path, set[str]] = {}
    for each in [inside for path in files for inside in _inside(path)]:
        try:
            by_file[each] = kinds_of(open_tables(each), imu_known=any("imu" in kinds for kinds in by_file.values()))
        except InsnavError as error:
            patient.roles[str(each)] = "not readable"
            patient.refused(error)
    by_role: dict[str, str | Path] = {}
    # IMU samples first, then files of given role, then files of known kind, fixes before references, then by size
    order = {
        path: (
            "imu" not in kinds,
            Path(path) not in roles,
            not kinds,
            kinds == {"reference"},
            -Path(path).stat().st_size,
        )
        for path, kinds in by_file.items()
    }
    for each, kinds in sorted(by_file.items(), key=lambda item: order[item[0]]):
        parts = ("imu", "gps") if "imu" in kinds or not kinds else ("gps",)
        role = next((part for part in parts if part not in by_role), "reference")
        duplicate = "IMU" if kinds == {"imu"} else "reference" if kinds and role in by_role else ""
        if duplicate and role != "imu" and Path(each) not in roles:
            patient.roles[str(each)] = f"another {duplicate}: not checked"
            continue
        role = roles.get(Path(each), role)
        if not kinds and Path(each) not in roles:
            patient.roles[str(each)] = "not understood"
            if role == "reference":
                continue
        by_role[role] = each
        has_both = {"imu", "gps"} <= kinds
        patient.roles.setdefault(str(each), "IMU and GPS" if has_both else {"imu": "IMU", "gps": "GPS"}.get(role, role))
        if has_both:
            by_role.setdefault("gps", each)
    return by_role


def _inside(path: str | Path) -> list[str | Path]:
    """Return a file, or a folder whose file names identify a recording; else the files of the folder."""
    if not Path(path).is_dir():
        return [path]
    try:
        open_tables(path)
        return [path]
    except InsnavError:
        return [*data_files(path)] or [path]


def _opened(given: Mapping[str, str | Path], patient: _Patient) -> tuple[Recording | None, Drive | None]:
    """Open the recording, and the drive if possible, from as many files as are consistent."""
    if "imu" not in given:
        patient.refused(InputError("session.no_imu_file"))
        return None, None
    largest = None
    for parts in _ways(given):
        recording, drive = _attempt(parts, patient)
        largest = largest or recording
        patient.parts = parts
        if drive is not None and "reference" not in given and "reference" in parts:  # the GPS file is a reference
            patient.problems, patient.refusals = [], 0
            patient.roles[str(parts["reference"])] = "reference"
        if drive is not None or (recording is not None and recording.gps is not None and "reference" not in parts):
            return recording if drive is None else drive.recording, drive
    return largest, None


def _ways(given: Mapping[str, str | Path]) -> Iterator[dict[str, str | Path]]:
    """Yield file combinations to try: all; without reference, or fixes as bench position; samples alone."""
    imu, gps = given["imu"], given.get("gps")
    yield {**given}
    if "reference" in given:
        yield {key: path for key, path in given.items() if key != "reference"}
    elif gps is not None and gps != imu:
        yield {"imu": imu, "reference": gps}
    if gps is not None and gps != imu:
        yield {"imu": imu}


def _attempt(parts: Mapping[str, str | Path], patient: _Patient) -> tuple[Recording | None, Drive | None]:
    """Read files; after a refusal, repeat with the inputs that it requests."""
    recording = None
    for _ in range(ATTEMPTS):
        try:
            recording = read(parts["imu"], parts.get("gps"), parts.get("reference"), patient.inputs)
            return recording, drive_of(recording)
        except InsnavError as error:
            if not patient.refused(error):  # no new input to try
                break
    return recording, None


def _fixes_alone(path: str | Path, found: Checked, patient: _Patient) -> tuple[dict[str, ReadingFacts], Checked]:
    """Examine a file of fixes if there are no IMU samples."""
    inputs = patient.inputs
    try:
        reading = read_gps(path, columns=inputs.get("gps_columns"), height=inputs.get("gps_height"))
    except InsnavError as error:
        patient.refused(error)
        return {}, found
    found = replace(found, gps=look_at_fixes(reading.data))
    _of_gps(reading, found, patient)
    return {"gps": reading.facts}, found


def _examined(found: Checked, data: Recording, drive: Drive | None, patient: _Patient) -> Checked:
    """Add statistics of the data to the result, and problems to `patient`."""
    imu = data.imu.data
    fixes = None if data.gps is None else with_sd(data.gps.data)[0]
    has_both = drive is not None and fixes is not None
    if drive is not None and drive.fixes is None:
        patient.refused(InputError("session.no_gps"))
    try:
        rest = stationary_part(imu, fixes if has_both else None, data.inputs)
    except InsnavError:
        rest = None
    still = _standing(imu, data.gps.data) if has_both and data.gps is not None else None
    found = replace(found, imu=inspect_samples(imu, rest, still), rest=rest)
    _report_sensor_faults(imu, patient)
    for reading in data.given().values():
        lost_rows = of_code((*reading.events, *reading.facts.evidence), Code.ROWS_CUT, Code.READ_ROWS_UNREADABLE)
        patient.problems += lost_rows
    _of_imu(data.imu, found, patient)
    if data.gps is not None:
        found = replace(found, gps=look_at_fixes(data.gps.data))
        _of_gps(data.gps, found, patient)
    if has_both and drive is not None and fixes is not None and data.gps is not None:
        parts = intervals(imu.beginning(BEGIN))
        offset = clock_offset(joined([parts]), fixes)
        significant = offset if isinstance(offset, ClockOffset) and offset.is_shown else None
        found = replace(found, offset=significant, mounting=find_mounting(parts, fixes))
    if drive is not None and drive.fixes is not None:
        found = replace(found, run=_run(drive, patient))
    if data.gps is not None:
        patient.problems += not_covered(data.imu.facts, data.gps.facts)
    if has_both:
        _suggest_options(found, data, patient)
    return found


def _standing(imu: ImuData, gps: GpsData) -> BoolArray | None:
    """Find samples at which the vehicle is stationary by GPS."""
    valid = np.isfinite(gps.v_n).all(axis=1)
    if valid.sum() < 2:
        return None
    return np.asarray(np.interp(imu.time, gps.time[valid], np.linalg.norm(gps.v_n[valid], axis=1)) < STATIC_SPEED)


def _report_sensor_faults(imu: ImuData, patient: _Patient) -> None:
    """Report clipped, stuck and spiking sensors: the first of each kind, and their number."""
    try:
        events = inspect(imu)[1]
    except InsnavError as error:
        patient.refused(error)
        return
    for codes, code in (
        ((Code.IMU_SATURATED, Code.IMU_LIMITED), Code.CHECK_CLIPPED),
        ((Code.IMU_STUCK, Code.IMU_FROZEN), Code.CHECK_STUCK),
        ((Code.IMU_SPIKE,), Code.CHECK_SPIKES),
    ):
        matching = [*of_code(events, *codes)]
        if matching:
            patient.add(code, matching[0].begin, count=len(matching), sensor=matching[0].subject)


def _of_imu(reading: Reading[ImuData], found: Checked, patient: _Patient) -> None:
    facts, figures = reading.facts, found.imu
    assert figures is not None
    if facts.n_gaps:
        patient.add(Code.CHECK_IMU_GAPS, count=facts.n_gaps, longest_s=facts.longest_gap_s)
    for codes, code in (
        ((Code.ROWS_UNSORTED,), Code.CHECK_UNSORTED),
        ((Code.ROWS_DUPLICATE, Code.ROWS_SAME_TIME), Code.CHECK_SAME_TIME),
    ):
        rows = [*of_code(reading.events, *codes)]
        if rows:
            patient.add(code, rows[0].begin, count=sum(each["count"] for each in rows))
    if facts.rate_hz < LEAST_RATE:
        patient.add(Code.CHECK_LOW_RATE, rate_hz=facts.rate_hz, limit_hz=LEAST_RATE)
    share = figures.jitter * facts.rate_hz
    if share > JITTER:
        patient.add(Code.CHECK_JITTER, jitter_s=figures.jitter, share=share, limit=JITTER)
    coarse = [each for each in figures.axes if each.resolution > 0.0 and not np.isnan(each.noise)]
    noisy = [each.name for each in coarse if each.resolution > 3.0 * each.noise * np.sqrt(facts.rate_hz)]
    if noisy:
        patient.add(Code.CHECK_COARSE, sensors=tuple(noisy))
    step, time = figures.gravity_steps
    if abs(step) > STEP:
        patient.add(Code.CHECK_FORCE_STEP, time, step_m_s2=step, limit_m_s2=STEP)
    step, time = figures.jolt
    if step > STEP:
        patient.add(Code.CHECK_JOLT, time, step_m_s2=step, limit_m_s2=STEP, limit=JOLT)
    if found.rest is None:
        patient.add(Code.CHECK_NO_REST)


def _of_gps(reading: Reading[GpsData], found: Checked, patient: _Patient) -> None:
    facts, figures = reading.facts, found.gps
    assert figures is not None
    if figures.with_velocity < 0.5:
        patient.add(Code.CHECK_NO_VELOCITIES, share=1.0 - figures.with_velocity)
    if figures.with_sd < 0.5:
        patient.add(Code.CHECK_NO_SD, share=1.0 - figures.with_sd)
    if figures.false_velocities > 0.002:
        share, speed = figures.false_velocities, figures.worst_velocity
        patient.add(Code.CHECK_FALSE_VELOCITIES, share=share, limit=0.002, speed_m_s=speed)
    if figures.jumps:
        patient.add(Code.CHECK_JUMPS, count=figures.jumps, jump_m=figures.largest_jump)
    ratio = float(np.max(figures.scatter / figures.reported_sd))
    if np.isfinite(ratio) and ratio > 3.0:
        patient.add(Code.CHECK_SMALL_SD, ratio=ratio, limit=3.0)
    if facts.n_gaps:
        patient.add(Code.CHECK_GPS_GAPS, count=facts.n_gaps, longest_s=facts.longest_gap_s)
    if abs(figures.velocity_lag) > max(0.03, 5.0 * figures.velocity_lag_sd):
        patient.add(Code.CHECK_VELOCITY_LAG, lag_s=figures.velocity_lag, sd_s=figures.velocity_lag_sd)


def _run(drive: Drive, patient: _Patient) -> Run | None:
    """Navigate the first `BEGIN` seconds of a drive by the filter alone; if this fails, the drive by ``insnav run``.

    None if the files are refused or the filter diverges.
    """
    if drive.gps is not None and drive.reference is not None and same_positions(drive.gps.data, drive.reference.data):
        patient.add(Code.CHECK_SAME_DATA)
    run: Run | None = None
    fault: Finding | None = None
    with suppress(InsnavError):
        begin = drive.beginning(BEGIN).until("align")
        run = looked(begin.ready)
        run, fault = replace(run, gps_delay=run.gps_delay + begin.model.clock.value), failure(run)
    if run is None or fault:
        try:
            run = drive.navigate(output_interval=1.0).found.run
        except InsnavError as error:
            patient.refused(error)
            return None
        fault = failure(run)
    if fault:
        patient.refused(DivergenceError("session.contradiction", cause=fault))
        return None
    return run


def _suggest_options(found: Checked, data: Recording, patient: _Patient) -> None:
    """Report estimated axes, GPS delay and lever arm if they are significant; add the axes to the command."""
    axes = data.imu.facts.axes
    if found.mounting and axes and axes != "FRD" and data.inputs.get("axes") is None:
        patient.inputs["axes"] = axes
        patient.add(Code.CHECK_AXES, axes=axes)
    if found.run is None:
        return
    delay, sd = found.run.gps_delay, found.run.gps_delay_sd
    if abs(delay) > WORTH["delay"] and abs(delay) > 4.0 * sd:
        patient.add(Code.CHECK_DELAY, delay_s=delay, sd_s=sd, span_s=np.ptp(found.run.solution.time))
    lever, lever_sd = found.run.lever_b, found.run.lever_sd
    if data.inputs.get("lever_arm") is None:
        if np.linalg.norm(lever) > WORTH["lever"] and bool((np.abs(lever) > 4.0 * lever_sd).any()):
            patient.add(Code.CHECK_LEVER_ARM, lever_m=tuple(lever), sd_m=tuple(lever_sd))
        else:
            patient.add(Code.CHECK_NO_LEVER_ARM)


def _command(patient: _Patient) -> str:
    """Compose the ``insnav run`` command for the files."""
    parts = patient.parts
    words = ["insnav", "run", str(parts["imu"])]
    if parts.get("gps", parts["imu"]) != parts["imu"]:
        words += ["--gps", str(parts["gps"])]
    if "reference" in parts:
        words += ["--ref", str(parts["reference"])]
    for key, value in patient.inputs.items():
        if value is not None and key in INPUTS and INPUTS[key].option:
            words += [INPUTS[key].option, _spelled(value, INPUTS[key].size)]
    return shlex.join(words)


def _spelled(value: object, size: float) -> str:
    """Format the value of an option in its unit; `size`: the unit in SI units."""
    if isinstance(value, Mapping):
        return ",".join(f"{key}={each}" for key, each in value.items())
    if isinstance(value, list | tuple | np.ndarray):
        return ",".join(f"{each:g}" for each in value)
    return f"{value / size:.3f}" if isinstance(value, float) else str(value)
