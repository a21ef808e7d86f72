"""What every floor stands on: errors, configuration, message bytes, compiler; no ROS, no law."""
