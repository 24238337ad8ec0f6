"""The precomputed radiance field of open water and its lookups."""
