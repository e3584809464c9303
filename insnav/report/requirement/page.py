"""Report of a requirement on the position error: allowed size of each sensor error, and IMUs that meet it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from insnav.errors.requirement import study as aiding
from insnav.errors.requirement.allocation import STEEP, TAU, Share
from insnav.errors.requirement.study import FIELD_FACTOR, LIMITS, NINE_POSITION, Candidate, RequirementStudy
from insnav.findings import Code, Finding
from insnav.quantity import Quantity
from insnav.report.page import DataFrame, Page, Section, Verdict, by_warnings, drawn, only_json, rows_frame
from insnav.report.panels import Curve, Panel, bars, row_panel
from insnav.report.style import BLACK, BLUE, GRADES, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILLION, number
from insnav.report.tables import of_section, of_table
from insnav.result import Result
from insnav.types import FloatArray
from insnav.units import UNITS, shown_unit

LINES = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY)  # line colours of the IMUs that the legend names
SMALLEST = 0.01  # lower end of the error axis [m]
NAMED = 6  # number of IMUs that the legend names: the nearest to the limit
_NEAR = 10  # number of IMUs in the short table: the nearest to the limit
_BRIEF = ("part", "class", "alone_error", "alone_meets", "nhc_error", "nhc_meets")  # columns of the short table


def page(result: Result[RequirementStudy]) -> Page:
    """Lay out a requirement study: allowed errors, real IMUs, simulated runs, and improvements of an example IMU."""
    study = result.found
    title = f"Allocation: {study.required.text}"
    how = "alone: this error and no other; in the set: all at once"
    how += f", errors of {study.imu} as given" if study.imu else ""
    sections = (
        only_json("requirement", *of_table("requirement.required", study, imu=study.imu or None)),
        *_parts(study),
        drawn("allocation", title, (allocation_panel(study),)),
        Section("allocation", "How large each error may be, 1 sd", rows=_rows(study), note=how, folded=True),
        Section("verification", "Simulated runs of the set", rows=_verification(study)),
        *_example(study),
    )
    return Page(
        f"Requirement: {study.required.text}",
        summary(study),
        sections,
        (*warnings(study), *assumptions(study)),
        verdict=_verdict(study),
        merits=_merits(study),
    )


def frame(result: Result[RequirementStudy]) -> DataFrame:
    """Build a table of the real IMUs in the study; without real IMUs, of the allowed size of each error."""
    study = result.found
    return rows_frame(tuple(_part(study, each) for each in study.candidates) or _rows(study))


def _met(study: RequirementStudy, kind: str, *answers: str) -> list[str]:
    """List the IMUs that meet the requirement with one of `answers`, by default yes or likely; least accurate first."""
    wanted = answers or ("yes", "likely")
    return [each.name for each in study.candidates if getattr(each, kind).answer in wanted][::-1]


def _verdict(study: RequirementStudy) -> Verdict | None:
    if not study.candidates:
        return None
    if _met(study, "alone", "yes"):
        return by_warnings(_answer(study), warnings(study), ("good", "some IMUs meet it alone"))
    if _met(study, "alone"):
        reason = "alone some IMUs only likely meet it: not all of their figures are documented"
        return Verdict("attention", reason, _answer(study))
    if _met(study, "nhc"):
        return Verdict("attention", "only with the NHC", _answer(study))
    return Verdict("bad", "no IMU of the library meets it", _answer(study))


def _merits(study: RequirementStudy) -> tuple[Quantity, ...]:
    shares = {share.family: share for share in study.allocation.shares}
    families = ("gyro bias", "gyro white noise", "accel bias", "accel white noise")
    sizes = tuple(
        Quantity(name.replace(" ", "_"), shares[name].size, shares[name].unit, meaning=f"{name} in the set")
        for name in families
        if study.allocation.feasible
    )
    counts = (
        Quantity("parts_alone", len(_met(study, "alone")), meaning="IMUs that meet it without aiding, or likely do"),
        Quantity("parts_nhc", len(_met(study, "nhc")), meaning="with NHC, or likely do"),
    )
    return (*counts, *sizes) if study.candidates else sizes


def _answer(study: RequirementStudy) -> str:
    """Write how many IMUs meet the requirement, alone and with NHC, and the least accurate of them, in a sentence."""
    alone, aided = _met(study, "alone"), _met(study, "nhc")
    nhc_only = [name for name in aided if name not in alone]
    count, required = len(study.candidates), study.required
    text = f"{len(_met(study, 'alone', 'yes'))} of {count} IMUs stay within {required.error:g} m for "
    text += f"{required.after:g} s alone{_likely(study, 'alone')}"
    text += f", the least accurate of them {', '.join(alone[:3])}" if alone else ""
    text += f"; {len(_met(study, 'nhc', 'yes'))} with NHC{_likely(study, 'nhc')}"
    return text + (f", the least accurate {', '.join(nhc_only[:3])}." if nhc_only else ".")


def _likely(study: RequirementStudy, kind: str) -> str:
    """Write how many more IMUs meet the requirement if class figures replace undocumented ones; empty for none."""
    count = len(_met(study, kind, "likely"))
    return f" and {count} others likely do (with class figures for missing ones)" if count else ""


def _parts(study: RequirementStudy) -> tuple[Section, ...]:
    if not study.candidates:
        return ()
    note = (
        "meets: yes or no by documented figures; likely with class figures for missing ones. open: only with missing "
        "figures better than their class. Times: when the error exceeds 1, 10, 100 m"
        + f" (– : not within {study.time[-1]:g} s). Missing: usual figures without a document, see insnav imus PART."
    )
    near, all_rows = nearest(study, _NEAR), tuple(_part(study, each) for each in study.candidates)
    brief = tuple(tuple(one for one in _part(study, each) if one.key in _BRIEF) for each in near)
    subset = f", the {len(near)} of {len(study.candidates)} nearest to it" if len(near) < len(study.candidates) else ""
    return (
        drawn("parts", f"Real IMUs: {study.required.text}", part_panels(study), outages_text(study), columns=2),
        Section("", f"Which IMUs meet it{subset}", rows=brief),
        Section("parts", f"All IMUs, {outages_text(study)}", rows=all_rows, note=note, show="page", folded=True),
    )


def _part(study: RequirementStudy, each: Candidate) -> tuple[Quantity, ...]:
    limit = study.required.error
    row = [*of_table("requirement.part", each)]
    for key, label, result in (("alone", "alone", each.alone), ("nhc", "NHC", each.nhc)):
        row += [
            Quantity(f"{key}_error", result.error, "m", meaning=f"{label}: error"),
            Quantity(f"{key}_meets", result.answer, meaning="meets"),
            Quantity(f"{key}_margin", limit / result.error, meaning="limit / error", digits=2),
            *(
                Quantity(f"{key}_time_to_{m:g}_m", time if np.isfinite(time) else None, "s", meaning=f"to {m:g} m")
                for m, time in zip(LIMITS, result.reaches, strict=True)
            ),
        ]
    return (*row, Quantity("missing", len(each.missing), meaning="missing"))


def _example(study: RequirementStudy) -> tuple[Section, ...]:
    """Lay out improvements of the example IMU, the effect of halving each error, and the shares of its errors."""
    if not study.remedies:
        return ()
    limit = study.required.error
    remedies = tuple(
        of_table("requirement.remedy", each, change=each.ratio - 1.0, meets=each.error <= limit)
        for each in study.remedies
    )
    elasticities = tuple(
        of_table("requirement.elasticity", each) for each in sorted(study.elasticities, key=lambda each: each.halved)
    )
    shares = tuple(
        (Quantity("source", name, meaning="error when GPS ends"), Quantity("share", value, "%"))
        for name, value in sorted(study.shares.items(), key=lambda item: -item[1])
    )
    imu = {"imu": study.example}
    return (
        of_section("requirement.remedy", remedies, imu),
        of_section("requirement.elasticity", elasticities, imu, show="page", folded=True),
        of_section("requirement.shapley", shares, imu, show="page", folded=True),
    )


def _rows(study: RequirementStudy) -> tuple[tuple[Quantity, ...], ...]:
    rows = []
    for share in study.allocation.shares:
        size = share.size if share.given or study.allocation.feasible else None
        note = "given" if share.given else "hardly acts" if share.capped else ""
        rows.append(of_table("requirement.share", share, in_set=size, note=note))
    return tuple(rows)


def _verification(study: RequirementStudy) -> tuple[tuple[Quantity, ...], ...]:
    wanted, rows = study.required.probability, []
    for each in study.verified:
        set_name, share = f"{each.factor:g} x the set", each.within / each.runs
        error = Quantity("error", each.error, "m", meaning=f"{100 * wanted:g} % error")
        meets = Quantity("meets", each.meets(wanted), meaning=f"agrees with {100 * wanted:g} %")
        rows.append((*of_table("requirement.run", each, set=set_name, probability=share), error, meets))
    return tuple(rows)


def summary(study: RequirementStudy) -> tuple[str, ...]:
    """Summarise the study in a few sentences: motion, given IMU, balanced set of errors, simulated runs."""
    found, required = study.allocation, study.required
    lines = [f"Motion: {study.motion}."]
    if study.imu:
        remark = f"{number(found.given / required.error)} times the limit, with no share for other errors."
        remark = "the other errors share the rest." if found.feasible else remark
        lines.append(f"The figures of {study.imu} alone make {number(found.given)} m: {remark}")
    if found.feasible:
        tight = sorted((share for share in found.shares if not share.given and not share.capped), key=lambda s: -s.part)
        sizes = (f"{each.family} {_size(each.size, each)}" for each in tight[:6])
        lines.append(f"A balanced set: {', '.join(sizes)}; see the table.")
    for each in study.verified:
        low, high = each.interval
        # simulated runs can refute the required probability but not prove it: they only agree with it
        verdict = "agrees with" if each.meets(required.probability) else "less than"
        lines.append(
            f"{each.factor:g} x the set, {each.runs} simulated runs: {100 * each.within / each.runs:.1f} % within the "
            f"limit ({100 * low:.1f} to {100 * high:.1f} %): {verdict} {100 * required.probability:g} %."
        )
    return tuple(lines)


def warnings(study: RequirementStudy) -> tuple[Finding, ...]:
    """Return a warning if the errors of the given IMU alone exceed the requirement."""
    error, limit = study.allocation.given, study.required.error
    finding = Finding.of(Code.REQUIREMENT_INFEASIBLE, subject=study.imu, error_m=error, limit_m=limit)
    return () if study.allocation.feasible else (finding,)


def assumptions(study: RequirementStudy) -> tuple[Finding, ...]:
    """Return findings that explain the method of the study and its assumptions."""
    return (
        Finding.of(Code.REQUIREMENT_COVARIANCE),
        Finding.of(Code.REQUIREMENT_IN_RUN_BIAS, correlation_time_s=TAU),
        Finding.of(Code.REQUIREMENT_SHARES),
        Finding.of(Code.REQUIREMENT_CAPPED, tilt_rad=STEEP, scale=0.05),
        Finding.of(Code.BUDGET_VERTICAL_HELD if study.hold else Code.BUDGET_VERTICAL_FREE),
        *(_aided_assumptions(study) if study.candidates else ()),
    )


def _aided_assumptions(study: RequirementStudy) -> Iterator[Finding]:
    first, last = study.begins[0], study.begins[-1]
    outages: dict[str, Any] = {"first_s": first, "last_s": last, "count": len(study.begins)}
    outages = outages if first != last else {"begin_s": first}
    yield Finding.of(Code.REQUIREMENT_PARTS, fix_m=aiding.POSITION_SD, fix_m_s=aiding.VELOCITY_SD, **outages)
    yield FIELD_FACTOR
    yield Finding.of(
        Code.REQUIREMENT_AIDING,
        nhc_m_s=aiding.NHC_SD,
        odometer_m_s=aiding.ODOMETER_SD,
        zupt_m_s=aiding.ZUPT_SD,
        barometer_m=aiding.BAROMETER_SD,
        heading_rad=aiding.HEADING_SD,
    )
    bias, scale, angle = NINE_POSITION.values()
    yield Finding.of(Code.REQUIREMENT_CALIBRATION, scale=scale, angle_rad=angle, bias_m_s2=bias)


def outages_text(study: RequirementStudy) -> str:
    """Describe how long GPS was available before the outages of the study."""
    first, last = study.begins[0], study.begins[-1]
    if first == last:
        return f"after {first} s of GPS"
    return f"mean of {len(study.begins)} outages after {first} to {last} s of GPS"


def nearest(study: RequirementStudy, count: int) -> list[Candidate]:
    """Select the `count` IMUs whose unaided error is nearest to the limit, by ratio; the most accurate first."""
    limit = study.required.error
    order = sorted(study.candidates, key=lambda each: abs(np.log(each.alone.error / limit)))[:count]
    return [each for each in study.candidates if any(each is one for one in order)]


def part_panels(study: RequirementStudy) -> Iterator[Panel]:
    """Draw the error of every IMU over time, alone and with the NHC, with the limit.

    The legend names IMUs near the limit; for the other IMUs it has only their classes.
    """
    required, named = study.required, nearest(study, NAMED)
    x, y = np.array([required.after]), np.array([required.error])
    label = f"{required.component} error, {100 * required.probability:g} % [m]"
    for title, kind in (("the IMU alone", "alone"), ("with non-holonomic constraint (NHC)", "nhc")):
        curves = [
            Curve(f"others, {each.grade}", study.time, _error(each, kind), GRADES[each.grade], "thin")
            for each in study.candidates
            if not any(each is one for one in named)
        ]
        curves += [
            Curve(f"{each.name} ({each.grade})", study.time, _error(each, kind), colour, text=(each.name,))
            for each, colour in zip(named, LINES, strict=False)
        ]
        text = (f"required: {required.error:g} m after {required.after:g} s",)
        curves.append(Curve("requirement", x, y, BLACK, "points", text=text))
        labels, levels = (f"Error over time, {title}", label, "time without GPS [s]"), ((required.error, "limit"),)
        yield Panel(f"parts_{kind}", *labels, tuple(curves), "parts", log="y", levels=levels, height=330)


def _error(each: Candidate, kind: str) -> FloatArray:
    return np.asarray(np.maximum(getattr(each, kind).curve, SMALLEST))


def allocation_panel(study: RequirementStudy) -> Panel:
    """Draw the effect of halving each error of the example IMU; without an example, the allowed size of each error.

    Allowed sizes are relative to the size that meets the limit alone. In a balanced set, these bars are equal.
    """
    if study.elasticities:
        order = sorted(study.elasticities, key=lambda each: each.halved)
        kinds, rows, widths = ["halved"] * len(order), [each.family for each in order], [-100 * e.halved for e in order]
        title, label = f"Effect of halving each error of {study.example}", "reduction of the error [%]"
        texts = [f"{name}: {number(value)} % less error" for name, value in zip(rows, widths, strict=True)]
    else:
        shares = [share for share in study.allocation.shares if np.isfinite(share.alone)]
        kinds = ["given" if share.given else "hardly acts" if share.capped else "of the set" for share in shares]
        rows, widths = [share.family for share in shares], [min(share.size / share.alone, 1.2) for share in shares]
        title, label = "How large each error may be", "size in the set / size that meets the limit alone [-]"
        texts = [f"{e.family}: {_size(e.size, e)} in the set, {_size(e.alone, e)} alone" for e in shares]
    colours = {"halved": BLUE, "of the set": BLUE, "given": ORANGE, "hardly acts": GREY}
    curves = bars(kinds, colours, np.zeros(len(rows)), np.array(widths), texts)
    return row_panel("allocation", title, label, curves, rows)


def _size(value: float, share: Share) -> str:
    return f"{number(value / UNITS[share.unit][1])} {shown_unit(share.unit)}"
