"""The subcommands of parallel_robot, one module each."""
