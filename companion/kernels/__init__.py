"""Kernels: floats and C-contiguous arrays in SI and radians, status codes out; machine code by :mod:`.native`."""

__all__: list[str] = []
