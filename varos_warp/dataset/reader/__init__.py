"""A dataset on disk, read back: frames, poses, sensors, points, PyTorch."""
