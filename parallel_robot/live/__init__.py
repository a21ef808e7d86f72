"""The live page: a robot that moves, in a browser."""
