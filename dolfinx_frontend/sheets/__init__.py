"""The answer sheet of an engineer: bolts, joints and gaskets of any answer, as HTML and CSV."""
