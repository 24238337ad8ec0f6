"""Particles on the host: which cells a frame needs, and their splats from cells to an image."""
