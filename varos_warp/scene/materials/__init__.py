"""Materials: records for the device, images, the lobe of metals."""
