"""A small visual odometry, mono and stereo, its score, and the signs by which its failure is forecast."""
