"""Decks of other programs, and of this one, as scenes: a leaf on the public scene."""
