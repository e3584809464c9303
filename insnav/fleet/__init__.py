"""Many drives with one command: found, navigated on any engine, resumed, and compared on one page."""
