"""What happens over time: vehicle, control, guidance, sensors."""
