"""How light is carried: paths, next event estimation, random numbers, first hits, ambient light."""
