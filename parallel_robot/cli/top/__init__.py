"""A running graph in a terminal: what is heard, what is shown, and how it is drawn."""
