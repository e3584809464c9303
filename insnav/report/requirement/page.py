"""The report of a requirement: how large each error may be, and which IMUs meet it."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from insnav.errors.requirement.allocation import STEEP, TAU, Share
from insnav.errors.requirement.study import RequirementStudy
from insnav.errors.requirement.verification import Verified
from insnav.quantity import Quantity
from insnav.report.frames import rows_frame
from insnav.report.numbers import number
from insnav.report.page import FigureSpec, Page, Section
from insnav.report.requirement.figures import draw_allocation
from insnav.result import Result
from insnav.units import DEG, UNITS

if TYPE_CHECKING:
    import pandas as pd


def page(result: Result[RequirementStudy]) -> Page:
    """Lay out a requirement."""
    study = result.found
    bars = FigureSpec(
        "allocation", "How large each error may be, alone and in the set", partial(draw_allocation, study)
    )
    sections = (
        Section("requirement", items=_requirement(study), show="json"),
        Section(
            "allocation", "How large each error may be, 1 sd", rows=_rows(study), figures=(bars,), note=_how(study)
        ),
        Section("verification", "Simulated runs of the set", rows=_verification(study)),
    )
    return Page(f"Requirement: {study.required.text}", summary(study), sections, warnings(study), assumptions(study))


def frame(result: Result[RequirementStudy]) -> pd.DataFrame:
    """Give the allocation as a table."""
    return rows_frame(_rows(result.found))


def _requirement(study: RequirementStudy) -> tuple[Quantity, ...]:
    required = study.required
    return (
        Quantity("error", required.error, "m"),
        Quantity("after", required.after, "s"),
        Quantity("probability", required.probability),
        Quantity("component", required.component),
        Quantity("motion", study.motion),
        Quantity("imu", study.imu or None),
        Quantity("feasible", study.allocation.feasible),
        Quantity("given_error", study.allocation.given, "m"),
        Quantity("set_error", study.allocation.error, "m"),
    )


def _rows(study: RequirementStudy) -> tuple[tuple[Quantity, ...], ...]:
    feasible = study.allocation.feasible
    return tuple(_row(share, feasible=feasible) for share in study.allocation.shares)


def _row(share: Share, *, feasible: bool) -> tuple[Quantity, ...]:
    what = "given" if share.given else "hardly acts" if share.capped else ""
    return (
        Quantity("family", share.family, meaning="error"),
        Quantity("alone", share.alone, share.unit),
        Quantity("in_set", share.size if share.given or feasible else None, share.unit, meaning="in the set"),
        Quantity("share", share.part, "%", meaning="share of the variance"),
        Quantity("note", what),
    )


def _verification(study: RequirementStudy) -> tuple[tuple[Quantity, ...], ...]:
    return tuple(
        (
            Quantity("set", f"{each.factor:g} x the set"),
            Quantity("runs", each.runs),
            Quantity("within", each.within, meaning="within the limit"),
            Quantity("probability", each.within / each.runs, interval=each.interval, meaning="probability (95 %)"),
            Quantity("error", each.error, "m", meaning=f"{100 * study.required.probability:g} % error"),
            Quantity("meets", each.meets(study.required.probability)),
        )
        for each in study.verified
    )


def _how(study: RequirementStudy) -> str:
    return "alone: this error and no other; in the set: all at once" + (
        f", those of {study.imu} as given" if study.imu else ""
    )


def summary(study: RequirementStudy) -> tuple[str, ...]:
    """Say the result in a few sentences."""
    found, required = study.allocation, study.required
    lines = [f"Motion: {study.motion}."]
    if study.imu:
        lines.append(
            f"The figures of {study.imu} alone make {number(found.given)} m: "
            + (
                "the other errors share what is left."
                if found.feasible
                else f"{number(found.given / required.error)} times the limit, so nothing is left for other errors."
            )
        )
    if found.feasible:
        tight = sorted((share for share in found.shares if not share.given and not share.capped), key=lambda s: -s.part)
        lines.append(
            "A balanced set: "
            + ", ".join(
                f"{share.family} {number(share.size / UNITS[share.unit][1])} {share.unit}" for share in tight[:6]
            )
            + "; see the table."
        )
    lines += [_verified(each, study) for each in study.verified]
    return tuple(lines)


def _verified(each: Verified, study: RequirementStudy) -> str:
    low, high = each.interval
    verdict = "meets" if each.meets(study.required.probability) else "does not meet"
    return (
        f"{each.factor:g} x the set, {each.runs} simulated runs: {100 * each.within / each.runs:.1f} % within the "
        f"limit ({100 * low:.1f} to {100 * high:.1f} %): {verdict} {100 * study.required.probability:g} %."
    )


def warnings(study: RequirementStudy) -> tuple[str, ...]:
    """Say what the reader must not overlook."""
    if study.allocation.feasible:
        return ()
    return (f"{study.imu} cannot meet this requirement on this motion as it is turned on, whatever the rest is.",)


def assumptions(study: RequirementStudy) -> tuple[str, ...]:
    """Say how to read the requirement and what it takes for granted."""
    return (
        "Errors are independent and Gaussian; the error of the set is that of the covariance of the whole linear error "
        "model along the motion. Sizes are those that are left when GPS ends: a filter that has estimated a bias "
        "leaves less than the turn-on bias of a datasheet.",
        f"An in-run bias has a correlation time of {TAU / 3600.0:g} h. All axes have the same size.",
        "Shares are equal, or by --cost: the cheapest set if a family x times as large as it may be alone costs w / x.",
        "Where a family hardly acts on this motion, its size in the set is where the linear model ends: "
        f"{STEEP / DEG:g} deg of tilt, 5 % of scale.",
        "The vertical channel is held to the reference." if study.hold else "The vertical channel is free.",
    )
