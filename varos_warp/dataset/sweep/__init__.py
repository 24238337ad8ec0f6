"""One course in many versions: what changes is made for each version, all else once."""
