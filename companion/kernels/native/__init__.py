"""How kernels become machine code: their types, the compiler, what is kept on disk, and how Python calls it.

A kernel's annotations are its signature, and its only one. Each is compiled for itself, calls others by their
symbols, allocates nothing and needs no interpreter: object code that is kept is loaded without numba.
"""
