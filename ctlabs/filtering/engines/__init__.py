"""The compiled loops over one record: the filter forward, and what later data say backward.

A matrix that is constant is a stack of one; time is the first axis. The functions are plain Python and run without
numba as well; importing them costs numba's 0.3 s.
"""
