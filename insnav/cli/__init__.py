"""Command line: one thin file a command. Heavy imports happen inside the command, mathematics elsewhere."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

import typer

from insnav.cli import align, compare, run
from insnav.cli.console import error_block

EPILOG = (
    "Every command has examples: insnav COMMAND --help. Exit codes: 0 ok, 1 a check failed, 2 usage, 3 input, 4 output."
)

app = typer.Typer(
    name="insnav",
    help="Strapdown INS / GPS navigation and INS error analysis.",
    no_args_is_help=True,
    add_completion=False,
    epilog=EPILOG,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
app.command("run", help=run.HELP)(run.run)
app.command("align", help=align.HELP)(align.align)
app.command("compare", help=compare.HELP)(compare.compare)


def _version(value: bool) -> None:
    if value:
        from insnav import __version__

        print(f"insnav {__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Print the version."),
    debug: bool = typer.Option(False, "--debug", help="Show the traceback of an error."),
) -> None:
    pass


def _terminated(number: int, frame: FrameType | None) -> None:
    sys.exit(128 + number)  # unwinds, so that half-written folders are removed


def main() -> None:
    """Run the command line and end the process with its exit code."""
    from insnav.exceptions import InsnavError

    debug = "--debug" in sys.argv
    if debug:  # wherever it stands
        sys.argv.remove("--debug")
    signal.signal(signal.SIGTERM, _terminated)
    try:
        app()
    except InsnavError as error:
        if debug:
            raise
        error_block(error.what, error.details())
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        error_block("interrupted", ())
        sys.exit(130)
    except BrokenPipeError:
        # the reader went away, as `| head` does; nothing more can be said there
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(141)
    except Exception as error:
        if debug:
            raise
        error_block(
            "this is a defect of insnav",
            (
                ("why", f"{type(error).__name__}: {error}"),
                ("fix", "repeat with --debug and report what it prints"),
            ),
        )
        sys.exit(70)
