"""Faults injected into a running loop, and what becomes of it."""
