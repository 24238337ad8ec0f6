"""Unlike scenes, and how right, how noisy and how honest an integrator is in them."""
