"""HTML writer of all report pages: escaping templates, interactive panels and embedded figures."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from insnav.findings import catalogue
from insnav.messages import language, phrase, speaking, translated
from insnav.report.page import Page, Section, Show, Table, cell, section_tables
from insnav.report.panels import modes, panel_data
from insnav.version import __version__

_MEDIA = {".png": "image/png", ".svg": "image/svg+xml"}
_TEMPLATES = Path(__file__).parent / "templates"
_BOKEH = ("bokeh.min.js", "bokeh-api.min.js")


def filled(template: str, **values: Any) -> str:
    """Fill a template file of the folder ``templates`` with values; a missing value is an error.

    A template with ``.html.`` in its name escapes every value.
    """
    how: dict[str, Any] = {"autoescape": ".html." in template, "trim_blocks": True, "lstrip_blocks": True}
    environment = Environment(loader=FileSystemLoader(_TEMPLATES), undefined=StrictUndefined, **how)
    environment.filters["plain"] = translated
    return environment.get_template(template).render(**values, value=cell, phrase=phrase, modes=modes)


def page_html(page: Page, files: Mapping[str, Path]) -> str:
    """Write a report as one self-contained HTML page. `files`: images by figure name; other figures are omitted."""
    scripts, drawings = _scripts() if page.panels else (), [panel_data(each) for each in page.panels]
    with speaking(language(), page.names):
        words = catalogue(f"page.{language()}")["words"] | dict(_translations(drawings))
        return filled(
            "page.html.j2",
            page=page,
            images={name: _inlined(file.suffix, file.read_bytes()) for name, file in files.items()},
            words=_json_script({text: wanted for text, wanted in words.items() if text not in page.names}),
            lang=language(),
            tables=_tables_of("all", "page"),
            version=__version__,
            data=_json_script(drawings),
            scripts=[Markup(text) for text in scripts],
            policy=_policy(scripts),
        )


def page_fragment(page: Page) -> str:
    """Write a report as HTML to embed in another page, such as a notebook: figures of merit, two figures, tables.

    The figure ``track`` (map), if there is one, comes first.
    """
    from insnav.report.figures import drawing

    images = {}
    for figure in sorted(page.figures, key=lambda each: each.name != "track")[:2]:
        picture = BytesIO()
        with drawing():
            figure.draw().savefig(picture, format="png", dpi=80)
        images[figure.name] = _inlined(".png", picture.getvalue())
    style = re.sub(":root|body", "&", (_TEMPLATES / "style.css").read_text(encoding="utf-8"))
    with speaking(language(), page.names):
        content = filled("fragment.html.j2", page=page, images=images, tables=_tables_of("all"))
    return f'<div class="insnav"><style>.insnav {{{style}}}</style>{content}</div>'


def _inlined(suffix: str, picture: bytes) -> str:
    return f"data:{_MEDIA[suffix]};base64,{base64.b64encode(picture).decode('ascii')}"


def _tables_of(*shown: Show) -> Callable[[Section], list[Table]]:
    """Return a function that lays out a section's own tables; the template adds its subsections after its figures."""
    return lambda section: section_tables(replace(section, parts=()), shown)


def _scripts() -> tuple[str, ...]:
    """Read the JavaScript of a page with panels: BokehJS from the Python package, then ``panels.js``."""
    spec = find_spec("bokeh")  # located, not imported: only its JavaScript is used
    assert spec is not None
    assert spec.origin is not None
    bokeh = Path(spec.origin).parent / "server" / "static" / "js"
    files = *(bokeh / name for name in _BOKEH), _TEMPLATES / "panels.js"
    return tuple(file.read_text(encoding="utf-8") for file in files)


def _policy(scripts: tuple[str, ...]) -> str:
    """Build a Content-Security-Policy for a page: no network requests, and no scripts except `scripts`."""
    hashes = (base64.b64encode(hashlib.sha256(each.encode()).digest()).decode("ascii") for each in scripts)
    allowed = " ".join(f"'sha256-{each}'" for each in hashes) or "'none'"
    return f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src {allowed}"


def _translations(value: Any) -> Iterator[tuple[str, str]]:
    """Yield each text in the drawings' data that has a translation, paired with this translation."""
    if isinstance(value, str) and len(value) < 1000 and (wanted := translated(value)) != value:
        yield value, wanted
    elif isinstance(value, Mapping | list | tuple):
        for each in value.values() if isinstance(value, Mapping) else value:
            yield from _translations(each)


def _json_script(value: Any) -> Markup:
    """Encode a value as JSON that is safe inside an HTML script element."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return Markup(text)
