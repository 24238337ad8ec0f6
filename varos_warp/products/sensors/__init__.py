"""The sensors of a vehicle: what each has to tell (protocol.py), one file for each, and their list (registry.py)."""
