"""Real IMUs by name, identical for command line and notebook."""

from __future__ import annotations

from insnav.exceptions import ConfigError
from insnav.imu.library import Part, close_names, find_part, parts
from insnav.result import Result


def imus(name: str | None = None) -> Result[tuple[Part, ...]]:
    """List real IMUs, or show one IMU with the documents of its figures.

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
