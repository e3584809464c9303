"""Noise of one IMU from several of its drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Unpack

from insnav.exceptions import InputError
from insnav.filter.innovation_likelihood import InnovationLikelihood
from insnav.filter.noise_estimate import NoiseEstimate, NoiseFigure
from insnav.filter.noise_search import FEWEST, identify, unlike
from insnav.findings import Code, Finding
from insnav.session.drive import Drive, load
from insnav.steps.given import better_kinds
from insnav.steps.inputs import Inputs


def tune(
    recordings: Sequence[tuple[Path, Path | None]], **inputs: Unpack[Inputs]
) -> tuple[NoiseEstimate, tuple[Drive, ...], tuple[Finding, ...]]:
    """Find the noise of one IMU in several of its drives, by the likelihood of all their innovations together.

    Returns: noise, the drives, and a warning for each figure by which drives are of different IMUs.

    `recordings`: IMU and GPS file of each drive, or a log of both and None; `inputs`: as for `insnav.load`, the same
    for all drives; ``imu_model`` is the prior, that of the first drive by default.
    Raises: InputError: files are missing, or a drive is too short.
    """
    drives: list[Drive] = []
    likelihoods: list[InnovationLikelihood] = []
    for imu, gps in recordings:
        given: Inputs = {**inputs, "noise": "estimate"}
        if drives:
            given["imu_model"] = drives[0].imu_spec
        drive = load(imu, gps, **given)
        if drive.fixes is None:
            raise InputError("no fixes were found for the samples", where=str(imu), fix="put them beside it, alone")
        ready = drive.until("align").ready
        one = InnovationLikelihood(ready, drive.imu_spec)
        if one.fixes < FEWEST:
            raise InputError(
                "the drive is too short to tell noise", where=str(imu), why=f"{one.fixes} fixes; {FEWEST} are needed"
            )
        drives.append(drive)
        likelihoods.append(one)
    if len({tuple(each.key for each in one.parameters) for one in likelihoods}) > 1:
        raise InputError("some drives have GPS velocities and some have none", fix="tune them apart")
    found = identify(likelihoods, better_kinds(inputs, drives[0].imu_spec))
    name = f"{drives[0].imu_spec.name}, from {len(drives)} drives" if len(drives) > 1 else found.spec.name
    different = unlike(likelihoods, found) if len(drives) > 1 else []
    files = [str(Path(*imu.parts[-2:])) for imu, _ in recordings]
    warnings = tuple(_different_drives(figures, files) for figures in different)
    return replace(found, spec=replace(found.spec, name=name)), tuple(drives), warnings


def _different_drives(figures: Sequence[NoiseFigure], files: Sequence[str]) -> Finding:
    """Report a figure of one IMU that differs from drive to drive; `files`: of the drives."""
    low, high = (end(range(len(figures)), key=lambda drive: figures[drive].value) for end in (min, max))
    ratio = figures[high].value / figures[low].value
    return Finding.of(Code.TUNE_DRIVES_DIFFER, subject=figures[low].key, ratio=ratio, high=files[high], low=files[low])
