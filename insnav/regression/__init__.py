"""Is this version better or worse than the last, and where: a corpus of drives, figures of merit, and fair tests.

corpus.toml -> cases -> measure -> Accuracy -> compare with baseline.json -> better, same, worse
                                          -> a line of history.jsonl    -> plots over versions
"""
