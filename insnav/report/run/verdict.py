"""A run in one sentence, how accurate or how sure and whether what it states is true, and in at most 21 lines."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from insnav.errors.evaluated_run import EvaluatedRun, outages
from insnav.errors.metrics import TrajectoryErrors, nees, travelled
from insnav.errors.reference_check import fixes_are_late, known_delay
from insnav.errors.run_findings import HOLDS
from insnav.filter.gps_noise import heights_measured
from insnav.findings import CORRECTIONS, Code, Severity, of_code
from insnav.input.readers.reading import ReadingFacts
from insnav.messages import sentence
from insnav.plain_text import plain_text, wrapped
from insnav.quantity import Quantity
from insnav.report.numbers import distance_text, duration_text, number
from insnav.report.page import Light, Page, Table, Verdict, cell
from insnav.report.run.quantities import mean_nis
from insnav.report.terminal import WIDTH, table_text
from insnav.result import Result
from insnav.sample_statistics import rms, rms_length
from insnav.types import FloatArray, Run

SCATTER = 2.0  # mean NIS per axis from which on fixes and solution contradict each other
CAREFUL = 3.0  # times the errors of positions from which on what is stated is much more
FEW = 10  # epochs of a reference, fewer of which tell nothing of a whole drive
MOST = 0.5  # of the drive that the reference must cover to say something of the whole
_PARTS = (
    ("horizontal", "m", slice(0, 2)),
    ("vertical", "m", slice(2, 3)),
    ("horizontal velocity", "m/s", slice(3, 5)),
    ("tilt", "deg", slice(6, 8)),
    ("heading", "deg", slice(8, 9)),
)
_WARNINGS, _FOUND, _ASSUMED = 3, 3, 6  # rows of each at most, of the last two together; the others are on the page
_HARDLY, _UNKNOWN = 0.1, 0.7  # from which a delay [s] and an arm [m] that are found are hardly known


def run_verdict(found: EvaluatedRun, warnings: int) -> Verdict:
    """Rate a run by its errors and its number of warnings, or by its innovations where there is no reference."""
    light, reason = _light(found, warnings)
    if found.errors is not None:
        sizes = [_error_size(mode, each.horizontal) for mode, each in found.errors_on_clock.items()]
        as_it_is = f" {_as_it_is(found)}" if found.reference_late else ""
        return Verdict(light, reason, f"Horizontal error {', '.join(sizes)}{as_it_is}; {_holds(found)}.")
    stated = {mode: each.sd for mode, each in found.solutions.items() if each.sd is not None}
    sds = [f"{number(rms_length(sd[:, :2]))} m {mode}" for mode, sd in stated.items()]
    if not sds:
        return Verdict(light, reason, "The solution states no standard deviation, and there is no reference.")
    return Verdict(
        light, reason, f"Stated horizontal sd {', '.join(sds)} (RMS); no reference, so the error is not known."
    )


def _as_it_is(found: EvaluatedRun) -> str:
    """How the clock of a reference was corrected, and the RMS error of the better solution without."""
    size = rms(next(iter(found.known_errors.values())).horizontal)
    return f"with {-found.reference_late:+.2f} s added to the times of the reference, {number(size)} m without"


def _error_size(mode: str, horizontal: FloatArray) -> str:
    """RMS, and the 95 % error where a few epochs make nearly all of the RMS."""
    size, most = rms(horizontal), float(np.percentile(horizontal, 95.0))
    return f"{number(size)} m RMS {mode}" + f" (95 % within {number(most)} m)" * (most < 0.5 * size)


def run_line(result: Result[EvaluatedRun]) -> str:
    """What was navigated: length, distance, rates, outages."""
    run = result.found.run
    if len(run.solution.time) == 0:
        return "The solution is empty."
    time, distance = run.solution.time, travelled(run.solution)[0]
    spans = outages(run)
    inside = [(end - start, rejected) for start, end, rejected in spans if start > time[0] and end < time[-1]]
    since = f" from {time[0]:.1f} s" if abs(time[0]) > 1.0 else ""
    parts = [f"{duration_text(float(np.ptp(time)))}{since}, {distance_text(distance)}"]
    parts += [_rate(name, result.inputs[name]) for name in ("imu", "gps") if name in result.inputs]
    for one, many, refused in (
        ("GPS outage of", "GPS outages, longest", False),
        ("fixes rejected for", "times fixes rejected, longest for", True),
    ):
        if lost := [length for length, rejected in inside if bool(rejected) is refused]:
            parts.append(f"{f'{len(lost)} {many}' if lost[1:] else one} {duration_text(max(lost))}")
    ends = {"before the first used fix": (0, time[0]), "after the last used fix": (1, time[-1])}
    for words, (side, edge) in ends.items():
        parts += [f"{duration_text(each.end - each.start)} {words}" for each in spans if each[side] == edge]
    return "; ".join(parts) + "."


def run_circles(found: EvaluatedRun, reference: str) -> tuple[str, ...]:
    """Say how the horizontal errors of the better solution are distributed."""
    for mode, errors in found.known_errors.items():
        size = errors.horizontal
        cep50, r95 = (number(float(np.percentile(size, share))) for share in (50.0, 95.0))
        return (
            f"CEP50 {cep50} m, R95 {r95} m, largest {number(float(size.max()))} m: {mode} solution minus {reference}, "
            f"at {len(size)} epochs.",
        )
    return ()


def rated(found: EvaluatedRun) -> list[str]:
    """Solutions that have figures of merit, the better one first."""
    return [*found.known_errors] or [mode for mode, each in found.solutions.items() if each.sd is not None]


def run_merits(found: EvaluatedRun, mode: str) -> tuple[Quantity, ...]:
    """Figures of merit of a solution.

    RMS errors, or standard deviations where there is no reference; and whether they agree with what is stated.
    """
    errors, sd = found.known_errors.get(mode), found.solutions[mode].sd
    if errors is not None:
        whole = np.hstack((errors.position, errors.velocity, errors.attitude))
        share = inside(errors)
        within = Quantity("inside_3_sd", share, "%", meaning="position inside 3 sd")
        if errors.sd is None:
            return *_sizes(whole, "error RMS"), within
        stated = Quantity("horizontal_sd", rms_length(errors.sd[:, :2]), "m", meaning="horizontal sd stated")
        return *_sizes(whole, "error RMS"), stated, within
    assert sd is not None
    agree = Quantity("nis_mean_per_axis", mean_nis(found.run), meaning="mean NIS per axis (1 ideal)")
    return *_sizes(sd, "sd"), agree


def _sizes(values: FloatArray, what: str) -> list[Quantity]:
    """RMS of position, velocity and attitude errors ``(n, 9)`` by groups that are known."""
    sizes = [
        Quantity(part, rms_length(values[:, columns]), unit, meaning=f"{part} {what}") for part, unit, columns in _PARTS
    ]
    return [each for each in sizes if isinstance(each.value, float) and np.isfinite(each.value)]


def inside(errors: TrajectoryErrors, group: str = "position") -> float | None:
    """Share of the errors of a group inside three stated standard deviations."""
    stated: dict[str, Any] = (nees(errors) or {}).get(group) or {}
    return stated.get("inside_3_sd")


def _too_sure(found: EvaluatedRun) -> list[str]:
    """What besides the position errs more than stated."""
    groups = ("velocity", "attitude")
    shares = [(group, inside(each, group)) for group in groups for each in found.known_errors.values()]
    return list(dict.fromkeys(group for group, share in shares if share is not None and share < HOLDS))


def _light(found: EvaluatedRun, warnings: int) -> tuple[Light, str]:
    shares = [share for each in found.errors_on_clock.values() if (share := inside(each)) is not None]
    diverged = any(of_code(found.run.events, Code.FILTER_DIVERGED))
    epochs = max((len(each.time) for each in found.errors_on_clock.values()), default=0)
    if 0 < epochs < FEW:
        return "unknown", f"the reference has {epochs} epoch{'s' * (epochs > 1)} within the drive, which tell little"
    if found.other_drive:
        return "unknown", "the reference is of another drive"
    if any(share < HOLDS for share in shares):
        return "bad", "the errors are larger than stated"
    if diverged:
        return "bad", "innovations and stated sd contradict each other"
    if found.reference_late and shares and (mean_nis(found.run) or 0.0) < SCATTER:
        best = next(iter(found.errors_on_clock.values()))
        fixes = fixes_are_late(found.reference_late, known_delay(found.run))
        of_fixes = "the solution has the time of the fixes, not that of samples and reference"
        what = of_fixes if fixes else "the clock of the reference is off, not the solution"
        return "attention", f"{what}: {number(rms(best.horizontal))} m RMS {_as_it_is(found)}"
    more = _too_sure(found) if shares else []
    reasons = [f"{warnings} warning{'s' * (warnings > 1)}"] if warnings else []
    reasons += [f"the errors of {' and '.join(more)} are larger than stated"] if more else []
    if reasons:
        return "attention", "; ".join(reasons)
    if shares:
        if (share := _covered(found)) < MOST:
            return "unknown", f"the reference covers {100.0 * share:.0f} % of the drive; there, errors are as stated"
        return "good", f"no warning, and the errors are within what is stated{_careful(found)}"
    nis = mean_nis(found.run)
    if nis is None:
        return "unknown", "no reference to check against"
    measured = f"NIS {number(nis)} per axis, 1 ideal"
    if nis > SCATTER:
        return "attention", f"the fixes scatter more than the solution states ({measured})"
    agree = "fixes and solution agree" if nis > 1.0 / SCATTER else "the fixes scatter less than stated"
    return "unknown", f"no reference to check against; {agree} ({measured})"


def _careful(found: EvaluatedRun) -> str:
    """How many times as large as the errors of positions is what is stated, where it is much."""
    errors = next(iter(found.errors_on_clock.values()))
    assert errors.sd is not None
    times = rms_length(errors.sd[:, :3]) / max(rms_length(errors.position), 1e-9)
    return f", {number(times)} times their size" if times > CAREFUL else ""


def _covered(found: EvaluatedRun) -> float:
    """Share of the drive that the reference covers, gaps left out."""
    if found.errors is None or len(found.errors.time) < 2:
        return 0.0
    time = found.errors.time
    return float(np.median(np.diff(time))) * len(time) / float(np.ptp(found.run.solution.time))


def _holds(found: EvaluatedRun) -> str:
    share = inside(next(iter(found.errors_on_clock.values())))
    if share is None:
        return "it states no standard deviation"
    holds = "holds" if share >= HOLDS else "does not hold"
    return f"the stated sd of position {holds} ({100.0 * share:.1f} % inside 3 sd)"


def _rate(name: str, facts: ReadingFacts) -> str:
    return f"{name.upper()} {number(facts.rate_hz)} Hz" if facts.rate_hz else name.upper()


def brief_lines(page: Page, found: EvaluatedRun, width: int | None = WIDTH) -> list[str]:
    """Sum up a run: verdict, figures of merit of both solutions, warnings, what was assumed.

    `page`: that of the run; `width`: of the lines, which may cut long texts; none: nothing is wrapped or cut.
    """
    title = _rows(f"{page.title}: {page.summary[0]}" if page.summary else page.title, 2, width)
    verdict = [] if page.verdict is None else _rows(page.verdict.rating, 2, width)
    best, *others = rated(found) or [""]
    table = _table({best: page.merits} | {mode: run_merits(found, mode) for mode in others})
    warnings = _listed("warning", page.warnings, _WARNINGS, width)
    told = "; ".join(_found(found))
    corrections = tuple(sentence(each, at=page.at) for each in of_code(page.findings, *CORRECTIONS))
    doubtful = page.verdict is not None and page.verdict.light == "bad" and not _wrong_reference(found.run)
    doubt = " (doubtful, as the run is)" * doubtful
    shown = _rows(f"found{doubt}: {told}", _FOUND, width) if told else []
    shown += _listed("corrected", corrections, len(CORRECTIONS), width)
    assumed = _listed("assumed", page.assumptions, _ASSUMED - len(shown), width)
    return [*title, *verdict, *table, *warnings, *shown, *assumed]


def _wrong_reference(run: Run) -> bool:
    """Whether the reference is contradicted, so that errors against it need not be those of the run."""
    return any(event.subject == "ref" and event.severity >= Severity.WARNING for event in run.events)


def _found(found: EvaluatedRun) -> Iterator[str]:
    """What gates rejected, and what the drive shows of what was not given."""
    run, heights = found.run, found.gps is None or heights_measured(found.gps.lla)
    yield from _rejected(run, 3 if heights else 2)
    if 0.0 < run.gps_delay_sd < np.inf:
        size, sd = abs(run.gps_delay), max(run.gps_delay_sd, 0.001)
        late = f"the fixes are {size:.3f} ± {sd:.3f} s {'late' if run.gps_delay > 0.0 else 'early'}"
        none = (
            f"the fixes are on time to ± {sd:.3f} s" if sd < _HARDLY else f"delay of the fixes not told, ± {sd:.1f} s"
        )
        yield late if size > 2.0 * sd else none
    if (run.lever_sd > 0.0).any():
        arm = ", ".join(
            f"{x:.2f} ± {max(sd, 0.01):.2f}" if sd < _UNKNOWN else "not told"
            for x, sd in zip(run.lever_b, run.lever_sd, strict=True)
        )
        yield f"lever arm x, y, z {arm} m" if (run.lever_sd < _UNKNOWN).any() else "lever arm not told"


def _rejected(run: Run, measured: int) -> Iterator[str]:
    """Fixes that gates rejected one by one, and how far off they were at most, in so many components of positions."""
    fixes = run.innovations
    for name, unit, part, kinds in (
        ("positions", "m", slice(0, measured), {Code.GATE_POSITION, Code.GATE_PHYSICAL_POSITION}),
        ("velocities", "m/s", slice(3, 6), {Code.GATE_VELOCITY, Code.GATE_PHYSICAL_VELOCITY}),
    ):
        rows = np.isin(fixes.time, [event.begin for event in of_code(run.events, *kinds)])
        every = np.linalg.norm(fixes.innovation[:, part], axis=1)
        if rows.any():
            most = number(float(np.nanmax(every[rows])))
            yield f"{rows.sum()} of {np.isfinite(every).sum()} {name}, up to {most} {unit} off, rejected"


def _table(merits: dict[str, tuple[Quantity, ...]]) -> list[str]:
    """One row a figure, one column a solution."""
    first = next(iter(merits.values()))
    if not first:
        return []
    names = [f"{each.label} [{each.shown_unit}]" if each.shown_unit else each.label for each in first]
    rows = tuple((name, *(cell(own[i]) for own in merits.values())) for i, name in enumerate(names))
    return table_text(Table("", ("", *merits), rows)).splitlines()


def _listed(name: str, texts: Sequence[str], most: int, width: int | None) -> list[str]:
    """The first texts of some, one row each, and how many more there are."""
    of = f" (first {most} of {len(texts)})" if len(texts) > most else ""
    shown = [f"{name}{'' if i else of}: {text}" for i, text in enumerate(texts[:most])]
    return [line for text in shown for line in _rows(text, 2 if len(texts) == 1 else 1, width)]


def _rows(text: str, most: int, width: int | None) -> list[str]:
    """A text in at most so many rows, the rest of it cut; whole in one row without a width."""
    if width is None:
        return [plain_text(text)]
    rows = wrapped(plain_text(text), width, subsequent_indent="  ", break_on_hyphens=False) or [""]
    if len(rows) > most:
        rows[most - 1 :] = [f"{rows[most - 1][: width - 1]}…"]
    return rows
