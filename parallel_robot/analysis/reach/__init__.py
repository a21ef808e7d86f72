"""Where the tool of a robot can reach in a plane of its pose, with its margins."""
