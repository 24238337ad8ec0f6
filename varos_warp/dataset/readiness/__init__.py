"""Readiness: what a SLAM system will meet in a dataset, and how well a small visual odometry does on it."""
