"""How kernels run: on which device, compiled when, launched how."""
