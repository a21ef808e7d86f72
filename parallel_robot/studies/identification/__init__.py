"""Inertia and friction of a robot from its recorded motion."""
