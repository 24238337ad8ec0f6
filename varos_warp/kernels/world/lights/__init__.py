"""Lights: what they send where. Other kernels ask light.py and choice.py, which know the kinds."""
