"""Initial attitude with its uncertainty: stationary (levelling, gyrocompass), from GPS course, or in motion."""

from insnav.alignment.align import align, align_static, stationary_of
from insnav.alignment.mounting import Mounting, find_mounting
from insnav.alignment.static import StationaryMeans, find_stationary

__all__ = ["Mounting", "StationaryMeans", "align", "align_static", "find_mounting", "find_stationary", "stationary_of"]
