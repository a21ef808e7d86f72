"""The simulated plant, the plant node, and the closed loop without ROS."""
