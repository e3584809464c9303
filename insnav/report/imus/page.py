"""Report of the library of real IMUs: a table of all, or one IMU with its figures and their source documents."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from insnav.findings import Code, Finding
from insnav.imu.library import PROVENANCE, Figure, Part, parts
from insnav.imu.specification import PRESETS, TERMS
from insnav.messages import sentence
from insnav.quantity import Quantity
from insnav.report.page import DataFrame, Page, Section, drawn, one_each, only_json, rows_frame
from insnav.report.panels import Curve, Panel
from insnav.report.style import GRADES, GREY
from insnav.report.tables import of_table
from insnav.result import Result
from insnav.units import HOUR, UNITS, shown_unit

_UNITS = {f"{term.sensor}.{term.key}": term.unit for term in TERMS}
_HEADINGS = {
    "gyro.bias": "gyro bias",
    "gyro.bias_instability": "in-run",
    "gyro.random_walk": "ARW",
    "accel.bias": "accel bias",
    "accel.bias_instability": "in-run",
    "accel.random_walk": "VRW",
}
RULES = (
    Finding.of(Code.IMUS_STATISTICS),
    Finding.of(Code.IMUS_BIASES, correlation_time_s=HOUR),
    Finding.of(Code.IMUS_DOCUMENTS, order=PROVENANCE),
)


def page(result: Result[tuple[Part, ...]]) -> Page:
    """Lay out the IMU named by the options, or a table of all IMUs."""
    return _part_page(result.found[0]) if result.options.get("name") else _parts_page(result.found)


def frame(result: Result[tuple[Part, ...]]) -> DataFrame:
    """Build a table of the IMU figures that insnav uses, one row per IMU."""
    return rows_frame(map(_part_row, result.found))


def _part_row(part: Part) -> tuple[Quantity, ...]:
    return (
        Quantity("part", part.name),
        Quantity("class", part.grade),
        *(_shown(part, key) for key in _HEADINGS),
        Quantity("source", part.provenance),
    )


def _parts_page(all_parts: Sequence[Part]) -> Page:
    """Lay out a table of IMUs: turn-on bias, in-run bias and white noise of gyros and accelerometers."""
    classes = {grade: [part.name for part in all_parts if part.grade == grade] for grade in PRESETS}
    named = {grade: (Quantity("parts", names),) for grade, names in classes.items() if names}
    by_class = only_json("", parts=(one_each("classes", "", named),))
    return Page(
        f"{len(all_parts)} real IMUs",
        (
            "Use any of them as the IMU model: --imu STIM300.",
            "insnav imus STIM300 shows every figure of a part and its source.",
        ),
        (Section("imus", rows=tuple(map(_part_row, all_parts))), by_class, _noise_section(all_parts)),
        findings=RULES,
    )


def _noise_section(shown: Sequence[Part]) -> Section:
    """Draw gyro in-run bias over gyro white noise, a colour per IMU class; IMUs of the library not `shown` are grey."""
    names, keys, curves = {part.name for part in shown}, ("gyro.random_walk", "gyro.bias_instability"), []
    documented = [part for part in parts() if not {*keys} & {*part.missing}]
    for group, colour in {"others": GREY, **GRADES}.items():
        of_class = [part for part in documented if group == (part.grade if part.name in names else "others")]
        x, y = (np.array([_shown(part, key).facts().popitem()[1] for part in of_class]) for key in keys)
        curves.append(Curve(group, x, y, colour, "points", text=tuple(part.name for part in of_class)))
    noise, bias = (f"{_HEADINGS[key]} [{shown_unit(_UNITS[key])}]" for key in keys)
    panel = Panel("noise", "Noise of the gyros", bias, noise, tuple(curves), log="xy", height=330)
    return drawn("noise", panel.title, (panel,))


def _shown(part: Part, key: str) -> Quantity:
    """Build the quantity of the IMU figure that insnav uses for a key, of its largest axis; None without a figure."""
    sizes = [float(figure.sd.max()) for figure in part.figures if figure.used and figure.key == key]
    return Quantity(key.replace(".", "_"), sizes[0] if sizes else None, _UNITS[key], meaning=_HEADINGS[key])


def _part_page(part: Part) -> Page:
    """Lay out one IMU: every figure, its interpretation, and its source document."""
    rows = tuple(_row(figure) for figure in part.figures if not figure.key.endswith("correlation_time"))
    missing = ", ".join(part.missing) or "none of the usual figures"
    about = of_table("imus.part", part, temperature=part.temperature or None, missing=missing, note=part.note or None)
    sources = {
        each.document: (Quantity("provenance", each.provenance), Quantity("where", each.where)) for each in part.figures
    }
    tables = Section("part", items=about), Section("figures", "Figures", rows=rows), one_each("documents", "", sources)
    return Page(
        f"{part.name}, {part.maker}",
        (sentence(Finding.of(Code.IMUS_MISSING, subject=part.name, terms=part.missing)),) if part.missing else (),
        (*tables, _noise_section((part,))),
        findings=RULES,
    )


def _row(figure: Figure) -> tuple[Quantity, ...]:
    sd = f"{figure.sd.max() / UNITS[_UNITS[figure.key]][1]:.3g} {_UNITS[figure.key]}"
    return of_table("imus.figure", figure, as_written=", ".join(figure.text), sd=sd)
