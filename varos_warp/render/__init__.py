"""Images from a pose: planning, rendering, denoising, exposure, encoding."""
