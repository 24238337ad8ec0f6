"""What bends a camera's rays: the lens's distortion, the port, and the water behind it. In float64, camera axes.

kernels/world/optics.py does the same in float32 for the images.
"""
