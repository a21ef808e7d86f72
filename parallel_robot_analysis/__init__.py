"""Metrics, claims, timing, reports, the monitor, and the command line of the suite."""
