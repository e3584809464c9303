"""A simulated drive: a motion that is exactly known, measured by sensors that are sampled from their specifications."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypedDict, Unpack

from insnav import steps
from insnav.exceptions import InputError
from insnav.imu import load_imu
from insnav.imu.specification import ImuSpec
from insnav.input import Reading, read_reference
from insnav.session.drive import Drive, drive_of
from insnav.session.read import in_memory
from insnav.simulate.faults import Fault, parse_fault
from insnav.simulate.gps_errors import GpsSpec
from insnav.simulate.gps_file import load_gps
from insnav.simulate.montecarlo import run_seed
from insnav.simulate.motion import load_profile
from insnav.simulate.recording import MOTION_STREAM, Recording, perfect_imu, simulate_recording, temperature_ramp
from insnav.simulate.truth import Truth
from insnav.simulate.truth_from_track import Residual, track_residual, truth_from_track
from insnav.steps.given import one_of
from insnav.steps.inputs import Inputs
from insnav.types import Sampling, Trajectory

IDEAL = "ideal"  # name of a sensor without errors


class SimulationOptions(TypedDict, total=False):
    """How a motion is measured."""

    # IMU and receiver: a preset, a file, ``ideal`` for one without errors, or a specification
    imu: str | ImuSpec
    gps: str | GpsSpec
    seed: int  # random seed
    run: int | None  # number of a run of a series of this seed; by default not one of a series
    rate: float  # samples per second [Hz]
    sampling: Sampling  # what a sample is
    faults: Sequence[str]  # what goes wrong: ``gps-outage@200s+30s``
    temperature: tuple[float, float] | None  # of the IMU at the start and at the end [deg C]
    gravity: Literal["full", "plumb", "linear"]  # as it is; without its north component; and linear in height


@dataclass(frozen=True, slots=True)
class Motion:
    """A motion to be measured."""

    name: str
    purpose: str
    truth: Truth
    profile: str = ""  # text of the motion profile; empty if the motion is that of a recorded track
    track: Reading[Trajectory] | None = None  # track that the motion is a simulated replica of
    residual: Residual | None = None  # how far the replica is from its track

    @property
    def source(self) -> dict[str, str]:
        """File and digest of the track, for ``run.json``."""
        return {} if self.track is None else {"track": self.track.facts.path, "track_sha256": self.track.facts.sha256}


@dataclass(frozen=True, slots=True)
class Plan:
    """Everything a simulation is made from."""

    motion: Motion
    # sensors; None for ideal ones
    imu: ImuSpec | None
    gps: GpsSpec | None
    seed: int = 1  # random seed
    rate: float = 100.0  # of the IMU [Hz]
    sampling: Sampling = "mean"  # what its samples are
    faults: tuple[Fault, ...] = ()  # what goes wrong
    temperature: tuple[float, float] | None = None  # of the IMU at the start and at the end [deg C]
    configuration: Mapping[str, Any] = field(default_factory=dict)  # options as given

    @property
    def truth(self) -> Truth:
        """The motion itself."""
        return self.motion.truth

    def measured(self) -> Recording:
        """Measure the motion once."""
        perfect = perfect_imu(self.truth, self.rate, self.sampling)
        return simulate_recording(
            self.truth,
            self.imu,
            self.gps,
            self.seed,
            faults=self.faults,
            temperature=temperature_ramp(perfect, self.temperature),
            perfect=perfect,
        )


def simulate(profile: str | Path, **options: Unpack[SimulationOptions]) -> Drive:
    """Simulate a drive, with the exact motion as its reference.

    Parameters
    ----------
    profile : str or Path
        Name or file of a motion profile; a run folder or track file becomes a replica with ``insnav simulate --from``.
    **options
        IMU, receiver, seed, faults and more, as in `SimulationOptions`.

    Returns
    -------
    Drive
        Numbers are those of ``insnav simulate`` before they are written to files.

    Raises
    ------
    ConfigError
        An unknown profile, model or fault, or one that changes nothing.

    Examples
    --------
    >>> drive = insnav.simulate("city", imu="automotive", seed=1)  # doctest: +SKIP
    >>> drive.navigate().plot("position_error")  # doctest: +SKIP
    """
    for name in options:
        one_of("simulate", name, tuple(SimulationOptions.__annotations__))
    plan = plan_of(profiled(profile, options.get("seed", 1)), options)
    made = plan.measured()
    inputs: Inputs = {"imu_model": plan.imu, "lever_arm": made.lever_b}
    recording = steps.Recording(
        in_memory(made.imu, "IMU", f"simulated {plan.motion.name}"),
        in_memory(made.gps, "GPS", f"simulated {plan.motion.name}"),
        in_memory(made.reference, "reference", "exact motion"),
        {},
        inputs,
    )
    return drive_of(recording)


def plan_of(motion: Motion, options: SimulationOptions, configuration: Mapping[str, Any] | None = None) -> Plan:
    """Look up the models of a simulation; see `SimulationOptions`."""
    imu, gps = options.get("imu", "consumer"), options.get("gps", "single")
    seed, run = options.get("seed", 1), options.get("run")
    dataclass_of: Any = motion.truth  # every truth is one, which its base class cannot say
    truth: Truth = replace(dataclass_of, gravity=options.get("gravity", "full"))
    return Plan(
        replace(motion, truth=truth),
        imu if isinstance(imu, ImuSpec) else None if imu == IDEAL else load_imu(imu),
        gps if isinstance(gps, GpsSpec) else None if gps == IDEAL else load_gps(gps),
        seed if run is None else run_seed(seed, run),
        options.get("rate", 100.0),
        options.get("sampling", "mean"),
        tuple(parse_fault(text) for text in options.get("faults", ())),
        options.get("temperature"),
        configuration or {},
    )


def profiled(name: str | Path, seed: int) -> Motion:
    """Motion of a profile, by its name or file."""
    profile = load_profile(name)
    return Motion(profile.name, profile.purpose, profile.truth((seed, MOTION_STREAM)), profile.text)


def replica(source: Path) -> Motion:
    """Motion of a recorded track: the smoothed solution of a run folder, or its solution, or a file.

    Raises: InputError: the folder holds no solution, or the track cannot be used.
    """
    track = source
    if source.is_dir():
        names = [f"{stem}.{kind}" for stem in ("smoothed", "solution") for kind in ("csv", "parquet")]
        found = next((source / name for name in names if (source / name).is_file()), None)
        if found is None:
            raise InputError("session.no_solution", where=str(source), names=tuple(names))
        track = found
    reading = read_reference(track)
    truth = truth_from_track(reading.data)
    name = f"replica of {source.name or source.resolve().name}"
    return Motion(name, "", truth, track=reading, residual=track_residual(truth, reading.data))
