"""Light transport: paths, next-event estimation, random numbers, first hits, ambient light."""
