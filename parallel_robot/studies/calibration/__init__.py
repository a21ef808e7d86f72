"""Geometry and zero angles of a robot from measured poses."""
