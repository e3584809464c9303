"""Noise of one IMU from several of its drives."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias, Unpack

from insnav.exceptions import ConfigError, InputError
from insnav.filter.innovation_likelihood import InnovationLikelihood
from insnav.filter.noise_estimate import NoiseEstimate, NoiseFigure
from insnav.filter.noise_identification import FEWEST, identify, unlike
from insnav.findings import Code, Finding
from insnav.fleet.batch import find_drives
from insnav.imu.specification import ImuSpec
from insnav.result import Result
from insnav.session.drive import Drive, load
from insnav.session.read import NamedInputs, by_name
from insnav.steps.given import better_kinds, options_of

Files: TypeAlias = tuple[Path, Path | None]  # IMU and GPS file of a drive; None for a log of both


@dataclass(frozen=True, slots=True)
class Tuned:
    """Noise of one IMU, from several of its drives."""

    spec: ImuSpec
    figures: tuple[NoiseFigure, ...]
    gain: float  # gain of log-likelihood over the prior
    # mean square of the normalised innovations before and with the estimate [-]
    mean_before: float
    mean_after: float
    drives: int  # number of drives
    prior: ImuSpec  # IMU specification of the first drive
    prior_chosen: Finding  # finding on the choice of the prior


def tune(*drives: str | Path | Files, gps: str | Path | None = None, **inputs: Unpack[NamedInputs]) -> Result[Tuned]:
    """Estimate the noise of one IMU from its drives, by the joint likelihood of all innovations.

    Parameters
    ----------
    *drives : path or (Path, Path or None)
        Folders of recordings, which may contain several drives. One IMU file. Or IMU and GPS file of each drive.
    gps : path, optional
        GPS fixes of the one IMU file; by default from this file.
    **inputs
        As for `insnav.load`, equal for all drives. ``imu`` is the prior, by default from the first drive.

    Returns
    -------
    Result of Tuned
        The IMU error specification is ``found.spec``. The result has a warning for each noise figure that
        differs from drive to drive.

    Raises
    ------
    ConfigError
        `gps` is given with several drives.
    InputError
        Files are missing, or a drive is too short.
    """
    if gps is not None and len(drives) > 1:
        raise ConfigError("tune.fixes_of_several_drives", where="--gps", count=len(drives))
    recordings = [files for each in drives for files in _files(each, None if gps is None else Path(gps))]
    noise, loaded, different = _of_recordings(recordings, inputs)
    facts = {f"{name} {i}": facts for i, drive in enumerate(loaded, 1) for name, facts in drive.recording.facts.items()}
    figures = noise.figures, noise.gain, noise.mean_before, noise.mean_after
    found = Tuned(noise.spec, *figures, len(loaded), loaded[0].imu_spec, loaded[0].imu_chosen)
    names = [str(each[0]) for each in recordings]
    return Result("tune", found, facts, options_of(by_name(inputs), drives=names), findings=different)


def _files(drive: str | Path | Files, gps: Path | None) -> Iterator[Files]:
    """Yield the files of the drives of a folder, or of one drive."""
    if isinstance(drive, tuple):
        yield drive
    elif Path(drive).is_file():
        yield Path(drive), gps
    else:
        yield from (each.files() for each in find_drives(Path(drive), None, 1)[0])


def _of_recordings(
    recordings: Sequence[Files], inputs: NamedInputs
) -> tuple[NoiseEstimate, list[Drive], tuple[Finding, ...]]:
    """Estimate the noise; return it with the drives, and a warning for each noise parameter that differs among them."""
    drives: list[Drive] = []
    likelihoods: list[InnovationLikelihood] = []
    for imu, gps in recordings:
        given: NamedInputs = {**inputs, "noise": "estimate"}
        if drives:
            given["imu"] = drives[0].imu_spec
        drive = load(imu, gps, **given)
        if drive.fixes is None:
            raise InputError("tune.no_fixes", where=str(imu))
        likelihood = InnovationLikelihood(drive.until("align").ready, drive.imu_spec)
        if likelihood.fixes < FEWEST:
            raise InputError("tune.short_drive", where=str(imu), count=likelihood.fixes, limit=FEWEST)
        drives.append(drive)
        likelihoods.append(likelihood)
    if len({tuple(each.key for each in likelihood.parameters) for likelihood in likelihoods}) > 1:
        raise InputError("tune.mixed_velocities")
    estimate = identify(likelihoods, better_kinds(inputs, drives[0].imu_spec))
    name = f"{drives[0].imu_spec.name}, from {len(drives)} drives" if len(drives) > 1 else estimate.spec.name
    different = unlike(likelihoods, estimate) if len(drives) > 1 else []
    files = [str(Path(*imu.parts[-2:])) for imu, _ in recordings]
    warnings = tuple(_different_drives(figures, files) for figures in different)
    return replace(estimate, spec=replace(estimate.spec, name=name)), drives, warnings


def _different_drives(figures: Sequence[NoiseFigure], files: Sequence[str]) -> Finding:
    """Report a noise parameter that differs among drives of one IMU. `files`: names of the drives' files."""
    low, high = (end(range(len(figures)), key=lambda drive: figures[drive].value) for end in (min, max))
    ratio = figures[high].value / figures[low].value
    return Finding.of(Code.TUNE_DRIVES_DIFFER, subject=figures[low].key, ratio=ratio, high=files[high], low=files[low])
