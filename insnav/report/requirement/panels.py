"""Drawings of a requirement: the errors of real IMUs over time, and what each source of error may be."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from insnav.errors.requirement.parts import Candidate
from insnav.errors.requirement.study import RequirementStudy
from insnav.report.colours import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, VERMILLION
from insnav.report.numbers import number
from insnav.report.panels import Curve, Kind, Panel
from insnav.types import FloatArray
from insnav.units import UNITS

GRADES = {"consumer": VERMILLION, "automotive": ORANGE, "industrial": BLUE, "tactical": GREEN, "navigation": PURPLE}
SMALLEST = 0.01  # end of the error axis [m]
NAMED = 6  # parts with an entry of their own: those nearest to the limit


def outages_text(study: RequirementStudy) -> str:
    """How much GPS there was before the outages."""
    first, last = study.begins[0], study.begins[-1]
    return (
        f"after {first} s of GPS"
        if first == last
        else f"mean of {len(study.begins)} outages after {first} to {last} s of GPS"
    )


def nearest(study: RequirementStudy, count: int) -> list[Candidate]:
    """The parts whose errors are nearest to the limit, the most accurate first."""
    limit = study.required.error
    order = sorted(study.candidates, key=lambda each: abs(np.log(each.alone.error / limit)))[:count]
    return [each for each in study.candidates if any(each is one for one in order)]


def part_panels(study: RequirementStudy) -> Iterator[Panel]:
    """Draw the error of every part over time, the IMU alone and with the NHC, with the limit.

    Parts near the limit have names of their own, the others that of their class.
    """
    required, named = study.required, nearest(study, NAMED)
    kinds: tuple[Kind, ...] = ("line", "dashed") * NAMED
    x, y = np.array([required.after]), np.array([required.error])
    label = f"{required.component} error, {100 * required.probability:g} % [m]"
    for title, kind in (("the IMU alone", "alone"), ("with non-holonomic constraint (NHC)", "nhc")):
        curves = [
            Curve(f"others, {each.grade}", study.time, _error(each, kind), GRADES[each.grade], "thin")
            for each in study.candidates
            if not any(each is one for one in named)
        ]
        curves += [
            Curve(f"{each.name} ({each.grade})", study.time, _error(each, kind), GRADES[each.grade], how)
            for each, how in zip(named, kinds, strict=False)
        ]
        text = (f"required: {required.error:g} m after {required.after:g} s",)
        curves.append(Curve("requirement", x, y, BLACK, "points", text=text))
        yield Panel(
            f"parts_{kind}",
            f"Error over time, {title}",
            label,
            "time without GPS [s]",
            tuple(curves),
            "parts",
            log_y=True,
            levels=((required.error, "limit"),),
            height=330,
        )


def _error(each: Candidate, kind: str) -> FloatArray:
    return np.asarray(np.maximum(getattr(each, kind).curve, SMALLEST))


def allocation_panel(study: RequirementStudy) -> Panel:
    """Draw what each error may be in the set, as a part of what it may be alone."""
    shares = [share for share in study.allocation.shares if np.isfinite(share.alone)]
    kinds = ["given" if share.given else "hardly acts" if share.capped else "of the set" for share in shares]
    texts = [
        f"{share.family}: {number(share.size / UNITS[share.unit][1])} {share.unit} in the set, "
        f"{number(share.alone / UNITS[share.unit][1])} alone"
        for share in shares
    ]
    curves = []
    for kind, colour in (("of the set", BLUE), ("given", ORANGE), ("hardly acts", GREY)):
        own = [row for row, each in enumerate(kinds) if each == kind]
        if own:
            part = np.array([min(shares[row].size / shares[row].alone, 1.2) for row in own])
            rows, text = np.array(own, dtype=np.float64), tuple(texts[row] for row in own)
            curves.append(Curve(kind, part, rows, colour, "bars", np.zeros(len(own)), text=text))
    return Panel(
        "allocation",
        "How large each error may be",
        "",
        "size in the set / size that meets the limit alone [-]",
        tuple(curves),
        note="point at one to read both",
        rows=tuple(share.family for share in shares),
        height=80 + 24 * len(shares),
    )
