"""From the bytes of a file to a table, whatever the file is; what a file is, its first bytes tell."""
