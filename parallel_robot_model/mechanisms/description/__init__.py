"""Any machine from its description: MJCF, URDF and SDF read into a mechanism."""
