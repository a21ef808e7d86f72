"""What the controller takes for the motion of the joints, and how old it is."""
