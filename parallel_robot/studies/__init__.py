"""Studies: sweeps over uncertain robots, tuning, limits of any controller, identification."""
