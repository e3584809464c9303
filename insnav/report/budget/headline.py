"""The first screen of an error budget: the result in a sentence, its light, the four estimates side by side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from insnav.errors.budget.error_budget import Budget, SimulatedColumn
from insnav.errors.budget.from_windows import RecordedBudget
from insnav.findings import Finding
from insnav.quantity import Quantity
from insnav.report.budget.contributions import horizontal, ranked, shares, size
from insnav.report.numbers import number
from insnav.report.outage.windows import BELOW, below_noise
from insnav.report.page import Light, Section, Verdict, by_warnings

_SHOWN = 3  # times of the first screen


def shown_times(budget: Budget) -> list[int]:
    """Which of the chosen times the first screen shows: the first, the last, one between."""
    count = len(budget.chosen)
    return list(dict.fromkeys(np.linspace(0, count - 1, min(count, _SHOWN)).round().astype(int).tolist()))


def simulated_matches(budget: Budget, simulated: SimulatedColumn) -> bool:
    """Whether the squared errors at the chosen times have the size that the covariance says."""
    # nine states at each time, whose errors are independent once normalised: 4 sd of their mean
    limit = 4.0 * np.sqrt(2.0 / (simulated.runs * (6.0 if budget.hold else 9.0)))
    return bool(np.all(np.abs(simulated.nees[budget.chosen] - 1.0) < limit))


def verdict(budget: Budget, windows: RecordedBudget | None, warnings: Sequence[Finding]) -> Verdict:
    """Say the result, and whether it can be relied on; `warnings` of the page."""
    return by_warnings(sentence(budget), warnings, _light(budget, windows))


def _light(budget: Budget, windows: RecordedBudget | None) -> tuple[Light, str]:
    simulated = budget.simulated
    if not budget.linear:
        if simulated is None:
            return "bad", "attitude errors exceed the linear model"
        return "attention", "attitude errors exceed the linear model: only the simulated figure holds"
    if simulated is not None and not simulated_matches(budget, simulated):
        return "bad", "simulated errors do not match the covariance"
    if windows is None:
        if simulated is None:
            return "unknown", "predicted only: neither simulated (--runs) nor compared with a recorded drive"
        return "good", f"{simulated.runs} simulated runs agree with the covariance"
    if windows.settings.start != "forward":
        return "attention", "windows begin with the smoothed state, which has seen the fixes in them"
    wrong = [each for each in windows.shown.verdicts if not each.explained]
    if wrong:
        worst = max(wrong, key=lambda each: each.recorded / max(each.predicted, 1e-300))
        names = " and ".join(each.component for each in wrong if each.component != "horizontal") or "horizontal"
        times = number(worst.recorded / worst.predicted, 2) if worst.predicted > 0.0 else "many"
        return "attention", f"recorded errors {names} are not explained: up to {times} times as large as predicted"
    made = windows.shown.replicas
    if made is not None and not made.agree:
        return "attention", "recorded errors lie outside the band of the simulated replicas"
    less = " and ".join(each.component for each in windows.shown.verdicts if each.cautious)
    if less:
        return "good", f"no recorded error is larger than predicted, {less} smaller: the stated errors are cautious"
    return "good", "recorded errors are explained by the stated errors of IMU and fixes"


def sentence(budget: Budget) -> str:
    """Give the horizontal error at the last time, by all ways to it, and its largest source."""
    last = budget.chosen[-1]
    beyond = "" if budget.linear else " (beyond the linear model)"
    both = {"analytic": budget.analytic, "covariance": budget.covariance}
    ways = [f"{name} {number(float(horizontal(way.total[last])))}{beyond}" for name, way in both.items()]
    if budget.simulated is not None:
        ways.append(f"simulated {number(float(horizontal(budget.simulated.total[last])))}")
    if budget.recorded is not None:
        ways.append(f"recorded {_recorded(budget, len(budget.chosen) - 1)[0]}")
    whole = number(float(horizontal(budget.headline[last])))
    first = ranked(budget)[0]
    share, name = 100.0 * float(shares(budget)[first]), budget.families[first]
    largest = f"; {share:.0f} % of the variance is {size(budget, name)} of {name}" if share >= 1.0 else ""
    return f"After {budget.time[last]:g} s without GPS: {whole} m horizontal (1 sd) — {', '.join(ways)}{largest}."


def _recorded(budget: Budget, row: int) -> tuple[str, bool]:
    """Recorded RMS at a chosen time with its interval, and whether it is known."""
    found = budget.recorded
    assert found is not None
    at = np.flatnonzero(np.abs(found.time - budget.time[budget.chosen[row]]) < 1e-3)
    if not at.size:
        return "–", False
    value, low, high = (float(each[at[0], 3]) for each in (found.corrected, found.low, found.high))
    if not np.isfinite(value):
        return below_noise(high) if np.isfinite(high) else BELOW, False
    return number(value) + (f" ({number(low)} … {number(high)})" if np.isfinite(low) else ""), True


def estimates_section(budget: Budget) -> Section:
    """Tabulate the horizontal error by all four ways, with their intervals, at a few times."""
    rows = []
    for row in shown_times(budget):
        k = budget.chosen[row]
        cells = [
            Quantity("time", f"{budget.time[k]:g} s", meaning="without GPS"),
            Quantity("analytic", float(horizontal(budget.analytic.total[k])), "m"),
            Quantity("covariance", float(horizontal(budget.covariance.total[k])), "m"),
        ]
        if budget.simulated is not None:
            low, high = budget.simulated.band
            value = float(horizontal(budget.simulated.total[k]))
            cells.append(Quantity("simulated", value, "m", interval=(value / high, value / low)))
        if budget.recorded is not None:
            cells.append(Quantity("recorded", _recorded(budget, row)[0], "m", meaning="recorded, RMS corrected"))
        cells.append(Quantity("worst", float(budget.worst[k, 3]), "m", meaning="worst-case sum"))
        rows.append(tuple(cells))
    note = "1 sd; in brackets 95 % intervals; "
    if budget.simulated is None:
        note += "not simulated: --runs 500"
    else:
        nees = f"{budget.simulated.nees[budget.chosen[-1]]:.3g} (1 if the covariance is true)"
        note += f"{budget.simulated.runs} simulated runs: mean normalised squared error {nees}"
    note += "; not recorded: give a drive with --gps" * (budget.recorded is None)
    return Section("", "Horizontal error by four ways", rows=tuple(rows), note=note)


def merits(budget: Budget, windows: RecordedBudget | None) -> tuple[Quantity, ...]:
    """Give the figures of merit."""
    found = []
    for k in (budget.chosen[row] for row in shown_times(budget)):
        value, text = float(horizontal(budget.covariance.total[k])), f"horizontal after {budget.time[k]:g} s"
        found.append(Quantity(f"after_{budget.time[k]:g}_s", value, "m", meaning=text))
    last = budget.chosen[-1]
    if not budget.hold:
        found.append(Quantity("down", float(budget.covariance.total[last, 2]), "m", meaning="down at the end"))
    if windows is None:
        return (*found, Quantity("worst", float(budget.worst[last, 3]), "m", meaning="worst-case sum, horizontal"))
    part, count = windows.shown, windows.shown.windows.count
    i = part.growth.column("horizontal")
    value, by = float(part.growth.corrected[-1, i]), float(part.growth.predicted[-1, i])
    ratio = value / by if np.isfinite(value) and by > 0.0 else None
    return (
        *found,
        Quantity("recorded_ratio", ratio, meaning="recorded / predicted by the filter, horizontal"),
        Quantity("inside_3_sd", f"{100.0 * part.growth.inside_at_end:.0f} %", meaning=f"inside 3 sd, {count} windows"),
    )
