"""Sweeps of every method until it fails: where the boundary is, what fails there, what the program does about it."""
