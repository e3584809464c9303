"""Corpus file (``corpus.toml``): drives for the accuracy evaluation, each with IMU samples, fixes and reference.

[[simulated]]                 # a motion profile; each seed samples other sensor errors

name = "city"
profile = "city"              # name in the library next to the file, or a file
imu = "consumer"
gps = "single"                # preset or file

lever_arm = ["0.8 m", "-0.3 m", "-1.2 m"]
fault = ["gps-outage@220s+60s"]
seeds = 16
quick = 6                     # number of seeds in a quick run

[[recorded]]                  # a drive in the folder of recorded data; skipped if the folder is absent
name = "tokyo"
data = "ixr_tsukishima_20210412"
reference = "ref.csv"
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from insnav.attitude import quat_from_rotvec, quat_from_rph, quat_multiply, rph_from_quat
from insnav.config_file import Axes, Table, axes, read_toml, refuse, scalar, validate, wrong
from insnav.earth import lla_offset
from insnav.exceptions import ConfigError, InputError
from insnav.filter.gates import Gates
from insnav.filter.gps_noise import with_sd
from insnav.filter.prepare import first_stationary
from insnav.filter.receiver import DELAY_SD, Delay, LeverArm, Receiver
from insnav.imu import ImuSpec, identify, load_imu
from insnav.imu.imu_file import to_toml
from insnav.input import read_gps, read_imu, read_reference
from insnav.output.folder import file_sha256
from insnav.simulate.motion import load_profile
from insnav.simulate.recording import MOTION_STREAM, load_gps, parse_fault, perfect_imu, simulate_recording, times
from insnav.simulate.recording import to_toml as gps_to_toml
from insnav.simulate.truth import gps_from_truth
from insnav.types import FloatArray, GpsData, ImuData, Trajectory

Group = Literal["position", "velocity", "attitude", "heading"]
GROUPS: tuple[Group, ...] = ("position", "velocity", "attitude", "heading")
AT_REST = "at rest"  # value of `Case.imu`: identify the IMU from its noise while stationary
CORPUS_FILE = "corpus.toml"
_EXACT_SD = 1e-3  # standard deviation that error-free generated fixes report [m], [m/s]
_EXACT_RATE = 1.0  # rate of error-free fixes from a simulated truth [Hz]
_NOISE_STREAM = 7  # random stream of the noise of generated fixes
_MOTION_SEED = 1  # seed of the simulated vibration
_STEP = 1.0  # interval to which a sparse reference is interpolated [s]


class Case(Table):
    """Common fields of simulated and recorded drives."""

    name: str  # label of the results
    imu: str  # IMU preset or file; ``at rest``: identify the IMU from its noise while stationary
    # position of the antenna relative to the IMU, body axes [m]
    lever_arm: Annotated[Axes, axes("length", signed=True)] = (0.0, 0.0, 0.0)
    settle: Annotated[float, scalar("time")] = 60.0  # errors count from this time after the first fix [s]
    seeds: Annotated[int, Field(ge=1, le=1000)] = 16  # number of runs, each with different noise
    # number of runs in a quick evaluation; 0 excludes the case
    quick: Annotated[int, Field(ge=0, le=1000)] = 0
    _folder: Path = PrivateAttr(default=Path())

    @property
    def folder(self) -> Path:
        """Folder of the corpus file."""
        return self._folder

    def model(self, name: str) -> str:
        """Return the name of a preset, or the path of a file next to the corpus."""
        return str(self._folder / name) if name.endswith(".toml") else name


class SimulatedCase(Case):
    """Simulated drive: a motion profile with randomly sampled sensor errors."""

    profile: str  # motion profile: name in the folder of the corpus file, or a file
    gps: str  # GPS receiver: preset or file
    rate: Annotated[float, scalar("frequency")] = 100.0  # sampling rate of the IMU [Hz]
    fault: list[str] = Field(default_factory=list)  # faults, as for ``insnav simulate --fault``


class MadeFixes(Table):
    """Fixes generated from the reference, with noise."""

    sd: Annotated[float, scalar("length")]  # standard deviation of the white noise on each axis [m]
    interval: Annotated[float, scalar("time")] = 1.0  # time between fixes [s]


class RecordedCase(Case):
    """Recorded drive."""

    data: str  # name of its folder in the data folder
    # IMU file and GPS file in this folder
    imu_file: str = "imu.csv.gz"
    gps_file: str = "gps.csv"
    fixes: MadeFixes | None = None  # generate the fixes from the reference instead of reading `gps_file`
    reference: str = ""  # trajectory file of the antenna; empty: the fixes not used are the reference
    # navigate with every n-th fix only; the other fixes are the position reference, for a very accurate receiver
    use_every: Annotated[int, Field(ge=1, le=100)] = 1
    judge: list[Group] = Field(default_factory=lambda: list(GROUPS))  # quantities with an accurate reference
    min_speed: Annotated[float, scalar("velocity")] = 0.0  # reference epochs below this speed do not count [m/s]
    # remove a constant position difference, as from different base stations of reference and fixes
    remove_offset: bool = False
    # rotation vector from reference axes to IMU axes, body axes [rad]
    mounting: Annotated[Axes, axes("angle", signed=True)] = (0.0, 0.0, 0.0)
    block: Annotated[float, scalar("time")] = 60.0  # length of the evaluated pieces [s]
    seeds: Annotated[int, Field(ge=1, le=1000)] = 1

    @model_validator(mode="after")
    def _sound(self) -> RecordedCase:
        if self.fixes is not None and not self.reference:
            raise wrong("regress.fixes_without_reference")
        if self.seeds > 1 and self.fixes is None:
            raise wrong("regress.seeds_without_fixes")
        return self


class Corpus(Table):
    """Content of a corpus file: all cases."""

    simulated: list[SimulatedCase] = Field(default_factory=list)
    recorded: list[RecordedCase] = Field(default_factory=list)

    @property
    def cases(self) -> list[SimulatedCase | RecordedCase]:
        """All cases, simulated ones first, in the order of the file."""
        return [*self.simulated, *self.recorded]


def load_corpus(path: Path) -> Corpus:
    """Read a corpus file.

    Raises: ConfigError: no such file, invalid TOML, no case, two cases with one name, or wrong keys (all at once).
    """
    corpus = validate(Corpus, read_toml(path), str(path))
    names = [case.name for case in corpus.cases]
    if not names:
        raise ConfigError("regress.no_cases", where=str(path))
    duplicates = sorted({name for name in names if names.count(name) > 1})
    if duplicates:
        refuse([ConfigError("regress.same_name", where=name) for name in duplicates], str(path))
    for case in corpus.cases:
        case._folder = path.resolve().parent
    return corpus


def default_corpus() -> Path:
    """Find the corpus file next to the library of motion profiles. Raises: ConfigError: the file is absent."""
    from insnav.library import library

    profiles = library()
    path = profiles[0].parent / CORPUS_FILE if profiles else Path(CORPUS_FILE)
    if not path.is_file():
        raise ConfigError("regress.no_corpus", where=str(path))
    return path


def digest(case: Case, parts: Mapping[str, str]) -> str:
    """Compute a short digest of a case and its files: figures are comparable only if their digests are equal.

    `parts`: by name of each file, its text or digest.
    """
    content: dict[str, Any] = case.model_dump(exclude={"seeds", "quick"}, warnings=False)
    text = "\n".join(f"{key}={value!r}" for key, value in sorted({**content, **parts}.items()))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


@dataclass(frozen=True, slots=True)
class Material:
    """One recording to navigate, its reference, and how to evaluate the errors."""

    # input of the filter
    imu: ImuData
    gps: GpsData
    spec: ImuSpec  # IMU specification for the filter
    receiver: Receiver
    truth: Trajectory  # reference trajectory
    truth_lever_b: FloatArray  # (3,) position of its reference point relative to the IMU, body axes [m]
    exact: GpsData | None  # accurate antenna positions as reference of outages; None: the fixes
    groups: frozenset[str] = frozenset(GROUPS)  # quantities for which the reference is accurate enough
    whole_state: bool = False  # True: the reference has position, velocity and attitude in the IMU axes
    settle: float = 0.0  # errors count from this time after the first fix [s]
    min_speed: float = 0.0  # reference epochs below this speed do not count [m/s]
    remove_offset: bool = False  # remove a constant position difference
    block: float = 0.0  # length of the evaluated pieces [s]; zero for a single piece
    gates: Gates = field(default_factory=Gates)  # innovation gates of the filter


class SimulatedSource:
    """Source of the simulated recordings of a case."""

    def __init__(self, case: SimulatedCase) -> None:
        self._case = case
        name: str | Path = case.folder / case.profile if case.profile.endswith(".toml") else case.profile
        profile = load_profile(name, case.folder)
        self._truth = profile.truth((_MOTION_SEED, MOTION_STREAM))
        self._spec = load_imu(case.model(case.imu))
        self._gps = replace(load_gps(case.model(case.gps)), lever_b=case.lever_arm)
        self._perfect = perfect_imu(self._truth, case.rate)
        self._faults = tuple(parse_fault(text) for text in case.fault)
        lever_b = np.array(case.lever_arm)
        exact = gps_from_truth(self._truth, times(self._truth, _EXACT_RATE)[1:], lever_b)
        sd = np.full_like(exact.lla, _EXACT_SD)
        self._exact = replace(exact, position_sd=sd, velocity_sd=sd)
        self._receiver = Receiver(LeverArm(lever_b), Delay(sd=DELAY_SD))
        self.files: dict[str, str] = {}
        self.digest = digest(case, {"profile": profile.text, "imu": to_toml(self._spec), "gps": gps_to_toml(self._gps)})

    def material(self, seed: int) -> Material:
        """Simulate the recording with the sensor errors of one seed."""
        drive = simulate_recording(self._truth, self._spec, self._gps, seed, faults=self._faults, perfect=self._perfect)
        return Material(
            drive.imu,
            drive.gps,
            self._spec,
            self._receiver,
            drive.reference,
            np.zeros(3),
            self._exact,
            whole_state=True,
            settle=self._case.settle,
        )


class RecordedSource:
    """Source of the recorded drive of a case. Raises: InputError: a file is missing or cannot be used."""

    def __init__(self, case: RecordedCase, data: Path) -> None:
        self._case = case
        folder = data / case.data
        names = [case.imu_file, *([] if case.fixes else [case.gps_file]), *filter(None, [case.reference])]
        missing = [name for name in names if not (folder / name).is_file()]
        if missing:
            raise InputError("regress.missing_file", where=str(folder / missing[0]), case=case.name)
        self.files = {name: file_sha256(folder / name) for name in names}
        self._imu = read_imu(folder / case.imu_file).data
        reference = read_reference(folder / case.reference) if case.reference else None
        self._lever_b = np.array(case.lever_arm)
        exact = None
        if case.fixes is None:
            gps = read_gps(folder / case.gps_file).data
        else:
            assert reference is not None
            gps = exact = _fixes_on(reference.data, case.fixes.interval)
        if reference is not None:
            valid = np.ones(len(reference.data.time), dtype=np.bool_) if reference.fix is None else reference.fix == 1
            truth = reference.data.rows(valid)
            if len(truth.time) > 1 and np.median(np.diff(truth.time)) > _STEP:
                truth = _filled(truth, _STEP)
            if reference.fix is not None:
                exact = _as_fixes(truth)
        else:
            valid = np.ones(len(gps.time), dtype=np.bool_) if gps.fix is None else gps.fix == 1
            exact = gps.rows(valid)
            # no reference file: fixes that the filter does not use are the reference
            used = np.arange(len(gps.time)) % case.use_every == 0
            unused = gps.rows(valid & ~used)
            if not len(unused.time):
                raise InputError("regress.no_reference_fix", where=case.name)
            truth = Trajectory(unused.time, unused.lla, unused.v_n, np.full_like(unused.lla, np.nan))
            gps = gps.rows(used)
        self._gps, self._exact = gps, exact
        if any(case.mounting):
            attitude = quat_multiply(quat_from_rph(truth.rph), quat_from_rotvec(np.array(case.mounting)))
            truth = replace(truth, rph=rph_from_quat(attitude))
        self._truth = truth
        self._spec = self._model()
        self.digest = digest(case, {**self.files, "imu": "" if case.imu == AT_REST else to_toml(self._spec)})

    def _model(self) -> ImuSpec:
        if self._case.imu != AT_REST:
            return load_imu(self._case.model(self._case.imu))
        stationary = first_stationary(self._imu, with_sd(self._gps)[0])
        if stationary is None:
            raise InputError("regress.never_stationary", where=self._case.name)
        return identify(self._imu, *stationary)[0]

    def material(self, seed: int) -> Material:
        """Return the recording; if the case has generated fixes, they have the noise of this seed."""
        case, gps = self._case, self._gps
        if case.fixes is not None:
            noise = case.fixes.sd * np.random.default_rng((seed, _NOISE_STREAM)).standard_normal(gps.lla.shape)
            unknown = np.full_like(gps.lla, np.nan)
            sd = np.full_like(gps.lla, case.fixes.sd)
            gps = GpsData(gps.time, lla_offset(gps.lla, noise), unknown, sd, unknown)
        return Material(
            self._imu,
            gps,
            self._spec,
            Receiver(LeverArm(self._lever_b), Delay(sd=DELAY_SD)),
            self._truth,
            self._lever_b,
            self._exact,
            frozenset(case.judge),
            settle=case.settle,
            min_speed=case.min_speed,
            remove_offset=case.remove_offset,
            block=case.block if case.seeds == 1 else 0.0,
        )


Source = SimulatedSource | RecordedSource  # both have `digest`, of all inputs that determine their recordings


def source_of(case: SimulatedCase | RecordedCase, data: Path) -> Source:
    """Build the source of a case's recordings; see the classes for errors."""
    return SimulatedSource(case) if isinstance(case, SimulatedCase) else RecordedSource(case, data)


def _filled(truth: Trajectory, step: float) -> Trajectory:
    """Interpolate a sparse reference, such as of a stationary vehicle, to every `step` [s]; attitude becomes NaN."""
    time = np.arange(truth.time[0], truth.time[-1], step)

    def on(values: FloatArray) -> FloatArray:
        return np.column_stack([np.interp(time, truth.time, column) for column in values.T])

    return Trajectory(time, on(truth.lla), on(truth.v_n), np.full((len(time), 3), np.nan))


def _fixes_on(reference: Trajectory, interval: float) -> GpsData:
    """Generate error-free fixes from a reference, every `interval` [s]."""
    if np.median(np.diff(reference.time)) > interval:
        reference = _filled(reference, interval)
    step = max(1, round(interval / float(np.median(np.diff(reference.time)))))
    return _as_fixes(reference.rows(slice(None, None, step)))


def _as_fixes(truth: Trajectory) -> GpsData:
    sd = np.full_like(truth.lla, _EXACT_SD)
    return GpsData(truth.time, truth.lla, truth.v_n, sd, sd)
