"""Turns kernels into machine code: their types, the compiler, the store on disk, and calls from Python.

A kernel has one signature: its annotations. Each kernel is compiled by itself. It calls other kernels by
their symbols, allocates nothing and needs no interpreter, so stored code runs without numba. Only `compiler`
and `numba_types` import numba, and they are imported only when something has to be compiled.
"""
