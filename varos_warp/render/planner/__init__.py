"""How many samples and which integrator a sequence needs, and what it will cost."""
