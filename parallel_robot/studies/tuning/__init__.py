"""Tuning: gains of a law by their tracking error and their effort, under uncertainty."""
