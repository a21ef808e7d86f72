"""Studies: many runs of laws and scenarios under sampled uncertainty, and what follows of them."""
