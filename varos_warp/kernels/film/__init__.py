"""Films, which turn samples into pixels: sums, adaptive sampling, input for a denoiser."""
