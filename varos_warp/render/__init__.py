"""From a pose to images: planning, rendering, denoising, exposure, encoding."""
