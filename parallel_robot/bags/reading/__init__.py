"""Bags read whole, in windows, or from any moment on."""
