"""Reports of results: quantities, figures, HTML and PDF pages, terminal text, and comparisons of runs."""
