"""Base of all packages: errors, configuration, message bytes, compiler; no ROS, no law."""
