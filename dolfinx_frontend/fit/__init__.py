"""Measured data: calibration, and which inputs matter."""
