"""What identification and calibration share: estimates, and robots by them, in files."""
