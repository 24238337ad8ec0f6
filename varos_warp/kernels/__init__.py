"""Device code: Warp functions, structs and kernels; nothing of the host."""
