"""Processing of bench data from files or arrays to results, identical for command line and notebook."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, Unpack, cast, overload

import numpy as np

from insnav.earth import gravity_n
from insnav.exceptions import ConfigError
from insnav.findings import Finding
from insnav.imu import load_calibration
from insnav.imu.library import Part, close_names, find_part, parts
from insnav.input import Reading
from insnav.input.formats.registry import open_table
from insnav.input.formats.table import Table
from insnav.input.interpret.clean import IMU_KINDS
from insnav.input.interpret.columns import require, understand
from insnav.input.interpret.schema import IMU_SCHEMA, Quantity
from insnav.input.readers.imu import SLOWEST_ALONE
from insnav.input.readers.rows import read_rows
from insnav.lab import calibration
from insnav.lab.acceptance import Acceptance
from insnav.lab.acceptance import acceptance as acceptance_figures
from insnav.lab.bench_data import read_drift, read_powerups, read_static, read_steps
from insnav.lab.drift import DriftStudy, drift_study
from insnav.lab.noise.allan import between
from insnav.lab.noise.static_noise import SignalNoise, StaticNoise, signal_noise, static_noise
from insnav.result import Result
from insnav.session.read import is_frame, read_samples, samples_source
from insnav.steps.given import checked
from insnav.steps.inputs import Inputs, SampleInputs
from insnav.types import FloatArray, ImuData

if TYPE_CHECKING:
    from insnav.session.read import Given

Taus: TypeAlias = Sequence[float] | Literal["log", "octave"]
_COUNTS = ("accel_x", "accel_y", "accel_z")


def calibrate(
    method: str,
    files: Given | ImuData | Sequence[Given],
    *,
    rate: float | None = None,
    add: str | Path | None = None,
    stage: Callable[[str], None] | None = None,
    opened: Callable[[Any], None] | None = None,
    **options: Unpack[calibration.BenchInputs],
) -> Result[calibration.Calibration[Any, Any]]:
    """Calibrate sensors from files of the bench.

    Parameters
    ----------
    method : {"gyro", "accel", "imu", "nine", "poses", "rotor"}
        Rate table, tumble test, rate sweeps about three axes, nine positions, multi-position without a table, and
        moment of inertia of a rotor.
    files : path, data frame or sequence of these; for ``poses`` also arrays or ImuData
        For the columns see the help of the command, such as ``insnav calibrate gyro --help``. Arrays are
        ``(time, gyro, accel)``, or ``(gyro, accel)`` with `rate`.
    rate : float, optional
        Sampling rate of arrays without times [Hz].
    add : str or Path, optional
        A calibration file from which the triad that is not calibrated here is copied.
    stage : callable, optional
        Called with the name of each stage of the work.
    opened : callable, optional
        Called with the record once it is read.
    **options
        See `insnav.lab.calibration.BenchOptions`.

    Returns
    -------
    Result of Calibration
        ``found.errors`` is the content of the calibration file, ``found.impact`` the impact on navigation.

    Raises
    ------
    ConfigError
        Unknown method, or an invalid option.
    InputError
        A file cannot be used, or does not determine the result.
    """
    report_stage = stage or (lambda name: None)
    module = calibration.method_named(method)
    settings = calibration.BenchOptions(**options)
    report_stage("reading")
    if isinstance(files, ImuData):
        record = read_samples(files, Inputs())
    else:
        sources = _sources(files, rate, settings.counts)
        if method in ("nine", "poses") and len(sources) > 1:
            raise ConfigError("lab.one_file", method=method, count=len(sources))
        record = module.read(sources, settings)
    if opened is not None:
        opened(record)
    report_stage("fitting")
    found = module.fit(record, settings)
    if found.errors is not None:
        report_stage("navigating")
        impact = calibration.navigation_impact(found.sensed or found.errors, found.sd)
        added = None if add is None else load_calibration(add)
        copied_triad = "gyro" if method == "accel" else "accel"
        errors = found.errors if added is None else calibration.carried_over(found.errors, added, copied_triad)
        found = replace(found, errors=errors, impact=impact)
    chosen = {name: value for name, value in asdict(settings).items() if value != getattr(calibration.STANDARD, name)}
    return Result("calibration", found, options={"method": method, "add": add, **chosen}, findings=found.warnings)


def _sources(files: Any, rate: float | None, counts: bool) -> list[str | Path | Table]:
    """Convert files, data frames or arrays to the sources that the bench readers accept."""
    if isinstance(files, str | Path) or is_frame(files):
        return [samples_source(files, rate)]
    if all(isinstance(each, str | Path) or is_frame(each) for each in files):
        return [samples_source(each, rate) for each in files]
    table = samples_source(files, rate)
    if counts and isinstance(table, Table):  # raw counts have headers without unit
        table = replace(table, headers=("time_s", *(name[:6] for name in table.headers[1:4]), *_COUNTS))
    return [table]


@overload
def allan(imu: FloatArray, *, rate: float, taus: Taus = ..., workers: int | None = ...) -> Result[SignalNoise]: ...


@overload
def allan(
    imu: Given | ImuData | Reading[ImuData],
    *,
    rate: float | None = ...,
    column: str | None = ...,
    taus: Taus = ...,
    static: tuple[float, float] | None = ...,
    workers: int | None = ...,
    progress: Callable[[float], None] = ...,
    **inputs: Unpack[SampleInputs],
) -> Result[StaticNoise] | Result[SignalNoise]: ...


def allan(
    imu: Any,
    *,
    rate: float | None = None,
    column: str | None = None,
    taus: Taus = "log",
    static: tuple[float, float] | None = None,
    workers: int | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
    **inputs: Unpack[SampleInputs],
) -> Result[StaticNoise] | Result[SignalNoise]:
    """Compute Allan deviation and noise coefficients of a stationary IMU, or of signals in an array or file column.

    Parameters
    ----------
    imu : array, path, data frame, arrays or ImuData
        One array, ``(n,)`` or ``(n, c)``, holds signals at `rate`. Any other input is an IMU, as for `insnav.load`.
    rate : float, optional
        Sampling rate of arrays and files without times [Hz].
    column : str, optional
        Header of a single column of a file to analyse, in the unit of the column.
    taus : {"log", "octave"} or sequence of float
        Averaging times [s]: about 90 evenly spaced on a logarithmic axis, or powers of two, or the given ones.
    static : (float, float), optional
        Part of the record of an IMU to use, begin and end [s]; by default the whole record.
    workers : int, optional
        Threads; by default as many as there are processors.
    progress : callable, optional
        Called with the fraction of the work that is done.
    **inputs
        Inputs that describe the file of an IMU; see `insnav.steps.inputs.SampleInputs`.

    Returns
    -------
    Result of StaticNoise, or of SignalNoise
        For an IMU, ``found.spec`` is its specification for filters and simulations. For signals, in their unit.

    Raises
    ------
    ConfigError
        Averaging times too long or too short for the record, or an array without a rate.
    InputError
        The record is too short, or not stationary.

    Examples
    --------
    >>> noise = allan(np.random.default_rng(1).normal(size=10_000), rate=100.0).found
    >>> round(noise.models[0].coefficients["N"].value, 1)
    0.1
    """
    options = {"rate": rate, "column": column, "taus": taus, "static": static, **inputs}
    if column is not None:
        imu, rate = _signal(imu, column, rate)
    if isinstance(imu, np.ndarray):
        if rate is None or not rate > 0.0 or imu.ndim not in (1, 2) or len(imu) < 2:
            raise ConfigError("session.no_rate", where="rate")
        values = np.asarray(imu, dtype=np.float64).reshape(len(imu), -1)
        signals = signal_noise(values, 1.0 / rate, taus, workers=workers, progress=progress)
        return Result("allan", signals, options=options)
    if not isinstance(imu, Reading):
        given = cast("Inputs", inputs | ({} if rate is None else {"rate": rate}))
        imu = read_samples(imu, checked(given), "noise")
    samples: ImuData = imu.data if static is None else between(imu.data, *static)
    name = Path(imu.facts.path).name
    found = static_noise(
        samples,
        taus,
        name=f"IMU of {name}",
        source=f"Allan deviation of {name}, {samples.time[-1] - samples.time[0]:.0f} s at rest",
        workers=workers,
        progress=progress,
    )
    return Result("allan", found, {"imu": imu.facts}, options, findings=_each_once(found.warnings, found.notes))


def _signal(source: Given, column: str, rate: float | None) -> tuple[FloatArray, float]:
    """Read values ``(n,)`` of one column of a file, and their rate [Hz]."""
    table = open_table(samples_source(source, None))
    time_quantity = tuple(each for each in IMU_SCHEMA if each.key == "time") if rate is None else ()
    schema = (*time_quantity, Quantity("signal", "signal", "", "", ()))
    columns_found, _ = understand(table.headers, table.units, schema, columns={"signal": column}, where=table.name)
    require(columns_found, [each.key for each in schema], table, schema, hint="without_rate")
    if rate is not None:
        return table.cells.read([columns_found["signal"].index]).columns[columns_found["signal"].index], rate
    cleaned = read_rows(table, columns_found, ("time", "signal"), IMU_KINDS, slowest=SLOWEST_ALONE).clean()
    return cleaned.columns["signal"], 1.0 / cleaned.interval


def _each_once(*findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Join sequences of findings in order, without repetition."""
    return tuple(dict.fromkeys(each for sequence in findings for each in sequence))


def acceptance(
    steps: Sequence[Given] = (),
    static: Given | None = None,
    powerups: Sequence[Given] = (),
    *,
    lengths: Sequence[float] = (1.0, 10.0, 100.0),
    columns: Mapping[str, str] | None = None,
    spike_limit: float | None = None,
) -> Result[Acceptance]:
    """Compute scale factor, bias, bias stability and repeatability of sensors from bench records.

    Parameters
    ----------
    steps : sequence of path or data frame
        Rate tables of gyros, and positions of accelerometers in gravity.
    static : path or data frame, optional
        A record at rest.
    powerups : sequence of path or data frame
        Outputs at two opposite settings after each power-up, or the resulting biases.
    lengths : sequence of float
        Averaging times of the bias stability [s].
    columns : mapping of str to str, optional
        Header of each quantity, for headers that insnav does not recognise.
    spike_limit : float, optional
        Samples farther than this from a polynomial through their dwell are dropped; in the unit of the output.

    Returns
    -------
    Result of Acceptance
        For the columns of the files see ``insnav acceptance --help``.

    Raises
    ------
    ConfigError
        No file is given, two files of one kind have the same sensor, or volts have no scale factor.
    InputError
        A file cannot be used.

    Examples
    --------
    >>> insnav.acceptance(["rates.csv"], "static.csv").to_frame()  # doctest: +SKIP
    """
    if not (steps or static is not None or powerups):
        raise ConfigError("session.nothing_to_accept", where="insnav acceptance")
    limit = calibration.BenchOptions(spike_limit=spike_limit).spike_limit
    measured = [read_steps(samples_source(each, None), columns, limit) for each in steps]
    rest = None if static is None else read_static(samples_source(static, None), columns)
    repeated = [read_powerups(samples_source(each, None), columns) for each in powerups]
    found = acceptance_figures(measured, rest, repeated, sorted(set(lengths)))
    fits = {each.axis: each.scale.table.fit for each in found.sensors if each.scale is not None}
    options = {"lengths": lengths, "columns": columns, "spike_limit": spike_limit}
    findings = _each_once(found.warnings, calibration.badly_conditioned(fits), found.notes)
    return Result("acceptance", found, options=options, findings=findings)


def drift(file: Given, *, columns: Mapping[str, str] | None = None) -> Result[DriftStudy]:
    """Study the causes of gyro drift, and the effect of smoothing on it.

    Parameters
    ----------
    file : path, data frame or arrays
        Times, rates, and possible causes of drift; for its columns see ``insnav drift --help``.
    columns : mapping of str to str, optional
        Header of each quantity, for headers that insnav does not recognise.

    Returns
    -------
    Result of DriftStudy
        The drift, to correct other records, is ``found.errors``.

    Raises
    ------
    InputError
        The file cannot be used.

    Examples
    --------
    >>> insnav.drift("record.csv").plot("drift")  # doctest: +SKIP
    """
    record, table = read_drift(samples_source(file, None), columns)
    found = replace(drift_study(record), file=table.file)
    fits = {f"gyro {each.model.axis}": each.model.fit for each in found.gyros}
    findings = _each_once(found.warnings, calibration.badly_conditioned(fits), found.notes)
    return Result("drift", found, options={"columns": columns}, findings=findings)


def bench_gravity(gravity: float | None, lat: float | None, height: float = 0.0) -> tuple[float, str]:
    """Return gravity at the bench [m/s^2] and a text on its source; no value is assumed.

    `gravity`: measured value [m/s^2], or `lat`: latitude [deg] for normal gravity. `height`: above the ellipsoid [m].
    Raises: ConfigError: neither `gravity` nor `lat` is given, or both, or the latitude is invalid.
    """
    if gravity is not None and lat is not None:
        raise ConfigError("session.gravity_twice", where="--gravity, --lat")
    if gravity is not None:
        return gravity, "as given"
    if lat is None:
        raise ConfigError("session.no_gravity")
    if not -90.0 <= lat <= 90.0:
        raise ConfigError("session.bad_latitude", where="--lat", value=lat)
    return float(np.linalg.norm(gravity_n(np.deg2rad(lat), height))), f"normal gravity at {lat:g} deg, {height:g} m"


def imus(name: str | None = None) -> Result[tuple[Part, ...]]:
    """List real IMUs, or show one IMU with the source document of each figure.

    Parameters
    ----------
    name : str, optional
        A part, in any case and with or without hyphens; by default all.

    Returns
    -------
    Result of tuple of Part

    Raises
    ------
    ConfigError
        There is no such part.
    """
    part = None if name is None else find_part(name)
    if name is not None and part is None:
        raise ConfigError("imu.unknown_part", where="PART", name=name[:200], close=close_names(name))
    return Result("imus", parts() if part is None else (part,), options={"name": name})
