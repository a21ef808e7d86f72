"""Control laws, the control cycle around them, and the controller node."""
