"""Bags, metrics, figures, the recorder node, and the command line that ties the suite together."""
