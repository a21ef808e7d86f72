"""The command line without ROS, as functions that ``import parallel_robot`` offers."""
