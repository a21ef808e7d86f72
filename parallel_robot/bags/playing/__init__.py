"""Bags played; the player node."""
