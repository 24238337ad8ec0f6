"""The host of kernels/field: solves for the radiance of open water around lights, and keeps it on disk."""
