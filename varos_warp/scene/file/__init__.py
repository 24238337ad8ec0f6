"""Scene files and noise profiles: read, checked and written back, their schema, and where each key stands."""
