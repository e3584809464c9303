"""Content of ``run.json``: the quantities of a report, with units in the keys, and software versions.

Unknown values are None. The content depends on the input alone, not on clock or machine.
"""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping, Sequence
from enum import Enum
from importlib import metadata
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from insnav.report.page import Page, Section
from insnav.version import __version__

# of ``run.schema.json``: major version for removed or changed keys, minor version for new keys
SCHEMA = "2.0"
_VERSIONS_OF = ("numpy", "scipy", "numba", "filterpy", "pyarrow", "matplotlib")


def page_facts(page: Page) -> dict[str, Any]:
    """Convert a report to one nested dict for JSON.

    Returns: quantities under the key of each section, units in the keys, with table rows as a list. Last: ``verdict``
    if present, ``summary``, ``method`` and ``findings``.
    """
    facts = section_facts(page.sections)
    if page.verdict is not None:
        facts["verdict"] = {name: getattr(page.verdict, name) for name in ("light", "reason", "sentence")}
    texts = {name: list(getattr(page, name)) for name in ("summary", "method")}
    return facts | texts | {"findings": [each.as_dict() for each in page.findings]}


def section_facts(sections: Sequence[Section]) -> dict[str, Any]:
    """Convert sections to one nested dict for JSON."""
    facts: dict[str, Any] = {}
    for section in sections:
        _put(facts, section)
    ready: dict[str, Any] = json_ready(facts)
    return ready


def _put(facts: dict[str, Any], section: Section) -> None:
    content: dict[str, Any] = {} if section.key else facts
    for each in section.items:
        content |= each.facts()
    for part in section.parts:
        _put(content, part)
    rows = [{key: value for each in row for key, value in each.facts().items()} for row in section.rows]
    if section.keyed:
        for row, found in zip(section.rows, rows, strict=True):
            content[str(row[0].value)] = dict(islice(found.items(), 1, None))
        rows = []
    if not section.key:
        return
    if section.key.endswith("[]"):
        facts.setdefault(section.key.removesuffix("[]"), []).append(content)
        return
    old = facts.get(section.key, {})
    if section.rows and not section.keyed and not content:
        facts[section.key] = rows
    elif content or rows:
        facts[section.key] = {**(old if isinstance(old, dict) else {}), **content, **({"rows": rows} if rows else {})}
    elif not (old or section.parts or section.figures):
        facts[section.key] = {} if section.keyed else []  # a table without rows


def json_ready(value: Any) -> Any:
    """Convert arrays, paths and similar to JSON types; a number that is not finite becomes None."""
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
    """Return the versions of insnav, Python and the packages that affect results."""
    found: dict[str, str | None] = {"insnav": __version__, "python": platform.python_version()}
    for name in _VERSIONS_OF:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = None
    return found
