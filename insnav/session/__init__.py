"""One drive from its files to its results, the same for the command line and a notebook."""
