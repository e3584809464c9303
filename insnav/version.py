"""The release of insnav; it stands here alone, so that no module needs the whole package to name it."""

__version__ = "0.2.0"
