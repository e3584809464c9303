"""Verdict on a run: accuracy or stated uncertainty, their agreement, and a brief summary."""

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
from insnav.messages import form, phrase, sentence, word
from insnav.quantity import Quantity
from insnav.report.numbers import distance_text, duration_text, number
from insnav.report.page import Light, Page, Table, Verdict, cell
from insnav.report.run.quantities import mean_nis
from insnav.report.terminal import hanging, table_text
from insnav.result import Result
from insnav.sample_statistics import rms, rms_length
from insnav.types import FloatArray, Run

_IN_WORDS = ("nis_mean_per_axis", "horizontal_sd", "inside_3_sd")  # figures of merit that the verdict contains
SCATTER = 2.0  # mean NIS per axis from which fixes and solution contradict each other
CAREFUL = 3.0  # ratio of stated sd to position errors that is reported as cautious
FEW = 10  # least number of epochs for a reference
MOST = 0.5  # least share of the drive that a reference must cover
_PARTS = (
    ("horizontal", "m", slice(0, 2)),
    ("vertical", "m", slice(2, 3)),
    ("horizontal velocity", "m/s", slice(3, 5)),
    ("tilt", "deg", slice(6, 8)),
    ("heading", "deg", slice(8, 9)),
)
_WARNINGS, _ASSUMED = 3, 6  # most lines of each; the page has the others
_HARDLY, _UNKNOWN = 0.1, 0.7  # delay [s] and arm [m] sd of hardly known estimates


def run_verdict(found: EvaluatedRun, warnings: int) -> Verdict:
    """Rate a run by errors and number of warnings, or by innovations without a reference."""
    light, reason = _light(found, warnings)
    if found.errors is not None:
        sizes = tuple(_error_size(mode, each.horizontal) for mode, each in found.errors_on_clock.items())
        unmoved = _unmoved(found) if found.reference_late else ""
        return Verdict(light, reason, phrase("run.error", sizes=sizes, unmoved=unmoved, holds=_holds(found)))
    stated = {mode: each.sd for mode, each in found.solutions.items() if each.sd is not None}
    sds = tuple(
        phrase("run.sd_size", size=number(rms_length(sd[:, :2])), mode=phrase(f"run.{mode}"))
        for mode, sd in stated.items()
    )
    return Verdict(light, reason, phrase("run.sd", sizes=sds) if sds else phrase("run.no_sd"))


def _unmoved(found: EvaluatedRun) -> str:
    """Describe the correction of a reference clock, with the better solution's RMS error before it."""
    size = rms(next(iter(found.known_errors.values())).horizontal)
    return phrase("run.unmoved", shift_s=-found.reference_late, size=number(size))


def _error_size(mode: str, horizontal: FloatArray) -> str:
    """Write the RMS error, and the 95 % error if a few epochs dominate the RMS."""
    size, most = rms(horizontal), float(np.percentile(horizontal, 95.0))
    most_m = number(most) if most < 0.5 * size else ""
    return phrase("run.error_size", size=number(size), mode=phrase(f"run.{mode}"), most=most_m)


def run_line(result: Result[EvaluatedRun]) -> str:
    """Describe the drive: length, distance, rates, outages."""
    run = result.found.run
    if len(run.solution.time) == 0:
        return phrase("run.empty")
    time, distance = run.solution.time, travelled(run.solution)[0]
    spans = outages(run)
    inside = [(end - start, rejected) for start, end, rejected in spans if start > time[0] and end < time[-1]]
    since = time[0] if abs(time[0]) > 1.0 else None
    length = duration_text(float(np.ptp(time)))
    parts = [phrase("run.drive", duration=length, start_s=since, distance=distance_text(distance))]
    parts += [_rate(name, result.inputs[name]) for name in ("imu", "gps") if name in result.inputs]
    for name, refused in (("outages", False), ("rejected", True)):
        if lost := [length for length, rejected in inside if bool(rejected) is refused]:
            parts.append(phrase(f"run.{name}", count=len(lost), longest=duration_text(max(lost))))
    for name, side, edge in (("before", 0, time[0]), ("after", 1, time[-1])):
        lengths = (duration_text(each.end - each.start) for each in spans if each[side] == edge)
        parts += [phrase(f"run.{name}", length=length) for length in lengths]
    return form("parts").join(parts) + form("stop")


def run_circles(found: EvaluatedRun, reference: str) -> tuple[str, ...]:
    """Describe the distribution of the better solution's horizontal errors."""
    for mode, errors in found.known_errors.items():
        size = errors.horizontal
        cep50, r95 = (number(float(np.percentile(size, share))) for share in (50.0, 95.0))
        values = {"most": number(float(size.max())), "mode": phrase(f"run.{mode}"), "reference": reference}
        return (phrase("run.circles", cep50=cep50, r95=r95, count=len(size), **values),)
    return ()


def rated(found: EvaluatedRun) -> list[str]:
    """List the solutions with figures of merit, the better one first."""
    return [*found.known_errors] or [mode for mode, each in found.solutions.items() if each.sd is not None]


def run_merits(found: EvaluatedRun, mode: str) -> tuple[Quantity, ...]:
    """Build the figures of merit of a solution.

    RMS errors, or standard deviations without a reference, and their agreement with the stated values.
    """
    errors, sd = found.known_errors.get(mode), found.solutions[mode].sd
    if errors is not None:
        whole = np.hstack((errors.position, errors.velocity, errors.attitude))
        share = inside(errors)
        within = Quantity("inside_3_sd", share, "%", meaning=phrase("run.inside_3_sd"))
        if errors.sd is None:
            return *_sizes(whole, "error"), within
        stated = Quantity("horizontal_sd", rms_length(errors.sd[:, :2]), "m", meaning=phrase("run.stated_sd"))
        return *_sizes(whole, "error"), stated, within
    assert sd is not None
    agree = Quantity("nis_mean_per_axis", mean_nis(found.run), meaning=phrase("run.nis"))
    return *_sizes(sd, "sd"), agree


def _sizes(values: FloatArray, what: str) -> list[Quantity]:
    """Build RMS of position, velocity and attitude errors or sds ``(n, 9)`` by known groups."""
    sizes = [
        Quantity(part, rms_length(values[:, columns]), unit, meaning=phrase(f"run.{what}_of", part=word(part)))
        for part, unit, columns in _PARTS
    ]
    return [each for each in sizes if isinstance(each.value, float) and np.isfinite(each.value)]


def inside(errors: TrajectoryErrors, group: str = "position") -> float | None:
    """Compute the share of a group's errors inside three stated standard deviations."""
    stated: dict[str, Any] = (nees(errors) or {}).get(group) or {}
    return stated.get("inside_3_sd")


def _too_sure(found: EvaluatedRun) -> tuple[str, ...]:
    """List further quantities with errors above their stated sd."""
    groups = ("velocity", "attitude")
    shares = [(group, inside(each, group)) for group in groups for each in found.known_errors.values()]
    return tuple(dict.fromkeys(group for group, share in shares if share is not None and share < HOLDS))


def _light(found: EvaluatedRun, warnings: int) -> tuple[Light, str]:
    shares = [share for each in found.errors_on_clock.values() if (share := inside(each)) is not None]
    diverged = any(of_code(found.run.events, Code.FILTER_DIVERGED))
    epochs = max((len(each.time) for each in found.errors_on_clock.values()), default=0)
    if 0 < epochs < FEW:
        return "unknown", phrase("run.few_epochs", count=epochs)
    if found.useless_reference:
        why = "other_drive" if found.other_drive else "same_as_gps" if found.reference_is_gps else "noisy_reference"
        return "unknown", phrase(f"run.{why}")
    if any(share < HOLDS for share in shares):
        return "bad", phrase("run.overconfident")
    if diverged:
        return "bad", phrase("run.contradiction")
    if found.reference_late and shares and (mean_nis(found.run) or 0.0) < SCATTER:
        best = next(iter(found.errors_on_clock.values()))
        late = "fixes" if fixes_are_late(found.reference_late, known_delay(found.run)) else "reference"
        return "attention", phrase(f"run.late_{late}", size=number(rms(best.horizontal)), unmoved=_unmoved(found))
    more = _too_sure(found) if shares else ()
    reasons = [phrase("run.warnings", count=warnings)] if warnings else []
    reasons += [phrase("run.groups_overconfident", groups=more)] if more else []
    if reasons:
        return "attention", form("parts").join(reasons)
    if shares:
        if (share := _covered(found)) < MOST:
            return "unknown", phrase("run.part", share=share)
        return "good", phrase("run.good", times=_careful(found))
    nis = mean_nis(found.run)
    if nis is None:
        return "unknown", phrase("run.no_reference")
    if nis > SCATTER:
        return "attention", phrase("run.scatter_more", nis=number(nis))
    return "unknown", phrase("run.agree" if nis > 1.0 / SCATTER else "run.scatter_less", nis=number(nis))


def _careful(found: EvaluatedRun) -> str:
    """Write the ratio of stated sd to position errors, if large."""
    errors = next(iter(found.errors_on_clock.values()))
    assert errors.sd is not None
    times = rms_length(errors.sd[:, :3]) / max(rms_length(errors.position), 1e-9)
    return number(times) if times > CAREFUL else ""


def _covered(found: EvaluatedRun) -> float:
    """Compute the share of the drive that the reference covers, without gaps."""
    if found.errors is None or len(found.errors.time) < 2:
        return 0.0
    time = found.errors.time
    return float(np.median(np.diff(time))) * len(time) / float(np.ptp(found.run.solution.time))


def _holds(found: EvaluatedRun) -> str:
    share = inside(next(iter(found.errors_on_clock.values())))
    if share is None:
        return phrase("run.states_no_sd")
    return phrase("run.sd_holds" if share >= HOLDS else "run.sd_fails", share=share)


def _rate(name: str, facts: ReadingFacts) -> str:
    return phrase("run.rate", sensor=name.upper(), rate=number(facts.rate_hz) if facts.rate_hz else "")


def brief_lines(page: Page, found: EvaluatedRun, width: int | None = None) -> list[str]:
    """Summarise a run: verdict, figures of merit of both solutions, warnings, assumptions.

    `page`: of the run. `width`: of the lines; None: no wrapping.
    """
    title = phrase("terminal.line", name=page.title, text=page.summary[0]) if page.summary else page.title
    verdict = [] if page.verdict is None else [page.verdict.rating]
    best, *others = rated(found) or [""]
    merits = {best: page.merits} | {mode: run_merits(found, mode) for mode in others}
    table = _table({mode: [each for each in own if each.key not in _IN_WORDS] for mode, own in merits.items()})
    warnings = _listed("warning", page.warnings, _WARNINGS)
    estimates = form("parts").join(_estimates(found))
    corrections = tuple(sentence(each, at=page.at) for each in of_code(page.findings, *CORRECTIONS))
    doubtful = page.verdict is not None and page.verdict.light == "bad" and not _wrong_reference(found.run)
    name = phrase("run.doubtful_estimates" if doubtful else "run.estimates")
    shown = [phrase("terminal.line", name=name, text=estimates)] if estimates else []
    shown += _listed("corrected", corrections, len(CORRECTIONS))
    # one entry for an assumption on several files
    taken = {
        each.get("text") or each.code: each for each in page.findings[::-1] if each.severity is Severity.ASSUMPTION
    }
    assumed = [sentence(each, at=page.at) for each in reversed(taken.values())]
    shown += _listed("assumed", [form("joint").join(assumed[:_ASSUMED])] * bool(assumed), _ASSUMED, len(assumed))
    return [*hanging([title, *verdict], width), *table, *hanging([*warnings, *shown], width)]


def _wrong_reference(run: Run) -> bool:
    """Return whether findings contradict the reference, so that its errors may not be the run's."""
    return any(event.subject == "ref" and event.severity >= Severity.WARNING for event in run.events)


def _estimates(found: EvaluatedRun) -> Iterator[str]:
    """Yield gate rejections, and estimates of unspecified inputs."""
    run, heights = found.run, found.gps is None or heights_measured(found.gps.lla)
    yield from _rejected(run, 3 if heights else 2)
    if 0.0 < run.gps_delay_sd < np.inf:
        sd = max(run.gps_delay_sd, 0.001)
        name = "delay" if abs(run.gps_delay) > 2.0 * sd else "on_time" if sd < _HARDLY else "unknown_delay"
        yield phrase(f"run.{name}", delay_s=run.gps_delay, sd_s=sd)
    if (run.lever_sd > 0.0).any():
        arm = tuple(
            f"{x:.2f} ± {max(sd, 0.01):.2f}" if sd < _UNKNOWN else phrase("run.unknown")
            for x, sd in zip(run.lever_b, run.lever_sd, strict=True)
        )
        yield phrase("run.lever" if (run.lever_sd < _UNKNOWN).any() else "run.unknown_lever", arm=arm)


def _rejected(run: Run, measured: int) -> Iterator[str]:
    """Yield fixes that gates rejected individually, with the largest deviation in measured components."""
    fixes = run.innovations
    for name, unit, part, kinds in (
        ("rejected_positions", "m", slice(0, measured), {Code.GATE_POSITION, Code.GATE_PHYSICAL_POSITION}),
        ("rejected_velocities", "m/s", slice(3, 6), {Code.GATE_VELOCITY, Code.GATE_PHYSICAL_VELOCITY}),
    ):
        rows = np.isin(fixes.time, [event.begin for event in of_code(run.events, *kinds)])
        every = np.linalg.norm(fixes.innovation[:, part], axis=1)
        if rows.any():
            most = f"{number(float(np.nanmax(every[rows])))} {unit}"
            yield phrase(f"run.{name}", count=int(rows.sum()), total=int(np.isfinite(every).sum()), most=most)


def _table(merits: dict[str, list[Quantity]]) -> list[str]:
    """Build the table with a row per figure, a column per solution."""
    first = next(iter(merits.values()))
    if not first:
        return []
    names = [f"{each.label} [{each.shown_unit}]" if each.shown_unit else each.label for each in first]
    rows = tuple((name, *(cell(own[i]) for own in merits.values())) for i, name in enumerate(names))
    return table_text(Table("", ("", *(phrase(f"run.{mode}") for mode in merits)), rows)).splitlines()


def _listed(name: str, texts: Sequence[str], most: int, count: int = 0) -> list[str]:
    """List the first texts, one row each, and the total: `count` if a text joins several."""
    name, count = phrase(f"run.{name}"), count or len(texts)
    first = phrase("terminal.first_of", name=name, most=most, count=count) if count > most else name
    return [phrase("terminal.line", name=name if i else first, text=text) for i, text in enumerate(texts[:most])]
