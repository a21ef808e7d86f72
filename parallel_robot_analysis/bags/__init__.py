"""Bags: MCAP records, writing, reading, and what a run is made of again."""
