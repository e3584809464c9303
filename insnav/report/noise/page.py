"""The noise of a static record as a page with its Allan deviations, and as a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from insnav.lab.noise.allan import AXES, AllanDeviation
from insnav.lab.noise.noise_model import NoiseModel
from insnav.lab.noise.static_noise import StaticNoise
from insnav.output.data_files import csv_text
from insnav.quantity import Quantity, key_suffix
from insnav.report.colours import AXIS_COLOURS, GREY
from insnav.report.page import Page, Section, by_warnings, cell, drawn, only_json
from insnav.report.panels import Curve, Panel
from insnav.types import FloatArray
from insnav.units import DEG_PER_H, M_S_PER_SQRT_H, UG, UNITS

_TIMES = (0.01, 0.1, 1.0, 10.0, 100.0, 1000.0, 10000.0)  # of the table of deviations [s]
_NEAR = 1.3  # a table entry stands for times this near

# term -> key, label, unit shown and unit in SI of gyros, of accelerometers
_TERMS = {
    "Q": ("quantisation", "quantisation Q", ("arcsec", "rad"), ("mm/s", "m/s")),
    "N": ("random_walk", "random walk N", ("deg/sqrt(h)", "rad/sqrt(s)"), ("m/s/sqrt(h)", "m/s/sqrt(s)")),
    "B": ("bias_instability", "bias instability B", ("deg/h", "rad/s"), ("ug", "m/s^2")),
    "K": (
        "rate_random_walk",
        "rate random walk K",
        ("deg/h/sqrt(h)", "rad/s/sqrt(s)"),
        ("ug/sqrt(h)", "m/s^2/sqrt(s)"),
    ),
    "GM": ("gauss_markov", "Gauss-Markov bias, sd", ("deg/h", "rad/s"), ("ug", "m/s^2")),
    "R": ("rate_ramp", "rate ramp R", ("deg/h/h", "rad/s^2"), ("ug/h", "m/s^3")),
}
_IN_FILE = {
    "N": "random_walk",
    "GM": "bias_instability",
    "K": "rate_random_walk",
    "Q": "quantisation",
    "R": "rate_ramp",
}
ASSUMPTIONS = (
    "overlapping Allan deviation, NIST SP 1065 (2008) section 5.2.4; noise terms of IEEE Std 952-1997 annex C",
    "intervals 95 %: chi-square with the degrees of freedom that the fitted noise gives a record of this length "
    "(Greenhall and Riley 2003)",
    "fit by generalised least squares with the correlation between averaging times that the noise itself makes, up to "
    "a sixth of the record; no term is negative, and one that lowers chi-square by less than 6.63 (1 %) is left out",
    "sinusoidal noise: steady lines that stand out of the spectrum and make 5 % of an Allan variance; floor, fit and "
    "imu.toml are of what they leave (IEEE Std 952-1997 annex C)",
    "bias instability is B (a flat floor, 0.664 B) or a Gauss-Markov process, whichever is likelier",
)
NOTE = "points: overlapping Allan deviation; band: 95 %; lines: fitted model; grey: slopes of Q, N, B, K, R"
_GUIDES = ((-1.0, "Q −1"), (-0.5, "N −½"), (0.0, "B 0"), (0.5, "K +½"), (1.0, "R +1"))
_TALL = 2.4  # the lines reach up and down by this factor at most
_SENSORS = (("gyros", "deg/h", DEG_PER_H), ("accelerometers", "ug", UG))


def noise_quantity(
    term: str,
    value: float | None,
    sd: float | None = None,
    interval: tuple[float, float] | None = None,
    *,
    gyro: bool = True,
    si: bool = False,
) -> Quantity:
    """One noise coefficient of a gyro or an accelerometer.

    `term` {"Q", "N", "B", "K", "GM", "R"}; `si`: shown in SI, not in the unit usual for it.
    """
    key, label, *units = _TERMS[term]
    return Quantity(key, value, units[0 if gyro else 1][1 if si else 0], sd, interval, label)


def noise_page(found: StaticNoise, name: str) -> Page:
    """Report the noise of a static record."""
    record, tau, findings = found.record, found.allan.tau, (*found.warnings, *found.notes)
    axes = [_axis(found, column) for column in range(6)]
    named = (_sizes(found, term, gyro=gyro) for gyro in (True, False) for term in ("N", "B", "K"))
    return Page(
        f"Noise of {name}",
        (
            f"{record.length:.6g} s at {1.0 / record.interval:.6g} Hz, {len(tau)} averaging times from {tau[0]:.3g} to "
            f"{tau[-1]:.4g} s",
        ),
        (
            drawn("allan", f"Allan deviation of {name}", allan_panels(found.allan, found.models), NOTE),
            only_json("", Quantity("length", record.length, "s"), Quantity("interval", record.interval, "s")),
            Section("axes", parts=tuple(part for parts in axes for part in parts)),
            Section("deviations", "Allan deviation", rows=_deviations(found)),
            _filter_figures(found),
        ),
        findings,
        ASSUMPTIONS,
        verdict=by_warnings(_sentence(found), findings, ("good", "noise models follow the Allan deviation")),
        merits=tuple(each for each in named if each is not None),
        merits_note="medians of the three axes; N, B, K: IEEE Std 952",
    )


def _sizes(found: StaticNoise, term: str, *, gyro: bool) -> Quantity | None:
    """One coefficient of the three axes of a sensor; None where no axis shows it."""
    models = found.models[:3] if gyro else found.models[3:]
    values = [model.coefficients[term].value for model in models if model is not None and term in model.coefficients]
    if not values:
        return None
    quantity = noise_quantity(term, float(np.median(values)), gyro=gyro)
    sensor = "gyro" if gyro else "accel"
    return replace(quantity, key=f"{sensor}_{quantity.key}", meaning=f"{sensor}, {quantity.label}")


def _sentence(found: StaticNoise) -> str:
    """Random walk and bias instability of gyros and accelerometers in one sentence."""
    texts = []
    for sensor, gyro in (("gyros", True), ("accelerometers", False)):
        known = [each for each in (_sizes(found, term, gyro=gyro) for term in ("N", "B")) if each is not None]
        words = " and ".join(f"{each.label.split(', ')[1]} {cell(each)} {each.shown_unit}" for each in known)
        texts += [f"{sensor}: {words}"] if known else []
    return f"{'; '.join(texts).capitalize()}." if texts else "No axis shows noise that can be told."


def _axis(found: StaticNoise, column: int) -> tuple[Section, ...]:
    """Coefficients of one axis in their usual units, and in SI."""
    model, floor, gyro = found.models[column], found.floors[column], column < 3
    size = "deg/h" if gyro else "ug"
    key = AXES[column].replace(" ", "_")
    if model is None or floor is None:
        return (only_json("", Quantity(key, None)),)
    items = [
        noise_quantity(term, each.value, each.sd, (each.low, each.high), gyro=gyro)
        for term, each in model.coefficients.items()
    ]
    if np.isfinite(model.correlation_time):
        items.append(Quantity("correlation_time", model.correlation_time, "s", model.correlation_time_sd))
    for i, line in enumerate(model.sinusoids, start=1):
        items += [
            Quantity(f"sinusoid_{i}", line.amplitude, size, line.amplitude_sd, meaning=f"sinusoid {i}, amplitude"),
            Quantity(f"sinusoid_{i}_frequency", line.frequency, "Hz", line.frequency_sd, meaning=f"sinusoid {i} at"),
        ]
    items += [
        Quantity("floor", floor.value, size, meaning="lowest deviation"),
        Quantity("floor_tau", floor.tau, "s", meaning="at averaging time"),
        Quantity("misfit", model.misfit, meaning="relative misfit of the model"),
    ]
    si = (noise_quantity(term, each.value, gyro=gyro, si=True) for term, each in model.coefficients.items())
    return Section(key, f"Noise coefficients of {AXES[column]}", tuple(items)), only_json(key, *si)


def _deviations(found: StaticNoise) -> tuple[tuple[Quantity, ...], ...]:
    tau, rows = found.allan.tau, []
    for wanted in _TIMES:
        row = int(np.argmin(np.abs(np.log(tau / wanted))))
        if 1.0 / _NEAR < tau[row] / wanted < _NEAR:
            freedom = min((float(m.freedom[row]) for m in found.models if m is not None), default=None)
            axes = (
                Quantity(axis.replace(" ", "_"), float(found.allan.deviation[row, i]), "deg/h" if i < 3 else "ug")
                for i, axis in enumerate(AXES)
            )
            least = Quantity("degrees_of_freedom", freedom, digits=2)
            rows.append((Quantity("tau", float(tau[row]), "s"), *axes, least))
    return tuple(rows)


def _filter_figures(found: StaticNoise) -> Section:
    rows = []
    for column, axis in enumerate(AXES):
        sensor, k = (found.spec.gyro, column) if column < 3 else (found.spec.accel, column - 3)
        n, gm, *others = (
            noise_quantity(term, float(getattr(sensor, key)[k]) or None, gyro=column < 3)
            for term, key in _IN_FILE.items()
        )
        time = sensor.correlation_time if np.isfinite(sensor.correlation_time) else None
        rows.append((Quantity("axis", axis), n, gm, Quantity("correlation_time", time, "s"), *others))
    return Section(
        "imu_model",
        "IMU model for filters and simulations (imu.toml)",
        rows=tuple(rows),
        note=f"1 m/s/√h is {M_S_PER_SQRT_H / UG:.0f} ug/√Hz, 1 deg/√h is 60 deg/h/√Hz. Quantisation and rate ramp: "
        "in simulations only. Use it with insnav run --imu imu.toml.",
    )


def deviations_csv(found: StaticNoise) -> str:
    """Write the deviations with their intervals as text of a table, one row for each averaging time."""
    columns = {"tau_s": found.allan.tau}
    for i, (axis, model) in enumerate(zip(AXES, found.models, strict=True)):
        name, unit = axis.replace(" ", "_"), "deg/h" if i < 3 else "ug"
        end, factor = key_suffix(unit), UNITS[unit][1]
        columns[f"{name}{end}"] = found.allan.deviation[:, i] / factor
        if model is not None:
            columns |= {
                f"{name}_low{end}": model.low / factor,
                f"{name}_high{end}": model.high / factor,
                f"{name}_model{end}": np.sqrt(model.variance) / factor,
                f"{name}_freedom": model.freedom,
            }
    return csv_text(columns, digits=9)


def allan_panels(allan: AllanDeviation, models: Sequence[NoiseModel | None]) -> Iterator[Panel]:
    """Draw the deviations of six axes with 95 % intervals, their models, and guides of every slope.

    `models`: one for each; None is not drawn.
    """
    tau, note = allan.tau, NOTE
    for first, (name, unit, size) in zip((0, 3), _SENSORS, strict=True):
        curves, seen = [], []
        for axis, colour in enumerate(AXIS_COLOURS):
            model, deviation = models[first + axis], allan.deviation[:, first + axis] / size
            if model is not None:
                seen.append(deviation[deviation > 0.0])
                curves += [
                    Curve("xyz"[axis], tau, model.high / size, colour, "band", model.low / size),
                    Curve("xyz"[axis], tau, deviation, colour, "points"),
                    Curve("xyz"[axis], tau, np.sqrt(model.variance) / size, colour),
                ]
        if not seen:
            continue
        low, high = (float(limit(np.concatenate(seen))) for limit in (np.min, np.max))
        yield Panel(
            f"allan_{name}",
            f"Allan deviation of the {name}",
            f"Allan deviation [{unit}]",
            "averaging time [s]",
            (*curves, *_guides(tau, high)),
            "tau",
            note,
            log_x=True,
            log_y=True,
            limits=(0.4 * low, 5.0 * high),
            height=400,
        )
        note = ""


def _guides(tau: FloatArray, high: float) -> list[Curve]:
    """Short lines of every slope through one point, in the corner that the curves leave free."""
    half = (float(tau[-1]) / float(tau[0])) ** 0.1
    x, y, curves = float(tau[-1]) / half, 1.8 * high, []
    for slope, text in _GUIDES:
        reach = half if slope == 0.0 else min(half, _TALL ** (1.0 / abs(slope)))
        ends = np.array([1.0 / reach, reach])
        curves.append(Curve("", x * ends, y * ends**slope, GREY, "thin", text=(text, text)))
    return curves
