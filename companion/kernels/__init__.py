"""Numba kernels: floats and C-contiguous float64 arrays in SI and radians, status codes out."""
