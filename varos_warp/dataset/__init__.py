"""From frames and sensors to files: layout, writers, validation, reports."""
