"""What a dataset is made of: one object in one file for each sensor."""
