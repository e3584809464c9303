"""Initial attitude: from rest (levelling, gyrocompass), from GPS course, or in motion; each with its uncertainty."""

from insnav.alignment.align import align, align_static, rest_of
from insnav.alignment.static import Rest, find_rest

__all__ = ["Rest", "align", "align_static", "find_rest", "rest_of"]
