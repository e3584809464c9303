"""Defects of English prose: sentences that an engineer has to decode."""

from __future__ import annotations

import ast
import io
import re
import tokenize
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

LONGEST = 25  # words of a sentence
LONGEST_BULLET = 40  # words of an entry of the changelog
PRIVATE_VERBS = (
    r"tells?|told|telling|says?|said|saying|surer|surest|likelier|(?:stick|stuck) together|holds? both|beside|"
    r"(?:is|are|was|were) off|lets? go|goes by|go by|comes? out as|lives? through|mended?|mends|mending"
)
PATTERNS = {
    "free relative": re.compile(
        r"(?:^|(?<=[\s(;,:]))(?:what(?!\?)|(?<!than )(?<!from )(?:that|those) of|that which|those (?:that|which|who|in|"
        r"with|by))\b(?![^.]*\?)",
        re.IGNORECASE,
    ),
    "private verb": re.compile(rf"\b(?:{PRIVATE_VERBS})\b", re.IGNORECASE),
    "else option": re.compile(r"\(else --"),
    "semicolons": re.compile(r"^(?=(?:\S+ ){20})[^;]*;[^;]*;"),  # not in a short list of symbols
}
# A docstring begins with a verb or a noun, which an article or an adjective may precede, not with one of these words.
OPENINGS = (
    r"what|whether|how|that|those|this|these|as|if|in|of|by|for|with|where|when|which|who|why|"
    r"none|not|no|nothing|to|from|each|every|some|so|both|other|others|also|its|it|they|their|"
    r"he|there|here|at|on|about|after|before|between|beside|since|while|until|within|without|than|"
    r"then|once|and|or|but|nor|any|anything|everything|something|same|such|only|even|again|twice|"
    r"through|under|over|near|up|out|is|are|was|were|be|been|do|does|has|have|had|may|must|can|"
    r"could|shall|should|will|would"
)
QUOTED = re.compile(r"``.*?``|`[^`]*`|\"[^\"]*\"|\$[^$]+\$|\[[^\]]*\]", re.DOTALL)
BRACKETS, YEAR = re.compile(r"\((?:[^()]|\([^()]*\))*\)"), re.compile(r"\b(?:1[89]|20)\d\d\b")
PRAGMA = re.compile(r"(?:type: ignore|noqa|pragma)\b.*|![^\n]*")
EXAMPLE = re.compile(r"^ *(?:>>>|\.\.\. ).*$", re.MULTILINE)
ITEM = re.compile(r"^( *)(\S.*)\n(?=\1 +\S)", re.MULTILINE)  # a line with a deeper one below it
RULE_OFF = re.compile(r"^ *[-=]{3,} *$", re.MULTILINE)
END = re.compile(r"\n\s*\n|\n(?=\s*(?:[-*] |\d+\. |\w+ : ))|(?<=[.?!:])\s+(?=[A-Z0-9(`\"]|insnav|$)")
NO_PROSE = re.compile(r"^(```|\$\$)(?s:.*?)^\1|^(?:\||#+ |!\[|\[.*\]:).*$", re.MULTILINE)  # of Markdown


class Text(NamedTuple):
    """A passage that people read."""

    line: int
    words: str
    opening: bool = False  # it begins the docstring of a function or class


class Defect(NamedTuple):
    """A sentence to rewrite."""

    line: int
    rule: str
    text: str


def defects(text: Text) -> Iterator[Defect]:
    """Yield the defects of a text."""
    if text.opening and re.match(rf"[\W_]*(?:{OPENINGS})(?![\w-])", text.words, re.IGNORECASE):
        yield Defect(text.line, "opening", text.words.strip().splitlines()[0])
    for sentence in sentences(text.words):
        if len(re.findall(r"\S*\w\S*", sentence)) > LONGEST:
            yield Defect(text.line, "long sentence", sentence)
        yield from (Defect(text.line, rule, sentence) for rule, found in PATTERNS.items() if found.search(sentence))


def sentences(text: str) -> list[str]:
    """Split a text at full stops, blank lines, headings and items; quoted code counts as one word, a citation as 0."""
    plain = QUOTED.sub("X", RULE_OFF.sub("\n", ITEM.sub(r"\1\2\n\n", EXAMPLE.sub("", text))))
    plain = BRACKETS.sub(lambda match: "" if YEAR.search(match[0]) else match[0], plain)
    return [" ".join(part.split()) for part in END.split(plain) if part.strip()]


def docstrings(source: str) -> Iterator[Text]:
    """Yield the docstrings of a module."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node, clean=False):
            yield Text(node.body[0].lineno, str(ast.get_docstring(node, clean=False)), True)


def comments(source: str) -> Iterator[Text]:
    """Yield the comments of a module; lines that follow each other are one."""
    block: list[str] = []
    begin = last = 0
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            words, row = PRAGMA.sub("", token.string.lstrip("# ")), token.start[0]
            whole = token.line.lstrip().startswith("#")
            if block and not (whole and row == last + 1):
                yield Text(begin, "\n".join(block))
                block = []
            begin, last = begin if block else row, row if whole else 0
            block.append(words)
    yield Text(begin, "\n".join(block))


def labels(source: str) -> Iterator[Text]:
    """Yield the strings of three words or more, except docstrings; a value in braces counts as one word."""
    tree = ast.parse(source)
    other = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    other |= {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in ast.walk(tree):
        parts = node.values if isinstance(node, ast.JoinedStr) else [node] if isinstance(node, ast.Constant) else []
        words = "".join(str(part.value) if isinstance(part, ast.Constant) else "1" for part in parts)
        if id(node) not in other and words.count(" ") >= 2:
            yield Text(getattr(node, "lineno", 0), words)


def strings(value: Any) -> Iterator[Text]:
    """Yield the strings of a table that have words; a value in braces counts as one word."""
    if isinstance(value, dict | list):
        for part in value.values() if isinstance(value, dict) else value:
            yield from strings(part)
    elif isinstance(value, str) and " " in value:
        yield Text(0, re.sub(r"\{[^}]*\}", "1", value).replace("[[", "").replace("]]", ""))


def paragraphs(text: str) -> Iterator[Text]:
    """Yield the paragraphs of a page in Markdown, without code, tables, headings and addresses."""
    text = NO_PROSE.sub(lambda match: "\n" * match[0].count("\n"), text)
    text = re.sub(r"\]\([^)]*\)", "", text).replace("[", "").replace("*", "")
    for match in re.finditer(r"[^\n](?:(?!\n\n).)+", text, re.DOTALL):
        yield Text(text.count("\n", 0, match.start()) + 1, match[0])


def texts(path: Path) -> Iterator[Text]:
    """Yield the texts of a file by its kind."""
    source = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        yield from docstrings(source)
        yield from comments(source)
        yield from labels(source)
    elif path.suffix == ".toml":
        yield from strings(tomllib.loads(source))
    elif path.suffix == ".md":
        yield from paragraphs(source)
    else:  # help: a paragraph after \b is set as it is
        yield from (Text(0, part) for part in source.split("\n\n") if not part.lstrip("\n").startswith("\\b"))
