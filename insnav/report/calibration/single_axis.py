"""Reports of the rate table and of the tumble test."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from insnav.lab.calibration import Calibration, measured
from insnav.lab.single_axis.rate_table import RateTable
from insnav.lab.single_axis.records import Record
from insnav.lab.single_axis.tumble import Tumble, harmonics
from insnav.messages import sentence
from insnav.quantity import Quantity
from insnav.report.calibration.common import impact_section, quality_rows, quality_section
from insnav.report.calibration.panels import Series, residual_panels
from insnav.report.numbers import number
from insnav.report.page import Page, Section, drawn, only_json
from insnav.units import DEG


def gyro_page(calibration: Calibration[tuple[Record, ...], tuple[RateTable, ...]]) -> Page:
    """Report gyros on a rate table."""
    found, fits = dict(zip(calibration.fits, calibration.detail, strict=True)), calibration.fits
    unit = calibration.record[0].unit
    settings = {name: [f"{rate:+g} deg/s" for rate in item.rate[item.used]] for name, item in found.items()}
    series = (Series.of(name, unit, item) for name, item in found.items())
    dropped = [(name, drop) for name, item in found.items() for drop in item.dropped]
    lines = tuple(
        f"{name} leaves out {drop.rate:+g} deg/s (residual {number(drop.residual)} {unit}, limit "
        f"{number(drop.limit, 2)} {unit}): {sentence(drop.reason)}"
        for name, drop in dropped
    )
    left_out = tuple(
        (
            Quantity("sensor", name),
            Quantity("rate_deg_s", drop.rate),  # a round number, as on the table
            measured("residual", drop.residual, unit),
            measured("limit", drop.limit, unit),
            Quantity("code", drop.reason.code.value),
        )
        for name, drop in dropped
    )
    return Page(
        "Gyros on a rate table",
        (*_summary(calibration.parameters, len(fits)), *lines),
        (
            drawn("residuals", "Rate table: output minus the straight line", residual_panels(series, "rate [deg/s]")),
            Section("parameters", "Output = U0 + K rate", calibration.parameters, note=_IN_BRACKETS),
            _senses(found, unit),
            quality_section(quality_rows(fits, unit, settings)),
            _dwells(calibration.record, tuple(fits)),
            impact_section(calibration),
            Section("dropped", rows=left_out, show="json"),
        ),
        calibration.warnings,
        (
            "The rate of the table is exact, and the component of the Earth's rotation along the axis is in U0.",
            "Forward are rates from zero up, reverse from zero down.",
        ),
    )


def accel_page(calibration: Calibration[tuple[Record, ...], tuple[Tumble, ...]]) -> Page:
    """Report accelerometers tumbled in gravity."""
    found, fits = dict(zip(calibration.fits, calibration.detail, strict=True)), calibration.fits
    unit, gravity = calibration.record[0].unit, calibration.options.gravity
    settings = {name: [f"{angle / DEG:.4g} deg" for angle in item.angle] for name, item in found.items()}
    series = (
        Series(name, unit, item.angle / DEG, item.fit.residual, np.ones(item.angle.size, np.bool_), item.fit.sigma)
        for name, item in found.items()
    )
    note = f"ai = sin, ao = cos of the angle, in g; {_IN_BRACKETS}"
    return Page(
        "Accelerometers tumbled in gravity",
        _summary(calibration.parameters, len(fits)),
        (
            drawn("residuals", "Tumble test: output minus the model", residual_panels(series, _ANGLE)),
            Section("parameters", "Output = K0 + K1 ai + K2 ai² + K3 ai ao", calibration.parameters, note=note),
            *_harmonics(found, unit),
            quality_section(quality_rows(fits, unit, settings)),
            _dwells(calibration.record, tuple(fits)),
            impact_section(calibration),
            only_json("", Quantity("gravity", gravity, "m/s^2")),
        ),
        calibration.warnings,
        (
            f"Gravity is {gravity:.6g} m/s²; the angles are exact.",
            "The calibration file holds bias and scale factor; second order and cross-coupling are reported only.",
        ),
    )


def _harmonics(found: dict[str, Tumble], unit: str) -> tuple[Section, Section]:
    """Fourier coefficients of each sensor, and the model that follows from them."""
    rows, models = [], []
    for name, item in found.items():
        series = harmonics(item.angle, item.output)
        for n, a, b in zip(series.order.tolist(), series.cosine, series.sine, strict=True):
            sd = None if not n or np.isnan(series.sd) else series.sd
            rows.append(
                (
                    Quantity("sensor", name),
                    Quantity("order", n),
                    measured("cosine", a, unit, sd),
                    measured("sine", b, unit, sd),
                    measured("amplitude", float(np.hypot(a, b)), unit),
                )
            )
        by_model = zip(("K0", "K1", "K2", "K3"), series.model, item.fit.value, strict=True)
        models.append(
            (
                Quantity("sensor", name),
                *(measured(key, value, unit) for key, value, _ in by_model),
                Quantity(
                    "difference", float(np.abs(series.model - item.fit.value).max()), meaning="largest difference"
                ),
                Quantity("misalignment", series.misalignment, "mrad"),
            )
        )
    note = (
        "Orders 0 to 2 are the model: a0 = K0 + K2/2, b1 = K1, a2 = -K2/2, b2 = K3/2. a1 / b1 is the angle by which "
        "the table or the input axis is off; orders from 3 on are non-linearity and errors of position."
    )
    return (
        Section("harmonics", "Output = Σ a cos(n angle) + b sin(n angle)", rows=tuple(rows), note=note),
        Section(
            "model_by_harmonics",
            "The model by its harmonics",
            rows=tuple(models),
            note="largest difference: from least squares, zero for evenly spaced positions",
        ),
    )


_ANGLE = "angle of the input axis [deg]"
_IN_BRACKETS = "± 1 sd; in brackets the 95 % interval"


def _summary(items: Sequence[Quantity], sensors: int) -> tuple[str, ...]:
    """Parameters in words, a line a sensor."""
    texts = [f"{p.label} {_short(p.scaled(p.value))} ± {number(p.scaled(p.sd), 2)} {p.shown_unit}" for p in items]
    own = len(texts) // sensors
    return tuple("; ".join(texts[i : i + own]) for i in range(0, len(texts), own))


def _short(value: float) -> str:
    """Four digits, and four decimals as such calibrations are published."""
    size = abs(value)
    return number(value, 4) if size < 0.1 or size >= 1000.0 else f"{value:.4f}"


def _senses(found: dict[str, RateTable], unit: str) -> Section:
    """Forward, reverse and their average, where both senses of rotation were measured."""
    rows = []
    for name, item in found.items():
        if item.average is None or item.forward is None or item.reverse is None or item.asymmetry is None:
            continue
        for sense, values, sds in (
            ("forward", item.forward.value, item.forward.sd),
            ("reverse", item.reverse.value, item.reverse.sd),
            ("average", *item.average),
        ):
            row = [
                Quantity("rotation", f"{name} {sense}"),
                measured("U0", values[0], unit, float(sds[0])),
                measured("K", values[1], f"{unit}/(deg/s)", float(sds[1])),
            ]
            if sense == "average":
                row.append(Quantity("asymmetry", item.asymmetry, "%", meaning="K forward - reverse"))
            rows.append(tuple(row))
    return Section("senses", "Both senses of rotation", rows=tuple(rows))


def _dwells(records: Sequence[Record], names: Sequence[str]) -> Section:
    """What cleaning dropped, where there were samples to clean."""
    rows = tuple(
        (
            Quantity("sensor", name),
            Quantity("dwells", record.dwells.count.size),
            Quantity("fewest_samples", int(record.dwells.count.min())),
            Quantity("most_samples", int(record.dwells.count.max())),
            Quantity("spikes_dropped", int(record.dwells.dropped.sum())),
        )
        for name, record in zip(names, records, strict=True)
        if record.dwells.raw
    )
    note = (
        "Each dwell: polynomial of order 7 through its samples, those beyond the spike limit dropped, mean of the rest."
    )
    return Section("dwells", "Raw dwells", rows=rows, note=note)
