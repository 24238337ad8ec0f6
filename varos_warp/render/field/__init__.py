"""The host of kernels/field: solves for the radiance of open water around lamps, and keeps it on disk."""
