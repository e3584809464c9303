"""An ensemble of simulated runs as a folder: a row for each run, errors and stated sd over time, and a page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from insnav.errors.ensemble import BAND, COMPONENTS, FIGURES, GROUPS, Ensemble, band, ensemble, inside
from insnav.findings import Code, Finding
from insnav.messages import sentence
from insnav.output.data_files import write_table
from insnav.output.folder import RunFolder
from insnav.quantity import Quantity, key_suffix
from insnav.report.colours import AXIS_COLOURS, BLUE, GREY, VERMILLION
from insnav.report.numbers import number
from insnav.report.page import Light, Page, Section, Verdict, drawn
from insnav.report.panels import Curve, Panel
from insnav.report.run.panels import GROUPS as ERRORS
from insnav.report.save import write_page
from insnav.report.series import Clock, broken_at_gaps
from insnav.report.simulation import page as recording
from insnav.report.terminal import entry
from insnav.session.simulation import Plan
from insnav.simulate.gps_errors import GpsSpec
from insnav.simulate.montecarlo import Runs
from insnav.types import FloatArray, IntArray
from insnav.units import DEG

_FACTORS = np.array([1.0] * 6 + [1.0 / DEG] * 3)
_MUCH, _TOO_GOOD = 0.3, 2.0  # share of time-correlated errors, and NEES, for one to explain the other
_MATTERS = 1.25  # NEES up to which the stated sd is right to an eighth
_SHOWN = 5  # failures that are named one by one
_COUNTS = ("positions", "rejected", "resets")
_COMPONENTS = tuple(
    (axis if group == "attitude" else f"{axis} {group}", unit) for group, unit, _, axes in ERRORS for axis in axes
)
_UNITS = tuple(unit for _, unit in _COMPONENTS)


def write_runs(folder: RunFolder, plan: Plan, runs: Runs) -> tuple[Path, Page]:
    """Write an ensemble of runs and put its folder in its place.

    `folder`: entered, not committed; `runs`: what the runs came to, as `insnav.errors.ensemble.NavigatedRecording`
    makes them.
    Raises: InputError: every run failed.
    """
    found = ensemble(runs, plan.truth)
    write_table(folder.path("runs.csv"), _rows(runs))
    write_table(folder.path("ensemble.csv"), _epochs(found))
    page = ensemble_page(plan, found, runs)
    return write_page(folder, page, recording.plan_metadata(plan), recording.model_texts(plan)), page


def ensemble_page(plan: Plan, found: Ensemble, runs: Runs) -> Page:
    """Report an ensemble of simulated runs."""
    time, motion = recording.seen(plan.truth)
    columns = dict(zip(FIGURES, runs.figures.T, strict=True))
    share = inside(found).mean(axis=0) if len(found.nees) else ()
    nees = {name: float(columns[f"nees_{name}"].mean()) for name in GROUPS[: len(share)]}
    inside_band = dict(zip(GROUPS, map(float, share), strict=False))
    horizontal = columns["rms_horizontal"]
    positions, rejected, resets = (int(columns[name].sum()) for name in _COUNTS)
    failed = tuple(failures_of(runs))
    failures = tuple(
        (Quantity("run", each.number), Quantity("seed", each.seed), Quantity("code", each.error.code))
        for each in runs.failures
    )
    parts = (Section("failed", rows=failures, show="json"), _errors(found))
    items = (
        Quantity("runs", len(runs.number)),
        Quantity("rms_horizontal", {"mean": float(horizontal.mean()), "largest": float(horizontal.max())}, "m"),
        Quantity("nees_per_axis", nees, meaning="NEES per axis"),
        Quantity("nees_inside_band", inside_band, meaning="share inside the band"),
        Quantity("nees_band", BAND, meaning="probability of the band", digits=2),
        Quantity("fixes", positions),
        Quantity("rejected", rejected),
        Quantity("resets", resets),
    )
    inside_text = ", ".join(f"{name} {number(nees[name])} ({100.0 * part:.0f} %)" for name, part in inside_band.items())
    count, imu = len(runs.number), recording.model_name(plan.imu)
    drawings = [drawn("ensemble", f"RMS error and stated sd of {count} runs", ensemble_panels(found), columns=3)]
    if len(found.nees):
        drawings.append(drawn("nees", "Normalised error squared at the fixes", nees_panels(found)))
    return Page(
        f"{len(runs.number)} simulated runs of {plan.motion.name}",
        (
            *recording.motion_lines(plan, time, motion),
            entry("runs", f"{count} of {imu} and {recording.model_name(plan.gps)}, seed {plan.seed}"),
            entry(
                "horizontal",
                f"RMS {number(float(horizontal.mean()))} m in the mean of the runs, "
                f"{number(float(horizontal.max()))} m in the worst",
            ),
            entry("NEES", inside_text or "not known: there was no fix"),
            entry(
                "", f"per axis: 1 if the stated sd is right (share of the fixes inside the {100.0 * BAND:.0f} % band)"
            ),
            entry("rejected", f"{rejected} of {positions} fixes, {resets} resets"),
            *(entry("note", sentence(each)) for each in correlation_notes(plan.gps, nees)),
            *(entry("failed", sentence(each)) for each in failed),
        ),
        (
            *drawings,
            Section("ensemble", "Consistency and rejections", items, parts=parts),
            recording.motion_section(plan, time, motion),
            recording.sensor_section(plan),
            *recording.motion_drawings(plan, time, motion),
        ),
        (*failed, Finding.of(Code.SIMULATION_RUNS)),
        verdict=_verdict(plan, horizontal, nees, failed),
        merits=(
            Quantity("mean", float(horizontal.mean()), "m", meaning="horizontal RMS, mean of the runs"),
            Quantity("worst", float(horizontal.max()), "m", meaning="horizontal RMS, worst run"),
            *(Quantity(f"nees_{name}", value, meaning=f"NEES per axis, {name}") for name, value in nees.items()),
            Quantity("rejected", f"{rejected} of {positions}", meaning="fixes rejected"),
        ),
    )


def _verdict(plan: Plan, horizontal: FloatArray, nees: Mapping[str, float], failed: Sequence[Finding]) -> Verdict:
    """Say how large the errors are, and whether the stated sd explains them."""
    text = (
        f"{len(horizontal)} runs of {plan.motion.name} with {recording.model_name(plan.imu)} IMU: horizontal error "
        f"{number(float(horizontal.mean()))} m RMS in the mean, {number(float(horizontal.max()))} m in the worst."
    )
    if failed:
        return Verdict("bad", f"{len(failed)} runs failed: {sentence(failed[0])}", text)
    if not nees:
        return Verdict("unknown", "there was no fix to hold the stated sd against", text)
    name, worst = max(nees.items(), key=lambda each: each[1])
    # of errors that last the whole run, a mean over time scatters as at one fix
    chance = float(band(np.array([3 * len(horizontal)]))[1][0])
    light: Light = "attention" if worst > max(chance, _MATTERS) else "good"
    words = "the stated sd is too small" if light == "attention" else "the stated sd holds"
    limits = f"1 if right, up to {number(chance)} by chance"
    return Verdict(light, f"normalised error squared of {name} {number(worst)}, {limits}: {words}", text)


def ensemble_lines(page: Page, out: Path) -> list[str]:
    """What the terminal shows of an ensemble: its summary and its files."""
    return [*page.summary, entry("files", f"{out}: runs.csv, ensemble.csv, report.html, run.json, …")]


def failures_of(runs: Runs) -> Iterator[Finding]:
    """Give the first runs that failed, and how many more did."""
    for each in runs.failures[:_SHOWN]:
        yield Finding.of(Code.SIMULATION_RUN_FAILED, run=each.number, seed=each.seed, cause=each.error)
    more = len(runs.failures) - _SHOWN
    if more > 0:
        yield Finding.of(Code.SIMULATION_MORE_FAILED, count=more)


def correlation_notes(gps: GpsSpec | None, nees: Mapping[str, float]) -> tuple[Finding, ...]:
    """Say why the stated position is too good, if it is and the errors of the receiver explain it.

    `nees`: mean per axis, by group.
    """
    share = 0.0 if gps is None or nees.get("position", 1.0) < _TOO_GOOD else recording.correlated_share(gps)
    if gps is None or share < _MUCH:
        return ()
    time = gps.errors.correlation_time
    return (Finding.of(Code.SIMULATION_CORRELATED_FIXES, subject=gps.name, share=share, correlation_time_s=time),)


def _errors(found: Ensemble) -> Section:
    rms, sd = (np.sqrt(np.mean(value**2, axis=0)) for value in (found.rms, found.sd))
    rows = tuple(
        (
            Quantity("component", name),
            Quantity("rms", float(rms[i]), unit, meaning="RMS error"),
            Quantity("stated_sd", float(sd[i]), unit),
            Quantity("ratio", float(rms[i] / sd[i]) if sd[i] else None),
        )
        for i, (name, unit) in enumerate(zip(COMPONENTS, _UNITS, strict=True))
    )
    return Section("errors", "Errors over all runs and times", rows=rows, keyed=True)


def _rows(runs: Runs) -> dict[str, FloatArray | IntArray]:
    table: dict[str, FloatArray | IntArray] = {"run": runs.number, "seed": runs.seed}
    for name, values in zip(FIGURES, runs.figures.T, strict=True):
        if name in _COUNTS:
            table[name] = values.astype(np.int64)
        elif name.startswith("nees"):
            table[f"{name}_per_axis"] = np.round(values, 6)
        else:
            component = name.split("_", 1)[1]
            # what is none of the components is a length
            at = COMPONENTS.index(component) if component in COMPONENTS else 0
            table[f"{name}{key_suffix(_UNITS[at])}"] = np.round(values * _FACTORS[at], 6)
    return table


def _epochs(found: Ensemble) -> dict[str, FloatArray | IntArray]:
    table: dict[str, FloatArray | IntArray] = {"time_s": np.round(found.time, 6), "runs": found.count}
    for kind, values in (("rms", found.rms), ("sd", found.sd)):
        for i, (name, unit) in enumerate(zip(COMPONENTS, _UNITS, strict=True)):
            table[f"{kind}_{name}{key_suffix(unit)}"] = np.round(values[:, i] * _FACTORS[i], 7)
    # a second without a fix has none: an empty cell
    at, fixes = np.searchsorted(found.time, found.nees_time), np.isin(found.nees_time, found.time)
    for name, column in zip(GROUPS, found.nees.T, strict=True):
        values = np.full(len(found.time), np.nan)
        values[at[fixes]] = np.round(column[fixes], 6)
        table[f"nees_{name}_per_axis"] = values
    return table


def ensemble_panels(found: Ensemble) -> tuple[Panel, ...]:
    """Draw root mean square error and stated standard deviation of all nine components over time, axis by axis."""
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
        error, sd, least, most = (size * columns[:, 9 * part + column] for part in range(4))
        curves = (
            Curve(f"{100 * BAND:.0f} % band", time, most, BLUE, "band", least),
            Curve("stated sd", time, sd, BLUE),
            Curve("RMS error", time, error, VERMILLION),
        )
        # by the stated sd: at rest before the start an error may be as good as none
        limits = 0.5 * float(np.nanmin(least)), 1.5 * float(max(np.nanmax(most), np.nanmax(error)))
        key, title, label = f"ensemble_{name.replace(' ', '_')}", name.capitalize(), f"error [{unit}]"
        panels.append(Panel(key, title, label, clock.label, curves, "time", note, log_y=True, limits=limits))
        note = ""
    return tuple(panels)


def nees_panels(found: Ensemble) -> tuple[Panel, ...]:
    """Draw the mean normalised error squared of position, velocity and attitude over time."""
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
        known = columns[np.isfinite(columns[:, row]), row]
        top = max(float(np.percentile(known, 99.5)) if known.size else 1.0, float(np.nanmax(columns[:, 4])))
        note, limits = "" if row else "1 if the stated covariance is right", (0.0, 1.1 * top)
        panels.append(Panel(f"nees_{name}", title, "NEES / 3 [-]", clock.label, curves, "time", note, limits=limits))
    return tuple(panels)
