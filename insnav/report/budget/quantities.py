"""The quantities of an error budget, said once for page, figure and ``run.json``."""

from __future__ import annotations

import numpy as np

from insnav.errors.budget.error_budget import Budget, Column, RecordedColumn, SimulatedColumn
from insnav.quantity import Quantity
from insnav.report.budget.contributions import effect, growth, horizontal, ranked, saved, shares, size
from insnav.report.page import Section, one_each, only_json
from insnav.types import FloatArray

_AXES = ("N", "E", "D")
_RECORDED = ("north", "east", "down", "horizontal")
_SHORT = {"analytic": "anal.", "covariance": "cov.", "simulated": "sim.", "recorded": "rec.", "filter": "filt."}
_LONG = {"covariance": "covar.", "simulated": "simul."}


def _ways(budget: Budget) -> dict[str, Column | SimulatedColumn]:
    """Ways to the errors, by name."""
    ways: dict[str, Column | SimulatedColumn] = {"analytic": budget.analytic, "covariance": budget.covariance}
    return ways if budget.simulated is None else ways | {"simulated": budget.simulated}


def budget_sections(budget: Budget) -> tuple[Section, ...]:
    """Everything of a budget for JSON: what it is of, its sources, its errors at the chosen times."""
    last = float(budget.time[budget.chosen[-1]])
    bias, drift = budget.short_form_error(last)
    sources = tuple(
        (
            Quantity("name", each.name),
            Quantity("kind", each.kind),
            Quantity("sd_si", each.sd),
            Quantity("correlation_time", each.correlation_time, "s"),
        )
        for each in budget.sources
    )
    share = dict(zip(budget.families, map(float, shares(budget)), strict=True))
    return (
        only_json(
            "",
            Quantity("imu", budget.imu),
            Quantity("motion", budget.motion),
            Quantity("vertical_held", budget.hold),
            Quantity("gravity", budget.gravity, "m/s^2"),
            Quantity("schuler_period", 2.0 * np.pi / budget.schuler_rate, "s"),
        ),
        only_json(
            "short_form_error",
            Quantity("time", last, "s"),
            Quantity("bias_and_tilt", bias),
            Quantity("gyro_bias", drift),
        ),
        Section("sources", rows=sources, show="json"),
        only_json(
            "",
            Quantity("share_of_horizontal_variance", share),
            Quantity("not_given", budget.absent),
            Quantity("left_out", budget.ignored),
        ),
        *(_at_time(budget, k) for k in budget.chosen),
        _runs(budget.simulated),
        _recorded(budget.recorded),
    )


def _runs(simulated: SimulatedColumn | None) -> Section:
    if simulated is None:
        return only_json("", Quantity("runs", None))
    return only_json(
        "runs",
        Quantity("count", simulated.runs),
        Quantity("of_each_source", simulated.alone),
        Quantity("seed", simulated.seed),
        Quantity("rms_by_sd_95", simulated.band),
    )


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
        Quantity("windows", recorded.windows),
        Quantity("description", recorded.description),
        Quantity("time", recorded.time, "s"),
        *(Quantity(key, dict(zip(_RECORDED, values.T, strict=True)), "m") for key, values in statistics.items()),
    )


def _at_time(budget: Budget, k: int) -> Section:
    ways = _ways(budget)
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
        for name, way in ways.items()
    )
    return only_json("budget[]", Quantity("time", float(budget.time[k]), "s"), parts=tuple(parts))


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
    names, note = _LONG, "1 sd; worst: sum of all sources"
    groups = {name: way.total[at, :3] for name, way in _ways(budget).items()}
    if recorded is None:
        groups["worst"] = budget.worst[at, :3]
    else:
        groups |= {
            "recorded": _at(recorded.time, recorded.corrected[:, :3], budget.time[at]),
            "filter": _at(recorded.time, recorded.predicted[:, :3], budget.time[at]),
        }
        names = _SHORT
        note = "1 sd: analytic, covariance, simulated; RMS recorded, corrected; predicted by the filter for all windows"
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
    return Section("", "Position error North, East, Down [m]", rows=rows, note=note, folded=True)


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
    return Section("", title, rows=(*contributions_rows(budget), *rows), folded=True)


def states_section(budget: Budget) -> Section:
    """Velocity and attitude by family."""
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
    """The impact of the families, in words."""
    families = [budget.families[k] for k in ranked(budget)]
    rows = tuple((Quantity("source", each), Quantity("impact", effect(each))) for each in families)
    return Section("", "Impact of the sources", rows=rows, show="page", folded=True)
