"""Command line: thin commands without mathematics, help in ``texts``. Slow imports are inside the commands."""

from __future__ import annotations

import errno
import gc
import io
import itertools
import os
import signal
import sys
from importlib import import_module
from typing import Any

import typer
from typer.main import get_command

from insnav.cli import console
from insnav.cli.console import discard_output, error_block, result
from insnav.cli.help import GroupedCommand, LightGroup, help_of
from insnav.cli.options import declared, usage_error
from insnav.exceptions import ConfigError, InputError, InsnavError
from insnav.messages import translated
from insnav.plain_text import in_columns

# names of the commands, in the order of the help; also names of their functions, and of their files except `SHARED`
COMMANDS = (
    *("run", "live", "batch", "check", "demo", "align", "compare", "report", "export", "outage", "budget", "require"),
    *("simulate", "imus", "allan", "tune", "acceptance", "drift", "platform", "verify", "regress"),
)
SHARED = {
    "bench": ("acceptance", "allan", "drift", "imus", "platform", "tune"),
    "drives": ("align", "check", "compare", "demo", "outage", "report", "require"),
    "trials": ("regress", "simulate", "verify"),
}
_FILES = {name: file for file, names in SHARED.items() for name in names}


def commands(*names: str) -> Any:
    """Build the command group of `names`, or of all commands if `names` has none; building all takes 50 ms."""
    app = typer.Typer(
        name="insnav",
        cls=LightGroup,
        help=in_columns(translated("Strapdown INS / GPS navigation and INS error analysis.")),
        no_args_is_help=True,
        epilog=help_of("insnav")["help"],
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
    )
    app.callback()(_common)
    chosen = [name for name in COMMANDS if name in names]
    for name in chosen or COMMANDS:
        about = vars(import_module(f"insnav.cli.{_FILES.get(name, name)}"))
        settings = {"cls": GroupedCommand, "context_settings": about.get("SETTINGS"), **help_of(name)}
        app.command(name, **settings)(declared(about[name], name))
    if not chosen:
        from insnav.cli import bench

        app.add_typer(bench.app, name="calibrate", **help_of("calibrate"))
    return get_command(app)


# environment variable with which a shell requests completions
COMPLETE = "_INSNAV_COMPLETE"
QUIET, VERBOSE = {"-q", "--quiet"}, {"-v", "--verbose"}
# one thread for linear algebra: as matrices are small, more threads would waste a third of a run's CPU time waiting
THREADS = "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"
LEAST_MEMORY = 1200 << 20  # least address space for the libraries, which use a third of it [bytes]
RENAMED = {"--twins": "--replicas", "--raw": "--uncalibrated", "--workers": "--engine"}  # old and new option names


def _version(value: bool) -> None:
    if value:
        from insnav.version import __version__

        print(f"insnav {__version__}")
        raise typer.Exit


def _common(
    version: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Print the version."),
    verbose: bool = typer.Option(False, "-v", "--verbose", help="Print everything; goes with every command."),
    quiet: bool = typer.Option(False, "-q", "--quiet", help="Print nothing but errors; goes with every command."),
    debug: bool = typer.Option(False, "--debug", help="Show the traceback of an error; goes with every command."),
    lang: str = typer.Option(None, "--lang", metavar="en|zh", help="Language of messages; goes with every command."),
) -> None:
    pass


def main() -> None:
    """Run the command line and end the process with its exit code."""
    for name in THREADS:  # numpy reads these variables when it is imported, later
        os.environ.setdefault(name, "1")
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # otherwise pydantic searches all installed packages
    gc.set_threshold(200_000, 50)  # the 125 000 imported objects stay; searching them for garbage takes 3 % of a run
    words = list(itertools.takewhile(lambda text: text != "--", sys.argv[1:]))  # words before -- may be options
    debug = "--debug" in words
    console.level = -1 if QUIET & set(words) else 1 if VERBOSE & set(words) else 0
    renamed = {} if "allan" in words else RENAMED  # --workers of insnav allan is a number of threads
    others, languages = _without_language([text for text in words if text not in {"--debug", *QUIET, *VERBOSE}])
    arguments = [renamed.get(text, text) for text in others] + sys.argv[1 + len(words) :]
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without ± prints a question mark
    if COMPLETE in os.environ:  # the shell requests completions
        commands()(prog_name="insnav")
    console.listen()
    try:
        for wanted in languages:
            _set_language(wanted)
        code = _run(arguments)
        console.over()
    except BaseException as error:
        console.arrived()
        console.over()
        if debug and not isinstance(error, SystemExit):
            import traceback

            traceback.print_exc()
        code = _explain(error)
    gc.freeze()  # avoids a final garbage collection over all objects: 0.2 s
    sys.exit(code)


def _without_language(words: list[str]) -> tuple[list[str], list[str]]:
    """Extract ``--lang zh`` and ``--lang=zh`` from the words of a command; return other words and languages."""
    others, languages, remaining = [], [], iter(words)
    for word in remaining:
        name, _, value = word.partition("=")
        if name == "--lang":
            languages.append(value if "=" in word else next(remaining, ""))
        else:
            others.append(word)
    return others, languages


def _set_language(wanted: str) -> None:
    """Set the language of all messages, also for child processes."""
    from insnav.messages import LANGUAGES

    if not wanted:
        raise ConfigError("cli.no_language", where="--lang", languages=LANGUAGES)
    if wanted not in LANGUAGES:
        raise ConfigError("cli.unknown_language", where="--lang", language=wanted, languages=LANGUAGES)
    os.environ["INSNAV_LANG"] = wanted


def _run(arguments: list[str]) -> int:
    command = commands(*itertools.islice((word for word in arguments if not word.startswith("-")), 1))
    try:
        # not `command()`, which prints its own messages and uses its own exit codes
        with command.make_context("insnav", arguments) as context:
            _check_memory()
            command.invoke(context)
        sys.stdout.flush()
    except typer.Exit as end:
        return end.exit_code
    return 0


def _check_memory() -> None:
    """Refuse a memory limit below the need of the libraries, with which OpenBLAS would retry forever."""
    if sys.platform == "win32":
        return
    import resource

    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY and limit < LEAST_MEMORY:
        raise InputError("cli.little_memory", where="ulimit -v", limit_mb=limit >> 20, least_mb=LEAST_MEMORY >> 20)


def _explain(error: BaseException) -> int:
    """Print an error as one block; return its exit code."""
    if isinstance(error, SystemExit):
        return error.code if isinstance(error.code, int) else 0
    if isinstance(error, console.Stopped):
        error_block(InsnavError("cli.interrupted" if error.number == signal.SIGINT else "cli.terminated"))
        return 128 + error.number
    if isinstance(error, BrokenPipeError):
        discard_output()  # the reader closed the pipe, as `| head` does; nothing more can be printed
        return 141
    context = getattr(error, "ctx", None)
    if context is not None and type(error).__name__ == "NoArgsIsHelpError":
        result(context.get_help())
        return 2
    explained = _explained(error)
    error_block(explained)
    return explained.exit_code


def _explained(error: Any) -> InsnavError:
    """Convert any error to an error of insnav."""
    if isinstance(error, InsnavError):
        from insnav.cli.data_options import as_option

        error.where = as_option(error.where)
        return error
    no_memory = isinstance(error, OSError) and error.errno == errno.ENOMEM
    if isinstance(error, MemoryError) or no_memory or (isinstance(error, ImportError) and "map segment" in str(error)):
        return InputError("cli.no_memory")
    if type(error).__name__ == "UnpicklingError":  # a check by name avoids importing pickle; only numba's cache uses it
        from insnav.kernels.errorstate import propagate

        return InputError("cli.damaged_kernel", folder=str(propagate.stats.cache_path), reason=str(error))
    if hasattr(error, "format_message"):  # error of the option parser, whose type differs between releases of typer
        return usage_error(error)
    return InsnavError("cli.defect", kind=type(error).__name__, reason=str(error))
