"""Bench data from files or arrays to results, the same for the command line and a notebook."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from insnav.earth import gravity_n
from insnav.exceptions import ConfigError
from insnav.imu import load_calibration
from insnav.lab.acceptance.acceptance import Acceptance
from insnav.lab.acceptance.acceptance import acceptance as acceptance_figures
from insnav.lab.bench_data.bench_tables import BenchTable
from insnav.lab.bench_data.records import BenchRecord, read_drift, read_powerups, read_static, read_steps
from insnav.lab.calibration import BenchOptions, Calibration, carried_over, method_named
from insnav.lab.drift.allan_before_after import DriftStudy, drift_study
from insnav.lab.navigation_impact import navigation_impact


def calibrate(
    method: str,
    files: str | Path | Sequence[str | Path],
    *,
    add: str | Path | None = None,
    stage: Callable[[str], None] | None = None,
    opened: Callable[[Any], None] | None = None,
    **options: Any,
) -> Calibration[Any, Any]:
    """Calibrate sensors from files of the bench.

    Parameters
    ----------
    method : {"gyro", "accel", "imu", "nine", "poses", "rotor"}
        Rate table; tumble test; rate sweeps about three axes; nine positions; multi-position without a table; moment
        of inertia of a rotor.
    files : str, Path or sequence of these
        See the command of this name, such as ``insnav calibrate gyro --help``.
    add : str or Path, optional
        A calibration file whose other triad is carried over.
    stage : callable, optional
        Called with the name of each stage of the work.
    opened : callable, optional
        Called with the record once it is read.
    **options
        See `insnav.lab.calibration.BenchOptions`.

    Returns
    -------
    Calibration
        With its impact on navigation.

    Raises
    ------
    ConfigError
        No such method, or an option that cannot be.
    InputError
        A file that cannot be used, or does not determine what is to be found.
    """
    started = stage or (lambda name: None)
    module = method_named(method)
    how = BenchOptions(**options)
    started("reading")
    record = module.read([files] if isinstance(files, str | Path) else list(files), how)
    if opened is not None:
        opened(record)
    started("fitting")
    found = module.fit(record, how)
    if found.errors is None:
        return found
    started("navigating")
    impact = navigation_impact(found.sensed or found.errors, found.sd)
    errors = found.errors
    if add is not None:
        errors = carried_over(errors, load_calibration(add), "gyro" if method == "accel" else "accel")
    return replace(found, errors=errors, impact=impact)


def acceptance(
    steps: Sequence[str | Path] = (),
    static: str | Path | None = None,
    powerups: Sequence[str | Path] = (),
    *,
    lengths: Sequence[float] = (1.0, 10.0, 100.0),
    columns: Mapping[str, str] | None = None,
    spike_limit: float | None = None,
) -> tuple[Acceptance, list[BenchRecord]]:
    """Work out acceptance figures from files of the bench.

    Parameters
    ----------
    steps : sequence of str or Path
        Rate tables of gyros and positions of accelerometers in gravity.
    static : str or Path, optional
        Record at rest.
    powerups : sequence of str or Path
        Outputs after each power-up.
    lengths : sequence of float
        Averaging times of the bias stability [s], increasing.
    columns, spike_limit
        As in `insnav.lab.calibration.BenchOptions`.

    Returns
    -------
    Acceptance
    list of BenchRecord
        The files, as read.

    Raises
    ------
    InputError
        A file cannot be used.
    """
    limit = BenchOptions(spike_limit=spike_limit).spike_limit
    measured = [read_steps(path, columns, limit) for path in steps]
    rest = None if static is None else read_static(static, columns)
    repeated = [read_powerups(path, columns) for path in powerups]
    found = acceptance_figures(measured, rest, repeated, lengths)
    return found, [*measured, *([] if rest is None else [rest]), *repeated]


def drift(file: str | Path, *, columns: Mapping[str, str] | None = None) -> tuple[DriftStudy, BenchTable]:
    """Study what the drift of gyros depends on, and what smoothing does to it; see `drift_study`.

    Parameters
    ----------
    file : str or Path
        See ``insnav drift --help``.
    columns : mapping of str to str, optional
        As in `insnav.lab.calibration.BenchOptions`.

    Returns
    -------
    DriftStudy
    BenchTable
        The file, as read.

    Raises
    ------
    InputError
        The file cannot be used.
    """
    record, table = read_drift(file, columns)
    return drift_study(record), table


def bench_gravity(gravity: float | None, lat: float | None, height: float = 0.0) -> tuple[float, str]:
    """Gravity at the bench and where it is from; never assumed.

    Parameters
    ----------
    gravity : float or None
        As measured [m/s^2].
    lat : float or None
        Latitude [deg], for normal gravity instead.
    height : float
        Above the ellipsoid [m].

    Returns
    -------
    gravity : float
        [m/s^2].
    source : str
        In words.

    Raises
    ------
    ConfigError
        Neither is given, or both, or no latitude.
    """
    if gravity is not None and lat is not None:
        raise ConfigError("gravity is given twice", where="--gravity, --lat", fix="leave one out")
    if gravity is not None:
        return gravity, "as given"
    if lat is None:
        raise ConfigError(
            "gravity is not known",
            why="it is the measure of the accelerometers, and varies by 0.5 % over the Earth",
            fix="give --lat (and --height), or --gravity",
        )
    if not -90.0 <= lat <= 90.0:
        raise ConfigError(f"{lat:g} is not a latitude", where="--lat", fix="give degrees, north positive")
    return float(np.linalg.norm(gravity_n(np.deg2rad(lat), height))), f"normal gravity at {lat:g} deg, {height:g} m"
