"""Robots: parameters, kinematics, singularities, dynamics."""
