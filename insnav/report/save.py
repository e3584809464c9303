"""Saving and reading of results in folders: tables, figures, HTML page, ``run.json``.

Each kind of result has a module ``insnav.report.<kind>.page``, found by its name. Its function ``page(result)`` returns
a `Page`, and ``frame(result)`` the main table. Optional functions: ``texts(result)`` for text files by name,
``write_files(result, folder, table_format)`` for other files, ``text(result, width)`` for the terminal. A module with
``read_found(folder, findings)`` reads a result from its tables; other results are stored as one object.

``run.json`` contains the quantities of a report, with units in the keys, and software versions. Unknown values are
null. The content depends on the input alone, not on clock or machine.
"""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from enum import Enum
from importlib import import_module, metadata
from itertools import islice
from pathlib import Path
from types import ModuleType
from typing import Any, Literal, cast

import numpy as np

from insnav.exceptions import ConfigError, InputError, writing
from insnav.explain.explanation import Explanation, Tried
from insnav.findings import MODEL_CHOICES, Code, Finding, Severity, is_shown, of_code
from insnav.imu.imu_file import load_imu
from insnav.imu.specification import ImuSpec
from insnav.input.readers.reading import ReadingFacts
from insnav.messages import phrase, render, sentence, speaking
from insnav.output.data_files import FILE as STORED_FILE
from insnav.output.data_files import read_stored, store
from insnav.output.folder import FACTS_FILE, RunFolder, read_facts
from insnav.output.solution_tables import TableFormat, read_events
from insnav.plain_text import NOT_UTF8
from insnav.quantity import Quantity, quantity_of
from insnav.report.page import DataFrame, Figure, FigureSpec, Page, Section, cell, only_json
from insnav.report.tables import of_table
from insnav.report.terminal import page_text
from insnav.result import Result
from insnav.version import __version__

MOST = 8  # largest number of rows in the table of considered faults
# version of ``run.schema.json``: removed or changed keys raise the major version, new keys the minor version
SCHEMA = "2.0"
_VERSIONS_OF = ("numpy", "scipy", "numba", "filterpy", "pyarrow", "matplotlib")
EXPLANATION_FILE = "explanation.npz"
FigureFiles = Literal["page", "png", "svg", "none"]
_TABLE = ("path", "n_used", "start", "end", "rate", "n_gaps", "longest_gap", "axes", "sampling", "stamp", "height")
_TIMES = ("start", "end")


def explanation_section(found: Explanation) -> Section:
    """Lay out the faults that the search considered, best first; the section is folded if it accepted none."""
    items = of_table("explanation.search", found, considered=len(found.tried))
    data = Section("rows", rows=tuple(of_table("explanation.row", row) for row in found.tried[:MOST]), show="json")
    rows = tuple(map(_shown, found.tried, data.rows))
    table = Section("", "Considered faults", rows=rows, note=phrase("explanation.note"), show="page")
    folded = not any(row.accepted for row in found.tried)
    return Section("explanation", "Explanation", items, parts=(data, table), show="page", folded=folded)


def explanation_line(found: Explanation) -> str:
    """Summarise the search for faults in one line: numbers of considered and accepted faults."""
    values = {"count": len(found.tried), "accepted": sum(row.accepted for row in found.tried), "passes": found.passes}
    return phrase("explanation.some" if values["accepted"] else "explanation.none", **values)


def _shown(row: Tried, items: tuple[Quantity, ...]) -> tuple[Quantity, ...]:
    """Build the row of a fault in the table on the page: its name, and its effect on the run in words."""
    fault, *size, left_out, moved = items
    effects = [phrase(f"explanation.{each.key}", count=each.value) for each in (left_out, moved) if each.value]
    key = row.name if row.name in ("rough", "delay") else "corrected"
    changed = effects or [phrase(f"explanation.{key}")] * row.accepted
    return replace(fault, value=phrase(f"fault.{row.name}")), *size, Quantity("changed", changed)


def page_facts(page: Page) -> dict[str, Any]:
    """Convert a report to one nested dict for JSON: sections, verdict if there is one, summary, method, findings."""
    facts = section_facts(page.sections)
    if page.verdict is not None:
        facts["verdict"] = {name: getattr(page.verdict, name) for name in ("light", "reason", "sentence")}
    texts = {name: list(getattr(page, name)) for name in ("summary", "method")}
    return facts | texts | {"findings": [each.as_dict() for each in page.findings]}


def section_facts(sections: Sequence[Section]) -> dict[str, Any]:
    """Convert sections to one nested dict for JSON, by `Section.key`; the keys of quantities include their units."""
    facts: dict[str, Any] = {}
    for section in sections:
        _put(facts, section)
    ready: dict[str, Any] = json_ready(facts)
    return ready


def _put(facts: dict[str, Any], section: Section) -> None:
    # without a key, the quantities go directly into the dict of the parent section
    content: dict[str, Any] = {} if section.key else facts
    for each in section.items:
        content |= each.facts()
    for part in section.parts:
        _put(content, part)
    rows = [{key: value for each in row for key, value in each.facts().items()} for row in section.rows]
    if section.keyed:
        for row, row_facts in zip(section.rows, rows, strict=True):
            content[str(row[0].value)] = dict(islice(row_facts.items(), 1, None))
        rows = []
    if not section.key:
        return
    if section.key.endswith("[]"):
        facts.setdefault(section.key.removesuffix("[]"), []).append(content)
        return
    # several sections may have the same key: their quantities are merged
    old = facts.get(section.key, {})
    if section.rows and not section.keyed and not content:
        facts[section.key] = rows
    elif content or rows:
        facts[section.key] = {**(old if isinstance(old, dict) else {}), **content, **({"rows": rows} if rows else {})}
    elif not (old or section.parts or section.figures):
        facts[section.key] = {} if section.keyed else []  # a table without rows


def json_ready(value: Any) -> Any:
    """Convert arrays, enumerations, paths and containers to JSON types; NaN and infinity become None."""
    if isinstance(value, Mapping):
        return {str(key): json_ready(item) for key, item in value.items()}
    if isinstance(value, Enum):
        return json_ready(value.value)
    if isinstance(value, str | bool) or value is None:
        return value
    if isinstance(value, np.ndarray | np.generic):
        return json_ready(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, int):
        return value
    if isinstance(value, Sequence | set | frozenset) and not isinstance(value, bytes):
        items = sorted(value) if isinstance(value, set | frozenset) else value
        return [json_ready(item) for item in items]
    return value.as_posix() if isinstance(value, Path) else str(value)


def versions() -> dict[str, str | None]:
    """Return the versions of insnav, Python and the packages that affect results, by name; None if not installed."""
    result: dict[str, Any] = {"insnav": __version__, "python": platform.python_version(), **dict.fromkeys(_VERSIONS_OF)}
    for name in _VERSIONS_OF:
        # `metadata.version` would parse the whole METADATA file, which takes 7 ms per package
        with suppress(metadata.PackageNotFoundError):
            text = metadata.distribution(name).read_text("METADATA") or ""
            result[name] = text.partition("\nVersion: ")[2].partition("\n")[0] or None
    return result


def page_of(result: Result[Any]) -> Page:
    """Lay out a result of any kind, with provenance and findings added to the page of its report module."""
    page = cast(Page, _room(result.kind).page(result))
    return replace(
        page,
        sections=(*page.sections, *provenance(result)),
        findings=tuple(dict.fromkeys((*page.findings, *filter(is_shown, result.findings)))),
    )


def frame(result: Result[Any], solution: str) -> DataFrame:
    """Return the main table of a result; of a run the table of `solution`: "best", "smoothed" or "filtered"."""
    solutions = {"best": None, **(result.found.solutions if result.kind == "run" else {})}
    if solution not in solutions:
        raise ConfigError("input.unknown_word", where="solution", value=str(solution), known=tuple(solutions))
    chosen = solutions[solution]
    return cast(DataFrame, _room(result.kind).frame(result) if chosen is None else chosen.to_frame())


def key_lines(result: Result[Any]) -> list[str]:
    """Return up to two lines: the verdict of a result, and its figures of merit."""
    page = result.page()
    merits = ", ".join(f"{each.label} {cell(each)} {each.shown_unit}".rstrip() for each in page.merits)
    return [line for line in ("" if page.verdict is None else page.verdict.rating, merits) if line]


def text_of(result: Result[Any], width: int | None = None) -> str:
    """Write a result as text, wrapped at `width` if given, by the ``text`` function of its module or from its page."""
    room = _room(result.kind)
    return str(room.text(result, width)) if hasattr(room, "text") else page_text(page_of(result), width)


def _room(kind: str) -> ModuleType:
    """Import the report module of a kind of result."""
    return import_module(f"insnav.report.{kind}.page")


def figure(result: Result[Any], name: str) -> Figure:
    """Draw one figure of a result by its name; see `insnav.result.Result.plot`."""
    figures = {each.name: each.draw for each in page_of(result).figures}
    name = name or next(iter(figures), "")
    if name not in figures:
        raise ConfigError("report.no_figure", name=name, known=tuple(figures))
    from insnav.report.figures import drawing

    with drawing():
        return figures[name]()


def save_result(
    result: Result[Any], folder: RunFolder, *, figures: FigureFiles = "page", table_format: TableFormat = "csv"
) -> Path:
    """Write all files of a result into an open folder, and commit it. `figures`: see `write_page`."""
    room = _room(result.kind)
    if hasattr(room, "read_found"):
        if result.explanation is not None:
            store(result.explanation, folder.path(EXPLANATION_FILE))
    else:
        store(replace(result, options=json_ready(result.options), steps=()), folder.path(STORED_FILE))
    with speaking("en"):
        if hasattr(room, "write_files"):
            room.write_files(result, folder, table_format)
        texts = room.texts(result) if hasattr(room, "texts") else None
    return write_page(folder, result.page(), {"kind": result.kind}, texts, figures, facts_of(result))


def facts_of(result: Result[Any]) -> dict[str, Any]:
    """Return the content of ``run.json`` for a result, always in English."""
    with speaking("en"):
        return page_facts(result.page())


def write_result_pdf(result: Result[Any], file: Path) -> None:
    """Write a result as PDF: the figures of ``PDF_PAGES`` of its module if defined, otherwise all, two per page.

    Raises: OutputError: the file cannot be written.
    """
    from insnav.report.figures import drawing
    from insnav.report.pdf import write_pdf

    # `drawing` sets English also for the verdict, since the font of figures has no other characters
    with writing("output.file_unwritable", file), drawing():
        page = page_of(result)
        names = [figure.name for figure in page.figures]
        pairs = {f"figures {i // 2 + 1}": names[i : i + 2] for i in range(0, len(names), 2)} or {"summary": []}
        write_pdf(page, file, getattr(_room(result.kind), "PDF_PAGES", pairs))


def open_folder(folder: Path) -> Result[Any]:
    """Read a saved result; see `insnav.result.open_result`."""
    facts = read_facts(folder)
    kind = str(facts.get("kind", "run"))
    expected_types: dict[str, Any] = {
        "input": (dict, list),
        "configuration": dict,
        "findings": list,
        "fixes": dict,
        "imu_model": (dict, list),
    }
    for name, expected in expected_types.items():
        if name in facts and not isinstance(facts[name], expected):
            raise InputError("report.damaged", where=str(folder / FACTS_FILE), reason=name)
    if not hasattr(_room(kind), "read_found"):
        return cast("Result[Any]", read_stored(folder))
    try:
        inputs = {name: ReadingFacts.from_dict(each) for name, each in facts.get("input", {}).items()}
        stored = tuple(map(Finding.from_dict, facts.get("findings", ()))) or _of_version_0_2(kind, facts)
        for finding in stored:  # `render` raises an error if the file lacks a value of the finding's sentence
            render(finding)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError("report.damaged", where=str(folder / FACTS_FILE), reason=str(error)) from error
    events = read_events(folder) if any(folder.glob("events.*")) else ()
    findings = tuple(dict.fromkeys((*stored, *events)))
    outcome = _room(kind).read_found(folder, findings)
    file, model = folder / "imu.toml", facts.get("imu_model")
    # the last finding describes the IMU model in use: an earlier one may describe only the prior of its estimate
    *_, chosen = (None, *of_code(stored, *MODEL_CHOICES))
    if isinstance(model, dict) and model and chosen is None:
        chosen = Finding.of(Code.STORED_TEXT, text=str(model.get("chosen", "")))
    imu_model = (load_imu(str(file)), chosen) if chosen is not None and file.is_file() else None
    explanation = read_stored(folder, EXPLANATION_FILE) if (folder / EXPLANATION_FILE).is_file() else None
    return Result(kind, outcome, inputs, facts.get("configuration", {}), imu_model, findings, explanation=explanation)


def _of_version_0_2(kind: str, facts: Mapping[str, Any]) -> tuple[Finding, ...]:
    """Convert the texts in ``run.json`` of version 0.2 to findings, except texts that the page computes again."""
    derived = {"budget": ("warnings", "assumptions"), "outage": ("assumptions",)}.get(kind, ())
    severities = {"warnings": Severity.WARNING, "assumptions": Severity.ASSUMPTION, "notes": Severity.NOTE}
    return tuple(
        Finding.of(Code.STORED_TEXT, severity=severity, text=str(text))
        for name, severity in severities.items()
        if name not in derived
        for text in facts.get(name, ())
    )


def write_page(
    folder: RunFolder,
    page: Page,
    metadata: Mapping[str, Any] | None = None,
    texts: Mapping[str, str] | None = None,
    figures: FigureFiles = "png",
    facts: Mapping[str, Any] | None = None,
) -> Path:
    """Write figures, HTML page, ``run.json`` and text files of a report into a folder and commit it.

    `folder`: open, inside its ``with`` block. `metadata`: first part of ``run.json``: command, input, options. `texts`:
    contents of further files by name, such as ``calibration.toml``. `figures`: "page" writes the figures that the page
    shows, "png" or "svg" all figures, "none" no figures and no page. `facts`: rest of ``run.json``; None: from `page`.
    Raises: ConfigError: two figures of one name. OutputError: the folder cannot be written.
    """
    names = [figure.name for figure in page.figures]
    if len(set(names)) < len(names):
        raise ConfigError("report.same_name", where=", ".join(names))
    for name, text in (texts or {}).items():
        folder.path(name).write_text(text, encoding="utf-8", newline="\n", errors=NOT_UTF8)
    if figures != "none":
        from insnav.report.html import page_html

        files = _drawn(folder, page.embedded if figures == "page" else page.figures, figures)
        html = page_html(page, {each.name: files[each.name] for each in page.embedded})
        folder.path("report.html").write_text(html, encoding="utf-8", newline="\n")
    head = {"schema": SCHEMA, "versions": versions(), **json_ready(metadata or {})}
    return folder.commit({**head, **(page_facts(page) if facts is None else facts)})


def _drawn(folder: RunFolder, figures: Sequence[FigureSpec], file_format: FigureFiles) -> dict[str, Path]:
    """Draw figures into files and return these by figure name; without figures, matplotlib is not imported."""
    if not figures:
        return {}
    from insnav.report.figures import drawing, save

    suffix: Literal["png", "svg"] = "svg" if file_format == "svg" else "png"
    with drawing():
        return {each.name: save(each.draw(), folder.path(f"figures/{each.name}"), suffix) for each in figures}


def provenance(result: Result[Any]) -> tuple[Section, ...]:
    """Build the sections on the origin of a result: explanation, input files, IMU model, options."""
    options_set = {name: value for name, value in json_ready(dict(result.options)).items() if value is not None}
    options = tuple((Quantity("option", name), Quantity("value", str(value))) for name, value in options_set.items())
    return (
        *((explanation_section(result.explanation),) if result.explanation is not None else ()),
        *(_inputs(result.inputs) if result.inputs else ()),
        *((imu_model(*result.imu_model),) if result.imu_model is not None else ()),
        only_json("", Quantity("configuration", dict(result.options))),
        Section("", "Options", rows=options, show="page", folded=True),
    )


def _inputs(inputs: Mapping[str, ReadingFacts]) -> tuple[Section, ...]:
    read = {name: [quantity_of(key, value) for key, value in each.as_dict().items()] for name, each in inputs.items()}
    rows = []
    for name, items in read.items():
        shown = [replace(each, key=each.key.removeprefix("n_")) for each in items if each.key in _TABLE]
        cells = (replace(each, decimals=1) if each.key in _TIMES else each for each in shown)
        rows.append((Quantity("input", name), *cells))
    notes = []
    for name, each in inputs.items():
        columns = "; ".join(f"{key} = {text}" for key, text in each.columns.items())
        texts = (*map(sentence, each.evidence), f"columns: {columns}")
        notes += [(Quantity("input", name), Quantity("text", text, meaning="how it was understood")) for text in texts]
    return (
        Section("input", parts=tuple(only_json(name, *items) for name, items in read.items())),
        Section("", "Inputs", rows=tuple(rows), show="page", folded=True),
        Section("", "How the inputs were understood", rows=tuple(notes), show="page", folded=True),
    )


def imu_model(spec: ImuSpec, how: Finding) -> Section:
    """Lay out an IMU error specification, one standard deviation per axis. `how`: finding on its choice."""
    sensors = ("gyro", "Gyros", spec.gyro), ("accel", "Accelerometers", spec.accel)
    parts = tuple(Section(name, title, of_table(f"imu_model.{name}", sensor)) for name, title, sensor in sensors)
    items = (Quantity("name", spec.name), Quantity("chosen", sentence(how)), Quantity("source", spec.source))
    title = "IMU error specification: one standard deviation, x, y, z"
    return Section("imu_model", title, items, parts=parts, show="page", folded=True)
