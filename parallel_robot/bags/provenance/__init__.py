"""What a bag says of the experiment that made it."""
