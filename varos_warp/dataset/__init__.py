"""Files of datasets, made from frames and sensors: layout, writers, validation, reports."""
