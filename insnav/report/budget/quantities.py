"""The quantities of an error budget, said once for page, figure and ``run.json``."""

from __future__ import annotations

import numpy as np

from insnav.errors.budget.error_budget import Budget, Column, SimulatedColumn
from insnav.quantity import Quantity
from insnav.report.budget.contributions import horizontal, ranked, saved, shares
from insnav.report.budget.terms import effect, growth, size
from insnav.report.page import Section
from insnav.types import FloatArray

_AXES = ("N", "E", "D")
_SHORT = {"analytic": "anal.", "covariance": "cov.", "simulated": "sim.", "recorded": "rec.", "filter": "filt."}
_LONG = {"covariance": "covar.", "simulated": "simul."}


def _ways(budget: Budget) -> dict[str, Column | SimulatedColumn]:
    """Ways to the errors, by name."""
    ways: dict[str, Column | SimulatedColumn] = {"analytic": budget.analytic, "covariance": budget.covariance}
    return ways if budget.simulated is None else ways | {"simulated": budget.simulated}


def budget_sections(budget: Budget) -> tuple[Section, ...]:
    """Everything of a budget for JSON: what it is of, its sources, its errors at the chosen times."""
    bias, drift = budget.short_form_error(float(budget.time[budget.chosen[-1]]))
    simulated, recorded = budget.simulated, budget.recorded
    sections = [
        Section(
            "",
            items=(
                Quantity("imu", budget.imu),
                Quantity("motion", budget.motion),
                Quantity("vertical_held", budget.hold),
                Quantity("gravity", budget.gravity, "m/s^2"),
                Quantity("schuler_period", 2.0 * np.pi / budget.schuler_rate, "s"),
            ),
        ),
        Section(
            "short_form_error",
            items=(
                Quantity("time", float(budget.time[budget.chosen[-1]]), "s"),
                Quantity("bias_and_tilt", bias),
                Quantity("gyro_bias", drift),
            ),
        ),
        Section(
            "sources",
            rows=tuple(
                (
                    Quantity("name", each.name),
                    Quantity("kind", each.kind),
                    Quantity("sd_si", each.sd),
                    Quantity("correlation_time", each.correlation_time, "s"),
                )
                for each in budget.sources
            ),
        ),
        Section(
            "",
            items=(
                Quantity(
                    "share_of_horizontal_variance", dict(zip(budget.families, map(float, shares(budget)), strict=True))
                ),
                Quantity("not_given", budget.absent),
                Quantity("left_out", budget.ignored),
            ),
        ),
        *(_at_time(budget, k) for k in budget.chosen),
    ]
    if simulated is None:
        sections.append(Section("", items=(Quantity("runs", None),)))
    else:
        runs = (
            Quantity("count", simulated.runs),
            Quantity("of_each_source", simulated.alone),
            Quantity("seed", simulated.seed),
            Quantity("rms_by_sd_95", simulated.band),
        )
        sections.append(Section("runs", items=runs))
    if recorded is None:
        sections.append(Section("", items=(Quantity("recorded", None),)))
    else:
        names = ("north", "east", "down", "horizontal")
        statistics = {
            "rms_corrected": recorded.corrected,
            "rms_corrected_low": recorded.low,
            "rms_corrected_high": recorded.high,
            "predicted": recorded.predicted,
        }
        items = (
            Quantity("windows", recorded.windows),
            Quantity("description", recorded.description),
            Quantity("time", recorded.time, "s"),
            *(
                Quantity(key, {name: values[:, i] for i, name in enumerate(names)}, "m")
                for key, values in statistics.items()
            ),
        )
        sections.append(Section("recorded", items=items))
    return (Section("", parts=tuple(sections), show="json"),)


def _at_time(budget: Budget, k: int) -> Section:
    parts = []
    for name, way in _ways(budget).items():
        worst = _worst(budget, k) if name == "covariance" else ()
        nees = (Quantity("nees", float(way.nees[k])),) if isinstance(way, SimulatedColumn) else ()
        families = tuple(Section(each, items=_states(way.parts[k, i])) for i, each in enumerate(budget.families))
        parts.append(
            Section(name, items=(*_states(way.total[k]), *worst, *nees), parts=(Section("sources", parts=families),))
        )
    return Section("budget[]", items=(Quantity("time", float(budget.time[k]), "s"),), parts=tuple(parts))


def _worst(budget: Budget, k: int) -> tuple[Quantity, ...]:
    """The worst-case sum."""
    return (
        Quantity("worst_position", budget.worst[k, :3], "m"),
        Quantity("worst_horizontal", float(budget.worst[k, 3]), "m"),
    )


def _states(sd: FloatArray) -> tuple[Quantity, ...]:
    return (
        Quantity("position", sd[:3], "m"),
        Quantity("horizontal", float(horizontal(sd)), "m"),
        Quantity("velocity", sd[3:6], "m/s"),
        Quantity("attitude", sd[6:9], "deg"),
    )


def positions_section(budget: Budget) -> Section:
    """Tabulate position errors at the chosen times, one group of columns a way to them."""
    at, recorded = budget.chosen, budget.recorded
    groups = {name: way.total[at, :3] for name, way in _ways(budget).items()}
    if recorded is None:
        groups["worst"] = budget.worst[at, :3]
        note = "1 sd; worst: sum of all sources"
    else:
        groups |= {
            "recorded": _at(recorded.time, recorded.corrected[:, :3], budget.time[at]),
            "filter": _at(recorded.time, recorded.predicted[:, :3], budget.time[at]),
        }
        note = "1 sd: analytic, covariance, simulated; RMS recorded, corrected; predicted by the filter for all windows"
    names = _LONG if recorded is None else _SHORT
    rows = tuple(
        (
            Quantity("time", f"{budget.time[k]:g}", "s"),
            *(
                Quantity(name, dict(zip(_AXES, map(float, values[row]), strict=True)), meaning=names.get(name, name))
                for name, values in groups.items()
            ),
        )
        for row, k in enumerate(at)
    )
    return Section("", "Position error North, East, Down [m]", rows=rows, note=note)


def _at(time: FloatArray, values: FloatArray, wanted: FloatArray) -> FloatArray:
    """Rows of values at wanted times, NaN where there is none."""
    found = np.full((len(wanted), values.shape[1]), np.nan)
    for row, moment in enumerate(wanted):
        match = np.flatnonzero(np.abs(time - moment) < 1e-3)
        if match.size:
            found[row] = values[match[0]]
    return found


def contributions_rows(budget: Budget) -> list[tuple[Quantity, ...]]:
    """What each family contributes to the error at the last time, the largest first."""
    last, part, gain, ways = budget.chosen[-1], shares(budget), saved(budget), _ways(budget)
    return [
        (
            Quantity("source", budget.families[k]),
            Quantity("size", size(budget, budget.families[k]), meaning="size, 1 sd"),
            Quantity("growth", growth(budget, budget.families[k]), meaning="grows with"),
            *(Quantity(name, float(horizontal(way.parts[last, k]))) for name, way in ways.items()),
            Quantity("down", float(budget.covariance.parts[last, k, 2])),
            Quantity("share", float(part[k]), "%", meaning="of the variance", decimals=1),
            Quantity("halved_saves", float(gain[k]), meaning="half of it saves"),
        )
        for k in ranked(budget)
    ]


def contributions_section(budget: Budget) -> Section:
    """Tabulate the contributions of the families, and their sums."""
    last, ways = budget.chosen[-1], _ways(budget)
    together = {name: float(horizontal(way.total[last])) for name, way in ways.items()}
    sums = (
        ("together (RSS)", together, budget.covariance.total[last, 2]),
        ("worst-case sum", {"covariance": float(budget.worst[last, 3])}, budget.worst[last, 2]),
    )
    rows = [
        (
            Quantity("source", text),
            *(Quantity(name, value) for name, value in values.items()),
            Quantity("down", float(down)),
        )
        for text, values, down in sums
    ]
    title = f"Error contributions: horizontal error √(N² + E²) after {budget.time[last]:g} s [m]"
    return Section("", title, rows=(*contributions_rows(budget), *rows))


def states_section(budget: Budget) -> Section:
    """Velocity and attitude by family."""
    last, whole = budget.chosen[-1], budget.covariance
    rows = [(budget.families[k], whole.parts[last, k]) for k in ranked(budget)]
    return Section(
        "",
        f"Velocity and attitude after {budget.time[last]:g} s, covariance, 1 sd",
        rows=tuple(
            (
                Quantity("source", name),
                *(Quantity(f"v {axis}", float(v), "m/s") for axis, v in zip(_AXES, sd[3:6], strict=True)),
                *(
                    Quantity(angle, float(a), "deg")
                    for angle, a in zip(("tilt N", "tilt E", "heading"), sd[6:9], strict=True)
                ),
            )
            for name, sd in (*rows, ("together (RSS)", whole.total[last]))
        ),
        show="page",
    )


def impact_section(budget: Budget) -> Section:
    """The impact of the families, in words."""
    families = [budget.families[k] for k in ranked(budget)]
    rows = tuple((Quantity("source", each), Quantity("impact", effect(each))) for each in families)
    return Section("", "Impact of the sources", rows=rows, show="page")
