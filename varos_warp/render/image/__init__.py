"""Finished images from films: adaptive samples, denoising, exposure, encoding."""
