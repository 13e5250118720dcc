"""Probabilities of rare events of independent standard normal variables."""
