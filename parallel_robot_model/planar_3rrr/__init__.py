"""The 3-RRR planar parallel robot: parameters, kinematics, singularities, dynamics."""
