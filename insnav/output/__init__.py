"""Output files: run folders, tables, tracks and data files, complete or absent."""
