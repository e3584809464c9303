"""Options that describe a recording: built from one table, and passed to a command as one value.

A command on a recording has the decorator `takes_data`, and `data` as its first parameter. Its other parameters are
options of this command alone.
"""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

from insnav.cli import console
from insnav.cli import options as common
from insnav.cli.console import Stages, detail, note, write_result
from insnav.cli.options import FILES, argument, option
from insnav.deferred import library
from insnav.exceptions import CheckError, ConfigError, OutputError
from insnav.progress import announce
from insnav.steps.inputs import INPUTS, LOGS, Input, Inputs

if TYPE_CHECKING:
    from insnav.input import Reading, ReadingFacts
    from insnav.input.readers.imu import Use
    from insnav.output.folder import RunFolder
    from insnav.result import Result
    from insnav.session.drive import Drive
    from insnav.types import ImuData

_findings, _messages = library("insnav.findings"), library("insnav.messages")  # imported on first use, not for --help
_explanation = library("insnav.report.save")

READING = ("axes", "units", "columns", "sampling", "stamp")  # inputs that affect the reading of samples
_IMU_HELP = "IMU data, or a log with IMU and GPS: a file of any supported format, a folder, or - for standard input."
_SECOND_HELP = "GPS fixes, as with --gps; the content of two files determines which has the IMU data."
_FILE_HELP = {
    "gps": "GPS fixes. [those in the IMU file]",
    "ref": "Reference trajectory: position, and velocity and attitude if available.",
}
_FIRST_WORD = re.compile(r"^[a-z_-]+(?=[:,]|$)")
_READER_OPTION = re.compile(r"imu-[a-z]+")


@dataclass(frozen=True, slots=True)
class Data:
    """Files and inputs of a recording, as specified on the command line."""

    # input files; None if not specified
    imu: Path | None
    gps: Path | None
    ref: Path | None
    inputs: Inputs  # other specified inputs
    options: dict[str, Any]  # all specified options of the command, ready for JSON

    def read_imu(self, stage: Stages, use: Use | None = None) -> Reading[ImuData]:
        """Read IMU samples without fixes, and log their interpretation. `use`: see `insnav.read_imu`."""
        stage("reading")
        from insnav.session.read import read_samples

        assert self.imu is not None
        reading = read_samples(self.imu, self.inputs, use)
        say_reading(reading.facts)
        say_scale(reading.facts)
        return reading

    def load(self, stage: Stages) -> Drive:
        """Read the recording, log its interpretation, and choose the inputs that the user did not specify."""
        from insnav.session.drive import drive_of
        from insnav.session.read import read

        assert self.imu is not None
        compile_at_first(self.imu)
        stage("reading")
        recording = read(self.imu, self.gps, self.ref, self.inputs, run=True)
        for facts in recording.facts.values():
            say_reading(facts)
        drive = drive_of(recording)
        detail(f"IMU model: {drive.imu_spec.name}", _messages.sentence(drive.imu_chosen))
        return drive

    def save(self, outcome: Result[Any], folder: RunFolder, stage: Stages, **how: Any) -> tuple[Result[Any], Path]:
        """Save a result together with the specified options; return the result with options, and the finished folder.

        `how`: arguments of `insnav.report.save.save_result`.
        """
        for step in outcome.steps:
            lines = [*map(_messages.sentence, step.findings)]
            if step.name == "explain" and outcome.explanation is not None:
                lines.append(_explanation.explanation_line(outcome.explanation))
            detail(_messages.phrase("terminal.step", name=step.name, time_s=step.time_s), *lines)
        outcome = replace(outcome, options=self.options)
        return outcome, write_result(outcome, folder, stage, **how)


def say_scale(facts: Any) -> None:
    """Print the assumed gyro scale, which no fixes can check; with -v, `say_reading` has already printed it."""
    codes = _findings.Code.UNITS_GYRO_ASSUMED, _findings.Code.READ_IMU_MODEL_BY_GRAVITY
    for assumed in _findings.of_code(facts.evidence, *codes) if console.level == 0 else ():
        note(_messages.sentence(assumed))


def check_usable(outcome: Result[Any]) -> None:
    """Raise a `CheckError` (exit code 1) if the result is complete but unreliable; a rule for all commands."""
    for lost in outcome.findings:
        if lost.severity is _findings.Severity.UNUSABLE:
            raise CheckError("cli.unusable", cause=lost)
    verdict = outcome.page().verdict
    if verdict is not None and verdict.light == "bad":
        raise CheckError("cli.not_relied_on", reason=_messages.translated(verdict.reason))


def takes_data(
    imu: str | None = "IMU_FILE",
    *,
    optional: bool = False,
    files: Mapping[str, bool] | None = None,
    without: Collection[str] = (),
    only: Collection[str] | None = None,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Add the options that describe a recording to a command.

    `imu`: name of the argument with the IMU data; None for a command without. `files`: options ``gps``, ``ref``: True
    if required; by default both optional, as a log may contain fixes. `without`, `only`: inputs to exclude or to allow.
    """
    wanted = {"gps": False, "ref": False} if files is None else files
    logs = {} if only is not None or "logs" in without else LOGS
    keys = [key for key, what in INPUTS.items() if what.option and key not in without and (only is None or key in only)]

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        own_parameters = list(inspect.signature(function, eval_str=True).parameters.values())[1:]
        parameters = [_parameter("imu_file", Path, argument(imu, _IMU_HELP), needed=not optional)] if imu else []
        if imu and "gps" in wanted:
            parameters.append(_parameter("gps_file", Path, argument("GPS_FILE", _SECOND_HELP)))
        for name, needed in wanted.items():
            parameters.append(_parameter(name, Path, option(FILES, "FILE", _FILE_HELP[name]), needed=needed))
        parameters += [_option(INPUTS[key]) for key in keys]
        parameters += [_option(log) for log in logs.values()]
        parameters += own_parameters

        @functools.wraps(function)
        def command(**options: Any) -> None:
            inputs = {key: _value(INPUTS[key], options[_name(INPUTS[key])]) for key in keys}
            inputs["logs"] = {
                key: file for key, log in logs.items() if (file := options[_name(log)]) is not None
            } or None
            if (second := options.pop("gps_file", None)) is not None:
                options["imu_file"], options["gps"] = _told_apart(options["imu_file"], second, options["gps"])
            imu, gps, ref = (options.get(name) for name in ("imu_file", "gps", "ref"))
            data = Data(imu, gps, ref, cast(Inputs, inputs), common.configuration(options))
            try:
                function(data, **{item.name: options[item.name] for item in own_parameters})
            except OutputError:
                _refuse_nothing(data.imu, data.gps, data.ref)
                raise

        keyword = inspect.Parameter.KEYWORD_ONLY
        command.__dict__["__signature__"] = inspect.Signature([item.replace(kind=keyword) for item in parameters])
        command.__annotations__ = {item.name: item.annotation for item in parameters}
        return command

    return decorate


def _told_apart(first: Path, second: Path, gps: Path | None) -> tuple[Path, Path]:
    """Order two files: first samples, then fixes, identified as in `insnav check`. Keep the order if one is ``-``."""
    if gps is not None:
        raise ConfigError("cli.fixes_twice", where="--gps", file=str(second))
    if "-" in (str(first), str(second)):
        return first, second
    from insnav.input.readers.kinds import kinds_of, open_parts

    first_kinds = kinds_of(open_parts(first))
    swapped = "imu" in kinds_of(open_parts(second), imu_known="imu" in first_kinds) and "imu" not in first_kinds
    return (second, first) if swapped else (first, second)


def _refuse_nothing(*files: Path | None) -> None:
    """Raise the error for a missing or empty input file, which precedes the error of an unusable output folder."""
    for file in files:
        if file is None or str(file) == "-" or (file.exists() and (not file.is_file() or file.stat().st_size)):
            continue
        from insnav.input.formats.source import open_source

        open_source(file)


def _option(what: Input) -> inspect.Parameter:
    literal: Any = Literal  # untyped: the type checker does not know the choices
    kind = literal[what.choices] if what.choices else {"file": Path, "number": float}.get(what.kind, str)
    parser = {"parser": functools.partial(common.number_in, what.unit, what.option)} if what.kind == "number" else {}
    return _parameter(_name(what), kind, option(what.group, what.metavar, what.meaning, what.option, **parser))


def _parameter(name: str, kind: Any, how: Any, *, needed: bool = False) -> inspect.Parameter:
    default = inspect.Parameter.empty if needed else None
    annotated: Any = Annotated  # untyped: the type checker does not know `kind`
    return inspect.Parameter(
        name,
        inspect.Parameter.KEYWORD_ONLY,
        default=default,
        annotation=annotated[kind if needed else kind | None, how],
    )


def _name(what: Input) -> str:  # of the command's parameter for an input
    return what.option.lstrip("-").replace("-", "_")


_READ: dict[str, Callable[[str, str], Any]] = {
    "vector": common.vector,
    "numbers": common.positive_numbers,
    "span": common.span,
    "columns": common.columns,
}


def _value(what: Input, given: Any) -> Any:
    """Convert the command-line form of an input to its value in SI."""
    if given is not None and what.kind in _READ:
        return _READ[what.kind](given, what.option)
    return given * what.size if given is not None and what.kind == "number" else given


def as_option(where: str) -> str:
    """Replace the name of an input by its option in the location of an error: ``lever_arm`` by ``--lever-arm``."""
    return _FIRST_WORD.sub(lambda found: _option_of(found[0]), where)


def _option_of(word: str) -> str:
    if word in INPUTS:
        return INPUTS[word].option or f"--{word}"
    return f"--{word}" if _READER_OPTION.fullmatch(word) or word in ("epochs", "point", "correlated") else word


def say_reading(facts: ReadingFacts) -> None:
    """Log the interpretation of a file, without columns that keep their names and units that the file states."""
    head, *_ = facts.lines()
    renamed = _renamed(facts.columns)
    columns = [f"columns: {renamed}; the others by their names"] if renamed else []
    stated = _findings.Code.UNITS_STATED
    detail(head, *columns, *(_messages.sentence(finding) for finding in facts.evidence if finding.code != stated))


def _renamed(columns: Mapping[str, str]) -> str:
    """List columns whose header differs from the quantity's own name, with or without its unit."""
    headers = {name: text.split(" [")[0] for name, text in columns.items()}
    return ", ".join(
        f"{name} = {columns[name]}"
        for name, header in headers.items()
        if name != header and not name.startswith(f"{header}_")
    )


def compile_at_first(*files: Path) -> None:
    """Compile the kernels at the first use after an installation, and log the reason for the delay."""
    if not all(file.exists() for file in files):  # the error of a missing file must not wait
        return
    from insnav.kernels import ahead, errorstate

    if not hasattr(errorstate.propagate, "stats"):
        note(_messages.phrase("terminal.interpreted"))
    elif not ahead.kept():
        note(_messages.phrase("terminal.no_cache"))
    elif ahead.needed():
        note(_messages.phrase("terminal.compiling"))
        announce("compiling kernels (once)")
        ahead.compile_ahead()
