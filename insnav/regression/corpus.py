"""The corpus file (``corpus.toml``): the drives on which accuracy is evaluated, with everything they need.

[[simulated]]                 # a motion profile with sensors sampled from the models, once a seed
name = "city"
profile = "city"              # name in the library next to the file, or a file
imu = "consumer"
gps = "single"                # preset or file
lever_arm = ["0.8 m", "-0.3 m", "-1.2 m"]
fault = ["gps-outage@220s+60s"]
seeds = 16
quick = 6                     # of these in a quick run

[[recorded]]                  # a drive in the folder of recorded data; skipped where that is absent
name = "tokyo"
data = "ixr_tsukishima_20210412"
reference = "ref.csv"
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PrivateAttr, model_validator

from insnav.config_file import Axes, Table, axes, read_toml, refuse, scalar, validate, wrong
from insnav.exceptions import ConfigError

Group = Literal["position", "velocity", "attitude", "heading"]
GROUPS: tuple[Group, ...] = ("position", "velocity", "attitude", "heading")
AT_REST = "at rest"  # IMU model by the noise at rest
CORPUS_FILE = "corpus.toml"


class Case(Table):
    """What simulated and recorded drives have in common."""

    name: str  # shown with its results
    imu: str  # preset or file; ``at rest`` for the preset nearest to the noise at rest
    # antenna seen from the IMU, body axes [m]
    lever_arm: Annotated[Axes, axes("length", signed=True)] = (0.0, 0.0, 0.0)
    settle: Annotated[float, scalar("time")] = 60.0  # errors count from so long after the first fix [s]
    seeds: Annotated[int, Field(ge=1, le=1000)] = 16  # repetitions with other noise
    # how many of them a quick run makes; none leaves the case out of it
    quick: Annotated[int, Field(ge=0, le=1000)] = 0
    _folder: Path = PrivateAttr(default=Path())

    @property
    def folder(self) -> Path:
        """Where the corpus file is."""
        return self._folder

    def model(self, name: str) -> str:
        """Name of a preset, or path of a file next to the corpus."""
        return str(self._folder / name) if name.endswith(".toml") else name


class SimulatedCase(Case):
    """A motion profile with randomly sampled sensors."""

    profile: str  # name in the folder of the corpus file
    gps: str  # receiver: preset or file
    rate: Annotated[float, scalar("frequency")] = 100.0  # of the IMU [Hz]
    fault: list[str] = Field(default_factory=list)  # what goes wrong, as for ``insnav simulate --fault``


class MadeFixes(Table):
    """Fixes made from the reference, with noise."""

    sd: Annotated[float, scalar("length")]  # white noise on each axis [m]
    interval: Annotated[float, scalar("time")] = 1.0  # between fixes [s]


class RecordedCase(Case):
    """A recorded drive."""

    data: str  # name of its folder
    # in the folder
    imu_file: str = "imu.csv.gz"
    gps_file: str = "gps.csv"
    fixes: MadeFixes | None = None  # make the fixes from the reference instead
    reference: str = ""  # file with the reference, which is of the antenna; without it the fixes that are not used
    # only every n-th fix is used, and the others are a reference of position: for receivers better than the rest of the
    # system
    use_every: Annotated[int, Field(ge=1, le=100)] = 1
    judge: list[Group] = Field(default_factory=lambda: list(GROUPS))  # what the reference is accurate enough for
    min_speed: Annotated[float, scalar("velocity")] = 0.0  # slower epochs of the reference do not count [m/s]
    # a constant difference of position is no error: reference and fixes have base stations of their own
    remove_offset: bool = False
    # rotation vector from the axes of the reference to those of the IMU, body axes [rad]
    mounting: Annotated[Axes, axes("angle", signed=True)] = (0.0, 0.0, 0.0)
    block: Annotated[float, scalar("time")] = 60.0  # the drive is evaluated in pieces of this length [s]
    seeds: Annotated[int, Field(ge=1, le=1000)] = 1

    @model_validator(mode="after")
    def _sound(self) -> RecordedCase:
        if self.fixes is not None and not self.reference:
            raise wrong("regress.fixes_without_reference")
        if self.seeds > 1 and self.fixes is None:
            raise wrong("regress.seeds_without_fixes")
        return self


class Corpus(Table):
    """All drives."""

    # the cases
    simulated: list[SimulatedCase] = Field(default_factory=list)
    recorded: list[RecordedCase] = Field(default_factory=list)

    @property
    def cases(self) -> list[SimulatedCase | RecordedCase]:
        """All of them, in order."""
        return [*self.simulated, *self.recorded]


def load_corpus(path: Path) -> Corpus:
    """Read a corpus file.

    Raises: ConfigError: no such file, no TOML, unknown or wrong keys, two cases of one name: all of it at once.
    """
    corpus = validate(Corpus, read_toml(path), str(path))
    names = [case.name for case in corpus.cases]
    if not names:
        raise ConfigError("regress.no_cases", where=str(path))
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        refuse([ConfigError("regress.same_name", where=name) for name in twice], str(path))
    for case in corpus.cases:
        case._folder = path.resolve().parent
    return corpus


def default_corpus() -> Path:
    """Find the corpus file of the library of profiles.

    Raises: ConfigError: it is not here.
    """
    from insnav.library import library

    profiles = library()
    path = profiles[0].parent / CORPUS_FILE if profiles else Path(CORPUS_FILE)
    if not path.is_file():
        raise ConfigError("regress.no_corpus", where=str(path))
    return path


def digest(case: Case, parts: Mapping[str, str]) -> str:
    """Short digest of a case and of all files behind it: figures of other cases are not comparable.

    `parts`: text or digest of the files.
    """
    content: dict[str, Any] = case.model_dump(exclude={"seeds", "quick"}, warnings=False)
    text = "\n".join(f"{key}={value!r}" for key, value in sorted({**content, **parts}.items()))
    return hashlib.sha256(text.encode()).hexdigest()[:12]
