"""Lights: what they send where. Other kernels know them by light.py and choice.py only, which know the kinds."""
