"""Lights: how their intensity is distributed, by a cone or a file, in air or behind a port, and what kernels know."""
