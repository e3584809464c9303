"""Report on the moment of inertia of a rotor."""

from __future__ import annotations

from insnav.findings import Code, of_code
from insnav.lab.bench_data.bench_tables import BenchTable
from insnav.lab.calibration import Calibration, fitted
from insnav.lab.rotor_inertia import Inertia, Inertias
from insnav.messages import sentence
from insnav.quantity import Quantity
from insnav.report.calibration.common import quality_rows, quality_section
from insnav.report.calibration.panels import line_panels
from insnav.report.numbers import number
from insnav.report.page import Page, Section, drawn, only_json

UNIT, _KEY_UNIT = "kg m²", "kg m^2"
_ACROSS = ("height [m]", "precession period [s]")
_CAPTION = "Measured points, the lines fitted to them, and what these leave"


def rotor_page(calibration: Calibration[tuple[BenchTable, BenchTable], Inertias]) -> Page:
    """Report both methods and whether they agree."""
    fall, precession, both = calibration.detail.fall, calibration.detail.precession, calibration.detail.agreement
    how = calibration.options
    verdict = (
        f"the difference {number(both.difference, 2)} is within the "
        f"{number(both.limit, 2)} {UNIT} that their uncertainties explain (95 %)"
    )
    agreed = f"The methods agree: {verdict}; weighted mean {number(both.mean, 4)} ± {number(both.mean_sd, 2)} {UNIT}."
    text = agreed if both.agree else sentence(next(of_code(calibration.warnings, Code.ROTOR_DISAGREE)))
    quality = (
        *quality_rows({"falling weight": fall.fit}, "s^2", {"falling weight": [f"{h:.4g} m" for h in fall.x]}),
        *quality_rows({"precession": precession.fit}, "rad/s", {"precession": [f"{t:.4g} s" for t in precession.x]}),
    )
    column = calibration.record[1].get("mass")
    masses = [how.mass] if column is None else sorted(set(column.tolist()))
    weight = " and ".join(f"{each:g}" for each in masses) + " kg"
    given = only_json(
        "given",
        Quantity("fall_mass", how.fall_mass, "kg"),
        Quantity("radius", how.radius, "m"),
        Quantity("mass", masses, "kg"),
        Quantity("arm", how.arm, "m"),
        Quantity("gravity", how.gravity, "m/s^2"),
    )
    agreement = only_json(
        "",
        Quantity("agree", both.agree),
        Quantity("difference", both.difference, _KEY_UNIT),
        Quantity("limit", both.limit, _KEY_UNIT),
        Quantity("mean", both.mean if both.agree else None, _KEY_UNIT),
        Quantity("mean_sd", both.mean_sd if both.agree else None, _KEY_UNIT),
        parts=(given,),
    )
    lines = [
        ("squared time of fall [s²]", fall.x, fall.y, float(fall.fit.value[0])),
        ("rotor rate [rad/s]", precession.x, precession.y, float(precession.fit.value[0])),
    ]
    return Page(
        "Moment of inertia of a gyroscope's rotor",
        (
            *(
                f"moment of inertia, {i.method}: {number(i.value, 4)} ± {number(i.sd, 2)} {UNIT}"
                for i in (fall, precession)
            ),
            text,
        ),
        (
            drawn("lines", "Moment of inertia of a rotor", line_panels(lines, _ACROSS), _CAPTION, columns=2),
            Section("parameters", "Moment of inertia", calibration.parameters),
            *_powers(precession),
            quality_section(quality),
            agreement,
        ),
        calibration.warnings,
        (
            f"Falling weight {how.fall_mass:g} kg on a radius of {how.radius:g} m, weight {weight} on an arm "
            f"of {how.arm:g} m, gravity {how.gravity:g} m/s²: taken as exact; their uncertainty comes on top.",
            "Falling weight: no friction, a cord without weight, released from rest.",
            "Precession: a rotor much faster than its precession, balanced without the added weight.",
        ),
    )


def _powers(precession: Inertia) -> tuple[Section, ...]:
    """Powers of torque and spin, where several of both were measured."""
    if precession.powers is None:
        return ()
    items = fitted(precession.powers, ("", "", ""))[1:]
    return (Section("powers", "Precession rate as a power of torque and spin", items, note="by theory 1 and -1"),)
