"""The doctor: what recorded files are, what is wrong with them, and how to run them."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from insnav.alignment import Mounting, find_mounting
from insnav.alignment.clock_offset import ClockOffset
from insnav.exceptions import ClockError, InsnavError
from insnav.filter.fix_figures import FixFigures, look_at_fixes
from insnav.filter.gps_noise import with_sd
from insnav.imu.health import inspect
from insnav.imu.inspection import ImuFigures, inspect_samples
from insnav.input import Reading
from insnav.input.formats.registry import open_tables
from insnav.input.interpret.columns import match_header
from insnav.input.interpret.schema import GPS_SCHEMA, IMU_SCHEMA, Quantity
from insnav.result import Result
from insnav.session.clock import clock_offset
from insnav.session.defaults import stationary_part
from insnav.session.drive import Drive, drive_of
from insnav.session.inputs import INPUTS, Inputs
from insnav.session.read import Readings, read
from insnav.strapdown import intervals
from insnav.types import BoolArray, Event, EventKind, GpsData, ImuData, Run
from insnav.units import G0

TO_MEND = 3
STANDING = 0.3  # GPS speed of a vehicle that stands [m/s]
WORTH = {"delay": 0.05, "lever": 0.2}  # what is worth a word [s], [m]
STEP = 0.004 * G0  # of the specific force from one rest to the next [m/s^2]


@dataclass(frozen=True, slots=True)
class Problem:
    """Something to mend."""

    weight: float  # how much it harms, to order by
    what: str
    why: str
    fix: str


@dataclass(frozen=True, slots=True)
class Checked:
    """What was found in the files."""

    roles: Mapping[str, str]  # file to what it was taken for
    command: str  # line to run them with
    problems: tuple[Problem, ...]  # the worst first
    imu: ImuFigures | None = None
    gps: FixFigures | None = None
    offset: ClockOffset | None = None
    mounting: Mounting | None = None
    run: Run | None = None  # by the filter, if the files can be navigated
    rest: tuple[float, float] | None = None  # first stationary part [s]


@dataclass(slots=True)
class _Patient:
    """Files on their way through the examination."""

    inputs: Inputs
    roles: dict[str, str] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)

    def mend(self, weight: float, what: str, why: str, fix: str) -> None:
        self.problems.append(Problem(weight, what, why, fix))

    def refused(self, weight: float, error: InsnavError) -> None:
        self.mend(weight, f"{error.where}: {error.what}" if error.where else error.what, error.why, error.fix)


def check(files: Sequence[str | Path], inputs: Inputs) -> Result[Checked]:
    """Examine files of a recording, in any order.

    Nothing is refused: what cannot be read or navigated is the first thing to mend.
    """
    patient = _Patient({**inputs})
    given = _sorted(files, patient)
    readings = _read(given, patient)
    drive = _loaded(readings, patient) if readings is not None else None
    data = drive.readings if drive is not None else readings
    found = Checked(dict(patient.roles), "", ())
    if data is not None:
        found = _examined(found, data, drive, patient)
    problems = tuple(sorted(patient.problems, key=lambda each: -each.weight))
    found = replace(found, command=_command(given, patient.inputs), problems=problems)
    facts = {} if data is None else data.facts
    events: tuple[Event, ...] = () if data is None else data.imu.events
    return Result("check", found, facts, {}, None, () if drive is None else drive.notes, events)


def _sorted(files: Iterable[str | Path], patient: _Patient) -> dict[str, str | Path]:
    """Which file is what: IMU, GPS, reference."""
    given: dict[str, str | Path] = {}
    for each in files:
        try:
            tables = open_tables(each)
        except InsnavError as error:
            patient.roles[str(each)] = "not readable"
            patient.refused(100.0, error)
            continue
        kinds = {key.partition(":")[0] for key in tables}
        if "" in kinds:
            headers = next(iter(tables.values())).headers
            kinds = {"imu" if _known(headers, IMU_SCHEMA, "gyro accel dtheta dvel") else "gps"}
            if headers[0] == "1":
                kinds = {"gps" if "imu" in given else "imu"}
        role = "imu" if "imu" in kinds and "imu" not in given else "gps" if "gps" not in given else "reference"
        given[role] = each
        both = {"imu", "gps"} <= kinds
        patient.roles[str(each)] = "IMU and GPS" if both else {"imu": "IMU", "gps": "GPS"}.get(role, role)
        if both:
            given.setdefault("gps", each)
    return given


def _known(headers: Sequence[str], schema: Sequence[Quantity], words: str) -> bool:
    count = 0
    for header in headers:
        try:
            match = match_header(header, schema)
        except InsnavError:
            continue
        count += match is not None and match[0].key.partition("_")[0] in words.split()
    gps = sum(1 for header in headers if _is(header, "lat", "lon"))
    return count >= 3 and count > gps


def _is(header: str, *keys: str) -> bool:
    try:
        match = match_header(header, GPS_SCHEMA)
    except InsnavError:
        return False
    return match is not None and match[0].key in keys


def _read(given: Mapping[str, str | Path], patient: _Patient) -> Readings | None:
    if "imu" not in given:
        patient.mend(99.0, "no file with IMU data", "none has gyros and accelerometers", "give the IMU file too")
        return None
    for parts in (("gps", "reference"), ("gps",), ()):
        try:
            return read(
                given["imu"],
                given.get("gps") if "gps" in parts else None,
                given.get("reference") if "reference" in parts else None,
                patient.inputs,
            )
        except InsnavError as error:
            if all(problem.what.find(error.what) < 0 for problem in patient.problems):
                patient.refused(98.0, error)
    return None


def _loaded(readings: Readings, patient: _Patient) -> Drive | None:
    """The drive, with the offset of the clocks that it was refused with."""
    if readings.gps is None:
        patient.mend(50.0, "no GPS", "no file holds positions", "give the fixes too, or see insnav align")
    for _ in range(2):
        try:
            return drive_of(replace(readings, inputs=patient.inputs))
        except InsnavError as error:
            patient.refused(95.0, error)
            if not isinstance(error, ClockError) or patient.inputs.get("time_offset") is not None:
                return None
            patient.inputs["time_offset"] = error.offset
    return None


def _examined(found: Checked, data: Readings, drive: Drive | None, patient: _Patient) -> Checked:
    """Figures of what there is, and what is wrong with it."""
    imu = data.imu.data
    fixes = None if data.gps is None else with_sd(data.gps.data)[0]
    together = drive is not None and fixes is not None
    try:
        rest = stationary_part(imu, fixes if together else None, data.inputs)
    except InsnavError:
        rest = None
    still = _standing(imu, data.gps.data) if together and data.gps is not None else None
    found = replace(found, imu=inspect_samples(imu, rest, still), rest=rest)
    _faults(imu, patient)
    _of_imu(data.imu, found, patient)
    if data.gps is not None:
        found = replace(found, gps=look_at_fixes(data.gps.data))
        _of_gps(data.gps, found, patient)
    if together and drive is not None and fixes is not None and data.gps is not None:
        parts = intervals(imu)
        found = replace(found, offset=clock_offset(parts, fixes), mounting=find_mounting(parts, fixes))
        found = replace(found, run=_run(drive, patient))
        _of_both(found, data, patient)
    return found


def _standing(imu: ImuData, gps: GpsData) -> BoolArray | None:
    """Samples at which GPS says that the vehicle stands."""
    known = np.isfinite(gps.v_n).all(axis=1)
    if known.sum() < 2:
        return None
    speed = np.interp(imu.time, gps.time[known], np.linalg.norm(gps.v_n[known], axis=1))
    return np.asarray(speed < STANDING)


def _faults(imu: ImuData, patient: _Patient) -> None:
    try:
        events = inspect(imu)[1]
    except InsnavError as error:
        patient.refused(90.0, error)
        return
    kinds = (
        (EventKind.IMU_SATURATED, 70.0, "clipped samples", "take a larger range or a softer mount"),
        (EventKind.IMU_STUCK, 80.0, "a sensor that is stuck", "look at cable and logger"),
        (EventKind.IMU_SPIKE, 22.0, "single spikes", "look at cable and logger; they are replaced"),
    )
    for kind, weight, word, fix in kinds:
        some = [event for event in events if event.kind is kind]
        if some:
            what = some[0].action.split(":")[0]
            patient.mend(weight, f"{word}, {len(some)} times", f"first {what} at {some[0].time:.1f} s", fix)


def _of_imu(reading: Reading[ImuData], found: Checked, patient: _Patient) -> None:
    facts, figures = reading.facts, found.imu
    assert figures is not None
    if facts.n_gaps:
        patient.mend(
            60.0,
            f"{facts.n_gaps} gaps in the IMU, the longest {facts.longest_gap_s:.3g} s",
            "the motion in them is not known",
            "log to a faster medium, or with a larger buffer",
        )
    for kind, word in ((EventKind.IMU_UNSORTED, "out of order"), (EventKind.IMU_DUPLICATE, "at the time of another")):
        some = [event for event in reading.events if event.kind is kind]
        if some:
            patient.mend(
                30.0,
                f"{sum(event.value for event in some):.0f} samples {word}",
                f"first at {some[0].time:.1f} s",
                "stamp samples where they are taken",
            )
    if facts.rate_hz < 40.0:
        patient.mend(
            55.0,
            f"the IMU has only {facts.rate_hz:.3g} Hz",
            "turns and vibration within a sample are lost",
            "record at 100 Hz or more",
        )
    if figures.jitter * facts.rate_hz > 0.05:
        patient.mend(
            20.0,
            f"timestamps of the IMU scatter by {1e3 * figures.jitter:.2g} ms",
            f"{100 * figures.jitter * facts.rate_hz:.0f} % of the interval",
            "stamp them by the sensor's clock",
        )
    coarse = [each for each in figures.axes if each.resolution > 0.0 and not np.isnan(each.noise)]
    noisy = [each.name for each in coarse if each.resolution > 3.0 * each.noise * np.sqrt(facts.rate_hz)]
    if noisy:
        patient.mend(
            25.0,
            f"coarse steps: {', '.join(noisy)}",
            "a step is larger than the noise",
            "choose a smaller range, or more digits in the log",
        )
    if abs(figures.gravity_steps[0]) > STEP:
        patient.mend(
            35.0,
            f"the specific force at rest steps by {1e3 * figures.gravity_steps[0] / G0:+.1f} mg",
            f"between two stops, at {figures.gravity_steps[1]:.1f} s",
            "look for a knock, a change of temperature or a loose mount",
        )
    if found.rest is None:
        patient.mend(15.0, "no rest was found", "bias and noise at rest are not known", "stand still for 20 s first")


def _of_gps(reading: Reading[GpsData], found: Checked, patient: _Patient) -> None:
    facts, figures = reading.facts, found.gps
    assert figures is not None
    if figures.with_velocity < 0.5:
        patient.mend(
            45.0,
            "the fixes have no velocities",
            f"{100 * (1 - figures.with_velocity):.0f} % are without",
            "log them too: NAV-PVT, RMC, BESTVEL",
        )
    if figures.with_sd < 0.5:
        patient.mend(
            42.0,
            "the fixes have no standard deviations",
            "how far to believe them is then assumed",
            "log them too: NAV-PVT, GST",
        )
    if figures.false_velocities > 0.002:
        patient.mend(
            48.0,
            f"{100 * figures.false_velocities:.1f} % of the velocities are false",
            f"by up to {figures.worst_velocity:.3g} m/s against what the positions move",
            "nothing: the filter rejects them",
        )
    if figures.jumps:
        patient.mend(
            46.0,
            f"the position jumps {figures.jumps} times",
            f"by up to {figures.largest_jump:.3g} m against the velocities",
            "nothing: the filter weighs them",
        )
    ratio = figures.scatter / figures.reported_sd
    if np.isfinite(ratio).all() and float(ratio.max()) > 3.0:
        patient.mend(
            44.0,
            "positions scatter more than their standard deviations say",
            f"{float(ratio.max()):.1f} times",
            "scale them, or leave their columns out",
        )
    if facts.n_gaps:
        patient.mend(
            28.0,
            f"{facts.n_gaps} gaps in GPS, the longest {facts.longest_gap_s:.3g} s",
            "the IMU is alone in them",
            "insnav outage says what that costs",
        )
    if abs(figures.velocity_lag) > max(0.03, 5.0 * figures.velocity_lag_sd):
        patient.mend(
            12.0,
            f"velocities lag positions by {figures.velocity_lag:.3f} s",
            "mean velocities since the fix before",
            "nothing: it is corrected",
        )


def _run(drive: Drive, patient: _Patient) -> Run | None:
    """One pass of the filter."""
    try:
        return drive.navigate(smooth=False, aiding="off", output_interval=1.0).found.run
    except InsnavError as error:
        patient.refused(85.0, error)
        return None


def _of_both(found: Checked, data: Readings, patient: _Patient) -> None:
    axes = data.imu.facts.axes
    if axes and axes != "FRD" and data.inputs.get("axes") is None:
        patient.inputs["axes"] = axes
        patient.mend(38.0, f"the IMU's axes point {axes}", "found from gravity and GPS", f"say --imu-axes {axes}")
    if found.run is None:
        return
    delay, sd = found.run.gps_delay, found.run.gps_delay_sd
    if abs(delay) > WORTH["delay"] and abs(delay) > 4.0 * sd:
        patient.mend(
            32.0,
            f"IMU and GPS are {abs(delay):.3f} ± {sd:.3f} s apart",
            "by the filter",
            f"nothing: it is estimated; or --gps-delay {delay:.3f}",
        )
    lever, lever_sd = found.run.lever_b, found.run.lever_sd
    if data.inputs.get("lever_arm") is None:
        seen = np.linalg.norm(lever) > WORTH["lever"] and bool((np.abs(lever) > 4.0 * lever_sd).any())
        text = ", ".join(f"{each:.2f}" for each in lever)
        why = (
            f"the drive shows {text} m (forward, right, down)"
            if seen
            else "it is estimated from the drive, or taken as zero"
        )
        patient.mend(26.0 if seen else 10.0, "the lever arm was not given", why, "measure it: --lever-arm F,R,D")


def _command(given: Mapping[str, str | Path], inputs: Inputs) -> str:
    """Line that runs the files."""
    if "imu" not in given:
        return ""
    words = ["insnav", "run" if "gps" in given else "align", str(given["imu"])]
    if given.get("gps", given["imu"]) != given["imu"]:
        words += ["--gps", str(given["gps"])]
    if "reference" in given:
        words += ["--ref", str(given["reference"])]
    for key, value in inputs.items():
        if value is not None and key in INPUTS and INPUTS[key].option:
            words += [INPUTS[key].option, _spelled(value)]
    return shlex.join(words)


def _spelled(value: object) -> str:
    if isinstance(value, Mapping):
        return ",".join(f"{key}={each}" for key, each in value.items())
    if isinstance(value, list | tuple | np.ndarray):
        return ",".join(f"{each:g}" for each in value)
    return f"{value:.3f}" if isinstance(value, float) else str(value)
