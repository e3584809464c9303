"""Accuracy regression between versions: a corpus of drives, figures of merit, and statistical tests.

corpus.toml -> cases -> measure -> Accuracy -> compare with baseline.json -> better, same, worse
                                          -> a line of history.jsonl    -> plots over versions
"""
