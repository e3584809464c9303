"""Simulated drive: an exactly known motion, measured by sensors that are sampled from their specifications."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypedDict

from insnav import steps
from insnav.exceptions import InputError
from insnav.imu import load_imu
from insnav.imu.specification import ImuSpec
from insnav.input import Reading, read_reference
from insnav.session.drive import Drive, drive_of
from insnav.session.read import in_memory
from insnav.simulate.montecarlo import run_seed
from insnav.simulate.motion import load_profile
from insnav.simulate.recording import (
    MOTION_STREAM,
    Fault,
    Recording,
    load_gps,
    parse_fault,
    perfect_imu,
    simulate_recording,
    temperature_ramp,
)
from insnav.simulate.sensor_errors import GpsSpec
from insnav.simulate.truth import Truth
from insnav.simulate.truth_from_track import Residual, track_residual, truth_from_track
from insnav.steps.inputs import Inputs
from insnav.types import Sampling, Trajectory

IDEAL = "ideal"  # name of a sensor without errors


class SimulationOptions(TypedDict, total=False):
    """Options of a simulation."""

    # IMU and receiver: a preset, a file, ``ideal`` for no errors, or a specification
    imu: str | ImuSpec
    gps: str | GpsSpec
    seed: int  # random seed
    run: int | None  # number of a run in the series of this seed; by default no series
    rate: float  # samples per second [Hz]
    sampling: Sampling  # type of a sample: mean, instantaneous value or increment
    faults: Sequence[str]  # simulated faults: ``gps-outage@200s+30s``
    temperature: tuple[float, float] | None  # IMU temperature at the start and at the end [deg C]
    gravity: Literal["full", "plumb", "linear"]  # gravity model; see `insnav.simulate.truth.Truth`


@dataclass(frozen=True, slots=True)
class Motion:
    """Motion that the simulated sensors measure."""

    name: str
    purpose: str
    truth: Truth
    profile: str = ""  # text of the motion profile; empty for the motion of a recorded track
    track: Reading[Trajectory] | None = None  # original track of a simulated replica
    residual: Residual | None = None  # deviation of the replica from its track

    @property
    def source(self) -> dict[str, str]:
        """File and digest of the track, for ``run.json``."""
        return {} if self.track is None else {"track": self.track.facts.path, "track_sha256": self.track.facts.sha256}


@dataclass(frozen=True, slots=True)
class Plan:
    """Complete input of a simulation."""

    motion: Motion
    # sensors; None for ideal ones
    imu: ImuSpec | None
    gps: GpsSpec | None
    seed: int = 1  # random seed
    rate: float = 100.0  # sampling rate of the IMU [Hz]
    sampling: Sampling = "mean"  # type of the IMU samples
    faults: tuple[Fault, ...] = ()  # simulated faults
    temperature: tuple[float, float] | None = None  # IMU temperature at the start and at the end [deg C]
    configuration: Mapping[str, Any] = field(default_factory=dict)  # options as the user specified them

    @property
    def truth(self) -> Truth:
        """Exact motion."""
        return self.motion.truth

    def measured(self) -> Recording:
        """Simulate the sensor data of the motion."""
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


def simulate(
    profile: str | Path,
    *,
    imu: str | ImuSpec = "consumer",
    gps: str | GpsSpec = "single",
    seed: int = 1,
    run: int | None = None,
    rate: float = 100.0,
    sampling: Sampling = "mean",
    faults: Sequence[str] = (),
    temperature: tuple[float, float] | None = None,
    gravity: Literal["full", "plumb", "linear"] = "full",
) -> Drive:
    """Simulate a drive, with the exact motion as its reference.

    Parameters
    ----------
    profile : str or Path
        Name or file of a motion profile; a run folder or track file becomes a replica with ``insnav simulate --from``.
    imu, gps : str, ImuSpec or GpsSpec
        A preset, a file, ``ideal`` for no errors, or a specification.
    seed : int
        Random seed.
    run : int, optional
        Number of a run in the series of this seed.
    rate : float
        Samples per second [Hz].
    sampling : {"mean", "instant", "increment"}
        Mean over the interval, value at an instant, or integral over the interval.
    faults : sequence of str
        Simulated faults, such as ``gps-outage@200s+30s``.
    temperature : (float, float), optional
        Temperature of the IMU at the start and at the end [deg C].
    gravity : {"full", "plumb", "linear"}
        Normal gravity: full, without its north component, or also linear in height.

    Returns
    -------
    Drive
        Drive with the same numbers as ``insnav simulate`` has before it writes files.

    Raises
    ------
    ConfigError
        Unknown profile, model or fault, or a fault without effect.

    Examples
    --------
    >>> drive = insnav.simulate("city", imu="automotive", seed=1)  # doctest: +SKIP
    >>> drive.navigate().plot("position_error")  # doctest: +SKIP
    """
    options: SimulationOptions = {"imu": imu, "gps": gps, "seed": seed, "run": run, "rate": rate, "sampling": sampling}
    options |= {"faults": faults, "temperature": temperature, "gravity": gravity}
    plan = plan_of(profiled(profile, seed), options)
    measured = plan.measured()
    inputs: Inputs = {"imu_model": plan.imu, "lever_arm": measured.lever_b}
    recording = steps.Recording(
        in_memory(measured.imu, "IMU", f"simulated {plan.motion.name}"),
        in_memory(measured.gps, "GPS", f"simulated {plan.motion.name}"),
        in_memory(measured.reference, "reference", "exact motion"),
        {},
        inputs,
    )
    return drive_of(recording)


def plan_of(motion: Motion, options: SimulationOptions, configuration: Mapping[str, Any] | None = None) -> Plan:
    """Complete the input of a simulation: look up sensor models and faults; see `SimulationOptions`."""
    imu, gps = options.get("imu", "consumer"), options.get("gps", "single")
    seed, run = options.get("seed", 1), options.get("run")
    dataclass_truth: Any = motion.truth  # typed as Any: each truth is a dataclass, but its base class is not
    truth: Truth = replace(dataclass_truth, gravity=options.get("gravity", "full"))
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
    """Load the motion of a profile, by name or file."""
    profile = load_profile(name)
    return Motion(profile.name, profile.purpose, profile.truth((seed, MOTION_STREAM)), profile.text)


def replica(source: Path) -> Motion:
    """Build the motion of a recorded track: the smoothed or filtered solution of a run folder, or a file.

    Raises: InputError: the folder has no solution, or the track cannot be used.
    """
    track = source
    if source.is_dir():
        names = [f"{stem}.{kind}" for stem in ("smoothed", "solution") for kind in ("csv", "parquet")]
        solution_file = next((source / name for name in names if (source / name).is_file()), None)
        if solution_file is None:
            raise InputError("session.no_solution", where=str(source), names=tuple(names))
        track = solution_file
    reading = read_reference(track)
    truth = truth_from_track(reading.data)
    name = f"replica of {source.name or source.resolve().name}"
    return Motion(name, "", truth, track=reading, residual=track_residual(truth, reading.data))
