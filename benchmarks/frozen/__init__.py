"""The frozen corpus: what a state of this project answers, kept so that a later state can be held against it."""
