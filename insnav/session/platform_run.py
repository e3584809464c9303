"""North-pointing platform: integration of recorded specific force by each of the integrators."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import numpy as np

from insnav.errors import platform_errors
from insnav.errors.platform_errors import ERRORS, Demonstration, PlatformStudy
from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, Finding
from insnav.gimbal import DAMPING_TIME, INTEGRATORS, Integrator, PlatformErrors, Vertical, navigate_platform
from insnav.input import Reading, ReadingFacts
from insnav.input.readers.specific_force import Heights, LevelAxes, SpecificForce, read_heights, read_specific_force
from insnav.result import Result
from insnav.session.read import one_from_stdin, read_ref, samples_source
from insnav.steps.given import one_of
from insnav.types import FloatArray, Trajectory
from insnav.units import DEG

if TYPE_CHECKING:
    from insnav.session.read import Given


class PlatformReading(TypedDict, total=False):
    """Further input files of `platform`, and how to read the specific force."""

    heights: Given | None  # heights that damp the vertical channel
    ref: Given | None  # reference trajectory
    # see `insnav.input.readers.specific_force.read_specific_force`
    axes: LevelAxes | None
    columns: Mapping[str, str] | None
    sample_rate: float | None
    opened: Callable[[ReadingFacts], None]  # called with the facts of each file once it is read


def platform(
    force: Given,
    lat: float,
    lon: float,
    height: float = 0.0,
    v_n: Sequence[float] = (0.0, 0.0, 0.0),
    *,
    errors: Mapping[str, FloatArray] | None = None,
    integrator: Integrator = "fourth",
    vertical: Vertical = "off",
    gravity: float | None = None,
    interval: float = 0.1,
    **reading: Unpack[PlatformReading],
) -> Result[PlatformStudy]:
    """Integrate the specific force on a north-pointing platform with every integrator.

    Parameters
    ----------
    force : path or data frame
        Specific force along level axes; for its columns see ``insnav platform --help``.
    lat, lon, height : float
        Position at the start [rad], [rad], [m].
    v_n : sequence of float
        Velocity North, East, Down at the start [m/s].
    errors : mapping, optional
        Errors of the platform and its sensors: ``tilt``, ``drift``, ``bias``, each North, East, Down; by default none.
    integrator : {"forward", "backward", "mean", "fourth"}
        Integrator of the returned solution; all are compared.
    vertical : {"off", "free", "damped"}
        Vertical channel; ``damped`` needs `heights`.
    gravity : float, optional
        Constant gravity, straight down [m/s^2]; by default normal gravity.
    interval : float
        Time between rows of the solutions [s].
    **reading
        Further files, and how to read them; see `PlatformReading`.

    Returns
    -------
    Result of PlatformStudy

    Raises
    ------
    ConfigError
        Invalid option, or a start too near a pole.
    InputError
        The file cannot be used, has no vertical axis, or the heights do not cover it.
    DivergenceError
        The solution came too near a pole, or the free vertical channel diverged.

    Examples
    --------
    >>> insnav.platform("force.csv", np.radians(48.0), np.radians(11.0)).plot("track")  # doctest: +SKIP
    """
    _refuse_start(lat, lon, height, v_n)
    one_of("integrator", integrator, INTEGRATORS)
    samples, heights, reference = _read(force, reading)
    if gravity is not None and not 9.5 < gravity < 10.0:  # refuses NaN, too
        raise ConfigError("platform.bad_gravity", where="--gravity", value=gravity)
    time, f_n = samples.data.time, samples.data.f_n
    if vertical != "off" and np.isnan(f_n[:, 2]).all():
        raise InputError("platform.no_vertical_axis", where=samples.facts.path, option=vertical)
    sensor_errors = PlatformErrors(**errors or {})
    start = np.array([lat, (lon + np.pi) % (2.0 * np.pi) - np.pi, height])
    inputs: dict[str, Any] = {"vertical": vertical, "gravity": gravity, "errors": sensor_errors}
    inputs |= {"height": None if heights is None else _heights(heights.data, time)}
    inputs |= {"every": max(1, round(interval / float(np.median(np.diff(time)))))}
    runs = {name: navigate_platform(time, f_n, start, np.array(v_n), integrator=name, **inputs) for name in INTEGRATORS}
    study = PlatformStudy(integrator, runs, sensor_errors, None if reference is None else reference.data)
    readings = {"force": samples, "height": heights, "ref": reference}
    facts = {name: each.facts for name, each in readings.items() if each is not None}
    options = {"lat": lat, "lon": lon, "height": height, "v_n": v_n, "integrator": integrator, "vertical": vertical}
    options |= {"gravity": gravity, "interval": interval, **asdict(sensor_errors)}
    findings = (*_assumptions(study), *samples.facts.evidence, *samples.events)
    return Result("platform", study, facts, options, findings=findings)


def demonstrate() -> Result[Demonstration]:
    """Compare the integrators on a known flight, and a platform with a strapdown navigator that has equal errors."""
    sizes = {"heading_rad": ERRORS.tilt[2], "drift_rad_s": ERRORS.drift[0], "bias_m_s2": ERRORS.bias[0]}
    errors = Finding.of(Code.PLATFORM_DEMO_ERRORS, **sizes)
    findings = errors, Finding.of(Code.PLATFORM_DEMO_FOURTH), Finding.of(Code.PLATFORM_FIRST_ORDER)
    return Result("platform", platform_errors.demonstrate(), options={"demo": True}, findings=findings)


def _refuse_start(lat: float, lon: float, height: float, v_n: Sequence[float]) -> None:
    limits = (
        ("--lat", lat / DEG, -90.0, 90.0, "deg, north positive"),
        ("--lon", lon / DEG, -180.0, 360.0, "deg, east positive"),
        ("--height", height, -1e5, 1e5, "m"),
        *((name, each, -1e4, 1e4, "m/s") for name, each in zip(("--v-north", "--v-east", "--v-up"), v_n, strict=True)),
    )
    for option, value, low, high, unit in limits:
        if not low <= value <= high:  # refuses NaN, too
            raise ConfigError("platform.out_of_range", where=option, value=value, low=low, high=high, unit=unit)


def _read(
    force: Given, how: PlatformReading
) -> tuple[Reading[SpecificForce], Reading[Heights] | None, Reading[Trajectory] | None]:
    """Read specific force along level axes, heights, and a reference, small files first, to report errors early."""
    heights, ref, sample_rate, opened = how.get("heights"), how.get("ref"), how.get("sample_rate"), how.get("opened")
    if sample_rate is not None and not 0.1 <= sample_rate <= 1e5:
        raise ConfigError("platform.bad_rate", where="--sample-rate", value=sample_rate)
    one_from_stdin({"FORCE_FILE": force, "--height-input": heights, "--ref": ref})
    height = None if heights is None else read_heights(samples_source(heights, None))
    reference = None if ref is None else read_ref(ref, {})
    options: Any = {"axes": how.get("axes"), "columns": how.get("columns")}
    samples = read_specific_force(samples_source(force, None), sample_rate=sample_rate, **options)
    for each in (samples, height, reference):
        if each is not None and opened is not None:
            opened(each.facts)
    return samples, height, reference


def _assumptions(study: PlatformStudy) -> Iterator[Finding]:
    yield Finding.of(Code.PLATFORM_INTEGRATORS)
    yield Finding.of(Code.PLATFORM_STEPS)
    if study.run.vertical == "damped":
        yield Finding.of(Code.PLATFORM_VERTICAL_DAMPED, time_s=DAMPING_TIME)
    else:
        yield Finding.of(Code.PLATFORM_VERTICAL_OFF if study.run.vertical == "off" else Code.PLATFORM_VERTICAL_FREE)
    if study.errors.any:
        yield Finding.of(Code.PLATFORM_LEVEL_SAMPLES)


def _heights(given: Heights, time: FloatArray) -> FloatArray:
    """Interpolate the height at the times of the samples."""
    if not (given.time[0] <= time[0] and time[-1] <= given.time[-1]):
        heights, samples = (tuple(each[[0, -1]].tolist()) for each in (given.time, time))
        raise InputError("platform.heights_do_not_cover", where="--height-input", heights_s=heights, samples_s=samples)
    return np.interp(time, given.time, given.height)
