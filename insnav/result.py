"""Results of commands and of the methods of `insnav.session.drive.Drive`: one class for all.

A result contains the outcome, its inputs and its options. ``insnav.report.<kind>`` provides its page, tables and
figures, and is imported on first use.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar, cast

from insnav.deferred import library
from insnav.exceptions import as_keywords
from insnav.findings import Finding
from insnav.imu.specification import ImuSpec
from insnav.input.readers.reading import ReadingFacts
from insnav.messages import language
from insnav.output.folder import RunFolder

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from insnav.report.page import Page

F = TypeVar("F")
# modules imported on first use: they import this module, so it cannot import them at once
_save, _html, _run = (library(f"insnav.report.{name}") for name in ("save", "html", "run.page"))


@dataclass(frozen=True, slots=True)
class StepRecord:
    """Record of one processing step from a recording to a result; see `insnav.steps`."""

    name: str
    findings: tuple[Finding, ...]  # findings of the step
    time_s: float  # computing time, wall clock [s]


@dataclass(frozen=True)
class Result(Generic[F]):
    """Result of a command or method, with its inputs and options.

    Attributes
    ----------
    kind : str
        Name of its report in `insnav.report`: ``run``, ``outage``, ``budget``, …
    found : object
        Outcome, such as `insnav.errors.evaluated_run.EvaluatedRun`.
    inputs : mapping of str to ReadingFacts
        Interpretation of each input: ``imu``, ``gps``, ``reference``.
    options : mapping
        Options in force, ready for JSON.
    imu_model : (ImuSpec, Finding) or None
        IMU error specification, and the finding on its choice.
    findings : tuple of Finding
        All findings, most important first.
    steps : tuple of StepRecord
        Executed steps, in order; empty for a result read from a folder.
    explanation : insnav.explain.explanation.Explanation or None
        Faults found in the record, and alternatives considered; None if insnav did not search for faults.
    """

    kind: str
    found: F
    inputs: Mapping[str, ReadingFacts] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    imu_model: tuple[ImuSpec, Finding] | None = None
    findings: tuple[Finding, ...] = ()
    steps: tuple[StepRecord, ...] = ()
    explanation: Any = None

    def __repr__(self) -> str:
        sources = ", ".join(facts.path for facts in self.inputs.values())
        head = f"Result: {self.kind} of {sources}" if sources else f"Result: {self.kind}"
        return as_keywords("\n".join([head, *_save.key_lines(self)]))

    def __getattr__(self, name: str) -> Any:
        if name in ("notes", "events"):  # attributes of version 0.2
            raise AttributeError(f"Result.{name} is gone: use Result.findings")
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def page(self) -> Page:
        """Build the page of the result: sections of quantities and figures.

        Returns
        -------
        Page
        """
        if language() not in self._pages:
            self._pages[language()] = cast("Page", _save.page_of(self))
        return self._pages[language()]

    @cached_property
    def _pages(self) -> dict[str, Page]:
        """Pages built so far, by language."""
        return {}

    @property
    def laid_out(self) -> Page | None:
        """Page in the current language, or None if it is not built yet."""
        return self._pages.get(language())

    def save(
        self,
        folder: str | Path,
        *,
        force: bool = False,
        figures: Literal["page", "png", "svg", "none"] = "page",
        table_format: Literal["csv", "parquet"] = "csv",
    ) -> Path:
        """Write tables, figures, page and ``run.json`` into a new folder.

        Parameters
        ----------
        folder : str or Path
            Folder to create; it appears only when it is complete.
        force : bool
            Replace an existing result of insnav.
        figures : {"page", "png", "svg", "none"}
            Files of figures: ``png`` and ``svg`` write all figures in this format, for papers. ``page`` writes only
            figures that the page embeds. ``none`` writes neither figures nor page.
        table_format : {"csv", "parquet"}

        Returns
        -------
        Path
            Path of the finished folder.

        Raises
        ------
        OutputError
            The folder exists already, or cannot be written.
        """
        with RunFolder(Path(folder), force=force) as place:
            return cast(Path, _save.save_result(self, place, figures=figures, table_format=table_format))

    def plot(self, name: str = "") -> Figure:
        """Draw one figure of the page.

        Parameters
        ----------
        name : str
            Name of the figure, such as ``position_error`` or ``track``; by default the first figure.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        ConfigError
            The result has no figure of this name; the message lists the known names.
        """
        return cast("Figure", _save.figure(self, name))

    @property
    def accuracy(self) -> dict[str, dict[str, float]]:
        """Figures of merit of a run by solution, the best first, such as ``accuracy["smoothed"]["heading_deg"]``.

        They are RMS errors against the reference. Without a reference they are stated standard deviations, with ``sd_``
        before the name. Empty for other kinds of result.
        """
        return cast("dict[str, dict[str, float]]", _run.accuracy(self.found) if self.kind == "run" else {})

    def to_frame(self, solution: Literal["best", "smoothed", "filtered"] = "best") -> pd.DataFrame:
        """Return the main table of the result, units in the column names.

        Parameters
        ----------
        solution : {"best", "smoothed", "filtered"}
            Solution of a run; ``best`` is smoothed if available. Other kinds of result have one table, ``best``.

        Returns
        -------
        pandas.DataFrame
            For a run, one row per epoch: ``time_s``, ``lat_deg``, ``lon_deg``, ``height_m``, ``vn_m_s``, ``ve_m_s``,
            ``vd_m_s``, ``roll_deg``, ``pitch_deg``, ``heading_deg`` and their standard deviations ``sd_n_m``,
            ``sd_e_m``, ``sd_d_m``, ``sd_vn_m_s``, ``sd_ve_m_s``, ``sd_vd_m_s``, ``sd_roll_deg``, ``sd_pitch_deg``,
            ``sd_heading_deg``. For other kinds of result, the main table.

        Raises
        ------
        ConfigError
            The result does not have this solution.
        """
        return cast("pd.DataFrame", _save.frame(self, solution))

    def summary(self) -> str:
        """Return the result as text: a run in short form, other kinds in full, with keywords instead of options.

        Returns
        -------
        str
            Lines without control characters.
        """
        return as_keywords(_save.text_of(self))

    def _repr_html_(self) -> str:
        """Display the result in a notebook: figures of merit, map, first figure, tables."""
        return str(_html.page_fragment(self.page()))


def open_result(folder: str | Path) -> Result[Any]:
    """Read a saved result.

    Parameters
    ----------
    folder : str or Path
        Folder written by `Result.save` or by the command line.

    Returns
    -------
    Result

    Raises
    ------
    InputError
        The folder is not a result, is damaged, or is of another version.
    """
    return cast("Result[Any]", _save.open_folder(Path(folder)))
