"""The accuracy of this version against the baseline, the same for the command line and a notebook."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from insnav.engine import Workers
from insnav.regression.baseline import BASELINE_FILE, Baseline, read_baseline
from insnav.regression.corpus import default_corpus, load_corpus
from insnav.regression.history import HISTORY_FILE, Entry, entry, read_history, with_entry
from insnav.regression.peers.run_peers import PeerRow, run_peers
from insnav.regression.provenance import Origin, origin
from insnav.regression.run_corpus import Accuracy, run_corpus
from insnav.regression.verdict import Comparison, compare
from insnav.result import Result


@dataclass(frozen=True)
class Regression:
    """Accuracy of this version, and what changed since the baseline."""

    accuracy: Accuracy
    baseline: Baseline | None
    origin: Origin  # of this version
    history: tuple[Entry, ...] = ()  # oldest first; this version is the last unless only a part was run
    peers: tuple[PeerRow, ...] = ()  # other programs

    @cached_property
    def comparison(self) -> Comparison | None:
        """Changes since the baseline, if there is one."""
        return None if self.baseline is None else compare(self.accuracy, self.baseline)


def regress(
    corpus: str | Path | None = None,
    data: str | Path | None = None,
    *,
    reports: str | Path | None = None,
    quick: bool = False,
    peers: bool = False,
    workers: Workers = "processes",
    stage: Callable[[str, float | None], None] = lambda name, fraction: None,
) -> Result[Regression]:
    """Navigate all drives of a corpus, and compare the accuracy with that of the baseline.

    Parameters
    ----------
    corpus : path, optional
        The drives, by default ``trajectories/corpus.toml`` of insnav.
    data : path, optional
        Folder of recorded drives, by default ``shared/data`` beside the project.
    reports : path, optional
        Folder of the baseline and the history, by default ``reports`` beside the folder of the corpus.
    quick, peers : bool
        Run only some cases; run pyins and GTSAM too, where they are installed.
    workers, stage
        Where to compute; called with the name of each stage of the work and the fraction that is done.

    Returns
    -------
    Result of Regression
        ``found.comparison.passed``: no figure of merit is worse than in the baseline.

    Raises
    ------
    ConfigError, InputError
        The corpus, the baseline or the history cannot be read.
    """
    file = default_corpus() if corpus is None else Path(corpus).resolve()
    drives, project = load_corpus(file), file.resolve().parent.parent
    recorded = project.parent / "shared" / "data" if data is None else Path(data)
    folder = project / "reports" if reports is None else Path(reports)
    baseline, history = read_baseline(folder / BASELINE_FILE), read_history(folder / HISTORY_FILE)
    stage("navigating", None)
    accuracy = run_corpus(
        drives, recorded, quick=quick, workers=workers, progress=lambda fraction: stage("navigating", fraction)
    )
    rows = []
    if peers:
        stage("peers", None)
        rows = run_peers(drives, recorded, workers=workers, progress=lambda fraction: stage("peers", fraction))
    found = Regression(accuracy, baseline, origin(file.parent), tuple(history), tuple(rows))
    if not quick:
        found = replace(found, history=tuple(with_entry(history, entry(accuracy, found.comparison, found.origin))))
    options = {"corpus": file, "data": recorded, "reports": folder, "quick": quick, "peers": peers}
    return Result("regression", found, options=options)
