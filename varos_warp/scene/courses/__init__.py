"""Recorded courses: tables of poses from elsewhere, read exactly as their formats say."""
