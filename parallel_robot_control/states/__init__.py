"""Joint states that arrive: how often, which are refused, and what is said of it."""
