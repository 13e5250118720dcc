"""The frozen corpus: what a state of this project answers, for later ones to be held against."""
