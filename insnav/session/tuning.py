"""Noise of one IMU from several of its drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Unpack

from insnav.exceptions import InputError
from insnav.filter.noise_identification import FEWEST, InnovationLikelihood, NoiseEstimate, identify
from insnav.session.drive import Drive, load
from insnav.session.inputs import Inputs


def recording_in(folder: Path) -> tuple[Path, Path]:
    """IMU and GPS file of a folder that holds one drive: ``imu.*`` and ``gps.*``."""
    found = []
    for name in ("imu", "gps"):
        files = sorted(each for each in folder.glob(f"{name}.*") if each.suffix != ".toml")
        if len(files) != 1:
            names = ", ".join(each.name for each in files) or "none"
            raise InputError(
                f"a drive needs one {name} file", where=str(folder), why=f"found: {names}", fix=f"name it {name}.csv"
            )
        found.append(files[0])
    return found[0], found[1]


def tune(folders: Sequence[Path], **inputs: Unpack[Inputs]) -> tuple[NoiseEstimate, tuple[Drive, ...]]:
    """Find the noise of one IMU in several of its drives, by the likelihood of all their innovations together.

    `folders`: each with the IMU and GPS file of one drive; `inputs`: as for `insnav.load`, the same for all drives;
    ``imu_model`` is the prior, that of the first drive by default.
    Raises: InputError: files are missing, or a drive is too short.
    """
    drives: list[Drive] = []
    likelihoods: list[InnovationLikelihood] = []
    for folder in folders:
        given: Inputs = {**inputs, "noise": "estimate"}
        if drives:
            given["imu_model"] = drives[0].imu_spec
        imu, gps = recording_in(folder)
        drive = load(imu, gps, **given)
        ready = drive.prepared()
        one = InnovationLikelihood(ready, drive.imu_spec)
        if one.fixes < FEWEST:
            raise InputError(
                "the drive is too short to tell noise", where=str(folder), why=f"{one.fixes} fixes; {FEWEST} are needed"
            )
        drives.append(drive)
        likelihoods.append(one)
    if len({tuple(each.key for each in one.parameters) for one in likelihoods}) > 1:
        raise InputError("some drives have GPS velocities and some have none", fix="tune them apart")
    found = identify(likelihoods)
    name = f"{drives[0].imu_spec.name}, from {len(drives)} drives" if len(drives) > 1 else found.spec.name
    return replace(found, spec=replace(found.spec, name=name)), tuple(drives)
