"""What surfaces are made of: records for the device, images, the lobe of metals."""
