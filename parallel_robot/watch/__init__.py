"""What `top` and the page know of a running graph."""
