"""From samples to pixels: sums, adaptive sampling, input for a denoiser."""
