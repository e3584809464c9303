"""Parts of the manual that are made from the code, so that they cannot disagree with it.

``equation``: a numbered equation with its source and the tests that check it; a test that is not there is a warning,
and so an error of the build. ``equation-table``: all of them. ``commands``: the help of every command. ``errors``:
every error that insnav can raise, with cause and remedy. ``findings``: everything that insnav detects. ``run-json``:
the keys of ``run.json``, by its schema.
"""

from __future__ import annotations

import html
import io
import json
import re
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.parsers.rst import directives
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.directives.patches import MathDirective
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective
from sphinx.util.math import get_node_equation_number
from sphinx.util.nodes import make_refnode

from insnav.findings import Code
from insnav.messages import catalogue
from insnav.units import shown_unit
from tests.error_sites import error_sites

ROOT = Path(__file__).parents[2]
log = logging.getLogger(__name__)


class Equation(MathDirective):
    """An equation, its source, and what checks it."""

    option_spec = {  # noqa: RUF012
        **MathDirective.option_spec,
        "source": directives.unchanged_required,
        "code": directives.unchanged_required,
        "test": directives.unchanged_required,
    }

    def run(self) -> list[nodes.Node]:
        """Place the equation, and below it source, code and tests; note it for the table."""
        tests = self.options["test"].split()
        for name in (*tests, *self.options["code"].split()):
            if not _exists(name):
                log.warning("there is no %s", name, location=self.get_location())
        label = self.options["label"]
        noted = self.env.metadata[self.env.docname].setdefault("equations", [])  # type: ignore[attr-defined]
        noted.append((label, self.options["source"], self.options["code"].split(), tests))
        line = nodes.paragraph("", "", classes=["equation-source"])
        line += nodes.inline("", f"Source: {self.options['source']}. Code: ")
        for k, name in enumerate(self.options["code"].split()):
            line += [nodes.inline("", ", " if k else ""), nodes.literal("", name.replace("::", ": "))]
        line += nodes.inline("", ". Checked by: ")
        for k, name in enumerate(tests):
            line += [nodes.inline("", ", " if k else ""), nodes.literal("", name.split("::")[1])]
        return [*super().run(), line]


def _exists(name: str) -> bool:
    """Whether ``path::function`` is in the source."""
    path, function = name.split("::")
    return (ROOT / path).is_file() and re.search(
        rf"^(def|class) {function}\b", (ROOT / path).read_text(encoding="utf-8"), re.MULTILINE
    ) is not None


class table_of_equations(nodes.General, nodes.Element):  # noqa: N801
    """Place of the table, which is filled when all pages have been read."""


class EquationTable(SphinxDirective):
    """Equation, source, test."""

    def run(self) -> list[nodes.Node]:
        """Leave a place."""
        return [table_of_equations()]


def fill_tables(app: Sphinx, doctree: nodes.document, docname: str) -> None:
    """Fill the table of equations."""
    for place in list(doctree.findall(table_of_equations)):
        rows = []
        for page in app.env.toctree_includes[docname]:
            numbers = app.env.toc_fignumbers[page]["displaymath"]
            for label, source, _, tests in app.env.metadata[page].get("equations", []):
                anchor = nodes.make_id(f"equation-{label}")
                number = ".".join(map(str, numbers[anchor]))
                link = make_refnode(app.builder, docname, page, anchor, nodes.Text(f"({number})"))
                rows.append((nodes.paragraph("", "", link), nodes.paragraph("", source), _literals(tests)))
        place.replace_self(table(("equation", "source", "checked by"), rows, (10, 40, 50)))


def _literals(names: list[str]) -> nodes.paragraph:
    paragraph = nodes.paragraph()
    for k, name in enumerate(names):
        paragraph += [nodes.Text(", " if k else ""), nodes.literal("", name)]
    return paragraph


def table(head: tuple[str, ...], rows: list[tuple[nodes.Node, ...]], widths: tuple[int, ...]) -> nodes.table:
    """Table of paragraphs."""

    def row(cells: tuple[nodes.Node, ...]) -> nodes.row:
        return nodes.row("", *(nodes.entry("", cell) for cell in cells))

    group = nodes.tgroup("", *(nodes.colspec(colwidth=width) for width in widths), cols=len(head))
    group += nodes.thead("", row(tuple(nodes.paragraph("", text) for text in head)))
    group += nodes.tbody("", *(row(each) for each in rows))
    return nodes.table("", group)


class Commands(SphinxDirective):
    """Help of every command, as the terminal shows it."""

    def run(self) -> list[nodes.Node]:
        """Call the command line."""
        from insnav.cli import commands

        found: list[nodes.Node] = []
        for name, command in _commands(commands(), "insnav"):
            section = nodes.section(ids=[nodes.make_id(name)])
            section += nodes.title("", name)
            text = io.StringIO()
            with command.make_context(name, [], resilient_parsing=True) as context, redirect_stdout(text):
                section += nodes.literal_block("", command.get_help(context), language="none")
            found.append(section)
        return found


def _commands(group: Any, name: str) -> Iterator[tuple[str, Any]]:
    for key, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from _commands(command, f"{name} {key}")
        else:
            yield f"{name} {key}", command


class Errors(SphinxDirective):
    """Every error that insnav raises: its code, kind, words and remedy, from the catalogues."""

    def run(self) -> list[nodes.Node]:
        """Read the catalogues, family by family."""
        kinds: dict[str, set[str]] = {}
        for site in error_sites():
            kinds.setdefault(site.code, set()).add(site.kind)
        found: list[nodes.Node] = []
        for family in sorted({code.partition(".")[0] for code in kinds}):
            section = nodes.section(ids=[f"errors-{family}"])
            section += nodes.title("", family)
            rows = [
                (
                    nodes.paragraph("", "", nodes.literal("", code)),
                    *(nodes.paragraph("", _readable(entry.get(part, ""))) for part in ("what", "why", "fix")),
                    nodes.paragraph("", ", ".join(sorted(kinds[code]))),
                )
                for code, entry in catalogue(f"errors/{family}.en").items()
                if code in kinds
            ]
            section += table(("code", "message", "why", "what to do", "error"), rows, (16, 28, 23, 23, 10))
            found.append(section)
        return found


class Findings(SphinxDirective):
    """Everything that insnav detects: its code, severity, words and remedy, from the catalogue."""

    def run(self) -> list[nodes.Node]:
        """Read the catalogue, in the order of the codes."""
        groups: dict[str, list[tuple[nodes.Node, ...]]] = {}
        for code in Code:
            entry = catalogue("en")[code.value]
            text = " ".join(entry[part] for part in ("text", "done") if part in entry)
            row = (
                nodes.paragraph("", "", nodes.literal("", code.value)),
                nodes.paragraph("", code.severity.name.lower()),
                nodes.paragraph("", "", nodes.strong("", entry["title"]), nodes.Text(f". {_readable(text)}")),
                nodes.paragraph("", _readable(entry.get("advice", ""))),
            )
            groups.setdefault(code.value.partition(".")[0], []).append(row)
        sections: list[nodes.Node] = []
        for group, rows in groups.items():
            section = nodes.section(ids=[f"findings-{group}"])
            section += nodes.title("", group)
            section += table(
                ("code", "severity", "what was detected, and what insnav does", "what to do"), rows, (16, 8, 48, 28)
            )
            sections.append(section)
        return sections


def _readable(text: str) -> str:
    """Text of the catalogue with the unit, or an ellipsis, in the place of each number."""

    def shown(place: re.Match[str]) -> str:
        verb, _, rest = place[2].partition(" ")
        if verb in ("count", "plural", "sign"):
            return ("… " if verb == "count" else "") + rest.replace("|", "/")
        unit = rest.partition(" ")[2] if verb == "abs" else rest
        return f"… {shown_unit(unit)}" if unit and verb != "word" else "…"

    return re.sub(r"\{(\w+):?([^}]*)\}", shown, text.replace("[[", "").replace("]]", ""))


class RunJson(SphinxDirective):
    """Every key of ``run.json``, from its schema."""

    def run(self) -> list[nodes.Node]:
        """Read the schema."""
        schema = json.loads((ROOT / "insnav" / "report" / "run.schema.json").read_text(encoding="utf-8"))
        keys = {**schema["properties"], **schema["then"]["properties"]}
        rows = [
            row
            for key, rule in keys.items()
            for row in self._rows(
                key, {**schema["properties"].get(key, {}), **(rule if rule is not True else {})}, schema["$defs"]
            )
        ]
        return [table(("key", "what"), rows, (40, 60))]

    def _rows(self, key: str, rule: dict[str, Any], known: dict[str, Any]) -> Iterator[tuple[nodes.Node, ...]]:
        said = rule.get("description", "")
        while "properties" not in rule and ("$ref" in rule or "anyOf" in rule or rule.get("type") == "array"):
            inner = rule["items"] if "items" in rule else rule.get("anyOf", [rule])[0]
            rule = known[inner["$ref"].rpartition("/")[2]] if "$ref" in inner else inner
            said = said or rule.get("description", "")
        below = rule.get("properties", {})
        names = ", ".join(below)
        yield (
            nodes.paragraph("", "", nodes.literal("", key)),
            nodes.paragraph("", " ".join(filter(None, (said, names and f"Keys: {names}.")))),
        )


def _mathml(tex: str, display: str) -> str:
    """MathML of an equation; browsers know bold letters only as characters of their own."""

    def bold(match: re.Match[str]) -> str:
        letter = html.unescape(match[1])
        for first, after in (("A", 0x1D400), ("a", 0x1D41A), ("Α", 0x1D6A8), ("α", 0x1D6C2)):
            if 0 <= ord(letter) - ord(first) < 26:
                return f"<mi>{chr(after + ord(letter) - ord(first))}</mi>"
        return f"<mi>{chr(0x1D6DF) if letter in 'ϕφ' else letter}</mi>"

    found = convert(tex, display=display).replace(' stretchy="false"', "")
    return re.sub(r'<mi mathvariant="bold(?:-italic)?">([^<]+)</mi>', bold, found)


def _inline(translator: Any, node: nodes.math) -> None:
    translator.body.append(_mathml(node.astext(), "inline"))
    raise nodes.SkipNode


def _display(translator: Any, node: nodes.math_block) -> None:
    number = ""
    if node["number"]:
        number = f'<span class="eqno">({get_node_equation_number(translator, node)})</span>'
    translator.body.append(f'<div class="equation-line">{_mathml(node.astext(), "block")}{number}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives."""
    app.add_html_math_renderer("mathml", (_inline, None), (_display, None))  # no script, no network
    app.add_node(table_of_equations)
    app.add_directive("equation", Equation)
    app.add_directive("equation-table", EquationTable)
    app.add_directive("commands", Commands)
    app.add_directive("errors", Errors)
    app.add_directive("findings", Findings)
    app.add_directive("run-json", RunJson)
    app.connect("doctree-resolved", fill_tables)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
