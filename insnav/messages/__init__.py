"""Texts of findings and errors: one catalogue per language, and the renderer that inserts numbers.

An entry of ``<language>.toml`` has the code of `insnav.findings.Code` as its key and contains:

- ``severity``: ``assumption``, ``warning`` or ``unusable``; by default ``note`` (in English only);
- ``title``: the name of the finding, two to six words, without numbers;
- ``text``: the observation, one or two sentences with the decisive numbers;
- ``done``: action of insnav;
- ``advice``: recommended action of the user.

An error has its code as key in ``errors/<family>.<language>.toml``; the family is the first part of its code:

- ``what``: the error, understandable alone;
- ``why``: the evidence, with the decisive numbers;
- ``fix``: recommended action of the user.

A text contains names of values in braces, with a format:

- ``{delay_s:.3f s}``: format, then the unit to convert to from SI;
- ``{count:count fix|fixes}``: number and noun; ``{count:plural fix|fixes}``: noun alone;
- ``{delay_s:sign late|early}``: first word unless negative; ``{delay_s:abs .3f s}``: without the sign;
- ``{axis:word}``: value or values, translated by the table ``[words]`` of the file or of ``<language>.toml``;
- ``{problems:lines}``: each value on its own line; ``{begin:moment}``, ``{span}``: times of the record.

``{subject}`` is the subject of the finding. A part in double square brackets is left out if one of its values is
missing or not finite: ``[[ ± {delay_sd_s:.3f s}]]``. If a value is an error, ``{cause}`` writes its location and text,
``{cause:reason}`` only ``what`` and ``why``, ``{cause:fix}`` only ``fix``. The table ``[form]`` defines the punctuation
of sentences, lists and spans in a language.
"""

from __future__ import annotations

import math
import os
import re
from collections import ChainMap
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from numbers import Real
from string import Formatter
from typing import Any, NamedTuple

from insnav import plain_text
from insnav.findings import ErrorFacts, Finding, catalogue
from insnav.units import UNITS, shown_unit

LANGUAGES = ("en", "zh")
PARTS = ("title", "text", "done", "advice")
_NUMBER = re.compile(r"\d+(?:\.\d+)?")  # written as # in the catalogue of pages
_PROSE = re.compile(r"[a-z] [a-z]{2}|[a-z]{3}:")  # text, not a name: files, profiles and IMUs have single words
_OPTIONAL = re.compile(r"\[\[(.*?)\]\]")
_FORMATTER = Formatter()
# set by `speaking`: language, which precedes the language of the process; names that are not translated
_SPOKEN: ContextVar[tuple[str, frozenset[str]]] = ContextVar("_SPOKEN", default=("", frozenset()))

At = Callable[[float, float], str]
"""Function that writes a span of the record as text, from its begin and end [s]."""


class _Form(NamedTuple):
    """Language, function for times, and words, to write the values of a text."""

    lang: str
    at: At
    words: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Message:
    """Texts of a finding."""

    title: str  # name of the finding
    text: str  # observation
    done: str = ""  # action of insnav
    advice: str = ""  # recommended action of the user
    joint: str = " "  # separator of two sentences

    def __str__(self) -> str:
        return self.joint.join(part for part in (self.text, self.done, self.advice) if part)


@contextmanager
def speaking(lang: str, names: frozenset[str] = frozenset()) -> Iterator[None]:
    """Write every message inside the ``with`` block in this language. `names`: chosen by the user, never translated."""
    token = _SPOKEN.set((lang, names))
    try:
        yield
    finally:
        _SPOKEN.reset(token)


def language() -> str:
    """Return the language of messages: from `speaking`, else from ``INSNAV_LANG``."""
    wanted = _SPOKEN.get()[0] or os.environ.get("INSNAV_LANG", "")[:2].lower()
    return wanted if wanted in LANGUAGES else "en"


def form(name: str, lang: str | None = None) -> str:
    """Return an entry of a language's table ``[form]``, for text outside messages."""
    return str(catalogue(lang or language())["form"][name])


def word(name: str) -> str:
    """Translate a name by the table ``[words]`` of the language; return the name itself if it has no entry."""
    return str(catalogue(language())["words"].get(name, name))


def moment(begin: float, end: float, lang: str | None = None) -> str:
    """Write a time of the record, or a span [s]: ``t = 12.0 s``."""
    return plain_text.moment(begin, end, form("until", lang))


def render(finding: Finding, lang: str | None = None, at: At | None = None) -> Message:
    """Write the texts of a finding.

    Parameters
    ----------
    finding : Finding
    lang : str, optional
        A language of `LANGUAGES`; by default `language`.
    at : callable, optional
        Function that writes times of the record in this language; by default `moment`.

    Returns
    -------
    Message
    """
    lang = lang or language()
    entry = catalogue(lang)[finding.code.value]
    if text := finding.get("text"):  # text stored by an earlier version
        return Message(entry["title"], text)
    values = dict(finding.values) | {"subject": finding.subject, "begin": finding.begin, "end": finding.end}
    form_of = _Form(lang, at or partial(moment, lang=lang), catalogue(lang)["words"])
    parts = {part: _filled(entry[part], values, form_of) for part in PARTS if part in entry}
    return Message(**parts, joint=form("joint", lang))


def sentence(finding: Finding, lang: str | None = None, at: At | None = None) -> str:
    """Write a finding in one line: the observation, insnav's action, and the user's action."""
    return str(render(finding, lang, at))


def shows_time(finding: Finding, lang: str | None = None) -> bool:
    """Return whether the texts of a finding contain a time of the record."""
    entry = catalogue(lang or language())[finding.code.value]
    return finding.timed and any(place in entry.get(part, "") for part in PARTS for place in ("{span}", ":moment}"))


def render_error(code: str, part: str, values: Mapping[str, Any], lang: str | None = None) -> str:
    """Write a part of an error: ``what``, ``why`` or ``fix``; empty if absent."""
    lang = lang or language()
    entries = catalogue(f"errors/{code.partition('.')[0]}.{lang}")
    words = ChainMap(entries.get("words", {}), catalogue(lang)["words"])
    return _filled(entries[code].get(part, ""), values, _Form(lang, partial(moment, lang=lang), words))


def phrase(name: str, /, **values: Any) -> str:
    """Write a phrase of a report: an entry of ``phrases.<language>.toml``, such as ``run.good``."""
    lang, (group, _, key) = language(), name.partition(".")
    how = _Form(lang, partial(moment, lang=lang), catalogue(lang)["words"])
    return _filled(catalogue(f"phrases.{lang}")[group][key], values, how)


def translated(text: str) -> str:
    """Translate a text of a page or of the help by ``page.<language>.toml``; names, numbers and units stay.

    An entry is a whole text with ``#`` for each number, or a pattern with ``{}`` for each part, which is translated.
    A text without an entry is split at semicolons, colons, commas or "and". All parts of several words need entries.
    """
    is_name = isinstance(text, plain_text.Name)
    return text if is_name else _translated(plain_text.plain_text(text), language(), _SPOKEN.get()[1])


@lru_cache(maxsize=4096)
def _translated(text: str, lang: str, kept: frozenset[str]) -> str:
    words = catalogue(f"page.{lang}")["words"]
    if not words or text in words:
        return str(words.get(text, text))
    name, bracket, unit = text.partition(" [") if text.endswith("]") else (text, "", "")
    lowered = name[:1].lower() + name[1:]
    # an entry for the whole text, with # for each number
    key = next((key for key in (_NUMBER.sub("#", name), _NUMBER.sub("#", lowered)) if key in words), None)
    if key is not None:
        numbers = iter(_NUMBER.findall(name))
        return re.sub("#", lambda _: next(numbers, "#"), words[key]) + bracket + unit
    for pattern, wanted in _patterns(lang):  # entries with {} for parts
        match = pattern.fullmatch(name) or pattern.fullmatch(lowered)
        if match and (parts := _parts(match.groups(), lang, kept)):
            return f"{wanted.format(*parts)}{bracket}{unit}"
    for mark in (mark for mark in ("; ", ": ", ", ", " and ") if mark in name and mark in words):
        if (parts := _parts(pieces := name.split(mark), lang, kept)) and parts != pieces:
            return f"{words[mark].join(parts)}{bracket}{unit}"
    return text


def _parts(own: Sequence[str], lang: str, kept: frozenset[str]) -> list[str]:
    """Translate the parts of a text; return an empty list if a part of several words has no translation."""
    parts = [part if part in kept else _translated(part, lang, kept) for part in own]
    return [] if any(a == b and a not in kept and _PROSE.search(a) for a, b in zip(own, parts, strict=True)) else parts


@cache
def _patterns(lang: str) -> list[tuple[re.Pattern[str], str]]:
    """Return the entries with ``{}`` as regular expressions, each with its translation, longest first."""
    entries = {key: translation for key, translation in catalogue(f"page.{lang}")["words"].items() if "{}" in key}
    longest_first = sorted(entries, key=lambda key: -len(key.replace("{}", "")))
    return [(re.compile(re.escape(key).replace(r"\{\}", "(.+?)")), entries[key]) for key in longest_first]


def _filled(text: str, values: Mapping[str, Any], how: _Form) -> str:
    """Insert values into a text."""

    def optional(part: re.Match[str]) -> str:
        names = [name for _, name, _, _ in _FORMATTER.parse(part[1]) if name and name != "span"]
        return part[1] if all(_known(values.get(name)) for name in names) else ""

    parts = []
    for literal, name, spec, _ in _FORMATTER.parse(_OPTIONAL.sub(optional, text)):
        parts.append(literal)
        if name == "span":
            parts.append(how.at(values["begin"], values["end"]))
        elif name is not None:
            parts.append(_shown(values[name], spec or "", how))
    return "".join(parts)


def _known(value: Any) -> bool:  # a finite number, or another value that is not empty
    return math.isfinite(value) if isinstance(value, Real) else value not in (None, "", ())


def _shown(value: Any, spec: str, how: _Form) -> str:
    """Write a value in its format."""
    if isinstance(value, Finding | ErrorFacts):
        return sentence(value, how.lang, how.at) if isinstance(value, Finding) else _error(value, spec, how.lang)
    if isinstance(value, tuple):
        value = tuple(_shown(item, "", how) if isinstance(item, Finding | ErrorFacts) else item for item in value)
    verb, _, rest = spec.partition(" ")
    first, _, second = rest.partition("|")
    match verb:
        case "moment":
            return how.at(value, value)
        case "word":
            return _word(value, how)
        case "lines":
            return "\n".join(value)
        case "count":
            return f"{value:g} {first if value == 1 else second}"
        case "plural":
            return first if value == 1 else second
        case "sign":
            return first if value >= 0.0 else second
        case "abs":
            return _shown(abs(value), rest, how)
    parts = [_number(item, verb, rest) for item in (value if isinstance(value, tuple) else (value,))]
    return form("list", how.lang).join(parts) + (f" {shown_unit(rest)}" if rest else "")


def _error(error: ErrorFacts, spec: str, lang: str) -> str:
    """Write an error in one line. `spec`: ``reason``: location, error, evidence; ``fix``: advice; else all."""
    parts = {"reason": ("what", "why"), "fix": ("fix",)}.get(spec, ("what", "why", "fix"))
    texts = [render_error(error.code, part, dict(error.values), lang) for part in parts]
    joined = form("joint", lang).join(" ".join(sentences.split()) for sentences in texts if sentences)
    line = catalogue(f"phrases.{lang}")["terminal"]["line"]
    return str(line.format(name=error.where, text=joined)) if error.where and spec != "fix" else joined


def _word(value: Any, how: _Form) -> str:
    """Translate a name by the words, or several names; a file name in brackets may follow: ``gyro x (rates.csv)``."""
    if not isinstance(value, tuple) and (value in how.words or value in _SPOKEN.get()[1]):
        return str(value if value in _SPOKEN.get()[1] else how.words[value])
    parts = [str(item).partition(" (") for item in (value if isinstance(value, tuple) else str(value).split(", "))]
    return form("list", how.lang).join(f"{how.words.get(name, name)}{bracket}{rest}" for name, bracket, rest in parts)


def _number(value: Any, spec: str, unit: str) -> str:
    if not isinstance(value, Real):
        return str(value)
    scaled: Any = value / UNITS[unit][1] if unit in UNITS else value
    text = format(scaled, spec or ".3g") if not isinstance(scaled, int) or spec else str(scaled)
    if "e+" in text:  # large numbers are written without an exponent
        text = f"{scaled:.0f}"
    return text.removeprefix("-") if not text.strip("-0.") else text  # no negative zero
