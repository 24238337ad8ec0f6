"""Particles in the water that are drawn one by one: marine snow."""
