"""What all nodes share: parameters, topics, life cycle, diagnostics."""
