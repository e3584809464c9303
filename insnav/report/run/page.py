"""Report of a navigated drive: verdict, figures, tables, terminal summary; writing and reading of its files.

The verdict rates the errors against a reference and whether the stated sd holds. Without a reference, it rates the
innovations.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from insnav.deferred import library
from insnav.errors.evaluated_run import HOLDS, EvaluatedRun, outages
from insnav.errors.metrics import TrajectoryErrors, nees, travelled
from insnav.errors.reference_check import delay_shown, fixes_are_late
from insnav.exceptions import InputError
from insnav.filter.gps_noise import heights_measured
from insnav.findings import CORRECTIONS, OF_RESULTS, Code, Finding, Severity, by_time, is_shown, of_code
from insnav.imu.imu_file import to_toml
from insnav.messages import Message, form, phrase, render, word
from insnav.output import solution_tables
from insnav.output.data_files import write_table
from insnav.output.folder import RunFolder, read_facts
from insnav.output.track_files import write_kml
from insnav.quantity import Quantity, key_suffix
from insnav.report.page import DataFrame, Figure, FigureSpec, Later, Light, Page, Section, Table, Verdict, cell
from insnav.report.panels import Clock
from insnav.report.run.quantities import mean_nis, run_sections
from insnav.report.style import distance_text, duration_text, number
from insnav.report.terminal import hanging, table_text
from insnav.result import Result
from insnav.sample_statistics import rms, rms_length
from insnav.types import AidingUse, Alignment, Epochs, FloatArray, GpsData, Innovations, Run, SensorErrors, Smoothed
from insnav.units import DEG, DEG_PER_H

# The terminal table omits these figures of merit, since the verdict contains them.
_IN_WORDS = ("nis_mean_per_axis", "horizontal_sd", "inside_3_sd")
SCATTER = 2.0  # fixes and solution contradict each other above this mean NIS per axis; 1 is ideal [-]
CAREFUL = 3.0  # the verdict calls the stated sd cautious above this ratio of stated sd to position errors [-]
FEW = 10  # a reference needs at least this number of epochs for a verdict
MOST = 0.5  # a reference must cover at least this share of the drive for a good verdict [-]
_PARTS = (
    ("horizontal", "m", slice(0, 2)),
    ("vertical", "m", slice(2, 3)),
    ("horizontal velocity", "m/s", slice(3, 5)),
    ("tilt", "deg", slice(6, 8)),
    ("heading", "deg", slice(8, 9)),
)
_GROUPS = ("velocity", "attitude")
_WARNINGS, _ASSUMED = 3, 6  # largest numbers of warnings and assumptions in the terminal summary
_HARDLY, _UNKNOWN = 0.1, 0.7  # from these sd on, GPS delay [s] and lever arm components [m] count as unknown
_panels = library("insnav.report.run.panels")  # imported on first use, which only a page makes
PDF_PAGES = {
    "summary": ("track",),
    "accuracy": ("position_error", "attitude_error", "uncertainty", "attitude"),
    "filter": ("innovations", "biases"),
}
BACKDROP = "backdrop.geojson"
MOST_POINTS = 50_000  # largest number of points of a backdrop
_DEPTH = {"LineString": 0, "MultiLineString": 1, "Polygon": 1, "MultiPolygon": 2}  # nesting above the lists of points


def run_verdict(found: EvaluatedRun, warnings: int) -> Verdict:
    """Rate a run by its errors against a reference, or by its innovations without one. `warnings`: their number."""
    light, reason = _light(found, warnings)
    if found.errors is not None:
        sizes = tuple(_error_size(mode, each.horizontal) for mode, each in found.errors_on_clock.items())
        unmoved = _unmoved(found) if found.reference_late else ""
        share = inside(next(iter(found.errors_on_clock.values())))
        if share is None:
            holds = phrase("run.states_no_sd")
        else:
            holds = phrase("run.sd_holds" if share >= HOLDS else "run.sd_fails", share=share)
        return Verdict(light, reason, phrase("run.error", sizes=sizes, unmoved=unmoved, holds=holds))
    stated = {mode: each.sd for mode, each in found.solutions.items() if each.sd is not None}
    sds = tuple(
        phrase("run.sd_size", size=number(rms_length(sd[:, :2])), mode=phrase(f"run.{mode}"))
        for mode, sd in stated.items()
    )
    return Verdict(light, reason, phrase("run.sd", sizes=sds) if sds else phrase("run.no_sd"))


def _unmoved(found: EvaluatedRun) -> str:
    """Describe how far the reference clock was shifted, and the better solution's RMS error without this shift."""
    size = rms(next(iter(found.known_errors.values())).horizontal)
    return phrase("run.unmoved", shift_s=-found.reference_late, size=number(size))


def _error_size(mode: str, horizontal: FloatArray) -> str:
    """Write the RMS error, and also the 95 % error if it is below half the RMS, which few epochs then dominate."""
    size, p95 = rms(horizontal), float(np.percentile(horizontal, 95.0))
    p95_text = number(p95) if p95 < 0.5 * size else ""
    return phrase("run.error_size", size=number(size), mode=phrase(f"run.{mode}"), most=p95_text)


def run_line(result: Result[EvaluatedRun]) -> str:
    """Describe the drive in one line: duration, distance, sensor rates, GPS outages, rejected fixes."""
    run = result.found.run
    if len(run.solution.time) == 0:
        return phrase("run.empty")
    time, distance = run.solution.time, travelled(run.solution)[0]
    spans = outages(run)
    # outages inside the drive: neither at its start nor at its end
    inside = [(end - start, rejected) for start, end, rejected in spans if start > time[0] and end < time[-1]]
    parts = [phrase("run.drive", duration=duration_text(float(np.ptp(time))), distance=distance_text(distance))]
    rates = {name: result.inputs[name].rate_hz for name in ("imu", "gps") if name in result.inputs}
    parts += [phrase("run.rate", sensor=name.upper(), rate=number(hz) if hz else "") for name, hz in rates.items()]
    for name, refused in (("outages", False), ("rejected", True)):
        if lost := [length for length, rejected in inside if bool(rejected) is refused]:
            parts.append(phrase(f"run.{name}", count=len(lost), longest=duration_text(max(lost))))
    for name, side, edge in (("before", 0, time[0]), ("after", 1, time[-1])):
        lengths = (duration_text(each.end - each.start) for each in spans if each[side] == edge)
        parts += [phrase(f"run.{name}", length=length) for length in lengths]
    return form("parts").join(parts) + form("stop")


def run_circles(found: EvaluatedRun, reference: str) -> tuple[str, ...]:
    """Describe the horizontal errors of the better solution by CEP50, R95 and maximum; empty without a reference."""
    for mode, errors in found.known_errors.items():
        size = errors.horizontal
        cep50, r95 = (number(float(np.percentile(size, share))) for share in (50.0, 95.0))
        values = {"most": number(float(size.max())), "mode": phrase(f"run.{mode}"), "reference": reference}
        return (phrase("run.circles", cep50=cep50, r95=r95, count=len(size), **values),)
    return ()


def rated(found: EvaluatedRun) -> list[str]:
    """List the solutions that have errors or, without a reference, stated sd; the smoothed solution is first."""
    return [*found.known_errors] or [mode for mode, each in found.solutions.items() if each.sd is not None]


def run_merits(found: EvaluatedRun, mode: str) -> tuple[Quantity, ...]:
    """Build the figures of merit of a solution: RMS errors, or without a reference stated sd, and a consistency check.

    The check is the share of errors inside 3 sd, or without a reference the mean NIS.
    """
    errors, sd = found.known_errors.get(mode), found.solutions[mode].sd
    if errors is not None:
        every_error = np.hstack((errors.position, errors.velocity, errors.attitude))
        inside_3_sd = Quantity("inside_3_sd", inside(errors), "%", meaning=phrase("run.inside_3_sd"))
        if errors.sd is None:
            return *_sizes(every_error, "error"), inside_3_sd
        stated = Quantity("horizontal_sd", rms_length(errors.sd[:, :2]), "m", meaning=phrase("run.stated_sd"))
        return *_sizes(every_error, "error"), stated, inside_3_sd
    assert sd is not None
    return *_sizes(sd, "sd"), Quantity("nis_mean_per_axis", mean_nis(found.run), meaning=phrase("run.nis"))


def _sizes(values: FloatArray, what: str) -> list[Quantity]:
    """Build the RMS of each group, such as horizontal, of navigation errors or sd ``(n, 9)``; omit unknown groups."""
    sizes = [
        Quantity(part, rms_length(values[:, columns]), unit, meaning=phrase(f"run.{what}_of", part=word(part)))
        for part, unit, columns in _PARTS
    ]
    return [each for each in sizes if isinstance(each.value, float) and np.isfinite(each.value)]


def inside(errors: TrajectoryErrors, group: str = "position") -> float | None:
    """Compute the share of position (or velocity, attitude) errors inside 3 stated sd; None without stated sd."""
    stated: dict[str, Any] = (nees(errors) or {}).get(group) or {}
    return stated.get("inside_3_sd")


def _light(found: EvaluatedRun, warnings: int) -> tuple[Light, str]:
    # the first condition that applies decides: unusable references, serious faults, then warnings
    shares = [share for each in found.errors_on_clock.values() if (share := inside(each)) is not None]
    epochs = max((len(each.time) for each in found.errors_on_clock.values()), default=0)
    if 0 < epochs < FEW:
        return "unknown", phrase("run.few_epochs", count=epochs)
    if found.useless_reference:
        why = "other_drive" if found.other_drive else "same_as_gps" if found.reference_is_gps else "noisy_reference"
        return "unknown", phrase(f"run.{why}")
    if any(share < HOLDS for share in shares):
        return "bad", phrase("run.overconfident")
    if any(of_code(found.run.events, Code.FILTER_DIVERGED)):
        return "bad", phrase("run.contradiction")
    if found.reference_late and shares and (mean_nis(found.run) or 0.0) < SCATTER:
        best = next(iter(found.errors_on_clock.values()))
        late = "fixes" if fixes_are_late(found.reference_late, delay_shown(found.run)) else "reference"
        return "attention", phrase(f"run.late_{late}", size=number(rms(best.horizontal)), unmoved=_unmoved(found))
    group_shares = [(group, inside(each, group)) for group in _GROUPS for each in found.known_errors.values() if shares]
    overconfident = tuple(dict.fromkeys(group for group, share in group_shares if share is not None and share < HOLDS))
    reasons = [phrase("run.warnings", count=warnings)] if warnings else []
    reasons += [phrase("run.groups_overconfident", groups=overconfident)] if overconfident else []
    if reasons:
        return "attention", form("parts").join(reasons)
    if shares:
        errors = next(iter(found.errors_on_clock.values()))
        assert errors.sd is not None
        covered = float(np.median(np.diff(errors.time))) * epochs / float(np.ptp(found.run.solution.time))
        if covered < MOST:  # share of the drive with reference epochs
            return "unknown", phrase("run.part", share=covered)
        times = rms_length(errors.sd[:, :3]) / max(rms_length(errors.position), 1e-9)
        return "good", phrase("run.good", times=number(times) if times > CAREFUL else "")
    nis = mean_nis(found.run)
    if nis is None:
        return "unknown", phrase("run.no_reference")
    if nis > SCATTER:
        return "attention", phrase("run.scatter_more", nis=number(nis))
    return "unknown", phrase("run.agree" if nis > 1.0 / SCATTER else "run.scatter_less", nis=number(nis))


def brief_lines(page: Page, found: EvaluatedRun, width: int | None = None) -> list[str]:
    """Summarise a run: verdict, figures of merit of all solutions, first warnings, estimates, corrections, assumptions.

    `page`: page of the run. `width`: line width [characters]; None: no wrapping.
    """
    title = phrase("terminal.line", name=page.title, text=page.summary[0]) if page.summary else page.title
    verdict = [] if page.verdict is None else [page.verdict.rating]
    best, *others = rated(found) or [""]
    merits = {best: page.merits} | {mode: run_merits(found, mode) for mode in others}
    table = _table({mode: [each for each in own if each.key not in _IN_WORDS] for mode, own in merits.items()})
    estimates = form("parts").join(_estimates(found))
    corrections = [render(each, at=page.at).text for each in of_code(page.findings, *CORRECTIONS)]
    # A bad run has doubtful estimates, unless a warning shows that the reference is wrong.
    wrong_reference = any(event.subject == "ref" and event.severity >= Severity.WARNING for event in found.run.events)
    doubtful = page.verdict is not None and page.verdict.light == "bad" and not wrong_reference
    name = "doubtful_estimates" if doubtful else "estimates"
    shown = [*_listed("warning", page.warnings, _WARNINGS), *_listed(name, [estimates] * bool(estimates), 1)]
    shown += _listed("corrected", [form("joint").join(corrections)] * bool(corrections), len(CORRECTIONS))
    # equal assumptions on several files become one entry
    unique = {
        each.get("text") or each.code: each for each in page.findings[::-1] if each.severity is Severity.ASSUMPTION
    }
    assumed = [_with_options(render(each, at=page.at)) for each in reversed(unique.values())]
    shown += _listed("assumed", [form("joint").join(assumed[:_ASSUMED])] * bool(assumed), _ASSUMED, len(assumed))
    return [*hanging([title, *verdict], width), *table, *hanging(shown, width)]


def _with_options(said: Message) -> str:
    """Write a finding: the observation, the action of insnav, and in brackets the options that change this action."""
    options, stop = form("list").join(re.findall("--[a-z-]+", said.advice)), form("stop")
    text = form("joint").join(filter(None, (said.text, said.done)))
    return f"{text.removesuffix(stop)}{form('brackets').format(options)}{stop}" if options else text


def _estimates(found: EvaluatedRun) -> Iterator[str]:
    """Yield phrases on fixes that gates rejected, and on the estimated GPS delay and lever arm."""
    run, heights = found.run, found.gps is None or heights_measured(found.gps.lla)
    yield from _rejected(run, 3 if heights else 2)
    if 0.0 < run.gps_delay_sd < np.inf:
        sd = max(run.gps_delay_sd, 0.001)
        name = "delay" if abs(run.gps_delay) > 2.0 * sd else "on_time" if sd < _HARDLY else "unknown_delay"
        yield phrase(f"run.{name}", delay_s=run.gps_delay, sd_s=sd)
    if (run.lever_sd > 0.0).any():
        arm = tuple(
            f"{x:.2f} ± {max(sd, 0.01):.2f} m" if sd < _UNKNOWN else phrase("run.unknown")
            for x, sd in zip(run.lever_b, run.lever_sd, strict=True)
        )
        yield phrase("run.lever" if (run.lever_sd < _UNKNOWN).any() else "run.unknown_lever", arm=arm)


def _rejected(run: Run, measured: int) -> Iterator[str]:
    """Yield phrases on rejected positions and velocities: number, largest innovation. `measured`: 2 or 3 axes."""
    fixes = run.innovations
    for name, unit, part, kinds in (
        ("rejected_positions", "m", slice(0, measured), {Code.GATE_POSITION, Code.GATE_PHYSICAL_POSITION}),
        ("rejected_velocities", "m/s", slice(3, 6), {Code.GATE_VELOCITY, Code.GATE_PHYSICAL_VELOCITY}),
    ):
        rows = np.isin(fixes.time, [event.begin for event in of_code(run.events, *kinds)])
        sizes = np.linalg.norm(fixes.innovation[:, part], axis=1)
        if rows.any():
            largest = f"{number(float(np.nanmax(sizes[rows])))} {unit}"
            yield phrase(f"run.{name}", count=int(rows.sum()), total=int(np.isfinite(sizes).sum()), most=largest)


def _table(merits: dict[str, list[Quantity]]) -> list[str]:
    """Build the lines of a text table of figures of merit: a row per figure, a column per solution."""
    first = next(iter(merits.values()))
    if not first:
        return []
    names = [f"{each.label} [{each.shown_unit}]" if each.shown_unit else each.label for each in first]
    rows = tuple((name, *(cell(quantities[i]) for quantities in merits.values())) for i, name in enumerate(names))
    return table_text(Table("", ("", *(phrase(f"run.{mode}") for mode in merits)), rows)).splitlines()


def _listed(name: str, texts: Sequence[str], most: int, count: int = 0) -> list[str]:
    """List the first `most` texts, a line for each, with their total number: `count` if one text joins several."""
    name, count = phrase(f"run.{name}"), count or len(texts)
    first = phrase("terminal.first_of", name=name, most=most, count=count) if count > most else name
    return [phrase("terminal.line", name=name if i else first, text=text) for i, text in enumerate(texts[:most])]


def page(result: Result[EvaluatedRun], *, sections: bool = True) -> Page:
    """Lay out a run; without `sections` only title, summary, verdict and figures of merit."""
    found = result.found
    reference = result.inputs["reference"].path if "reference" in result.inputs else ""
    name = result.inputs["imu"].path if "imu" in result.inputs else "a drive"
    merits = {mode: run_merits(found, mode) for mode in rated(found)}
    best = next(iter(merits), "")
    clock = Clock.of(found.run.solution.time)
    shown = tuple(each for each in result.findings if is_shown(each))
    return Page(
        str(Path(*Path(name).parts[-2:])),  # with the folder, as files of many drives have the same name
        (run_line(result), *run_circles(found, Path(reference).name)),
        _sections(found, reference) if sections else (),
        shown,
        at=clock.moment,
        starts_at=clock.start,
        verdict=run_verdict(found, sum(each.severity >= Severity.WARNING for each in shown)),
        merits=merits.get(best, ()),
        merits_note="Root mean square over the drive, solution:" if best else "",
        merits_by=merits,
        method=tuple(phrase("method.run").splitlines()),
    )


def _sections(found: EvaluatedRun, reference: str) -> tuple[Section, ...]:
    accuracy, *others = run_sections(found, reference)
    return (
        Section("", panels=Later(lambda: _panels.run_panels(found)), figures=run_figures(found), show="page"),
        Section("", "Accuracy, stationary and moving", parts=(accuracy,), folded=True),
        Section("", "All figures of the run", parts=tuple(others), folded=True),
    )


def text(result: Result[EvaluatedRun], width: int | None = None) -> str:
    """Summarise a run in a few lines for the terminal."""
    return "\n".join(brief_lines(result.laid_out or page(result, sections=False), result.found, width))


def run_figures(found: EvaluatedRun) -> tuple[FigureSpec, ...]:
    """List the figures of a run for which there are data."""
    run, errors = found.run, found.errors
    if len(run.solution.time) == 0:
        return ()
    names = {"track": "Track, with fixes and outages"}
    if errors is not None:
        names |= {
            f"{group}_error": f"{group.capitalize()} error and its ±3 sd"
            for group in ("position", "velocity", "attitude")
            if np.isfinite(getattr(errors, group)).any()
        }
        names["error_distribution"] = "Distribution of the horizontal error"
    names |= {"height": "Height", "velocity": "Velocity", "attitude": "Attitude"}
    if run.smoothed is not None and run.smoothed.solution.sd is not None and run.solution.sd is not None:
        names["uncertainty"] = "Standard deviation of the filtered and of the smoothed solution"
    if np.isfinite(run.innovations.innovation).any():
        names["innovations"] = "Innovations and their gates"
    if np.isfinite(run.sensor_errors.value).any():
        names["biases"] = "Estimated sensor errors"
    return tuple(FigureSpec(name, caption, partial(_draw, name, found)) for name, caption in names.items())


def _draw(name: str, found: EvaluatedRun) -> Figure:
    from insnav.report.figures import draw_drawings  # imports matplotlib, needed only to draw figures
    from insnav.report.run.panels import figure_drawings

    title, note, drawings, columns = figure_drawings(name, found)
    return draw_drawings(drawings, title, note, columns=columns)


def write_files(result: Result[EvaluatedRun], folder: RunFolder, table_format: solution_tables.TableFormat) -> None:
    """Write solution, fixes, innovations, errors, sensor errors, IMU model, events and track as files.

    `folder`: open, inside its ``with`` block. `table_format` {"csv", "parquet"}: format of the large tables.
    """
    found, run, directory = result.found, result.found.run, folder.directory
    tables = [("", run.solution), ("", run.innovations), ("", run.sensor_errors), ("", found.gps)]
    tables += [("errors", found.errors), ("smoothed_errors", found.smoothed_errors)]
    if run.smoothed is not None:
        tables += [("smoothed", run.smoothed.solution), ("smoothed_biases", run.smoothed.sensor_errors)]
    tables.append(("poses", run.poses))
    for name, table in tables:
        if table is not None:
            solution_tables.write_run_table(directory, table, table_format, name)
    if result.imu_model is not None:
        folder.path("imu.toml").write_text(to_toml(result.imu_model[0]), encoding="utf-8", newline="\n")
    solution_tables.write_events(directory, result.findings or run.events)
    write_kml(directory, found.best, Path(result.inputs["imu"].path).name if "imu" in result.inputs else "track")
    if found.backdrop is not None:
        write_backdrop(found.backdrop, folder.path(BACKDROP))
    if found.short_duration:
        from insnav.report.run.quantities import short_columns

        write_table(folder.path("short.csv"), short_columns(found.short_duration))


def frame(result: Result[EvaluatedRun]) -> DataFrame:
    """Build a table of the smoothed solution, or of the filtered one, with the columns of ``solution.csv``."""
    return result.found.best.to_frame()


def accuracy(found: EvaluatedRun) -> dict[str, dict[str, float]]:
    """Return figures of merit of each solution by name with unit; without a reference, ``sd_`` precedes names of sd."""
    merits = {mode: [each for each in run_merits(found, mode) if each.value is not None] for mode in rated(found)}
    lead = "" if found.known_errors else "sd_"

    def name(each: Quantity) -> str:
        return f"{lead * (each.unit != '')}{each.key.replace(' ', '_')}{key_suffix(each.unit)}"

    return {mode: {name(each): float(each.scaled(each.value)) for each in own} for mode, own in merits.items()}


def read_found(folder: Path, findings: Sequence[Finding]) -> EvaluatedRun:
    """Read a run from its folder; covariances at the epochs and short-duration windows are not stored.

    Raises: InputError: a table is missing or damaged.
    """
    facts = read_facts(folder)
    try:
        fixes, aiding = facts["fixes"], facts["aiding"]
        alignment = _alignment(facts["alignment"])
    except (KeyError, TypeError) as error:
        raise InputError("report.other_version", where=str(folder), key=str(error)) from error
    none = np.empty(0)
    epochs = Epochs(none, np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 4)), np.empty((0, 9, 9)))
    sensor_errors = solution_tables.read_run_table(folder, SensorErrors)
    smoothed = None
    if solution_tables.has_smoothed(folder):
        biases = solution_tables.read_run_table(folder, SensorErrors, "smoothed_biases")
        smoothed = Smoothed(solution_tables.read_solution(folder, "smoothed"), epochs, biases)
    run = Run(
        solution_tables.read_solution(folder),
        solution_tables.read_run_table(folder, Innovations),
        sensor_errors,
        by_time(filter(_is_event, findings)),
        alignment,
        epochs,
        fixes["delay_s"],
        fixes["delay_sd_s"],
        np.array(fixes["lever_arm_m"]),
        np.array(fixes["lever_arm_sd_m"]),
        smoothed,
        tuple(map(_aiding, aiding)),
    )
    errors, smoothed_errors = (
        solution_tables.read_run_table(folder, TrajectoryErrors, name) if any(folder.glob(f"{name}.*")) else None
        for name in ("errors", "smoothed_errors")
    )
    gps = solution_tables.read_run_table(folder, GpsData) if any(folder.glob("fixes.*")) else None
    backdrop = read_backdrop(folder / BACKDROP) if (folder / BACKDROP).is_file() else None
    same = any(each.code is Code.REF_SAME_AS_GPS for each in findings)
    return EvaluatedRun(run, gps, errors, smoothed_errors, backdrop=backdrop, reference_is_gps=same)


def _is_event(finding: Finding) -> bool:
    """Return whether a finding is an event of the filter: it has a time, or is a warning, such as on a reference."""
    is_warning = finding.severity >= Severity.WARNING and finding.get("text") is None
    return finding.code not in OF_RESULTS and (finding.timed or is_warning)


def _alignment(facts: Mapping[str, Any]) -> Alignment:
    rph = (facts[f"{name}_deg"] for name in ("roll", "pitch", "heading"))
    sd = (facts[f"{name}_sd_deg"] for name in ("tilt_north", "tilt_east", "heading"))
    level, heading = (
        Code(name) if name in set(Code) else name for name in (facts["level_method"], facts["heading_method"])
    )
    bias, bias_sd = (_array(facts[f"gyro_bias{name}_deg_h"]) * DEG_PER_H for name in ("", "_sd"))
    return Alignment(
        facts["time_s"],
        _array(rph) * DEG,
        _array(sd) * DEG,
        bias,
        np.where(np.isnan(bias_sd), np.inf, bias_sd),
        None if facts["static_s"] is None else tuple(facts["static_s"]),
        level,
        heading,
    )


def _array(values: Any) -> FloatArray:
    return np.array(list(values), dtype=np.float64)


def _aiding(facts: Mapping[str, Any]) -> AidingUse:
    key = next(key for key in facts if key.startswith("innovation_rms_"))
    unit = key.removeprefix("innovation_rms_").replace("_", "/")
    return AidingUse(facts["name"], facts["processed"], facts["rejected"], facts[key], facts["nis"], unit)


def read_backdrop(file: Path) -> FloatArray:
    """Read the lines of a GeoJSON file (RFC 7946, WGS-84), to draw behind the map.

    Returns: (n, 2) latitude and longitude [rad], with a row of NaN after each line.
    Raises: InputError: no GeoJSON, no line in it, latitudes or longitudes out of range, or too many points.
    """
    try:
        lines = list(_lines(json.loads(file.read_text(encoding="utf-8"))))
        points = [np.array([each[:2] for each in line], dtype=np.float64).reshape(-1, 2)[:, ::-1] for line in lines]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError("report.not_geojson", where=str(file), reason=str(error)) from error
    if not points:
        raise InputError("report.empty_backdrop", where=str(file))
    vertices = np.concatenate([np.vstack((each, np.full((1, 2), np.nan))) for each in points])
    if len(vertices) > MOST_POINTS:
        raise InputError("report.large_backdrop", where=str(file), count=len(vertices), limit=MOST_POINTS)
    if np.nanmax(np.abs(vertices[:, 0])) > 90.0 or np.nanmax(np.abs(vertices[:, 1])) > 180.0:
        raise InputError("report.backdrop_unit", where=str(file))
    return vertices * DEG


def write_backdrop(lines: FloatArray, file: Path) -> None:
    """Write lines (n, 2), latitude and longitude [rad], separated by rows of NaN, as a GeoJSON file."""
    parts = np.split(lines, np.flatnonzero(np.isnan(lines[:, 0])) + 1)
    coordinates = [np.round(each[:-1, ::-1] / DEG, 9).tolist() for each in parts if len(each) > 1]
    file.write_text(json.dumps({"type": "MultiLineString", "coordinates": coordinates}), encoding="utf-8")


def _lines(value: Any) -> Iterator[Any]:
    """Yield the points of every line and polygon ring in a GeoJSON object and its members."""
    kind = value["type"]
    geometry = [value["geometry"]] if value.get("geometry") else []
    for part in value.get("features") or value.get("geometries") or geometry:
        yield from _lines(part)
    if kind in _DEPTH:
        lines = [value["coordinates"]]
        for _ in range(_DEPTH[kind]):
            lines = [each for part in lines for each in part]
        yield from lines
