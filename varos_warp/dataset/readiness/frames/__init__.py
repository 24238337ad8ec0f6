"""What is measured in the images, frame by frame, and in the IMU: features, light, excitation, places seen again."""
