"""Quantities of an error budget, built once for page, figure, table and ``run.json``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from insnav.errors.budget.error_budget import Budget, Column, RecordedColumn, SimulatedColumn
from insnav.errors.budget.from_windows import RecordedBudget
from insnav.errors.budget.sources import term_of
from insnav.quantity import Quantity
from insnav.report.outage.page import BELOW, below_noise
from insnav.report.page import Section, one_each, only_json
from insnav.report.style import number
from insnav.report.tables import of_table
from insnav.types import FloatArray
from insnav.units import UNITS, shown_unit

_SHOWN = 3  # number of times in the short table and the figures of merit
_AXES = ("N", "E", "D")
_RECORDED = ("north", "east", "down", "horizontal")
_SHORT = {"analytic": "anal.", "covariance": "cov.", "simulated": "sim.", "recorded": "rec.", "filter": "filt."}
_LONG = {"covariance": "covar.", "simulated": "simul."}
# error families without a term in the IMU specification: unit, number of integrations to position, effect
_OTHERS = {
    "initial position": ("m", 0, "constant"),
    "initial velocity": ("m/s", 1, "grows: v t"),
    "initial tilt": ("deg", 2, "a component of gravity appears as acceleration: g φ t² / 2"),
    "initial heading": ("deg", 2, "rotates every change of velocity: ψ Δv across, no effect at constant velocity"),
    "gravity model": ("mGal", 2, "gravity that the model does not have is taken for motion: Δg t² / 2"),
    "timing offset": ("ms", 0, "late samples: τ times the change of velocity"),
    "timing drift": ("ppm", 0, "samples that come later and later"),
}
_POWERS = {0.0: "stays", 0.5: "t⁰·⁵", 1.0: "t", 1.5: "t¹·⁵", 2.0: "t²", 2.5: "t²·⁵", 3.0: "t³", 3.5: "t³·⁵", 4.0: "t⁴"}


def horizontal(parts: FloatArray) -> FloatArray:
    """Compute the horizontal position error, the root of N^2 + E^2 [m], from navigation errors ``(..., 9)``."""
    return np.hypot(parts[..., 0], parts[..., 1])


def ranked(budget: Budget) -> list[int]:
    """Rank the error families by their horizontal error at the end; return their indices, the largest first."""
    last = budget.chosen[-1]
    size = horizontal(budget.covariance.parts[last])
    vertical = budget.covariance.parts[last, :, 2]
    return sorted(range(len(budget.families)), key=lambda k: (-size[k], -vertical[k]))


def shares(budget: Budget) -> FloatArray:
    """Compute the share of each error family in the variance of the horizontal error at the end, ``(f,)`` [-]."""
    variances = horizontal(budget.covariance.parts[budget.chosen[-1]]) ** 2
    total = float(variances.sum())
    return np.asarray(variances / total if total > 0.0 else variances)


def saved(budget: Budget) -> FloatArray:
    """Compute the reduction of the horizontal error at the end by halving each error family, ``(f,)`` [m]."""
    total = float(horizontal(budget.covariance.total[budget.chosen[-1]]))
    # an error of half the size has a quarter of the variance: three quarters of the family's share disappear
    return np.asarray(total * (1.0 - np.sqrt(1.0 - 0.75 * shares(budget))))


def source_texts(budget: Budget, chosen: Sequence[int], origin: str) -> tuple[str, ...]:
    """Describe size, origin, effect and benefit of halving of the families with indices `chosen`.

    `origin`: origin of the sizes of families that are not part of the covariance at the start.
    """
    last = budget.chosen[-1]
    total, reduction = float(horizontal(budget.covariance.total[last])), saved(budget)
    texts = []
    for k in chosen:
        name, alone = budget.families[k], float(horizontal(budget.covariance.parts[last, k]))
        joint = any(source.joint and source.sd > 0.0 for source in budget.sources if source.family == name)
        basis = "covariance of the filter at the start of the window" if joint else origin
        texts.append(
            f"{name}: {size(budget, name)} (1 sd; {basis}). Alone {number(alone)} m after {budget.time[last]:g} s, "
            f"{100.0 * shares(budget)[k]:.1f} % of the variance; position error grows with {growth(budget, name)}: "
            f"{effect(name)}. Half of it: {number(total)} -> {number(total - float(reduction[k]))} m."
        )
    return tuple(texts)


def effect(family: str) -> str:
    """Return the effect of a family of errors on navigation, in words."""
    return _OTHERS[family][2] if family in _OTHERS else term_of(family).text


def extent(budget: Budget, family: str) -> tuple[float, float, str]:
    """Return the sizes of a family's smallest and largest axis in its display unit, and this unit."""
    values = [source.sd for source in budget.sources if source.family == family and source.sd > 0.0]
    unit = _OTHERS[family][0] if family in _OTHERS else term_of(family).unit
    unit = {"ug": "mg", "mrad": "deg"}.get(unit, unit)  # the page shows the IMU error specification in these units
    return min(values) / UNITS[unit][1], max(values) / UNITS[unit][1], unit


def size(budget: Budget, family: str) -> str:
    """Write the size of an error family in its display unit, as a range if its axes differ."""
    *ends, unit = extent(budget, family)
    shown = dict.fromkeys(f"{float(f'{value:.3g}'):g}" for value in ends)
    return f"{' to '.join(shown)} {shown_unit(unit)}"


def growth(budget: Budget, family: str) -> str:
    """Return the power of time with which a family's position error grows over minutes, for a stationary vehicle."""
    source = next(each for each in budget.sources if each.family == family)
    if source.group == "timing":
        return "motion"
    order = _OTHERS[family][1] if family in _OTHERS else term_of(family).integrals
    by_process = {"ramp": 1.0, "white": -0.5, "random walk": 0.5, "quantisation": -1.5}.get(source.kind, 0.0)
    return _POWERS[order + by_process]


def shown_times(budget: Budget) -> list[int]:
    """Select at most three of the chosen times of a budget: indices of first, middle and last."""
    count = len(budget.chosen)
    return list(dict.fromkeys(np.linspace(0, count - 1, min(count, _SHOWN)).round().astype(int).tolist()))


def recorded_text(budget: Budget, row: int) -> str:
    """Write the recorded horizontal RMS error with its interval. `row`: index of the time in ``budget.chosen``."""
    recorded = budget.recorded
    assert recorded is not None
    match = np.flatnonzero(np.abs(recorded.time - budget.time[budget.chosen[row]]) < 1e-3)
    if not match.size:
        return "–"
    value, low, high = (float(each[match[0], 3]) for each in (recorded.corrected, recorded.low, recorded.high))
    if not np.isfinite(value):
        return below_noise(high) if np.isfinite(high) else BELOW
    return number(value) + (f" ({number(low)} … {number(high)})" if np.isfinite(low) else "")


def _ways(budget: Budget) -> dict[str, Column | SimulatedColumn]:
    """Return the predicted errors by method: analytic, covariance, and simulated if available."""
    ways: dict[str, Column | SimulatedColumn] = {"analytic": budget.analytic, "covariance": budget.covariance}
    return ways if budget.simulated is None else ways | {"simulated": budget.simulated}


def budget_sections(budget: Budget) -> tuple[Section, ...]:
    """Build all quantities of a budget for JSON: subject, sources, errors at the chosen times, recorded errors."""
    last = float(budget.time[budget.chosen[-1]])
    bias, drift = budget.short_form_error(last)
    short = of_table("budget.short_form_error", time=last, bias_and_tilt=bias, gyro_bias=drift)
    sources = tuple(of_table("budget.source", each) for each in budget.sources)
    share = dict(zip(budget.families, map(float, shares(budget)), strict=True))
    return (
        only_json("", *of_table("budget.subject", budget, schuler_period=2.0 * np.pi / budget.schuler_rate)),
        only_json("short_form_error", *short),
        Section("sources", rows=sources, show="json"),
        only_json("", *of_table("budget.terms", budget, share_of_horizontal_variance=share)),
        *(_at_time(budget, k) for k in budget.chosen),
        _runs(budget.simulated),
        _recorded(budget.recorded),
    )


def _runs(simulated: SimulatedColumn | None) -> Section:
    if simulated is None:
        return only_json("", Quantity("runs", None))
    return only_json("runs", *of_table("budget.runs", simulated))


def _recorded(recorded: RecordedColumn | None) -> Section:
    if recorded is None:
        return only_json("", Quantity("recorded", None))
    statistics = {
        "rms_corrected": recorded.corrected,
        "rms_corrected_low": recorded.low,
        "rms_corrected_high": recorded.high,
        "predicted": recorded.predicted,
    }
    return only_json(
        "recorded",
        *of_table("budget.recorded", recorded),
        *(Quantity(key, dict(zip(_RECORDED, values.T, strict=True)), "m") for key, values in statistics.items()),
    )


def _at_time(budget: Budget, k: int) -> Section:
    methods = _ways(budget)
    more: dict[str, tuple[Quantity, ...]] = {
        "covariance": (
            Quantity("worst_position", budget.worst[k, :3], "m"),
            Quantity("worst_horizontal", float(budget.worst[k, 3]), "m"),
        )
    }
    if budget.simulated is not None:
        more["simulated"] = (Quantity("nees", float(budget.simulated.nees[k])),)
    parts = (
        Section(
            name,
            items=(*_states(way.total[k]), *more.get(name, ())),
            parts=(one_each("sources", "", dict(zip(budget.families, map(_states, way.parts[k]), strict=True))),),
        )
        for name, way in methods.items()
    )
    return only_json("budget[]", Quantity("time", float(budget.time[k]), "s"), parts=tuple(parts))


def _states(sd: FloatArray) -> tuple[Quantity, ...]:
    return of_table(
        "budget.states", position=sd[:3], horizontal=float(horizontal(sd)), velocity=sd[3:6], attitude=sd[6:9]
    )


def positions_section(budget: Budget) -> Section:
    """Tabulate North, East, Down errors at the chosen times, with columns grouped by method."""
    at, recorded = budget.chosen, budget.recorded
    names, note = _LONG, "1 sd; worst: sum of all sources"
    errors_by = {name: way.total[at, :3] for name, way in _ways(budget).items()}
    if recorded is None:
        errors_by["worst"] = budget.worst[at, :3]
    else:
        errors_by |= {
            "recorded": _at(recorded.time, recorded.corrected[:, :3], budget.time[at]),
            "filter": _at(recorded.time, recorded.predicted[:, :3], budget.time[at]),
        }
        names = _SHORT
        note = "1 sd: analytic, covariance, simulated; RMS recorded, corrected; predicted by the filter for all windows"
    rows = []
    for row, k in enumerate(at):
        sizes = {name: dict(zip(_AXES, map(float, values[row]), strict=True)) for name, values in errors_by.items()}
        cells = (Quantity(name, value, meaning=names.get(name, name)) for name, value in sizes.items())
        rows.append((Quantity("time", f"{budget.time[k]:g}", "s"), *cells))
    return Section("", "Position error North, East, Down [m]", rows=tuple(rows), note=note, folded=True)


def _at(time: FloatArray, values: FloatArray, wanted: FloatArray) -> FloatArray:
    """Select the rows of values (n, k) at the times `wanted` (m,) from the times (n,); NaN at other times."""
    selected = np.full((len(wanted), values.shape[1]), np.nan)
    for row, moment in enumerate(wanted):
        match = np.flatnonzero(np.abs(time - moment) < 1e-3)
        if match.size:
            selected[row] = values[match[0]]
    return selected


def contributions_rows(budget: Budget) -> list[tuple[Quantity, ...]]:
    """List the contribution of each error family to the error at the last time as table rows, largest first."""
    last, part, gain, ways = budget.chosen[-1], shares(budget), saved(budget), _ways(budget)
    rows = []
    for k in ranked(budget):
        family, sizes = budget.families[k], {name: float(horizontal(way.parts[last, k])) for name, way in ways.items()}
        about = {"source": family, "size": size(budget, family), "growth": growth(budget, family)}
        end = {"down": float(budget.valid.parts[last, k, 2]), "share": float(part[k]), "halved_saves": float(gain[k])}
        *head, down, share, saves = of_table("budget.contribution", **about, **end)
        rows.append((*head, *(Quantity(*each) for each in sizes.items()), down, share, saves))
    return rows


def contributions_section(budget: Budget) -> Section:
    """Tabulate the contributions of the error families to the horizontal error, their RSS, and the worst-case sum."""
    last, methods = budget.chosen[-1], _ways(budget)
    rss = {name: float(horizontal(way.total[last])) for name, way in methods.items()}
    sums = (
        ("together (RSS)", rss, budget.valid.total[last, 2]),
        ("worst-case sum", {"covariance": float(budget.worst[last, 3])}, budget.worst[last, 2]),
    )
    rows = []
    for text, values, down in sums:
        sizes = (Quantity(name, value) for name, value in values.items())
        rows.append((Quantity("source", text), *sizes, Quantity("down", float(down))))
    title = f"Error contributions: horizontal error √(N² + E²) after {budget.time[last]:g} s [m]"
    return Section("", title, rows=(*contributions_rows(budget), *rows), folded=True)


def axes_section(budget: Budget, how: str) -> Section:
    """Tabulate the analytic contributions along each axis, and their sum. `how` {"rss", "worst"}: kind of sum."""
    parts = budget.analytic.parts[budget.chosen[-1], ranked(budget), :3]
    names = [budget.families[k] for k in ranked(budget)]
    total, name = (
        (parts.sum(axis=0), "worst-case sum")
        if how == "worst"
        else (budget.analytic.total[budget.chosen[-1], :3], "together (RSS)")
    )
    rows = tuple(
        (
            Quantity("source", each),
            *(Quantity(axis, float(v), digits=3 + (each == name)) for axis, v in zip(_AXES, sd, strict=True)),
        )
        for each, sd in zip([*names, name], [*parts, total], strict=True)
    )
    title = f"Error contributions along each axis after {budget.time[budget.chosen[-1]]:g} s, analytic [m]"
    return Section(
        "", title, rows=rows, note="rss: 1 sd; worst: all sources at 1 sd with the worst sign (--sum)", folded=True
    )


def states_section(budget: Budget) -> Section:
    """Tabulate velocity and attitude errors at the last time by error family, and their RSS, by the covariance."""
    last, whole = budget.chosen[-1], budget.covariance
    units = {"v N": "m/s", "v E": "m/s", "v D": "m/s", "tilt N": "deg", "tilt E": "deg", "heading": "deg"}
    sizes = {budget.families[k]: whole.parts[last, k] for k in ranked(budget)} | {"together (RSS)": whole.total[last]}
    rows = tuple(
        (
            Quantity("source", name),
            *(Quantity(key, float(v), unit) for (key, unit), v in zip(units.items(), sd[3:], strict=True)),
        )
        for name, sd in sizes.items()
    )
    title = f"Velocity and attitude after {budget.time[last]:g} s, covariance, 1 sd"
    return Section("", title, rows=rows, show="page", folded=True)


def impact_section(budget: Budget) -> Section:
    """Tabulate the impact of each error family on navigation, in words."""
    families = [budget.families[k] for k in ranked(budget)]
    rows = tuple((Quantity("source", each), Quantity("impact", effect(each))) for each in families)
    return Section("", "Impact of the sources", rows=rows, show="page", folded=True)


def estimates_section(budget: Budget) -> Section:
    """Tabulate the horizontal error by all methods, with 95 % intervals, at a few times."""
    rows = []
    for row in shown_times(budget):
        k = budget.chosen[row]
        cells = [
            Quantity("time", f"{budget.time[k]:g} s", meaning="after"),
            Quantity("analytic", float(horizontal(budget.analytic.total[k])), "m"),
            Quantity("covariance", float(horizontal(budget.covariance.total[k])), "m"),
        ]
        if budget.simulated is not None:
            low, high = budget.simulated.band
            value = float(horizontal(budget.simulated.total[k]))
            cells.append(Quantity("simulated", value, "m", interval=(value / high, value / low)))
        if budget.recorded is not None:
            cells.append(Quantity("recorded", recorded_text(budget, row), "m", meaning="recorded RMS"))
        cells.append(Quantity("worst", float(budget.worst[k, 3]), "m", meaning="worst case"))
        rows.append(tuple(cells))
    note = "1 sd; in brackets 95 % intervals; "
    if budget.simulated is None:
        note += "not simulated: --runs 500"
    else:
        nees = f"{budget.simulated.nees[budget.chosen[-1]]:.3g} (1 if the covariance is true)"
        note += f"{budget.simulated.runs} simulated runs: mean normalised squared error {nees}"
    note += "; not recorded: give a drive with --gps" * (budget.recorded is None)
    return Section("", "Horizontal error by method", rows=tuple(rows), note=note)


def merits(budget: Budget, windows: RecordedBudget | None) -> tuple[Quantity, ...]:
    """Return the figures of merit: errors at a few times; then recorded over predicted error, or worst-case sum."""
    quantities = []
    for k in (budget.chosen[row] for row in shown_times(budget)):
        value, text = float(horizontal(budget.valid.total[k])), f"horizontal after {budget.time[k]:g} s"
        quantities.append(Quantity(f"after_{budget.time[k]:g}_s", value, "m", meaning=text))
    last = budget.chosen[-1]
    if not budget.hold:
        quantities.append(Quantity("down", float(budget.valid.total[last, 2]), "m", meaning="down at the end"))
    if windows is None:
        return (*quantities, Quantity("worst", float(budget.worst[last, 3]), "m", meaning="worst-case sum, horizontal"))
    part, count = windows.shown, windows.shown.windows.count
    i = part.growth.column("horizontal")
    value, predicted = float(part.growth.corrected[-1, i]), float(part.growth.predicted[-1, i])
    ratio = value / predicted if np.isfinite(value) and predicted > 0.0 else None
    return (
        *quantities,
        Quantity("recorded_ratio", ratio, meaning="recorded / predicted by the filter, horizontal"),
        Quantity("inside_3_sd", f"{100.0 * part.growth.inside_at_end:.0f} %", meaning=f"inside 3 sd, {count} windows"),
    )
