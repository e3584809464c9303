"""What a result was made from: inputs, IMU error specification, options. The last sections of every page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from insnav.findings import Finding
from insnav.imu.specification import ImuSpec
from insnav.input.readers.reading import ReadingFacts
from insnav.messages import sentence
from insnav.quantity import Quantity, quantity_of
from insnav.report.page import Section, only_json
from insnav.report.run_json import json_ready
from insnav.result import Result

_TABLE = ("path", "n_used", "start", "end", "rate", "n_gaps", "longest_gap", "axes", "sampling", "stamp", "height")
_TIMES = ("start", "end")
_SENSORS = {"gyro": ("Gyros", "deg/h", "deg/sqrt(h)"), "accel": ("Accelerometers", "mg", "m/s/sqrt(h)")}


def provenance(result: Result[Any]) -> tuple[Section, ...]:
    """Give the sections that say from what and how a result was found."""
    given = {name: value for name, value in json_ready(dict(result.options)).items() if value is not None}
    options = tuple((Quantity("option", name), Quantity("value", str(value))) for name, value in given.items())
    return (
        *(_inputs(result.inputs) if result.inputs else ()),
        *((imu_model(*result.imu_model),) if result.imu_model is not None else ()),
        only_json("", Quantity("configuration", dict(result.options))),
        Section("", "Options", rows=options, show="page", folded=True),
    )


def _inputs(inputs: Mapping[str, ReadingFacts]) -> tuple[Section, ...]:
    read = {name: [quantity_of(key, value) for key, value in each.as_dict().items()] for name, each in inputs.items()}
    rows = tuple(
        (
            Quantity("input", name),
            *(
                Quantity(each.key.removeprefix("n_"), each.value, each.unit, decimals=1 if each.key in _TIMES else None)
                for each in items
                if each.key in _TABLE
            ),
        )
        for name, items in read.items()
    )
    columns = {
        name: "; ".join(f"{key} = {text}" for key, text in each.columns.items()) for name, each in inputs.items()
    }
    how = tuple(
        (Quantity("input", name), Quantity("text", text, meaning="how it was understood"))
        for name, each in inputs.items()
        for text in (*map(sentence, each.evidence), f"columns: {columns[name]}")
    )
    return (
        Section("input", parts=tuple(only_json(name, *items) for name, items in read.items())),
        Section("", "Inputs", rows=rows, show="page", folded=True),
        Section("", "How the inputs were understood", rows=how, show="page", folded=True),
    )


def imu_model(spec: ImuSpec, how: Finding) -> Section:
    """Give an IMU error specification, one standard deviation each, x, y, z."""
    sensors = {}
    for name, (_, unit, walk_unit) in _SENSORS.items():
        sensor = getattr(spec, name)
        sensors[name] = (
            Quantity("bias", sensor.bias, unit),
            Quantity("bias_instability", sensor.bias_instability, unit),
            Quantity("correlation_time", sensor.correlation_time, "h"),
            Quantity("random_walk", sensor.random_walk, walk_unit),
            Quantity("scale_factor", sensor.scale_factor, "ppm"),
            Quantity("misalignment", sensor.misalignment, "deg"),
        )
    items = (Quantity("name", spec.name), Quantity("chosen", sentence(how)), Quantity("source", spec.source))
    return Section(
        "imu_model",
        "IMU error specification: one standard deviation, x, y, z",
        items,
        parts=tuple(Section(name, _SENSORS[name][0], own) for name, own in sensors.items()),
        show="page",
        folded=True,
    )
