"""All drives of a corpus, navigated on several processors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from insnav.engine import Workers, every
from insnav.exceptions import InsnavError
from insnav.findings import Code, ErrorFacts, Finding
from insnav.regression.cases import Source, source_of
from insnav.regression.corpus import Corpus, RecordedCase, SimulatedCase
from insnav.regression.evaluate import NOTHING, Measured, joined, measure
from insnav.simulate.montecarlo import run_seed

AnyCase = SimulatedCase | RecordedCase
SERIES = 8  # seed of all seeds


@dataclass(frozen=True, slots=True)
class CaseResult:
    """Accuracy of one case."""

    digest: str  # of the case and all files behind it
    pieces: bool  # values are those of successive pieces of one drive, else of independent drives
    measured: Measured  # without values if every drive failed
    failures: Mapping[int, ErrorFacts | None]  # of drives by their numbers, from 1; None in a baseline
    files: dict[str, str]  # digest of each recorded file


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Accuracy of the whole corpus."""

    cases: dict[str, CaseResult]  # by name
    skipped: dict[str, Finding]  # name of each case that was left out, and why
    quick: bool  # only a part was run


@dataclass(frozen=True, slots=True)
class _Outcome:
    """Accuracy of one drive, or the error it ended in."""

    digest: str
    files: dict[str, str]
    measured: Measured | None
    error: ErrorFacts | None = None


def run_corpus(
    corpus: Corpus,
    data: Path,
    *,
    quick: bool = False,
    workers: Workers = 1,
    progress: Callable[[float], None] | None = None,
) -> Accuracy:
    """Navigate all drives.

    Raises: ConfigError: no worker, or a profile or model that a case names is wrong.
    """
    skipped: dict[str, Finding] = {}
    jobs: list[tuple[AnyCase, int]] = []
    for case in corpus.cases:
        if isinstance(case, RecordedCase) and not (data / case.data).is_dir():
            no_data = Finding.of(Code.REGRESSION_NO_DATA, subject=case.name, data=str(case.data), folder=str(data))
            skipped[case.name] = no_data
            continue
        count = min(case.quick, case.seeds) if quick else case.seeds
        if not count:
            skipped[case.name] = Finding.of(Code.REGRESSION_NOT_QUICK, subject=case.name)
        jobs += [(case, number) for number in range(1, count + 1)]
    outcomes: dict[str, list[_Outcome]] = {}
    for (case, _), outcome in zip(jobs, every(_attempt, jobs, workers, (data,), progress), strict=True):
        outcomes.setdefault(case.name, []).append(outcome)
    by_name = {case.name: case for case in corpus.cases}
    return Accuracy({name: _case(by_name[name], each) for name, each in outcomes.items()}, skipped, quick)


def _case(case: AnyCase, outcomes: list[_Outcome]) -> CaseResult:
    failures = {number: each.error for number, each in enumerate(outcomes, start=1) if each.error is not None}
    measured = joined([each.measured or NOTHING for each in outcomes])
    pieces = isinstance(case, RecordedCase) and case.seeds == 1
    return CaseResult(outcomes[0].digest, pieces, measured, failures, outcomes[0].files)


_made: dict[str, Source] = {}  # of the case this process is at


def _attempt(data: Path, job: tuple[AnyCase, int]) -> _Outcome:
    case, number = job
    key = f"{case.folder} {case.name} {case!r}"
    if key not in _made:
        _made.clear()
        _made[key] = source_of(case, data)
    source = _made[key]
    try:
        measured = measure(source.material(run_seed(SERIES, number)))
    except InsnavError as error:
        return _Outcome(source.digest, source.files, None, error.facts)
    return _Outcome(source.digest, source.files, measured)
