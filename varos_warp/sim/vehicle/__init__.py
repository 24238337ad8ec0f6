"""The vehicle: its body, thrusters, the current, and the controller."""
