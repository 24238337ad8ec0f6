"""What the sensors read, and their noise."""
