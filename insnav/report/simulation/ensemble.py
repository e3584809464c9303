"""What an ensemble of simulated runs leaves on the disk: a row for each run, errors over time, figures, page, facts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from insnav.errors.ensemble import BAND, COMPONENTS, FIGURES, GROUPS, Ensemble, ensemble, inside
from insnav.output.data_files import write_table
from insnav.output.folder import RunFolder
from insnav.report.numbers import number
from insnav.report.page import Table
from insnav.report.run_json import json_ready
from insnav.report.sheet import Picture, Sheet, write_sheet
from insnav.report.simulation.ensemble_figures import draw_ensemble, draw_nees
from insnav.report.simulation.page import (
    Plan,
    model_texts,
    motion_lines,
    motion_pictures,
    motion_table,
    plan_facts,
    seen,
)
from insnav.report.style import drawing
from insnav.simulate.montecarlo import Runs
from insnav.types import FloatArray, IntArray
from insnav.units import DEG

_UNITS = (*("m",) * 3, *("m_s",) * 3, *("deg",) * 3)
_FACTORS = np.array([1.0] * 6 + [1.0 / DEG] * 3)
_MUCH, _TOO_GOOD = 0.3, 2.0  # of lasting errors, and of NEES, for one to explain the other
_SHOWN = 5  # failures that are told one by one
_COUNTS = ("positions", "rejected", "resets")


def write_runs(folder: RunFolder, plan: Plan, runs: Runs) -> Path:
    """Write the whole folder and put it in its place.

    Parameters
    ----------
    folder : RunFolder
        Entered, not committed.
    plan : Plan
        What was simulated.
    runs : Runs
        What the runs came to, as `insnav.errors.ensemble.NavigatedRecording` makes them.

    Returns
    -------
    Path
        The finished folder.

    Raises
    ------
    InputError
        Every run failed.
    """
    found = ensemble(runs, plan.truth)
    write_table(folder.path("runs.csv"), _rows(runs))
    write_table(folder.path("ensemble.csv"), _epochs(found))
    time, motion = seen(plan.truth)
    facts = json_ready({**plan_facts(plan, time, motion), "ensemble": ensemble_facts(found, runs)})
    with drawing():
        pictures = [Picture("ensemble", draw_ensemble(found, len(runs.number)), "RMS error and stated sd over time")]
        nees = draw_nees(found)
        if nees is not None:
            pictures.append(Picture("nees", nees, "Normalised error squared over time"))
    sheet = Sheet(
        f"{len(runs.number)} simulated runs of {plan.name}",
        tuple(runs_lines(facts)),
        (_table(facts["ensemble"]), motion_table(facts["motion"])),
        (*pictures, *motion_pictures(plan, time, motion)),
        ("every run has an IMU, noise and fixes of its own; the motion is the same in all",),
        tuple(_failure_lines(facts["ensemble"])),
    )
    return write_sheet(folder, sheet, facts, model_texts(plan))


def ensemble_facts(found: Ensemble, runs: Runs) -> dict[str, Any]:
    """Figures of all runs together, units in the keys.

    Parameters
    ----------
    found : Ensemble
        The runs over time.
    runs : Runs
        The runs one by one.
    """
    share = inside(found).mean(axis=0) if len(found.nees) else ()
    rms, sd = (np.sqrt(np.mean(value**2, axis=0)) * _FACTORS for value in (found.rms, found.sd))
    columns = dict(zip(FIGURES, runs.figures.T, strict=True))
    return {
        "runs": len(runs.number),
        "failed": [{"run": each.number, "seed": each.seed, "reason": each.reason} for each in runs.failures],
        "rms": {f"{name}_{unit}": rms[i] for i, (name, unit) in enumerate(zip(COMPONENTS, _UNITS, strict=True))},
        "stated_sd": {f"{name}_{unit}": sd[i] for i, (name, unit) in enumerate(zip(COMPONENTS, _UNITS, strict=True))},
        "rms_horizontal_m": {
            "mean": columns["rms_horizontal"].mean(),
            "largest": columns["rms_horizontal"].max(),
        },
        "nees_per_axis": {name: columns[f"nees_{name}"].mean() for name in GROUPS[: len(share)]},
        "nees_band": BAND,
        "nees_inside_band": dict(zip(GROUPS, share, strict=False)),
        "fixes": int(columns["positions"].sum()),
        "rejected": int(columns["rejected"].sum()),
        "resets": int(columns["resets"].sum()),
    }


def ensemble_lines(facts: Mapping[str, Any], out: Path) -> list[str]:
    """Say what the runs came to, and where it is.

    Parameters
    ----------
    facts : mapping
        As in ``run.json``.
    out : Path
        The folder as the user gave it.
    """
    return [*runs_lines(facts), f"{'files':<12}{out}: runs.csv, ensemble.csv, report.html, run.json, …"]


def runs_lines(facts: Mapping[str, Any]) -> list[str]:
    """Say what the runs came to."""
    found = facts["ensemble"]
    nees = ", ".join(
        f"{name} {number(found['nees_per_axis'][name])} ({100.0 * share:.0f} %)"
        for name, share in found["nees_inside_band"].items()
    )
    lines = [
        *motion_lines(facts),
        f"{'runs':<12}{found['runs']} of {facts['imu_model']['name']} and {facts['gps_model']}, seed {facts['seed']}",
        f"{'horizontal':<12}RMS {number(found['rms_horizontal_m']['mean'])} m in the mean of the runs, "
        f"{number(found['rms_horizontal_m']['largest'])} m in the worst",
        f"{'NEES':<12}{nees or 'not known: there was no fix'}",
        f"{'':<12}per axis: 1 if the stated sd is true (share of the fixes inside the {100.0 * BAND:.0f} % band)",
        f"{'rejected':<12}{found['rejected']} of {found['fixes']} fixes, {found['resets']} resets",
    ]
    return lines + _lasting_lines(facts) + [f"{'failed':<12}{text}" for text in _failure_lines(found)]


def _lasting_lines(facts: Mapping[str, Any]) -> list[str]:
    """Why the stated position is too good, if it is and the receiver is to blame."""
    lasting, nees = facts["gps_lasting"], facts["ensemble"]["nees_per_axis"].get("position", 1.0)
    if lasting is None or lasting["share"] < _MUCH or nees < _TOO_GOOD:
        return []
    return [
        f"{'note':<12}{100.0 * lasting['share']:.0f} % of the position variance of {facts['gps_model']} lasts for "
        f"about {lasting['correlation_time_s']:g} s; a filter that takes",
        f"{'':<12}it for white, as it must on a short drive, states its position too well",
    ]


def _failure_lines(found: Mapping[str, Any]) -> list[str]:
    failed = found["failed"]
    lines = [f"run {each['run']} (seed {each['seed']}): {each['reason']}" for each in failed[:_SHOWN]]
    if len(failed) > _SHOWN:
        lines.append(f"and {len(failed) - _SHOWN} more: see run.json")
    return lines


def _table(found: Mapping[str, Any]) -> Table:
    rows = tuple(
        (key.replace("_m_s", " [m/s]").replace("_deg", " [deg]").removesuffix("_m"), number(rms), number(sd), ratio)
        for (key, rms), sd, ratio in zip(
            found["rms"].items(),
            found["stated_sd"].values(),
            (
                number(rms / sd) if sd else number(None)
                for rms, sd in zip(found["rms"].values(), found["stated_sd"].values(), strict=True)
            ),
            strict=True,
        )
    )
    return Table("Errors over all runs and times", ("", "RMS error", "stated sd", "ratio"), rows)


def _rows(runs: Runs) -> dict[str, FloatArray | IntArray]:
    table: dict[str, FloatArray | IntArray] = {"run": runs.number, "seed": runs.seed}
    for name, values in zip(FIGURES, runs.figures.T, strict=True):
        if name in _COUNTS:
            table[name] = values.astype(np.int64)
        elif name.startswith("nees"):
            table[f"{name}_per_axis"] = np.round(values, 6)
        else:
            unit, factor = _unit(name.split("_", 1)[1])
            table[f"{name}_{unit}"] = np.round(values * factor, 6)
    return table


def _unit(component: str) -> tuple[str, float]:
    """Unit of a component and its factor from SI; what is none of them is a length."""
    if component not in COMPONENTS:
        return "m", 1.0
    at = COMPONENTS.index(component)
    return _UNITS[at], float(_FACTORS[at])


def _epochs(found: Ensemble) -> dict[str, FloatArray | IntArray]:
    table: dict[str, FloatArray | IntArray] = {"time_s": np.round(found.time, 6), "runs": found.count}
    for kind, values in (("rms", found.rms), ("sd", found.sd)):
        for i, (name, unit) in enumerate(zip(COMPONENTS, _UNITS, strict=True)):
            table[f"{kind}_{name}_{unit}"] = np.round(values[:, i] * _FACTORS[i], 7)
    # a second without a fix has none, and an empty cell says so
    at, fixes = np.searchsorted(found.time, found.nees_time), np.isin(found.nees_time, found.time)
    for name, column in zip(GROUPS, found.nees.T, strict=True):
        values = np.full(len(found.time), np.nan)
        values[at[fixes]] = np.round(column[fixes], 6)
        table[f"nees_{name}_per_axis"] = values
    return table
