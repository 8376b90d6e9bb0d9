"""Calibration of the cameras from pictures of a known target."""
