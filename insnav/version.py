"""Release of insnav, in a separate module to avoid importing the whole package."""

__version__ = "0.4.0.dev0"
