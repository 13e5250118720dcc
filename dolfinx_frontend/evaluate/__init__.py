"""An assembly at many points of what varies: sweeps, samples, functions."""
