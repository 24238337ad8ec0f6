"""What a dataset consists of, written: texts, images, exposure, checksums; and whose folder it is."""
