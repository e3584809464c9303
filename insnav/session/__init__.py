"""Processing of a drive from its files to its results, identical for command line and notebook."""
