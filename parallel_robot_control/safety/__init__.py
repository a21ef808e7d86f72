"""Faults, limits, and the checks that find out that something is wrong."""
