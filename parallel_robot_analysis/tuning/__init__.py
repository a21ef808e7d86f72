"""Tuning: gains of a law by their tracking error and their chattering, under uncertainty."""
