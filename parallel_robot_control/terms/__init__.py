"""Terms that laws are made of."""
