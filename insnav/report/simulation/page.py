"""Reports and files of simulations: one recording with its data, or an ensemble of runs with its statistics."""

from __future__ import annotations

import hashlib
import json
import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from insnav.alignment.align import GYROCOMPASS_SD
from insnav.alignment.in_motion import SLOWEST
from insnav.attitude import dcm_from_quat
from insnav.earth import OMEGA_EARTH, earth_from_lla, quat_earth_from_level
from insnav.errors.ensemble import BAND, COMPONENTS, FIGURES, GROUPS, Ensemble, band, ensemble, inside
from insnav.findings import Code, Finding
from insnav.imu import ImuErrors, ImuSpec, calibration_to_toml, to_toml
from insnav.imu.specification import gyro_bias_sd
from insnav.messages import sentence
from insnav.output.data_files import write_data, write_table
from insnav.output.folder import RunFolder
from insnav.quantity import Quantity, key_suffix
from insnav.report.page import Light, Page, Section, Verdict, beside, drawn, only_json
from insnav.report.panels import Clock, Curve, Panel, Shade, Track, broken_at_gaps, over_time, wrapped
from insnav.report.run.panels import GROUPS as ERRORS
from insnav.report.save import imu_model, json_ready, section_facts, versions, write_page
from insnav.report.style import AXIS_COLOURS, BLUE, GREEN, GREY, ORANGE, VERMILLION, number
from insnav.report.tables import of_table
from insnav.report.terminal import entry
from insnav.session.simulation import IDEAL, Plan
from insnav.simulate.montecarlo import Runs
from insnav.simulate.motion import MotionProfile
from insnav.simulate.recording import Recording, times
from insnav.simulate.recording import to_toml as gps_to_toml
from insnav.simulate.sensor_errors import GpsSpec
from insnav.simulate.truth import Kinematics, Truth
from insnav.types import FloatArray, IntArray
from insnav.units import DEG

_AT_REST = 0.01  # a motion up to this speed is stationary: its sketch shows angular rate instead of speed [m/s]
_DRAWN = 20_000  # largest number of instants of the motion in reports
_DRAWN_RATE = 97.0  # rate of these instants: no multiple of usual motion frequencies, whose peaks it would miss [Hz]
_GRAVITY = {
    "plumb": "without its north component: for comparison with packages that omit it",
    "linear": "without its north component, and linear in height: for comparison with packages that use this model",
}
_SAMPLES = {"mean": "means over their interval", "instant": "values at an instant", "increment": "increments"}
_FACTORS = np.array([1.0] * 6 + [1.0 / DEG] * 3)  # SI to display units of `COMPONENTS`
# A note explains a large NEES of position by time-correlated fixes above these limits: share of variance, NEES [-].
_MUCH, _TOO_GOOD = 0.3, 2.0
_MATTERS = 1.25  # the verdict ignores a smaller NEES per axis: the stated sd is then too small by an eighth at most [-]
_SHOWN = 5  # largest number of failures that are listed individually
_COUNTS = ("positions", "rejected", "resets")
_COMPONENTS = tuple(
    (axis if group == "attitude" else f"{axis} {group}", unit) for group, unit, _, axes in ERRORS for axis in axes
)
_UNITS = tuple(unit for _, unit in _COMPONENTS)


def write_recording(folder: RunFolder, plan: Plan, made: Recording) -> tuple[Path, Page]:
    """Write the data, models and report of a simulated recording into an open folder, and commit it."""
    write_data(folder.path("imu.csv"), made.imu)
    write_data(folder.path("gps.csv"), made.gps)
    write_data(folder.path("ref.csv"), made.reference)
    texts = model_texts(plan)
    if made.errors is not None:
        texts["sensor_realisation.toml"] = calibration_to_toml(made.errors)
    page = recording_page(plan, made)
    return write_page(folder, page, plan_metadata(plan), texts, figures="page"), page


def recording_page(plan: Plan, made: Recording) -> Page:
    """Lay out a simulated recording; the last line of the summary is the command that navigates the recording."""
    time, motion = seen(plan.truth)
    command = run_command(plan, made.lever_b, motion)
    samples = f"{len(made.imu.time)} samples at {plan.rate:g} Hz, {_SAMPLES[plan.sampling]}"
    counts = of_table(
        "simulation.counts", made, imu_samples=len(made.imu.time), gps_fixes=len(made.gps.time), command=command
    )
    motion_part = motion_section(plan, time, motion)
    absent = () if plan.imu is None else plan.imu.absent
    realisation = () if made.errors is None else (_realisation(made.errors),)
    return Page(
        f"Simulated recording of {plan.motion.name}",
        (
            *motion_lines(plan, time, motion),
            entry("IMU", f"{model_name(plan.imu)}: {samples}"),
            entry("GPS", f"{model_name(plan.gps)}: {len(made.gps.time)} fixes; seed {plan.seed}"),
            *(entry("fault", text) for text in plan.configuration.get("fault", [])),
            entry("next", command),
        ),
        (motion_drawings(plan, time, motion), motion_part, *realisation, sensor_section(plan, *counts)),
        findings=(Finding.of(Code.SIMULATION_ABSENT, terms=absent),) if absent else (),
        merits=(*motion_part.items[:3], *counts[:2], sensor_section(plan).items[0]),
        verdict=Verdict(
            "good",
            "the exact motion is in ref.csv",
            f"{plan.truth.duration:.0f} s of {plan.motion.name}: {model_name(plan.imu)} IMU at {plan.rate:g} Hz, "
            f"{len(made.gps.time)} fixes of {model_name(plan.gps)} GPS.",
        ),
        names=frozenset({plan.motion.name}),
    )


def model_texts(plan: Plan) -> dict[str, str]:
    """Return contents of text files by name: simulated motion profile, IMU and GPS receiver, if not ideal."""
    texts = {
        "profile.toml": plan.motion.profile,
        "imu.toml": "" if plan.imu is None else to_toml(plan.imu),
        "gps.toml": "" if plan.gps is None else gps_to_toml(plan.gps),
    }
    return {name: text for name, text in texts.items() if text}


def plan_metadata(plan: Plan) -> dict[str, Any]:
    """Return the first part of the ``run.json`` of a simulation: options, seed, IMU model and faults."""
    model = (
        {"name": IDEAL}
        if plan.imu is None
        else section_facts([imu_model(plan.imu, Finding.of(Code.IMU_MODEL_SIMULATED))])["imu_model"]
    )
    faults = plan.configuration.get("fault", [])
    return {"configuration": plan.configuration, "seed": plan.seed, "imu_model": model, "faults": faults}


def model_name(model: ImuSpec | GpsSpec | None) -> str:
    """Return the name of a sensor model; None is an ideal sensor."""
    return IDEAL if model is None else model.name


def sensor_section(plan: Plan, *more: Quantity) -> Section:
    """Build the quantities of sensor sampling and GPS receiver of a simulation, then `more`, for ``run.json``."""
    items = (
        Quantity("imu_rate", plan.rate, "Hz"),
        Quantity("imu_sampling", plan.sampling),
        Quantity("gps_model", model_name(plan.gps)),
        *more,
    )
    if plan.gps is None:
        return only_json("", *items)
    share, time = correlated_share(plan.gps), plan.gps.errors.correlation_time
    correlated = only_json("gps_time_correlated", Quantity("share", share), Quantity("correlation_time", time, "s"))
    return only_json("", *items, parts=(correlated,))


def correlated_share(gps: GpsSpec) -> float:
    """Compute the time-correlated share of the variance of a GPS receiver's horizontal errors [-]."""
    errors = gps.errors
    return float(np.sum(np.array(errors.position_drift[:2]) ** 2) / np.sum(errors.position_sd[:2] ** 2))


def plan_key(plan: Plan) -> str:
    """Compute a SHA-256 digest of all that determines simulated runs: options, motion, models, seed, versions."""
    content = {
        "versions": versions(),
        "configuration": plan.configuration,
        "source": plan.motion.source,
        "texts": model_texts(plan),
        "seed": plan.seed,
    }
    return hashlib.sha256(json.dumps(json_ready(content), sort_keys=True).encode()).hexdigest()


def write_sketches(folder: RunFolder, profiles: Sequence[MotionProfile]) -> Path:
    """Write a page with a sketch of every motion profile into an open folder, and commit it."""
    rows = tuple(of_table("simulation.profile", each) for each in profiles)
    sketches = tuple(_sketch(each) for each in profiles)
    return write_page(folder, Page("Motion profiles", (), (Section("profiles", rows=rows), *sketches)))


def _sketch(profile: MotionProfile) -> Section:
    """Draw track and speed of a motion profile."""
    time, motion = seen(profile.truth(0))
    track = drawn(profile.name, profile.purpose, (simulated_track(time, motion, f"track_{profile.name}"),))
    both = (*track.panels, sketch_panel(time, motion, profile.name))
    return replace(track, title=f"{profile.name}: {profile.purpose}", panels=both, columns=2, show="page")


def seen(truth: Truth) -> tuple[FloatArray, Kinematics]:
    """Return the instants at which reports show the motion (n,) [s], and the true motion at these."""
    time = times(truth, min(_DRAWN_RATE, _DRAWN / truth.duration))
    return time, truth.evaluate(time)


def _realisation(errors: ImuErrors) -> Section:
    """Tabulate the constant errors of the simulated IMU, which were sampled from its specification."""
    gyro, accel = (np.diag(matrix) - 1.0 for matrix in (errors.gyro_matrix, errors.accel_matrix))
    items = of_table("simulation.realisation", errors, gyro_scale=gyro, accel_scale=accel)
    note = "constant errors, x, y, z; all of them: sensor_realisation.toml"
    return Section("sensor_realisation", "Sensor realisation", items, note=note)


def run_command(plan: Plan, lever_b: FloatArray, motion: Kinematics) -> str:
    """Write the command that navigates the recording, for use inside its folder.

    `lever_b` (3,): position of the antenna relative to the IMU, body axes [m].
    """
    words = ["insnav", "run", "imu.csv", "--gps", "gps.csv", "--ref", "ref.csv"]
    # the option is needed also for a lever arm of zero: without it, insnav would estimate the lever arm
    words += ["--lever-arm", ",".join(f"{length:g}" for length in lever_b)]
    if plan.sampling == "instant":
        words += ["--imu-sampling", "instant"]
    if _hides_heading(plan, motion):
        words += ["--heading", f"{motion.rph[0, 2] / DEG:.1f}"]
    # the filter needs IMU noise above zero: for an ideal IMU the command names the best grade
    return " ".join([*words, "--imu", "navigation" if plan.imu is None else "imu.toml"])


def _hides_heading(plan: Plan, motion: Kinematics) -> bool:
    """Return whether neither course nor gyrocompass can determine the heading."""
    # `SLOWEST` is the speed that a heading from the course needs: brief motion near this speed does not suffice
    moves = float(np.linalg.norm(motion.v_n[:, :2], axis=1).max()) > 2.0 * SLOWEST
    if moves or plan.imu is None:
        return False
    earth = OMEGA_EARTH * max(math.cos(motion.lla[0, 0]), 1e-9)
    return bool(gyro_bias_sd(plan.imu.gyro).max() > GYROCOMPASS_SD * earth)


def in_folder(command: str, folder: Path) -> str:
    """Add the folder to the file names in the command of `run_command`, for use outside the folder."""
    names = {"imu.csv", "gps.csv", "ref.csv", "imu.toml"}
    return shlex.join(str(folder / word) if word in names else word for word in command.split())


def shown_lines(page: Page, out: Path) -> list[str]:
    """Return the terminal lines of a simulated recording: summary, files, and command."""
    *lines, last = page.summary
    files = entry("files", f"{out}: imu.csv, gps.csv, ref.csv, report.html, run.json and others")
    return [*lines, files, entry("next", in_folder(last[last.index("insnav ") :], out))]


def motion_lines(plan: Plan, time: FloatArray, motion: Kinematics) -> list[str]:
    """Summarise the motion in lines of text."""
    top = float(np.linalg.norm(motion.v_n, axis=1).max())
    extent = f"{plan.truth.duration:.1f} s, {number(track_length(time, motion))} m, up to {number(top)} m/s"
    lines = [entry("motion", f"{plan.motion.name}: {extent}")]
    if plan.truth.gravity != "full":
        lines.append(entry("gravity", _GRAVITY[plan.truth.gravity]))
    deviation = plan.motion.residual
    if deviation is None:
        return lines
    velocity = f" and {number(deviation.velocity)} m/s" if math.isfinite(deviation.velocity) else ""
    text = f"{number(deviation.position)} m{velocity} RMS from its track, at most {number(deviation.farthest)} m"
    return [*lines, entry("replica", text), *(entry("warning", sentence(doubt)) for doubt in deviation.doubts)]


def motion_section(plan: Plan, time: FloatArray, motion: Kinematics) -> Section:
    """Tabulate extent and dynamics of the motion, and for a simulated replica its deviation from the recorded track."""
    lat, lon, height = plan.truth.evaluate(np.array([plan.truth.start])).lla[0]
    heights = np.array([motion.lla[:, 2].min(), motion.lla[:, 2].max()])
    rate, force = (np.abs(values).max(axis=0) for values in (motion.w_ib_b, motion.f_b))
    speed, length = float(np.linalg.norm(motion.v_n, axis=1).max()), track_length(time, motion)
    sizes = {"distance": length, "max_speed": speed, "max_rate": rate, "max_specific_force": force}
    shown = of_table("simulation.motion", plan.truth, height_range=heights, **sizes)
    start = of_table("simulation.start", plan.truth, start_lat=lat, start_lon=lon, start_height=height)
    source = (Quantity(key, value) for key, value in plan.motion.source.items())
    more = (Quantity("name", plan.motion.name), Quantity("purpose", plan.motion.purpose), *source, *start)
    parts = [only_json("", *more)]
    if (deviation := plan.motion.residual) is not None:
        doubts = only_json("", Quantity("doubts", tuple(sentence(each, "en") for each in deviation.doubts)))
        items = of_table("simulation.replica", deviation)
        parts.append(Section("replica", "Simulated replica minus its track", items, parts=(doubts,)))
    return Section("motion", f"Motion: {plan.motion.purpose or plan.motion.name}", shown, parts=tuple(parts))


def motion_drawings(plan: Plan, time: FloatArray, motion: Kinematics) -> Section:
    """Draw the motion as a map, and over time."""
    name = plan.motion.name
    return beside(
        drawn("track", f"Simulated motion {name}", (simulated_track(time, motion),)),
        drawn("motion", f"Simulated motion {name}: output of ideal sensors", motion_panels(time, motion)),
    )


def simulated_track(time: FloatArray, motion: Kinematics, key: str = "track") -> Track:
    """Draw a map of the motion at times (n,) [s], coloured by speed."""
    # the map is the tangent plane at the first position, computed from Earth-centred vectors: this works at the poles
    r_e = earth_from_lla(motion.lla)
    north, east, _ = dcm_from_quat(quat_earth_from_level(motion.lla[:1]))[0].T @ (r_e - r_e[0]).T
    shade = Shade("speed [m/s]", np.linalg.norm(motion.v_n, axis=1))
    lat, lon = np.degrees(motion.lla[0, :2])
    note = f"start at latitude {lat:.5f}°, longitude {lon:.5f}°, height {motion.lla[0, 2]:.1f} m; exact, without errors"
    return Track(key, "Track", east, north, Clock.of(time)(time), (shade,), "time", note=note)


def motion_panels(time: FloatArray, motion: Kinematics) -> tuple[Panel, ...]:
    """Draw speed, height, attitude, angular rate and specific force over times (n,) [s]."""
    tilt, rate = np.degrees(motion.rph[:, :2]).T, np.degrees(motion.w_ib_b).T
    rows = (
        ("Speed", "speed [m/s]", [("speed", np.linalg.norm(motion.v_n, axis=1), BLUE)], 0.1),
        ("Height", "height [m]", [("height", motion.lla[:, 2], BLUE)], 0.1),
        ("Roll and pitch", "angle [deg]", [*zip(("roll", "pitch"), tilt, (BLUE, VERMILLION), strict=True)], 0.1),
        ("Heading", "heading [deg]", [("heading", wrapped(np.degrees(motion.rph[:, 2])), GREEN)], 0.1),
        ("Angular rate", "rate [deg/s]", [*zip("xyz", rate, AXIS_COLOURS, strict=True)], 1e-3),
        ("Specific force", "force [m/s²]", [*zip("xyz", motion.f_b.T, AXIS_COLOURS, strict=True)], 1e-2),
    )
    return over_time(time, rows, "body axes x forward, y right, z down; rate against inertial space")


def sketch_panel(time: FloatArray, motion: Kinematics, key: str) -> Panel:
    """Draw the speed over times (n,) [s]; for a stationary motion, the angular rate."""
    speed = np.linalg.norm(motion.v_n, axis=1)
    if speed.max() > _AT_REST:
        row = ("Speed", "speed [m/s]", [("speed", speed, ORANGE)], 0.1)
    else:
        rate = np.degrees(np.linalg.norm(motion.w_ib_b, axis=1))
        row = ("Angular rate", "rate [deg/s]", [("rate", rate, ORANGE)], 0.1)
    return over_time(time, [row], link=key)[0]


def track_length(time: FloatArray, motion: Kinematics) -> float:
    """Compute the length of the track [m], by the trapezoidal rule."""
    speed = np.linalg.norm(motion.v_n, axis=1)
    return float(np.sum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time)))


def write_runs(folder: RunFolder, plan: Plan, runs: Runs) -> tuple[Path, Page]:
    """Write tables, models and report of an ensemble of runs into an open folder, and commit it.

    `runs`: results of `insnav.errors.ensemble.NavigatedRecording`. Raises: InputError: every run failed.
    """
    found = ensemble(runs, plan.truth)
    write_table(folder.path("runs.csv"), _rows(runs))
    write_table(folder.path("ensemble.csv"), _epochs(found))
    page = ensemble_page(plan, found, runs)
    return write_page(folder, page, plan_metadata(plan), model_texts(plan)), page


def ensemble_page(plan: Plan, found: Ensemble, runs: Runs) -> Page:
    """Lay out an ensemble of simulated runs: errors, consistency with the stated sd, and the motion."""
    time, motion = seen(plan.truth)
    columns = dict(zip(FIGURES, runs.figures.T, strict=True))
    share = inside(found).mean(axis=0) if len(found.nees) else ()
    nees = {name: float(columns[f"nees_{name}"].mean()) for name in GROUPS[: len(share)]}
    inside_band = dict(zip(GROUPS, map(float, share), strict=False))
    horizontal = columns["rms_horizontal"]
    mean, worst = float(horizontal.mean()), float(horizontal.max())
    positions, rejected, resets = (int(columns[name].sum()) for name in _COUNTS)
    failed = tuple(failures_of(runs))
    failures = tuple(of_table("simulation.failure", each) for each in runs.failures)
    parts = (Section("failed", rows=failures, show="json"), _errors(found))
    sizes = {"rms_horizontal": {"mean": mean, "largest": worst}, "nees_per_axis": nees, "nees_band": BAND}
    counts = {"runs": len(runs.number), "fixes": positions, "rejected": rejected, "resets": resets}
    items = of_table("simulation.ensemble", **sizes, nees_inside_band=inside_band, **counts)
    inside_text = ", ".join(f"{name} {number(nees[name])} ({100.0 * part:.0f} %)" for name, part in inside_band.items())
    count, imu = len(runs.number), model_name(plan.imu)
    drawings = [drawn("ensemble", f"RMS error and stated sd of {count} runs", ensemble_panels(found), columns=3)]
    if len(found.nees):
        drawings.append(drawn("nees", "Normalised error squared at the fixes", nees_panels(found)))
    return Page(
        f"{len(runs.number)} simulated runs of {plan.motion.name}",
        (
            *motion_lines(plan, time, motion),
            entry("runs", f"{count} of {imu} and {model_name(plan.gps)}, seed {plan.seed}"),
            entry("horizontal", f"RMS {number(mean)} m in the mean of the runs, {number(worst)} m in the worst"),
            entry("NEES", inside_text or "not known: there was no fix"),
            entry(
                "", f"per axis: 1 if the stated sd is right (share of the fixes inside the {100.0 * BAND:.0f} % band)"
            ),
            entry("rejected", f"{rejected} of {positions} fixes, {resets} resets"),
            *(entry("note", sentence(each)) for each in correlation_notes(plan.gps, nees)),
        ),
        (
            *drawings,
            Section("ensemble", "Consistency and rejections", items, parts=parts),
            motion_section(plan, time, motion),
            sensor_section(plan),
            motion_drawings(plan, time, motion),
        ),
        (*failed, Finding.of(Code.SIMULATION_RUNS)),
        verdict=_verdict(plan, horizontal, nees, failed),
        merits=(
            Quantity("mean", mean, "m", meaning="horizontal RMS, mean of the runs"),
            Quantity("worst", worst, "m", meaning="horizontal RMS, worst run"),
            *(Quantity(f"nees_{name}", value, meaning=f"NEES per axis, {name}") for name, value in nees.items()),
            Quantity("rejected", f"{rejected} of {positions}", meaning="fixes rejected"),
        ),
        names=frozenset({plan.motion.name}),
    )


def _verdict(plan: Plan, horizontal: FloatArray, nees: Mapping[str, float], failed: Sequence[Finding]) -> Verdict:
    """Rate an ensemble: size of the horizontal errors, and whether the stated sd explains all errors."""
    text = (
        f"{len(horizontal)} runs of {plan.motion.name} with {model_name(plan.imu)} IMU: horizontal error "
        f"{number(float(horizontal.mean()))} m RMS in the mean, {number(float(horizontal.max()))} m in the worst."
    )
    if failed:
        return Verdict("bad", f"{len(failed)} runs failed: {sentence(failed[0])}", text)
    if not nees:
        return Verdict("unknown", "no fix was available to check the stated sd", text)
    name, worst = max(nees.items(), key=lambda each: each[1])
    # errors may be correlated over the whole run: the mean NEES over time may then scatter as much as a single NEES
    chance = float(band(np.array([3 * len(horizontal)]))[1][0])
    light: Light = "attention" if worst > max(chance, _MATTERS) else "good"
    holds = "the stated sd is too small" if light == "attention" else "the stated sd holds"
    limits = f"1 if right, up to {number(chance)} by chance"
    return Verdict(light, f"normalised error squared of {name} {number(worst)}, {limits}: {holds}", text)


def failures_of(runs: Runs) -> Iterator[Finding]:
    """Yield findings on the first failed runs, then on the number of other failed runs."""
    for each in runs.failures[:_SHOWN]:
        yield Finding.of(Code.SIMULATION_RUN_FAILED, run=each.number, seed=each.seed, cause=each.error)
    more = len(runs.failures) - _SHOWN
    if more > 0:
        yield Finding.of(Code.SIMULATION_MORE_FAILED, count=more)


def correlation_notes(gps: GpsSpec | None, nees: Mapping[str, float]) -> tuple[Finding, ...]:
    """Explain a too small stated position sd by time-correlated receiver errors, if these are large enough.

    `nees`: mean NEES per axis, by group such as position.
    """
    share = 0.0 if gps is None or nees.get("position", 1.0) < _TOO_GOOD else correlated_share(gps)
    if gps is None or share < _MUCH:
        return ()
    time = gps.errors.correlation_time
    return (Finding.of(Code.SIMULATION_CORRELATED_FIXES, subject=gps.name, share=share, correlation_time_s=time),)


def _errors(found: Ensemble) -> Section:
    rows, sizes = [], (np.sqrt(np.mean(value**2, axis=0)).tolist() for value in (found.rms, found.sd))
    for name, unit, rms, sd in zip(COMPONENTS, _UNITS, *sizes, strict=True):
        error = Quantity("rms", rms, unit, meaning="RMS error")
        ratio = Quantity("ratio", rms / sd if sd else None)
        rows.append((Quantity("component", name), error, Quantity("stated_sd", sd, unit), ratio))
    return Section("errors", "Errors over all runs and times", rows=tuple(rows), keyed=True)


def _rows(runs: Runs) -> dict[str, FloatArray | IntArray]:
    table: dict[str, FloatArray | IntArray] = {"run": runs.number, "seed": runs.seed}
    for name, values in zip(FIGURES, runs.figures.T, strict=True):
        if name in _COUNTS:
            table[name] = values.astype(np.int64)
        elif name.startswith("nees"):
            table[f"{name}_per_axis"] = np.round(values, 6)
        else:
            component = name.split("_", 1)[1]
            # other names, such as horizontal, are lengths like the first component
            i = COMPONENTS.index(component) if component in COMPONENTS else 0
            table[f"{name}{key_suffix(_UNITS[i])}"] = np.round(values * _FACTORS[i], 6)
    return table


def _epochs(found: Ensemble) -> dict[str, FloatArray | IntArray]:
    table: dict[str, FloatArray | IntArray] = {"time_s": np.round(found.time, 6), "runs": found.count}
    for kind, values in (("rms", found.rms), ("sd", found.sd)):
        for i, (name, unit) in enumerate(zip(COMPONENTS, _UNITS, strict=True)):
            table[f"{kind}_{name}{key_suffix(unit)}"] = np.round(values[:, i] * _FACTORS[i], 7)
    # NEES is known only at fixes: the cells of other times stay empty
    rows, fixes = np.searchsorted(found.time, found.nees_time), np.isin(found.nees_time, found.time)
    for name, column in zip(GROUPS, found.nees.T, strict=True):
        values = np.full(len(found.time), np.nan)
        values[rows[fixes]] = np.round(column[fixes], 6)
        table[f"nees_{name}_per_axis"] = values
    return table


def ensemble_panels(found: Ensemble) -> tuple[Panel, ...]:
    """Draw RMS error over all runs and stated sd of the nine navigation errors over time, a panel for each."""
    clock = Clock.of(found.time)
    low, high = (np.sqrt(limit)[:, None] for limit in band(found.count))
    time, columns = broken_at_gaps(
        clock(found.time), np.column_stack((found.rms, found.sd, low * found.sd, high * found.sd))
    )
    panels = []
    note = f"{100 * BAND:.0f} % of the RMS errors lie in the band if the filter is right"
    for column in (3 * group + axis for axis in range(3) for group in range(3)):
        name, unit = _COMPONENTS[column]
        size = 180.0 / np.pi if unit == "deg" else 1.0
        error, sd, lower, upper = (size * columns[:, 9 * part + column] for part in range(4))
        curves = (
            Curve(f"{100 * BAND:.0f} % band", time, upper, BLUE, "band", lower),
            Curve("stated sd", time, sd, BLUE),
            Curve("RMS error", time, error, VERMILLION),
        )
        # The lower limit comes from the stated sd: errors before the departure may be almost zero.
        limits = 0.5 * float(np.nanmin(lower)), 1.5 * float(max(np.nanmax(upper), np.nanmax(error)))
        key, title, label = f"ensemble_{name.replace(' ', '_')}", name.capitalize(), f"error [{unit}]"
        panels.append(Panel(key, title, label, clock.label, curves, "time", note, log="y", limits=limits))
        note = ""
    return tuple(panels)


def nees_panels(found: Ensemble) -> tuple[Panel, ...]:
    """Draw the mean normalised squared error of position, velocity and attitude over time, with its 95 % band."""
    clock = Clock.of(found.nees_time)
    low, high = band(3 * found.nees_count)
    share = inside(found).mean(axis=0)
    time, columns = broken_at_gaps(clock(found.nees_time), np.column_stack((found.nees, low, high)))
    panels = []
    for row, (name, colour) in enumerate(zip(GROUPS, AXIS_COLOURS, strict=True)):
        curves = (
            Curve(f"{100 * BAND:.0f} % of a consistent filter", time, columns[:, 4], GREY, "band", columns[:, 3]),
            Curve("mean of the runs and axes", time, columns[:, row], colour),
        )
        title = f"Normalised error squared of {name}: {100.0 * share[row]:.0f} % of the fixes inside"
        finite = columns[np.isfinite(columns[:, row]), row]
        top = max(float(np.percentile(finite, 99.5)) if finite.size else 1.0, float(np.nanmax(columns[:, 4])))
        note, limits = "" if row else "1 if the stated covariance is right", (0.0, 1.1 * top)
        panels.append(Panel(f"nees_{name}", title, "NEES / 3 [-]", clock.label, curves, "time", note, limits=limits))
    return tuple(panels)
