"""How strong the tests are: ``python -m tests.mutants`` changes the program at random places.

It prints the changes that no test notices. Tools for that are not used: mutmut 3 changes nothing outside
functions, and cosmic-ray runs the same command for every change, not the tests that reach it.
"""
