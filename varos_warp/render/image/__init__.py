"""From films to finished images: adaptive samples, denoising, exposure, encoding."""
