"""A pair of commits, measured in turns: scenes, the process that runs them, builds, and verdicts."""
