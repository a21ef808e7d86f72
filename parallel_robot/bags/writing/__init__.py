"""Bags written, recorded and recovered; the recorder node."""
