"""Laws made ready: found by name or file, tried, compiled."""
