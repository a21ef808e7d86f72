"""What the suite says to the outside: errors, configuration files, topics and bytes."""
