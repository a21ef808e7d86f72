"""Bags: written, read, recovered, recorded, played."""
