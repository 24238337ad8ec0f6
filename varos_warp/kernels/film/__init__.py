"""Samples to pixels: sums, adaptive sampling, what a denoiser needs."""
