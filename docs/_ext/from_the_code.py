"""Parts of the manual that are made from the code, so that they cannot disagree with it.

``equation``: a numbered equation with its source and the tests that check it; a test that is not there is a warning,
and so an error of the build. ``equation-table``: all of them. ``commands``: the help of every command. ``messages``:
every error and everything that insnav detects, with cause and remedy. ``run-json``: the keys of ``run.json``, by its
schema.
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


KINDS = {  # of errors and findings, in the order in which they matter to who sees them
    "ConfigError": "Errors: an option or a configuration file is wrong",
    "InputError": "Errors: a data file cannot be used",
    "AlignmentError": "Errors: the start cannot be aligned",
    "DivergenceError": "Errors: the solution diverges",
    "OutputError": "Errors: a result cannot be written",
    "CheckError": "Errors: a result is not as good as you asked for",
    "unusable": "Findings: the solution is not to be relied on",
    "warning": "Findings: warnings",
    "assumption": "Findings: assumptions",
    "note": "Findings: notes",
}


class Messages(SphinxDirective):
    """Everything that insnav says: errors by what is wrong, findings by severity; each by its first words."""

    def run(self) -> list[nodes.Node]:
        """Read the catalogues; a field of search stands first."""
        found: dict[str, dict[tuple[str, str], list[str]]] = {}
        for site in error_sites():
            entry = catalogue(f"errors/{site.code.partition('.')[0]}.en")[site.code]
            what, *others = (_readable(entry.get(part, "")) for part in ("what", "why", "fix"))
            found.setdefault(site.kind, {})[what, site.code] = others
        for code in Code:
            entry = catalogue("en")[code.value]
            text = " ".join(entry[part] for part in ("text", "done") if part in entry)
            others = [_readable(text), _readable(entry.get("advice", ""))]
            found.setdefault(code.severity.name.lower(), {})[entry["title"], code.value] = others
        sections: list[nodes.Node] = [
            raw('<input type="search" id="find-message" placeholder="Words of the message, or its code">')
        ]
        for kind in sorted(found, key=[*KINDS, *sorted({*found} - {*KINDS})].index):
            section = nodes.section(ids=[nodes.make_id(f"messages-{kind}")])
            section += nodes.title("", KINDS.get(kind, kind))
            section += raw(f"<details class='messages'><summary>All {len(found[kind])}</summary>")
            for (what, code), others in sorted(found[kind].items(), key=lambda each: each[0][0].lstrip("… ").lower()):
                section += [
                    raw('<details class="message"><summary>'),
                    nodes.inline("", f"{what} "),
                    nodes.literal("", code),
                ]
                section += raw("</summary>")
                section += [nodes.paragraph("", each) for each in others if each]
                section += raw("</details>")
            section += raw("</details>")
            sections.append(section)
        return sections


def raw(text: str) -> nodes.raw:
    """HTML as it is."""
    return nodes.raw("", text, format="html")


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
    app.add_directive("messages", Messages)
    app.add_directive("run-json", RunJson)
    app.connect("doctree-resolved", fill_tables)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
