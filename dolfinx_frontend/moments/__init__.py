"""Means, deviations and quantiles of a function of the germs, by its values at points."""
