"""Kernels for meshes on the host: closest points, shrinkwrap, baking."""
