"""Dissimilar scenes, and an integrator's bias, noise and error bars in them."""
