"""Parts that calibration pages share, such as fits and residuals; pages of single axes, rate sweeps and rotors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from insnav.findings import Code, of_code
from insnav.imu.model import ImuErrors
from insnav.lab.bench_data import BenchFile, BenchTable
from insnav.lab.calibration import Calibration, Fit, fitted, measured
from insnav.lab.rate_sweep import SweepCalibration, SweepRecord
from insnav.lab.rotor_inertia import Inertia, Inertias
from insnav.lab.single_axis.rate_table import RateTable, Record
from insnav.lab.single_axis.tumble import Positions, Tumble, harmonics
from insnav.messages import phrase, sentence
from insnav.quantity import Quantity
from insnav.report.page import Page, Section, drawn, only_json
from insnav.report.panels import Curve, Panel
from insnav.report.style import AXIS_COLOURS, BLACK, GREY, number
from insnav.report.tables import of_columns, of_section, of_table
from insnav.sample_statistics import rms
from insnav.types import BoolArray, FloatArray
from insnav.units import DEG, G0


def quality_section(*sets: tuple[Mapping[str, Fit], str, Mapping[str, Sequence[str]]], factor: float = 1.0) -> Section:
    """Tabulate scatter, worst residual and condition of fits. `sets`: fits by sensor, unit, settings in words."""
    rows = []
    for fits, unit, settings in sets:
        for name, fit in fits.items():
            sizes = {"rms": fit.rms, "sd": fit.sigma, "worst": abs(float(fit.residual[fit.worst]))}
            shown = (measured(key, size * factor, unit) for key, size in sizes.items())
            *head, at, condition = of_table("calibration.fits", fit, name=name, worst_at=settings[name][fit.worst])
            rows.append((*head, *shown, at, condition))
    return of_section("calibration.fits", rows)


def impact_section(calibration: Calibration[Any, Any], note: str = "") -> Section:
    """Tabulate the position error after a minute of navigation, without and with the calibration."""
    rows = tuple(
        of_table("calibration.impact", item, ratio=item.without / item.corrected if item.corrected > 0.0 else None)
        for item in calibration.impact
    )
    method = (
        "Simulated horizontal position error after 60 s, RMS. True errors are sampled about the calibrated ones by "
        "their uncertainty. No other errors, exact initial state, constant height. "
    )
    # For raw output in volts or counts, the note defines the errors without calibration.
    errors, sd = calibration.errors or ImuErrors(), calibration.sd
    raw = (errors.gyro_raw and sd.gyro_bias.any()) or (errors.accel_raw and sd.accel_bias.any())
    note = note or "Without: zero output taken as 0, scale factor known." * bool(raw)
    return Section("navigation_impact", "Impact on navigation", rows=rows, note=(method + note).rstrip())


def corrected_section(calibration: Calibration[Any, Any]) -> Section:
    """Tabulate the sd of corrected rates and specific forces that results from the uncertainty of the calibration."""
    errors, spread = calibration.sensed or calibration.errors or ImuErrors(), calibration.sd
    still, diagonal, g = np.zeros((1, 3)), np.full((1, 3), 1.0 / np.sqrt(3.0)), np.array([[0.0, 0.0, -G0]])
    at_rest, up = spread.corrected(errors, still, g)
    turning, _ = spread.corrected(errors, 100.0 * DEG * diagonal, g)
    cases: list[tuple[str, FloatArray, str]] = [
        ("rate at rest, z down", at_rest, "deg/s"),
        ("rate at 100 deg/s about (1, 1, 1)", turning, "deg/s"),
        ("specific force at rest, z down", up, "mg"),
    ]
    rows = tuple(
        (
            Quantity("case", motion),
            *(Quantity(f"sd_{axis}", float(sd[0, k]), unit, digits=2) for k, axis in enumerate("xyz")),
        )
        for motion, sd, unit in cases
        if np.any(sd)
    )
    return of_section("calibration.corrected", rows)


def bench_input(tables: Sequence[BenchTable | BenchFile]) -> Any:
    """Return name, checksum and units of each bench file, for ``run.json``."""
    return [{"path": table.name, "sha256": table.sha256, "units": dict(table.units)} for table in tables]


@dataclass(frozen=True, slots=True)
class Series:
    """Settings, residuals and outputs of one sensor, to be drawn in panels."""

    name: str  # name of the sensor
    unit: str  # unit of residuals and outputs
    setting: FloatArray  # (n,) settings of the bench, such as rates
    residual: FloatArray  # (n,) output minus fitted model
    used: BoolArray  # (n,) true if the fit uses the point
    sd: float = 0.0  # standard deviation, drawn as a band in the panel of residuals; zero: no band
    output: FloatArray | None = None  # (n,) outputs, drawn in a further panel with the fitted model; None: no panel

    @classmethod
    def of(cls, name: str, unit: str, table: RateTable) -> Series:
        """Build the series of a sensor from its rate table test, with residuals from the fitted line."""
        zero, slope = table.fit.value[:2]
        residual = table.output - (zero + slope * table.rate)
        return cls(name, unit, table.rate, residual, table.used, table.fit.sigma, table.output)

    def points(self, values: FloatArray, colour: str) -> list[Curve]:
        """Draw values (n,) over the settings; crosses are points that the fit does not use."""
        unused = ~self.used
        crosses = [Curve("left out", self.setting[unused], values[unused], BLACK, "crosses")] if unused.any() else []
        return [Curve("used", self.setting[self.used], values[self.used], colour, "points"), *crosses]


def residual_panels(series: Iterable[Series], setting: str, key: str = "residuals") -> Iterator[Panel]:
    """Draw output with fitted model, and residuals, over the settings; axis limits ignore points unused in the fit."""
    for row, item in enumerate(series):
        order = np.argsort(item.setting)
        colour, ends = AXIS_COLOURS[row % 3], np.array([item.setting.min(), item.setting.max()])
        largest = 1.2 * max(float(np.abs(item.residual[item.used]).max()), 1.5 * item.sd) or 1.0
        output, curves = item.output, [Curve("", ends, np.zeros(2), GREY)]
        if item.sd > 0.0:
            curves.append(Curve("± 1 sd of the fit", ends, np.full(2, item.sd), colour, "band", np.full(2, -item.sd)))
        curves += item.points(item.residual, colour)
        if output is not None:
            line = Curve("fitted", item.setting[order], (output - item.residual)[order], GREY)
            labels = f"Output of {item.name}", f"output [{item.unit}]", setting
            yield Panel(f"{key}_output_{row}", *labels, (line, *item.points(output, colour)), key, height=240)
        title, label, note = f"Residuals of {item.name}", f"residual [{item.unit}]", "measured minus fitted"
        yield Panel(f"{key}_{row}", title, label, setting, tuple(curves), key, note, limits=(-largest, largest))


def gyro_page(calibration: Calibration[tuple[Record, ...], tuple[RateTable, ...]]) -> Page:
    """Lay out the calibration of gyros on a rate table."""
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
    left_out = []
    for name, drop in dropped:
        sensor, rate, code = of_table("calibration.dropped", drop, sensor=name)
        sizes = (measured(key, getattr(drop, key), unit) for key in ("residual", "limit"))
        left_out.append((sensor, rate, *sizes, code))
    return Page(
        "Gyros on a rate table",
        (*_summary(calibration.parameters, len(fits)), *lines),
        (
            drawn("residuals", "Rate table: output and residuals", residual_panels(series, "rate [deg/s]")),
            Section("parameters", "Output = U0 + K rate", calibration.parameters, note=_IN_BRACKETS),
            _senses(found, unit),
            quality_section((fits, unit, settings)),
            _dwells(calibration.record, tuple(fits)),
            impact_section(calibration),
            Section("dropped", rows=tuple(left_out), show="json"),
        ),
        method=tuple(phrase("method.rate_table").splitlines()),
    )


def accel_page(calibration: Calibration[Any, Any]) -> Page:
    """Lay out the calibration of accelerometers: single ones tumbled in gravity, or a triad in known positions."""
    return (_positions_page if isinstance(calibration.record[0], Positions) else _tumble_page)(calibration)


def _positions_page(calibration: Calibration[tuple[Positions], tuple[Fit, ...]]) -> Page:
    """Lay out the calibration of an accelerometer triad in known positions."""
    (record,), fits = calibration.record, calibration.fits
    places = [", ".join(f"{axis} {f:+.2f}" for axis, f in zip("xyz", row, strict=True)) for row in record.force / G0]
    unit = record.unit if record.raw else "m/s^2"
    return Page(
        "Accelerometers in known positions",
        _summary(calibration.parameters, len(fits)),
        (
            Section("parameters", "Output = B f + b", calibration.parameters, note=_IN_BRACKETS),
            quality_section((fits, unit, dict.fromkeys(fits, places))),
            corrected_section(calibration),
            impact_section(calibration),
            only_json("", Quantity("gravity", calibration.options.gravity, "m/s^2")),
        ),
        method=tuple(phrase("method.positions", gravity_m_s2=calibration.options.gravity).splitlines()),
    )


def _tumble_page(calibration: Calibration[tuple[Record, ...], tuple[Tumble, ...]]) -> Page:
    """Lay out the calibration of single accelerometers tumbled in gravity."""
    found, fits = dict(zip(calibration.fits, calibration.detail, strict=True)), calibration.fits
    unit, gravity = calibration.record[0].unit, calibration.options.gravity
    settings = {name: [f"{angle / DEG:.4g} deg" for angle in item.angle] for name, item in found.items()}
    series = (
        Series(name, unit, item.angle / DEG, item.fit.residual, item.angle < np.inf, item.fit.sigma, item.output)
        for name, item in found.items()
    )
    panels = residual_panels(series, "angle of the input axis [deg]")
    note = f"ai = sin, ao = cos of the angle, in g; {_IN_BRACKETS}"
    return Page(
        "Accelerometers tumbled in gravity",
        _summary(calibration.parameters, len(fits)),
        (
            drawn("residuals", "Tumble test: output and residuals", panels),
            Section("parameters", "Output = K0 + K1 ai + K2 ai² + K3 ai ao", calibration.parameters, note=note),
            *_harmonics(found, unit),
            quality_section((fits, unit, settings)),
            _dwells(calibration.record, tuple(fits)),
            impact_section(calibration),
            only_json("", Quantity("gravity", gravity, "m/s^2")),
        ),
        method=tuple(phrase("method.tumble", gravity_m_s2=gravity).splitlines()),
    )


def _harmonics(found: dict[str, Tumble], unit: str) -> tuple[Section, Section]:
    """Tabulate the Fourier coefficients of each sensor's output over the angle, and the model derived from these."""
    rows, models = [], []
    for name, item in found.items():
        series = harmonics(item.angle, item.output)
        for n, a, b in zip(series.order.tolist(), series.cosine, series.sine, strict=True):
            sd = None if not n or np.isnan(series.sd) else series.sd
            parts = measured("cosine", a, unit, sd), measured("sine", b, unit, sd)
            amplitude = measured("amplitude", float(np.hypot(a, b)), unit)
            rows.append((Quantity("sensor", name), Quantity("order", n), *parts, amplitude))
        largest = float(np.abs(series.model - item.fit.value).max())
        terms = (measured(f"K{order}", value, unit) for order, value in enumerate(series.model))
        difference = Quantity("difference", largest, meaning="largest difference")
        turned = Quantity("misalignment", series.misalignment, "mrad")
        models.append((Quantity("sensor", name), *terms, difference, turned))
    return of_section("calibration.harmonics", rows), of_section("calibration.model_by_harmonics", models)


_IN_BRACKETS = "± 1 sd; in brackets the 95 % interval"


def _summary(items: Sequence[Quantity], sensors: int) -> tuple[str, ...]:
    """Describe the parameters, one line per sensor."""
    texts = []
    for p in items:
        value = p.scaled(p.value)  # with four decimals, as usual in publications, or else four significant digits
        short = number(value, 4) if abs(value) < 0.1 or abs(value) >= 1000.0 else f"{value:.4f}"
        texts.append(f"{p.label} {short} ± {number(p.scaled(p.sd), 2)} {p.shown_unit}")
    per_sensor = len(texts) // sensors
    return tuple("; ".join(texts[i : i + per_sensor]) for i in range(0, len(texts), per_sensor))


def _senses(found: dict[str, RateTable], unit: str) -> Section:
    """Tabulate the fits for forward and reverse rotation and their average, for sensors measured in both senses."""
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
    """Tabulate the numbers of dwells, of samples in them, and of dropped spikes, for sensors with raw samples."""
    raw = {name: record.dwells for name, record in zip(names, records, strict=True) if record.dwells.raw}
    counts, dropped = [each.count for each in raw.values()], [int(each.dropped.sum()) for each in raw.values()]
    extremes = {"fewest_samples": map(np.min, counts), "most_samples": map(np.max, counts)}
    rows = of_columns("calibration.dwells", sensor=raw, dwells=map(len, counts), **extremes, spikes_dropped=dropped)
    return of_section("calibration.dwells", rows)


def sweep_page(calibration: Calibration[SweepRecord, SweepCalibration]) -> Page:
    """Lay out the calibration of three gyros by rate sweeps about three axes."""
    record, found, fits = calibration.record, calibration.detail, calibration.fits
    unit, scale = (record.unit, 1.0) if record.raw else ("deg/s", 1.0 / DEG)
    stages = (rms(found.error_line), rms(found.error_matrix), rms(found.error_map))
    settings = {name: _settings(found.rate[found.used[:, i]]) for i, name in enumerate(fits)}
    note = "given the pieces below, whose shape is not in the 1 sd" * any(item is not None for item in found.pieces)
    condition = Quantity("condition_matrix", float(np.linalg.cond(found.matrix / np.diag(found.matrix)[:, None])))
    dropped = tuple(of_table("calibration.dropped", item, sensor="xyz"[axis]) for axis, item in found.dropped)
    return Page(
        "Three gyros swept over rates about three axes",
        (
            f"Rate error, RMS over all dwells: {number(stages[0] / DEG)} deg/s by one line a gyro, "
            f"{number(stages[1] / DEG)} deg/s by the matrix, {_gain(found, stages)}.",
            *_dropped(found),
        ),
        (
            drawn("rate_errors", "Rate sweeps: error of each gyro", sweep_panels(found), columns=2),
            Section("parameters", "Output = B rate + b", calibration.parameters, note=note),
            _errors(found, stages),
            *_pieces(found),
            *_adjusted(found),
            quality_section((fits, unit, settings), factor=scale),
            corrected_section(calibration),
            impact_section(calibration),
            only_json("", condition, parts=(Section("dropped", rows=dropped),)),
        ),
        method=tuple(phrase("method.sweeps").splitlines()),
    )


def _dropped(found: SweepCalibration) -> Iterator[str]:
    """Describe which rates the fit of each gyro leaves out, separately for both senses of rotation, and why."""
    for i, axis in enumerate("xyz"):
        for sense in (-1.0, 1.0):
            rates = [item.rate for gyro, item in found.dropped if gyro == i and sense * item.rate > 0.0]
            if rates:
                first, last = min(rates, key=abs), max(rates, key=abs)
                reason = next(item.reason for gyro, item in found.dropped if gyro == i and item.rate == first)
                span = f"{first:+g}" + (f" to {last:+g}" if last != first else "")
                yield f"gyro {axis} leaves out {span} deg/s: {sentence(reason)}"


def _gain(found: SweepCalibration, stages: Sequence[float]) -> str:
    if all(item is None for item in found.pieces):
        return "which leaves nothing that a piecewise compensation could correct"
    _, before, after = stages
    improvement = f", {number(before / after, 2)} times smaller" if 0.0 < after < before else ""
    return f"{number(after / DEG)} deg/s with the piecewise compensation too{improvement}"


def _settings(rate: FloatArray) -> list[str]:
    texts = []
    for row in rate / DEG:
        turned = [f"{value:+.4g} deg/s about {axis}" for value, axis in zip(row, "xyz", strict=True) if value != 0.0]
        texts.append(", ".join(turned) or "rest")
    return texts


def _errors(found: SweepCalibration, stages: Sequence[float]) -> Section:
    worst = np.nanargmax(np.abs(found.error_map), axis=0)
    left_out = (None if item is None else rms(item.left_out) for item in found.pieces)
    errors = {"line": found.error_line, "matrix": found.error_matrix, "map": found.error_map}
    sizes = {name: map(rms, each.T) for name, each in errors.items()} | {"left_out": left_out}
    settings, largest = _settings(found.rate[worst]), np.abs(found.error_map[worst, range(3)])
    rows = of_columns("calibration.sweep_error", gyro="xyz", **sizes, worst=largest, worst_at=settings)
    of_all = (Quantity(name, value, "deg/s") for name, value in zip(errors, stages, strict=True))
    table = of_section("calibration.sweep_error", rows, keyed=True)
    return Section("", parts=(table, only_json("rate_error", *of_all)))


def _adjusted(found: SweepCalibration) -> tuple[Section, ...]:
    """Tabulate the manually adjusted intercepts of the piecewise compensation, and their effect."""
    rows = tuple(
        of_table("calibration.adjusted", each, piece=f"{'xyz'[each.gyro]}{each.piece + 1}") for each in found.adjusted
    )
    return (of_section("calibration.adjusted", rows, keyed=True),) if rows else ()


def _pieces(found: SweepCalibration) -> tuple[Section, ...]:
    """Tabulate the pieces of the compensation of each gyro; JSON also has the gyro errors at the ends of pieces."""
    compensated = {axis: item for axis, item in zip("xyz", found.pieces, strict=True) if item is not None}
    rows = tuple(
        (
            *of_table("calibration.piece", gyro=axis, piece=i + 1, **{"from": item.knot[i]}, to=item.knot[i + 1]),
            Quantity("k", float(slope), "ppm", sd=float(item.slope_sd[i])),
            Quantity("b", float(item.value[i] - slope * item.knot[i]), "deg/s", meaning="b'", decimals=4),
        )
        for axis, item in compensated.items()
        for i, slope in enumerate(item.slope)
    )
    knots = tuple(
        of_table("calibration.knots", item, gyro=axis, sd=np.sqrt(np.diag(item.covariance)))
        for axis, item in compensated.items()
    )
    return of_section("calibration.piece", rows), Section("pieces", rows=knots, show="json", keyed=True)


def sweep_panels(found: SweepCalibration) -> Iterator[Panel]:
    """Draw the error of each gyro over the rate: after the matrix alone, and after the piecewise compensation."""
    for axis, (rows, item) in enumerate(zip(found.own, found.pieces, strict=True)):
        colour, rate, name = AXIS_COLOURS[axis], found.rate[rows, axis] / DEG, "xyz"[axis]
        ends = np.array([rate.min(), rate.max()])
        for stage, stage_name, error in (
            ("matrix", "matrix", found.error_matrix),
            ("pieces", "piecewise compensation", found.error_map),
        ):
            curves = [Curve("", ends, np.zeros(2), GREY)]
            curves.append(Curve("dwells", rate, error[rows, axis] / DEG, colour, "points"))
            if item is not None and stage == "matrix":
                knots, values = item.knot / DEG, item.value / DEG
                curves.append(Curve("pieces", knots, values, BLACK))
                curves.append(Curve("borders", knots[1:-1], values[1:-1], BLACK, "crosses"))
            none = "; nothing to compensate" if item is None and stage == "pieces" else ""
            key, title = f"rate_error_{name}_{stage}", f"Gyro {name} after the {stage_name}"
            note = f"corrected rate minus rate of the table{none}"
            yield Panel(key, title, "error [deg/s]", "rate of the table [deg/s]", tuple(curves), "rate", note)


def rotor_page(calibration: Calibration[tuple[BenchTable, BenchTable], Inertias]) -> Page:
    """Lay out a rotor's moment of inertia from a falling weight and from precession, and their agreement."""
    fall, precession, both = calibration.detail.fall, calibration.detail.precession, calibration.detail.agreement
    how = calibration.options
    taken = {"fall_mass_kg": how.fall_mass, "radius_m": how.radius, "arm_m": how.arm, "gravity_m_s2": how.gravity}
    agreed = (
        f"The methods agree: the difference {number(both.difference, 2)} is within the {number(both.limit, 2)} kg m² "
        f"that their uncertainties explain (95 %); weighted mean {number(both.mean, 4)} ± {number(both.mean_sd, 2)} "
        "kg m²."
    )
    text = agreed if both.agree else sentence(next(of_code(calibration.warnings, Code.ROTOR_DISAGREE)))
    quality = quality_section(
        ({"falling weight": fall.fit}, "s^2", {"falling weight": [f"{h:.4g} m" for h in fall.x]}),
        ({"precession": precession.fit}, "rad/s", {"precession": [f"{t:.4g} s" for t in precession.x]}),
    )
    column = calibration.record[1].get("mass")
    masses = [how.mass] if column is None else sorted(set(column.tolist()))
    weight = " and ".join(f"{each:g}" for each in masses) + " kg"
    given = only_json("given", *of_table("calibration.rotor_given", how, mass=masses))
    names = ("difference", "limit", "mean", "mean_sd")
    sizes = [getattr(both, name) if both.agree or "mean" not in name else None for name in names]
    in_unit = (Quantity(name, size, "kg m^2") for name, size in zip(names, sizes, strict=True))
    agreement = only_json("", Quantity("agree", both.agree), *in_unit, parts=(given,))
    lines = (
        ("squared time of fall [s²]", "height [m]", fall),
        ("rotor rate [rad/s]", "precession period [s]", precession),
    )
    # in theory the precession rate is torque over angular momentum; several values of both permit a test of the powers
    powers = () if precession.powers is None else fitted(precession.powers, ("", "", ""))[1:]
    title, note = "Precession rate as a power of torque and spin", "by theory 1 and -1"
    caption = "Measured points, fitted lines, and residuals"
    return Page(
        "Moment of inertia of a gyroscope's rotor",
        (
            *(
                f"moment of inertia, {i.method}: {number(i.value, 4)} ± {number(i.sd, 2)} kg m²"
                for i in (fall, precession)
            ),
            text,
        ),
        (
            drawn("lines", "Moment of inertia of a rotor", _line_panels(lines), caption, columns=2),
            Section("parameters", "Moment of inertia", calibration.parameters),
            *((Section("powers", title, powers, note=note),) if powers else ()),
            quality,
            agreement,
        ),
        method=tuple(phrase("method.rotor", weight=weight, **taken).splitlines()),
    )


def _line_panels(lines: Sequence[tuple[str, str, Inertia]]) -> tuple[Panel, ...]:
    """Draw points with fitted lines through the origin, then residuals. `lines`: label of y, label of x, inertia."""
    upper, lower = [], []
    for i, ((name, label, each), colour) in enumerate(zip(lines, AXIS_COLOURS, strict=False)):
        x, y, slope = each.x, each.y, float(each.fit.value[0])
        ends = np.array([0.0, 1.05 * float(np.max(x))])
        title, unit = name[: name.index(" [")], name[name.index("[") :]
        line, points = Curve("fitted", ends, slope * ends, GREY), Curve("measured", x, y, colour, "points")
        upper.append(Panel(f"line_{i}", title.capitalize(), name, label, (line, points), f"line_{i}", height=260))
        residuals = (Curve("", ends, np.zeros(2), GREY), Curve("residual", x, y - slope * x, colour, "points"))
        lower.append(Panel(f"rest_{i}", f"Residual of {title}", f"residual {unit}", label, residuals, f"line_{i}"))
    return *upper, *lower
