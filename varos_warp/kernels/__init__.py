"""Device code: Warp functions, structs and kernels; no host code."""
