"""A robot from its description: a machine that a file tells, with the attributes of a robot."""
