"""The command line `parallel_robot`, its commands, and `top`."""
