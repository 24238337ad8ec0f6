"""Phase functions: where scattered light goes. One file each; registry.py lists them."""
