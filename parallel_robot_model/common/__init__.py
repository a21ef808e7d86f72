"""Errors, units, arrays, texts that all others use."""
