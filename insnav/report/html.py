"""What all report pages share: templates that escape everything, and figures inside the page."""

from __future__ import annotations

import base64
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from insnav import __version__
from insnav.plain_text import plain_text
from insnav.report.page import Page, Section, Show, Table, section_tables

_MEDIA = {".png": "image/png", ".svg": "image/svg+xml"}


def filled(template: str, **values: Any) -> str:
    """Fill a template.

    `template`: name of the file in ``templates/``; `**values`: what it needs; a value it asks for and does not get is
    an error.
    """
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["plain"] = plain_text
    return environment.get_template(template).render(**values)


def data_uri(file: Path) -> str:
    """Content of a PNG or SVG file as an address, so that the page needs no other file."""
    return f"data:{_MEDIA[file.suffix]};base64,{base64.b64encode(file.read_bytes()).decode('ascii')}"


def page_html(page: Page, files: Sequence[Path]) -> str:
    """Write a report as one self-contained page."""
    images = {each.name: data_uri(file) for each, file in zip(page.figures, files, strict=True)}
    return filled("page.html.j2", page=page, images=images, tables=_tables_of("all", "page"), version=__version__)


def page_fragment(page: Page) -> str:
    """Write a report as a part of another page, such as a notebook: what the terminal shows, as tables."""
    return filled("fragment.html.j2", page=page, images={}, tables=_tables_of("all"))


def _tables_of(*shown: Show) -> Callable[[Section], list[Table]]:
    """Tables of one section, and none of its parts, which follow its figures."""
    return lambda section: section_tables(replace(section, parts=()), shown)
