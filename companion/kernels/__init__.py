"""Kernels take numbers and C-contiguous arrays in SI and radians, and return status codes.

The package `native` turns them into machine code.
"""

__all__: list[str] = []
