"""Help of the commands: texts, and options in named groups, as plain text, since importing rich takes too long."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from typing import Any, get_args

from typer.core import TyperCommand, TyperGroup

from insnav.findings import catalogue
from insnav.messages import language, translated
from insnav.plain_text import in_columns

_TYPE = re.compile(r" <[^>]*>$")  # type that typer writes after the name of an argument
_TWICE = re.compile(r"(?<=\])\s+\[(default: [^]]*|[-\d.<=>x]+)\]$")  # default or range that typer adds to a text
_WHOLE = re.compile(r"(\[default: -?\d+)\.0\]")  # default that is a whole number with a needless decimal
_HEADING = re.compile(r"(?m)^[A-Z][A-Za-z ]*(?=:)|(?<=\[)(?:default(?=:)|required(?=\]))")
_TEXTS = Path(__file__).parent / "texts"


def help_of(command: str) -> dict[str, Any]:
    """Read the help of a command from its file; an optional short form for the command list precedes ``---``.

    `command`: such as ``run`` or ``calibrate/gyro``. Returns: ``help`` and ``short_help`` for typer.
    """
    short, _, text = (_TEXTS / f"{command}.txt").read_text(encoding="utf-8").rpartition("---\n")
    if translation := catalogue(f"help.{language()}").get(command):  # translated prose; examples stay as in the file
        prose = iter(translation["text"])
        blocks = (_block(block) if block.startswith("\\b") else in_columns(next(prose)) for block in text.split("\n\n"))
        text = "\n\n".join(blocks)
        short = in_columns(translation["short"])
    return {"help": text.replace("\\b\n", "\b\n"), "short_help": (short or text).partition("\n")[0]}


def _block(text: str) -> str:
    """Translate the entries of a block of lines; commands and names stay."""
    return re.sub(r"\S+(?: \S+)*", lambda found: in_columns(translated(found[0])), text)


class _Light:
    """Mixin that converts texts, paths, choices and defaults itself: typer would import pydantic, which is slow."""

    def get_params(self, ctx: Any) -> list[Any]:
        params: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for param in params:
            param.__dict__["process_value"] = partial(_processed, param)
        return params

    def get_help(self, ctx: Any) -> str:
        """Write the help in the language of the messages."""
        for param in self.get_params(ctx):
            param.help = in_columns(translated(param.help or ""))
        text: str = super().get_help(ctx)  # type: ignore[misc]
        return _HEADING.sub(lambda found: translated(found[0]), text).replace("\0", "")


class LightGroup(_Light, TyperGroup):
    """Group of commands, without pydantic."""


class GroupedCommand(_Light, TyperCommand):
    """Command whose help lists options in groups."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the options in their groups, which are in the order of their first option."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record is not None:
                name, text = _TYPE.sub("", record[0]), _TWICE.sub("", _WHOLE.sub(r"\1]", record[1]))
                groups.setdefault(getattr(param, "rich_help_panel", None) or "Other", []).append((name, text))
        for title, records in groups.items():
            with formatter.section(title):
                formatter.write_dl(records)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the arguments of the usage line in the usual form: RUN, not {RUN}."""
        return [piece.replace("{", "").replace("}", "") for piece in super().collect_usage_pieces(ctx)]


def _processed(param: Any, ctx: Any, value: Any) -> Any:
    # convert texts, paths, choices and defaults here; typer converts other values, and reports wrong ones
    kind = getattr(getattr(param, "type_descriptor", None), "annotation", None)
    source = ctx.get_parameter_source(param.name)
    if param.nargs != 1 or getattr(param, "multiple", False) or source is None or (param.required and value is None):
        return type(param).process_value(param, ctx, value)
    if isinstance(value, str) and kind in (str, Path):
        value = kind(value)
    elif value in get_args(kind):  # one of the allowed words
        pass
    elif source.name != "DEFAULT":
        return type(param).process_value(param, ctx, value)
    return value if param.callback is None else param.callback(ctx, param, value)
