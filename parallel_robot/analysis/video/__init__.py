"""The moving robot of a bag, or of several side by side, as a video."""
