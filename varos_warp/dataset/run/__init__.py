"""The main job: a scene becomes a dataset, on one device or several."""
