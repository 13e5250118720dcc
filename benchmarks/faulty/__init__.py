"""Pieces of ``faults.py`` and ``fuzz.py``."""
