"""Quantities of a run, built once for page, summary and ``run.json``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from insnav.errors.evaluated_run import LENGTH, EvaluatedRun, ShortWindow, outages, size_at
from insnav.errors.metrics import MOVING_M_S, TrajectoryErrors, accuracy_by_motion, nees, travelled
from insnav.errors.reference_check import ReferenceOffset
from insnav.filter.noise_estimate import NoiseEstimate
from insnav.findings import Code, of_code
from insnav.quantity import Quantity, quantity_of
from insnav.report.page import Section, drawn, one_each, only_json
from insnav.report.panels import Curve, Panel
from insnav.report.style import BLACK, BLUE, GREY, ORANGE, VERMILLION
from insnav.report.tables import of_table
from insnav.sample_statistics import rms, rms_length
from insnav.types import Alignment, BoolArray, FloatArray, Run, SensorErrors, Trajectory

if TYPE_CHECKING:  # only type hints need `insnav.fleet`
    from insnav.fleet.tuning import Tuned

TIMES = (10.0, 30.0, 60.0)  # times since the start of a window in the table of short-duration mechanization [s]
# columns of this table: attribute of `ShortWindow`, key, unit, label
_ROWS = (
    ("position", "position", "m", "position"),
    ("dropped", "position_by_dropped_terms", "m", "by dropped terms"),
    ("rest", "position_by_euler", "m", "by Euler's rule"),
    ("velocity", "velocity", "m/s", "velocity"),
    ("untilted", "position_if_dropped_from_attitude_too", "m", "attitude too"),
)


def short_section(windows: Sequence[ShortWindow]) -> Section:
    """Tabulate and draw the difference between short-duration and full mechanization: RMS and largest, horizontal."""
    after = {}
    for time in TIMES:
        sizes = {key: size_at(windows, name, time) for name, key, _, _ in _ROWS}
        after[f"after_{time:g}_s"] = tuple(
            Quantity(key, {"rms": rms(sizes[key]), "max": float(sizes[key].max())}, unit, meaning=label)
            for _, key, unit, label in _ROWS
        )
    title = "Short-duration mechanization minus the full one, horizontal"
    shape = f"{len(windows)} windows of {LENGTH:g} s, free-inertial from the same state"
    caption = "Short-duration mechanization minus the full one"
    drawing = drawn("short_mechanization", caption, short_panels(windows), shape)
    note = "Earth and transport rate dropped from the velocity; last columns: position if from the attitude as well"
    return Section(
        "short_mechanization",
        "Short-duration mechanization",
        (Quantity("windows", len(windows)), Quantity("mean_speed", float(np.mean([w.speed for w in windows])), "m/s")),
        parts=(one_each("", title, after, "time", note), drawing),
    )


def short_panels(windows: Sequence[ShortWindow]) -> Iterator[Panel]:
    """Draw the difference between short-duration and full mechanization in every window, and its RMS by cause."""
    elapsed = windows[0].elapsed

    def sizes(name: str) -> FloatArray:
        horizontal = (np.hypot(*getattr(window, name)[:, :2].T) for window in windows)
        return np.array([np.interp(elapsed, w.elapsed, size) for w, size in zip(windows, horizontal, strict=True)])

    def mean(name: str) -> FloatArray:
        return np.asarray(np.sqrt(np.mean(sizes(name) ** 2, axis=0)))

    for title, name, label in (
        ("Position", "position", "horizontal [m]"),
        ("Velocity", "velocity", "horizontal [m/s]"),
        ("Position, if Earth and transport rate are dropped from the attitude too", "untilted", "horizontal [m]"),
    ):
        size = sizes(name)
        curves = [Curve("each window", elapsed, each, GREY, "thin") for each in size]
        curves += [Curve("RMS", elapsed, mean(name), BLUE), Curve("largest", elapsed, size.max(axis=0), ORANGE)]
        if name == "position":
            curves.append(Curve("RMS caused by the dropped terms", elapsed, mean("dropped"), BLACK, "dashed"))
            curves.append(Curve("RMS by Euler's rule", elapsed, mean("rest"), VERMILLION, "dashed"))
        across = "time since the start of the window [s]"
        yield Panel(f"short_{name}", f"{title}, short minus full", label, across, tuple(curves), "short")


def short_columns(windows: Sequence[ShortWindow]) -> dict[str, FloatArray]:
    """Return the columns of ``short.csv``: time, window start, and the differences on each axis in all windows."""
    columns = {
        "time_s": np.round(np.concatenate([w.start + w.elapsed for w in windows]), 9),
        "window_start_s": np.concatenate([np.full(len(w.elapsed), w.start) for w in windows]),
    }
    for name, unit in (("position", "m"), ("velocity", "m_s"), ("dropped", "m"), ("untilted", "m")):
        values = np.concatenate([getattr(w, name) for w in windows])
        columns |= {f"{name}_{axis}_{unit}": np.round(values[:, i], 6) + 0.0 for i, axis in enumerate("ned")}
    return columns


SHOWN_STATISTICS = ("rms", "p95", "max")
SHOWN_ERRORS = tuple(
    Quantity(key, None, unit)
    for key, unit in (
        *((name, "m") for name in ("horizontal", "north", "east", "down")),
        *((name, "m/s") for name in ("velocity_horizontal", "velocity_down")),
        *((name, "deg") for name in ("roll", "pitch", "heading")),
    )
)
_REASONS = {
    Code.GATE_QUALITY: "quality",
    Code.GATE_PHYSICAL_POSITION: "physical limit, position",
    Code.GATE_PHYSICAL_VELOCITY: "physical limit, velocity",
    Code.GATE_POSITION: "chi-square, position",
    Code.GATE_VELOCITY: "chi-square, velocity",
}


def run_sections(found: EvaluatedRun, reference: str = "") -> tuple[Section, ...]:
    """Build the sections with all quantities of a run, in page order: accuracy first, events last."""
    run = found.run
    events = Quantity("events", dict(sorted(Counter(event.code.value for event in run.events).items())))
    spans = [
        of_table("run.outage", start=a, end=b, duration=b - a, rejected=rejected) for a, b, rejected in outages(run)
    ]
    return (
        _accuracy("Accuracy of the filtered solution", found.errors, reference),
        *((_reference_offset(offset),) if (offset := found.reference_offset) is not None else ()),
        _smoothed(found, reference),
        _solution(run.solution),
        _fixes(run),
        _aiding(run),
        Section("outages", "GPS outages, and times with every position rejected", rows=tuple(spans)),
        Section("sensor_errors", "Estimated sensor errors at the end", _sensor_errors(run.sensor_errors)),
        *((noise_section(found.noise),) if found.noise is not None else ()),
        Section("alignment", "Initial alignment", alignment_items(run.alignment), show="page"),
        *((short_section(found.short_duration),) if found.short_duration else ()),
        Section("", "Events", (events,), note="events.csv has each of them", show="page"),
    )


def noise_section(found: NoiseEstimate | Tuned) -> Section:
    """Tabulate the noise parameters of IMU and fixes that were estimated from innovations, with 95 % intervals."""
    quantities = []
    for figure in found.figures:
        name, interval = figure.key.replace(".", " ").replace("_", " "), (figure.low, figure.high)
        # GPS parameters without unit are a share of the variance, or factors of the reported sd
        if figure.key.startswith("gps.") and not figure.unit:
            name += " of time-correlated variance" if figure.key == "gps.share" else ", factor of sd"
        name += "" if figure.observable else ", not observable: the prior"
        quantities.append(Quantity(figure.key.replace(".", "_"), figure.value, figure.unit, None, interval, name))
    quantities += [*of_table("run.likelihood", found)]
    note = (
        "imu.toml is the IMU for --imu. gps: factors of sd. prior: the preset. Prior of white gyro noise: "
        "the noise of a minute at rest (0.1 to 0.5 Hz)"
    )
    return Section("noise", "Noise from the innovations", tuple(quantities), note=note)


def alignment_items(alignment: Alignment) -> tuple[Quantity, ...]:
    """Build the quantities of an alignment: time, attitude with its sd, and methods."""
    (roll, pitch, heading), (north, east, down) = alignment.rph, alignment.sd
    time, *level = of_table("run.level", alignment, roll=roll, pitch=pitch, tilt_north_sd=north, tilt_east_sd=east)
    heading_quantity = Quantity("heading", heading % (2.0 * np.pi), "deg", sd=down)
    return (time, *level, heading_quantity, *of_table("run.alignment", alignment))


def _solution(solution: Trajectory) -> Section:
    time = solution.time
    rows = Quantity("rows", len(time))
    if len(time) == 0:
        return Section("solution", "Solution", (rows,))
    extent = {"start": time[0], "end": time[-1], "duration": time[-1] - time[0]}
    extent |= dict(zip(("distance", "moving", "max_speed"), travelled(solution), strict=True))
    rate = 1.0 / float(np.median(np.diff(time))) if len(time) > 1 else None
    sd = None if solution.sd is None else rms_length(solution.sd[:, :2])
    parts = (Section(name, f"State at the {name}", _state(solution, row)) for name, row in (("start", 0), ("end", -1)))
    items = (rows, *of_table("run.solution", **extent, rate=rate, horizontal_sd=sd))
    return Section("solution", "Solution", items, parts=tuple(parts), show="page")


def _state(solution: Trajectory, row: int) -> tuple[Quantity, ...]:
    values = [float(x) for x in (*solution.lla[row], *solution.v_n[row], *solution.rph[row])]
    names = ("lat", "lon", "height", "vn", "ve", "vd", "roll", "pitch", "heading")
    state = of_table("run.state", **dict(zip(names, values, strict=True)))
    if solution.sd is None:
        return state
    position, velocity, attitude = np.split(solution.sd[row], 3)
    return (*state, *of_table("run.state_sd", position_sd=position, velocity_sd=velocity, attitude_sd=attitude))


def _fixes(run: Run) -> Section:
    fixes = run.innovations
    codes = Counter(event.code for event in run.events)
    remark = "" if np.any(run.lever_b) or np.any(run.lever_sd > 0.0) else "(not estimated: taken as zero)"
    groups = {
        "position": _innovations(fixes.innovation[:, :3], fixes.used_position, "m", mean_nis(run, "position")),
        "velocity": _innovations(fixes.innovation[:, 3:], fixes.used_velocity, "m/s", mean_nis(run, "velocity")),
    }
    items = (
        Quantity("delay", run.gps_delay, "s", sd=run.gps_delay_sd),
        Quantity("lever_arm", run.lever_b, "m", sd=run.lever_sd, mark=remark),
        Quantity("rejected_for", {why: codes[code] for code, why in _REASONS.items() if codes[code]}),
    )
    parts = (one_each("", "GPS fixes", groups, "GPS", "NIS per axis is 1 if fixes and filter agree"),)
    return Section("fixes", "GPS: time offset and lever arm", items, parts=parts, show="page")


def mean_nis(run: Run, *halves: str) -> float | None:
    """Compute the mean NIS per axis of the accepted fixes: 1 if the stated sd is right; None without fixes.

    `halves`: "position", "velocity"; by default both. The NIS of a de-weighted fix counts as the gate limit, since its
    covariance was increased until it passed the gate.
    """
    fixes, deweighted = run.innovations, of_code(run.events, Code.DEWEIGHTED_POSITION, Code.DEWEIGHTED_VELOCITY)
    limit = min((event.limit for event in deweighted), default=np.inf)
    groups = halves or ("position", "velocity")
    nis = np.concatenate([getattr(fixes, f"nis_{name}")[getattr(fixes, f"used_{name}")] for name in groups])
    finite = np.minimum(nis[np.isfinite(nis)], limit)
    return float(finite.mean()) / 3.0 if finite.size else None


def _innovations(innovation: FloatArray, used: BoolArray, unit: str, nis: float | None) -> tuple[Quantity, ...]:
    finite = np.isfinite(innovation)
    processed = finite.any(axis=1)
    accepted = np.where(finite & used[:, None], innovation, np.nan)
    rms_by_axis = Quantity("innovation_rms", [rms(each) for each in accepted.T], unit, meaning="innovation RMS N, E, D")
    count = {"accepted": int((processed & used).sum()), "rejected": int((processed & ~used).sum())}
    return (*of_table("run.fixes", processed=int(processed.sum()), **count, nis_mean_per_axis=nis), rms_by_axis)


def _aiding(run: Run) -> Section:
    return Section("aiding", "Aiding besides GPS", rows=tuple(of_table("run.aiding", use) for use in run.aiding))


def _sensor_errors(sensor_errors: SensorErrors) -> tuple[Quantity, ...]:
    if len(sensor_errors.time) == 0:
        return ()
    value, sd = sensor_errors.value[-1], sensor_errors.sd[-1]
    groups = (("gyro_bias", "deg/h"), ("accel_bias", "mg"), ("gyro_scale", "ppm"), ("accel_scale", "ppm"))
    columns = [(*group, slice(3 * i, 3 * i + 3)) for i, group in enumerate(groups)]
    return (
        Quantity("time", sensor_errors.time[-1], "s", decimals=1),
        *(
            Quantity(name, value[axes], unit, sd=sd[axes])
            for name, unit, axes in columns
            if np.isfinite(value[axes]).any()
        ),
    )


def _accuracy(title: str, errors: TrajectoryErrors | None, reference: str) -> Section:
    if errors is None:
        return only_json("", Quantity("accuracy", None))
    parts = {
        part: () if figures is None else tuple(quantity_of(key, value) for key, value in figures.items())
        for part, figures in accuracy_by_motion(errors).items()
    }
    about = of_table("run.compared", reference=reference, epochs=len(errors.time), moving_is_faster_than=MOVING_M_S)
    each = (only_json(part, *items) if items else only_json("", Quantity(part, None)) for part, items in parts.items())
    table = _accuracy_table(title, parts)
    return Section("accuracy", parts=(only_json("", *about), *each, table, _consistency(nees(errors))))


def _reference_offset(found: ReferenceOffset) -> Section:
    """Tabulate constant differences from the reference: position of its reference point on the vehicle, and height."""
    items = (
        Quantity("forward", found.body[0], "m", sd=found.body_sd[0], meaning="point of the reference, forward"),
        Quantity("right", found.body[1], "m", sd=found.body_sd[1], meaning="point of the reference, right"),
        *of_table("run.reference_offset", found),
    )
    note = "From the errors themselves; the accuracy above is not corrected by it."
    return Section("reference_offset", "Point and height of the reference", items, note=note)


def _accuracy_table(title: str, parts: Mapping[str, tuple[Quantity, ...]]) -> Section:
    """Tabulate the errors: a row for each; columns RMS, 95 %, largest for the whole drive, stationary, and moving."""
    by_part = {part: {each.key: each for each in items} for part, items in parts.items() if items}
    if len(by_part) == 2:  # a drive entirely stationary or moving: its one part equals the whole
        by_part = {"all": by_part["all"]}
    rows = [
        (
            Quantity("error", f"{error.label} [{error.shown_unit}]"),
            *(_shown(part, quantities[error.key]) for part, quantities in by_part.items()),
        )
        for error in SHOWN_ERRORS
        if by_part["all"][error.key].value is not None
    ]
    return Section("", title, rows=tuple(rows), note=f"Moving: faster than {MOVING_M_S:g} m/s.")


def _shown(part: str, error: Quantity) -> Quantity:
    """Build the statistics of an error, converted to its display unit: the name of the row contains this unit."""
    statistics = error.scaled(error.value) or {}
    return Quantity(part, {name: statistics.get(name) for name in SHOWN_STATISTICS})


def _consistency(found: Mapping[str, Any] | None) -> Section:
    if found is None:
        return only_json("", Quantity("consistency", None))
    groups = {
        name: tuple(quantity_of(key, value) for key, value in (each or {}).items()) for name, each in found.items()
    }
    note = "Mean squared error over stated variance (1 if the stated sd is right), share inside 3 sd (0.997 if normal)."
    return one_each("consistency", "Stated uncertainty", groups, "error", note)


def _smoothed(found: EvaluatedRun, reference: str) -> Section:
    """Tabulate the effect of smoothing: sd, and errors against a reference, relative to the filtered solution."""
    run = found.run
    if run.smoothed is None:
        return only_json("", Quantity("smoothed", None))
    sds = (run.solution.sd, run.smoothed.solution.sd)
    sd = [None if each is None else rms_length(each[:, :2]) for each in sds]
    items = [
        Quantity("horizontal_sd", sd[1], "m"),
        Quantity("horizontal_sd_ratio", _ratio(sd[1], sd[0]), meaning="horizontal sd, smoothed / filtered"),
    ]
    parts: tuple[Section, ...] = ()
    if found.errors is not None and found.smoothed_errors is not None:
        size = [rms(each.horizontal) for each in (found.errors, found.smoothed_errors)]
        ratio = _ratio(size[1], size[0])
        items.append(Quantity("horizontal_rms_ratio", ratio, meaning="RMS error, smoothed / filtered"))
        parts = (_accuracy("Accuracy of the smoothed solution", found.smoothed_errors, reference),)
    return Section("smoothed", "Smoothed solution", tuple(items), parts=parts, show="page")


def _ratio(value: float | None, by: float | None) -> float | None:
    return value / by if value is not None and by else None
