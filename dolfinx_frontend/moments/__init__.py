"""Means, deviations and quantiles from solved points."""
