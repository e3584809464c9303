"""Report on the moment of inertia of a rotor."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from insnav.lab.bench_data.bench_tables import BenchTable
from insnav.lab.calibration import Calibration
from insnav.lab.rotor_inertia import Inertias
from insnav.report.calibration.figures import draw_line
from insnav.report.calibration.page import base_facts, fit_facts, parameter_table, quality_table
from insnav.report.numbers import number
from insnav.report.sheet import Picture, Sheet
from insnav.report.style import drawing

UNIT = "kg m²"


def rotor_report(
    calibration: Calibration[tuple[BenchTable, BenchTable], Inertias],
) -> tuple[Sheet, dict[str, Any]]:
    """Page and facts of both methods and whether they agree."""
    fall, precession, both = calibration.detail.fall, calibration.detail.precession, calibration.detail.agreement
    found, how, items = (fall, precession), calibration.options, calibration.parameters
    given = {
        "fall_mass_kg": how.fall_mass,
        "radius_m": how.radius,
        "mass_kg": how.mass,
        "arm_m": how.arm,
        "gravity_m_s2": how.gravity,
    }
    gap = (
        f"the difference {number(both.difference, 2)} is within"
        if both.agree
        else (f"the difference {number(both.difference, 2)} is beyond")
    )
    verdict = f"{gap} the {number(both.limit, 2)} {UNIT} that their uncertainties explain (95 %)"
    if both.agree:
        summary = (
            f"The methods agree: {verdict}; weighted mean {number(both.mean, 4)} ± {number(both.mean_sd, 2)} {UNIT}."
        )
    else:
        summary = f"The methods do not agree: {verdict}; one of them has a systematic error."
        calibration = replace(calibration, warnings=(summary, *calibration.warnings))
    with drawing():
        figure = draw_line(
            [
                ("squared time of fall [s²]", fall.x, fall.y, float(fall.fit.value[0])),
                ("rotor rate [rad/s]", precession.x, precession.y, float(precession.fit.value[0])),
            ],
            ("height [m]", "precession period [s]"),
            "Moment of inertia of a rotor: falling weight, and precession",
            f"I = {number(fall.value, 4)} ± {number(fall.sd, 2)} and {number(precession.value, 4)} ± "
            f"{number(precession.sd, 2)} {UNIT}; lines through the origin, residuals below",
        )
    quality = [
        quality_table({"falling weight": fall.fit}, "s²", {"falling weight": [f"{h:.4g} m" for h in fall.x]}),
        quality_table({"precession": precession.fit}, "rad/s", {"precession": [f"{t:.4g} s" for t in precession.x]}),
    ]
    sheet = Sheet(
        "Moment of inertia of a gyroscope's rotor",
        (
            *(f"moment of inertia, {i.method}: {number(i.value, 4)} ± {number(i.sd, 2)} {UNIT}" for i in found),
            summary,
        ),
        (parameter_table("Moment of inertia", items), replace(quality[0], note=""), quality[1]),
        (Picture("lines", figure, "Measured points, the lines fitted to them, and what these leave."),),
        (
            f"Falling weight {given['fall_mass_kg']:g} kg on a radius of {given['radius_m']:g} m, weight of "
            f"{given['mass_kg']:g} kg on an arm of {given['arm_m']:g} m, gravity {given['gravity_m_s2']:g} m/s²: taken "
            "as exact; their uncertainty comes on top.",
            "Falling weight: no friction, a cord without weight, released from rest.",
            "Precession: a rotor much faster than its precession, balanced without the added weight.",
        ),
        calibration.warnings,
    )
    facts = base_facts("rotor", calibration.record, calibration)
    facts |= {
        "given": given,
        "agree": both.agree,
        "difference_kg_m2": both.difference,
        "limit_kg_m2": both.limit,
        "mean_kg_m2": both.mean if both.agree else None,
        "mean_sd_kg_m2": both.mean_sd if both.agree else None,
        "fits": [*fit_facts({"falling weight": fall.fit}, "s^2"), *fit_facts({"precession": precession.fit}, "rad/s")],
    }
    return sheet, facts
