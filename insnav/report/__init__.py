"""Reports of results: facts, figures, pages, one screen of text, and comparisons of runs."""
