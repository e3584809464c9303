"""Report of a check of input files: their content, problems, and the command that navigates them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from insnav.findings import Code, Finding, Severity, of_code
from insnav.input.readers.reading import ReadingFacts
from insnav.messages import At, form, moment, phrase, render, sentence, translated
from insnav.plain_text import plain_text
from insnav.quantity import Quantity
from insnav.report.page import DataFrame, Light, Page, Section, Verdict, drawn, only_json, rows_frame
from insnav.report.panels import Clock, Curve, bars, row_panel
from insnav.report.style import BLUE, VERMILLION
from insnav.report.tables import of_table
from insnav.report.terminal import brief_text, hanging, page_text
from insnav.result import Result
from insnav.session.check import Checked
from insnav.steps.one_clock import SIGMAS

_TO_MEND = 3  # largest number of problems listed at the end of the brief text

_BODY = "x, y, z: forward, right, down"


def page(result: Result[Checked]) -> Page:
    """Lay out a check of input files: run command, timeline, files, IMU, GPS, and both together."""
    found = result.found
    sections = _files(found, result.inputs), *_imu(found), *_gps(found), *_both(found)
    line = Quantity("command", found.command if found.runs else None), Quantity("runs_as_given", found.runs_as_given)
    run = _run_line(found, "the first problem is solved")
    to_correct = _to_mend(found)
    files = ", ".join(f"{each.kind} {each.n_used} rows" for each in result.inputs.values())
    reasons = {"good": "no problem found", "attention": f"{len(to_correct)} to mend", "bad": "the files do not run"}
    light: Light = "bad" if not found.runs else "attention" if to_correct else "good"
    return Page(
        "Check of a recording",
        (run,),
        (*_timeline(result), *sections, only_json("mend", *line)),
        verdict=Verdict(light, reasons[light], f"{files or 'No file was read'}."),
    )


def _to_mend(found: Checked) -> list[Finding]:
    """Return the problems that the user can correct, the worst first."""
    return [each for each in found.problems if each.severity > Severity.NOTE and render(each).advice]


def _timeline(result: Result[Checked]) -> tuple[Section, ...]:
    """Draw the time interval that each file covers, with its gaps."""
    inputs = list(result.inputs.values())
    if not inputs:
        return ()
    clock = Clock.of(np.array([min(each.start_s for each in inputs), max(each.end_s for each in inputs)]))
    names = [f"{each.kind}, {each.rate_hz:.4g} Hz" for each in inputs]
    spans = clock([each.start_s for each in inputs]), clock([each.end_s for each in inputs])
    curves = bars(["recorded"] * len(names), {"recorded": BLUE}, *spans, [each.path for each in inputs])
    gaps = [
        (row, each.begin, each.begin + each["gap_s"])
        for row, facts in enumerate(inputs)
        for each in of_code(result.findings, Code.ROWS_GAP)
        if each.subject == facts.kind.lower()
    ]
    if gaps:
        row, begin, end = np.array(gaps).T
        texts = tuple(f"gap of {b - a:.3g} s" for _, a, b in gaps)
        curves.append(Curve("gap", clock(end), row, VERMILLION, "bars", clock(begin), text=texts))
    panel = row_panel("timeline", "Timeline", clock.label, curves, names)
    return (drawn("timeline", "Time span of the files", (panel,)),)


def _run_line(found: Checked, before: str) -> str:
    if found.runs:
        return f"{translated('run:')}  {found.command}"
    so_far = translated("; command so far: ") + found.command if found.command.count(" --") else ""
    return f"{translated('run:')}  {translated(f'nothing to copy before {before}')}{so_far}"


def text(result: Result[Checked], width: int | None = None, *, brief: bool = False) -> str:
    """Write the report for the terminal, with problems and run command last. `brief`: only about 15 lines."""
    laid_out, at = result.page(), _from_start(result)
    first = enumerate(_to_mend(result.found)[: _TO_MEND if brief else None], 1)
    problems = [phrase("terminal.line", name=translated(f"mend {i}"), text=sentence(each, at=at)) for i, each in first]
    problems = problems or [translated("no problem found")]
    listed = {*result.found.problems, *(each for each in result.findings if each.timed)}
    shown = replace(laid_out, summary=(), findings=tuple(each for each in result.findings if each not in listed))
    run = plain_text(_run_line(result.found, "mend 1"))  # not wrapped, as users copy this line
    if brief:
        return brief_text(shown, width, [*hanging([*problems, phrase("terminal.details")], width), run])
    return "\n".join([page_text(shown, width, ("all", "page")), *hanging(["", *problems], width), run])


def _from_start(result: Result[Checked]) -> At:
    """Return a function that writes finding times since the first IMU sample; tables show times as in the files."""
    if "imu" not in result.inputs:
        return moment
    clock = Clock(result.inputs["imu"].start_s, 1.0, "s", "")

    def from_start(begin: float, end: float) -> str:
        time = clock.moment(begin, end)
        return form("from_start").format(time) if begin >= clock.start else time

    return from_start


def _files(found: Checked, inputs: Mapping[str, ReadingFacts]) -> Section:
    rows: list[tuple[Quantity, ...]] = []
    for path, role in found.roles.items():
        members = [each for each in inputs.values() if each.path == path or each.path.startswith(f"{path}/")]
        for facts in members:
            times = of_table("check.file", facts)
            rows.append((Quantity("file", facts.path), Quantity("role", facts.kind, meaning="is"), *times))
        if not members:
            rows.append((Quantity("file", path), Quantity("role", role, meaning="is")))
    return Section("files", "Files", rows=tuple(rows))


def _imu(found: Checked) -> tuple[Section, ...]:
    if found.imu is None:
        return ()
    parts = []
    for sensor, title in (("gyro", "Gyros"), ("accel", "Accelerometers")):
        axes = [each for each in found.imu.axes if each.name.startswith(sensor)]
        rows = tuple(of_table(f"check.{sensor}", each, resolution=each.resolution or None) for each in axes)
        parts.append(Section(sensor, title, rows=rows, note=_BODY))
    peaks = tuple(of_table("check.peak", each) for each in found.imu.peaks)
    (step, step_time), (jolt, jolt_time) = found.imu.gravity_steps, found.imu.jolt
    values = {"rest": None if found.rest is None else np.array(found.rest), "rest_step": step or None}
    values |= {"rest_step_time": step_time, "jolt": jolt or None, "jolt_time": jolt_time}
    items = of_table("check.imu", found.imu, **values)
    return (Section("imu", "IMU", items=items, parts=(*parts, Section("vibration", "Vibration: lines", rows=peaks))),)


def _gps(found: Checked) -> tuple[Section, ...]:
    each = found.gps
    if each is None:
        return ()
    types = ", ".join(f"{kind}: {count}" for kind, count in sorted(each.fix_types.items()))
    return (Section("gps", "GPS", of_table("check.gps", each, fix_types=types or None)),)


def _both(found: Checked) -> tuple[Section, ...]:
    items: list[Quantity] = []
    if found.offset is not None:
        items += [*of_table("check.offset", found.offset)]
    if found.mounting is not None:
        items += [*of_table("check.mounting", found.mounting)]
    if found.run is not None and found.gps is not None:
        arm, sd = (found.run.lever_b, found.run.lever_sd) if np.any(found.run.lever_sd) else (None, None)
        unknown, span = " (not estimated)" * (arm is None), np.ptp(found.run.solution.time)
        late = f"GPS late, by the filter in {span:.0f} s"
        items += [
            Quantity("delay", found.run.gps_delay, "s", sd=found.run.gps_delay_sd, meaning=late),
            Quantity("lever_arm", arm, "m", sd=sd, meaning=f"lever arm by the filter{unknown}"),
        ]
    if not items:
        return ()
    clocks_differ = found.offset is not None and abs(found.offset.offset) > SIGMAS * found.offset.sd
    note = "The offset by motion shows clocks that differ; the delay that counts is that by the filter." * clocks_differ
    return (Section("together", "IMU and GPS together", items=tuple(items), note=note),)


def frame(result: Result[Checked]) -> DataFrame:
    """Build a table of the problems: a row for each, with columns ``what``, ``why``, ``fix``."""
    return rows_frame(
        of_table("check.problem", each, why=f"{each.text} {each.done}".rstrip())
        for each in map(render, result.found.problems)
    )
