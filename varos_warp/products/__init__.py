"""What a dataset is made of: an object each in a file of its own, behind a protocol."""
