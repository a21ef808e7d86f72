"""Topics, and the bytes of their messages."""
